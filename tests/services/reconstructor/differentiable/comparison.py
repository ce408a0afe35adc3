"""The rasterizer next to float64 autograd of the reference."""

import torch

from readygo.services.reconstructor.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.differentiable.reference import ReferenceRendered, rasterize_with_torch

RELATIVE = 1e-3


def draw_both(case, loss, **options) -> tuple[Rendered, ReferenceRendered, dict, dict]:
    slow = case.doubled()
    fast_image = rasterize(**case.parameters, **case.camera, **options)
    loss(fast_image).backward()
    if options.get("background") is not None:
        options["background"] = options["background"].double()
    slow_image = rasterize_with_torch(**slow.parameters, **slow.camera, **options)
    loss(slow_image).backward()
    return fast_image, slow_image, case.gradients(), slow.gradients()


def assert_close(fast: dict, slow: dict) -> None:
    for name, expected in slow.items():
        assert torch.isfinite(fast[name]).all(), name
        error = (fast[name] - expected).norm() / expected.norm()
        assert error <= RELATIVE, f"{name}: {error:.2e}"
