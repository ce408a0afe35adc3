import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from readygo.common.arrays import Float64Array
from readygo.common.gaussians import GaussianCloud
from tests.common.conftest import camera, make_cloud

__all__ = ["camera", "make_cloud"]
Tensor = torch.Tensor
NAMES = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh", "features")


@dataclass
class Case:
    """A cloud and a camera, with gradients wanted for everything."""

    parameters: dict[str, Tensor]
    T_world_camera: Tensor
    K_px: Float64Array
    height_px: int
    width_px: int

    @property
    def camera(self) -> dict[str, object]:
        return {
            "T_world_camera": self.T_world_camera,
            "K_px": self.K_px,
            "height_px": self.height_px,
            "width_px": self.width_px,
        }

    def doubled(self) -> "Case":
        """The same in float64, with gradients of its own."""
        parameters = {name: value.detach().double().requires_grad_() for name, value in self.parameters.items()}
        pose = self.T_world_camera.detach().double().requires_grad_()
        return Case(parameters, pose, self.K_px, self.height_px, self.width_px)

    def cloud(self) -> GaussianCloud:
        return GaussianCloud(
            **{name: value.detach().numpy() for name, value in self.parameters.items() if name != "features"}
        )

    def gradients(self) -> dict[str, Tensor]:
        named = {**self.parameters, "pose": self.T_world_camera}
        return {name: value.grad.double() for name, value in named.items()}


def make_case(
    count: int = 300, *, seed: int = 0, coefficients: int = 16, features: int = 0, scale_m: float = 0.05,
    opacity: tuple[float, float] = (0.0, 1.0), height_px: int = 36, width_px: int = 52, yaw: float = 0.2,
) -> Case:  # fmt: skip
    rng = np.random.default_rng(seed)
    sh = 0.25 * rng.normal(size=(count, coefficients, 3))
    sh[:, 0] = rng.uniform(-1.6, 1.6, size=(count, 3))
    arrays = {
        "means_m": rng.uniform((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0), size=(count, 3)),
        "quats_wxyz": rng.normal(size=(count, 4)),
        "scales_m": scale_m * np.exp(rng.normal(size=(count, 3))),
        "opacities": rng.uniform(*opacity, size=count),
        "sh": sh,
    }
    if features:
        arrays["features"] = rng.normal(size=(count, features))
    parameters = {name: torch.tensor(a.astype(np.float32), requires_grad=True) for name, a in arrays.items()}
    c, s = math.cos(yaw), math.sin(yaw)
    T = np.eye(4)
    T[:3, :3] = [[s, 0.1 * c, 0.995 * c], [-c, 0.1 * s, 0.995 * s], [0.0, -0.995, 0.1]]
    T[:3, :3] = np.linalg.qr(T[:3, :3])[0] * np.sign(np.diag(np.linalg.qr(T[:3, :3])[1]))
    T[:3, 3] = (-1.0, 0.3, 1.2)
    focal = 0.42 * width_px
    K = np.array([[focal, 0.0, 0.52 * width_px], [0.0, 1.1 * focal, 0.47 * height_px], [0.0, 0.0, 1.0]])
    return Case(parameters, torch.tensor(T, requires_grad=True), K, height_px, width_px)


@pytest.fixture(scope="session")
def case() -> Callable[..., Case]:
    return make_case


@pytest.fixture(autouse=True)
def _one_torch_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def some_loss(rendered: object) -> Tensor:
    """Depends on every image, with other weights for every pixel."""
    generator = torch.Generator().manual_seed(3)
    total = torch.zeros((), dtype=torch.float64)
    for name in ("rgb", "features", "alpha", "depth_m"):
        image = getattr(rendered, name)
        if image is not None:
            image = torch.where(torch.isfinite(image), image, 0.0).double()
            total = total + (image * torch.randn(image.shape, generator=generator, dtype=torch.float64)).sum()
    return total


@pytest.fixture(scope="session")
def loss() -> Callable[[object], Tensor]:
    return some_loss
