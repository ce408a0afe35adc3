"""Sides of a comparison, and what they lose, for a wall that two cameras look at."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.training.config import GeometryConfig
from readygo.services.reconstructor.training.neighbours import Side
from readygo.services.reconstructor.training.surfaces import between, normals_within, side_of

SIZE_PX = (24, 32)
K = np.array([[40.0, 0.0, 16.0], [0.0, 40.0, 12.0], [0.0, 0.0, 1.0]])
CONFIG = GeometryConfig(enabled=True, normal=2.0, consistent=3.0, ncc=5.0)


def photo() -> torch.Tensor:
    return torch.tensor(np.random.default_rng(0).random((3, *SIZE_PX)), dtype=torch.float32)


def side(x_m: float = 0.0, planes: tuple[float, ...] = (0.0, 0.0, -1.0, 2.0)) -> Side:
    """A wall 2 m before a camera that looks along z."""
    T = np.eye(4)
    T[0, 3] = x_m
    return side_of(torch.tensor(planes).expand(*SIZE_PX, 4), photo(), K, T)


def test_rays_turn_with_the_camera_and_grey_is_the_photos() -> None:
    T = np.eye(4)
    T[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    turned = side_of(torch.zeros(*SIZE_PX, 4), photo(), K, T)
    np.testing.assert_allclose(turned.rays_W[..., 0], 1.0)
    np.testing.assert_allclose(turned.rays_W[..., 2], -side().rays_W[..., 0], atol=1e-6)
    r, g, b = photo()
    np.testing.assert_allclose(turned.grey, 0.299 * r + 0.587 * g + 0.114 * b, rtol=1e-5)


def test_normals_count_by_their_weight() -> None:
    alpha, straight, crooked = torch.ones(SIZE_PX), side(), side(planes=(0.6, 0.0, -0.8, 2.0))
    assert float(normals_within(straight, alpha, photo(), CONFIG)) == pytest.approx(0.0, abs=1e-5)
    tilted = replace(crooked, planes=torch.cat([straight.planes[..., :3] * 0.5, straight.planes[..., 3:]], dim=-1))
    one = float(normals_within(tilted, alpha, photo(), CONFIG))
    assert one > 0.01
    assert float(normals_within(tilted, alpha, photo(), replace(CONFIG, normal=4.0))) == pytest.approx(2 * one)


def test_the_same_wall_comes_back_and_another_depth_does_not() -> None:
    def loss(planes: tuple[float, ...], config: GeometryConfig) -> float:
        return float(between(side(), side(0.05, planes), config, np.random.default_rng(0)))

    far = replace(CONFIG, ncc=0.0)
    assert loss((0.0, 0.0, -1.0, 2.0), far) == pytest.approx(0.0, abs=1e-4)
    off = loss((0.0, 0.0, -1.0, 2.5), far)
    assert off > 0.1
    assert loss((0.0, 0.0, -1.0, 2.5), replace(far, consistent=6.0)) == pytest.approx(2 * off)
    # The photos are the same though the cameras are apart: patches differ.
    assert loss((0.0, 0.0, -1.0, 2.0), replace(CONFIG, consistent=0.0)) > 0.01
