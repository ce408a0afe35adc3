"""Selective Adam against torch's own."""

import numpy as np
import torch

from readygo.services.reconstructor.training.adam import Adam
from readygo.services.reconstructor.training.parameters import PARAMETERS, Gaussians

WIDTHS = {"means_m": 3, "quats_wxyz": 4, "log_scales": 3, "logits": 1, "sh": 12}


def some_gaussians(count: int) -> Gaussians:
    rng = np.random.default_rng(0)
    return Gaussians.fresh({name: rng.normal(size=(count, width)) for name, width in WIDTHS.items()})


def test_seen_gaussians_move_as_torchs_adam_moves_them_and_others_stay() -> None:
    gaussians, rng, steps = some_gaussians(6), np.random.default_rng(1), 4
    rates = {name: np.full(width, 0.01, dtype=np.float32) for name, width in WIDTHS.items()}
    before = gaussians.select(np.arange(6))
    wanted = torch.tensor(before.values["sh"][2], dtype=torch.float64, requires_grad=True)
    peer = torch.optim.Adam([wanted], lr=0.01, eps=1e-15)
    adam, places = Adam(steps, 1), np.array([[-1, 0, 1, -1, -1, -1]], dtype=np.int32)
    for _ in range(steps):
        gradients = {name: rng.normal(size=(2, width)).astype(np.float32) for name, width in WIDTHS.items()}
        wanted.grad = torch.tensor(gradients["sh"][1], dtype=torch.float64)
        peer.step()
        adam.step(gaussians, [gradients], places, rates, slice(0, 3))
        adam.step(gaussians, [gradients], places, rates, slice(3, 6))
    np.testing.assert_allclose(gaussians.values["sh"][2], wanted.detach().numpy(), atol=1e-5)
    for name in PARAMETERS:
        np.testing.assert_array_equal(gaussians.values[name][[0, 3, 4, 5]], before.values[name][[0, 3, 4, 5]])
    np.testing.assert_array_equal(gaussians.updates, [0, steps, steps, 0, 0, 0])


def test_gradients_of_the_views_of_a_batch_add_up() -> None:
    one, two = some_gaussians(2), some_gaussians(2)
    rates = {name: np.full(width, 0.01, dtype=np.float32) for name, width in WIDTHS.items()}
    part = {name: np.full((1, width), 0.25, dtype=np.float32) for name, width in WIDTHS.items()}
    whole = {name: np.full((1, width), 0.5, dtype=np.float32) for name, width in WIDTHS.items()}
    empty = {name: np.zeros((1, width), dtype=np.float32) for name, width in WIDTHS.items()}
    Adam(1, 2).step(one, [part, part], np.array([[0, -1], [0, -1]], dtype=np.int32), rates, slice(0, 2))
    Adam(1, 2).step(two, [whole, empty], np.array([[0, -1], [-1, -1]], dtype=np.int32), rates, slice(0, 2))
    for name in PARAMETERS:
        np.testing.assert_array_equal(one.values[name], two.values[name])
