"""Kernels of surfaces against torch and differences; whole losses are in test_surface_slopes."""

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.training.planes import FACING_MIN, plane_depth, rays_of
from readygo.services.reconstructor.training.surface_kernels import (
    add_depth_slopes,
    patch_slopes,
    plane_depths,
    return_slopes,
)
from readygo.services.reconstructor.training.surface_slopes import camera_numbers
from tests.services.reconstructor.training.test_surface_slopes import SIZE_PX, K, photo, planes

ONE, OTHER = photo(0.0, 0.0), photo(0.3, -0.08)


def depths(number: int) -> np.ndarray:
    view = (ONE, OTHER)[number]
    out = np.empty(SIZE_PX, dtype=np.float32)
    plane_depths(planes(view, number), camera_numbers(view), FACING_MIN, out)
    return out


def returned(depth_m: np.ndarray, other_m: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """The sum of the distances that count, the distances, and the derivatives."""
    away, by_one, by_other = (np.zeros(SIZE_PX, dtype=np.float32) for _ in range(3))
    cameras = camera_numbers(ONE), camera_numbers(OTHER)
    return_slopes(depth_m, other_m, *cameras, 0.1, 3.0, away, by_one, by_other)
    return float(away[np.isfinite(away)].sum(dtype=np.float64)), away, by_one, by_other


def test_depths_are_those_of_torch_and_0_where_there_is_none() -> None:
    T = torch.tensor(OTHER.T_world_camera)
    rays_W = rays_of(K, SIZE_PX, dtype=torch.float64) @ T[:3, :3].T
    wanted, known = plane_depth(torch.tensor(planes(OTHER, 1)).double().permute(1, 2, 0), rays_W)
    np.testing.assert_allclose(depths(1), torch.where(known, wanted, 0.0), rtol=1e-6)
    assert (depths(1) == 0.0).sum() == 12


def test_slopes_by_depths_become_slopes_by_planes() -> None:
    values, camera, step = planes(ONE, 0).astype(np.float64), camera_numbers(ONE), 1e-4
    by_depth = np.random.default_rng(4).normal(size=SIZE_PX).astype(np.float32)
    found = np.zeros((4, *SIZE_PX), dtype=np.float32)
    add_depth_slopes(planes(ONE, 0), camera, depths(0), by_depth, found)
    for k in range(4):
        ends = []
        for sign in (-1, 1):
            moved, out = values.copy(), np.empty(SIZE_PX)
            moved[k] += sign * step
            plane_depths(moved, camera, FACING_MIN, out)
            ends.append(out)
        known = (ends[0] > 0) & (ends[1] > 0)
        wanted = np.where(known, by_depth * (ends[1] - ends[0]) / (2 * step), 0.0)
        np.testing.assert_allclose(found[k], wanted, atol=1e-3 * np.abs(wanted).max())


def test_slopes_by_the_views_depths_are_differences_of_its_own_pixels() -> None:
    # The kernel's sum has weights exp(-away), which count as constants: a pixel's slope is its weight's share.
    one, other, step = depths(0).astype(np.float64), depths(1).astype(np.float64), 1e-5
    _, away, by_one, _ = returned(one, other)
    for v, u in ((5, 9), (20, 30), (14, 16)):
        ends = []
        for sign in (-1, 1):
            moved = one.copy()
            moved[v, u] += sign * step
            ends.append(float(returned(moved, other)[1][v, u]))
        assert by_one[v, u] == pytest.approx(np.exp(-away[v, u]) * (ends[1] - ends[0]) / (2 * step), rel=0.02, abs=0.02)


def test_slopes_by_the_neighbours_depths_are_differences_of_all_that_see_them() -> None:
    one, other, step = depths(0).astype(np.float64), depths(1).astype(np.float64), 1e-3
    _, away, _, by_other = returned(one, other)
    ends = []
    for sign in (-1, 1):
        moved = other.copy()
        moved[15, 18] += sign * step
        ends.append(returned(one, moved)[1])
    both = np.isfinite(ends[0]) & np.isfinite(ends[1])
    wanted = (np.exp(-away[both].astype(np.float64)) * (ends[1][both] - ends[0][both])).sum() / (2 * step)
    assert by_other[15, 18] == pytest.approx(wanted, rel=0.05, abs=0.05)
    assert wanted != 0.0


def test_patches_of_other_places_do_not_count() -> None:
    grey = np.random.default_rng(5).random((2, *SIZE_PX)).astype(np.float32)
    chosen, slopes, work = np.array([600, 610, 700]), np.ones((3, 4)), np.empty((3, 49))
    away = np.zeros(SIZE_PX, dtype=np.float32)
    cameras = camera_numbers(ONE), camera_numbers(ONE)
    count, total = patch_slopes(planes(ONE, 0), grey[0], grey[1], *cameras, chosen, away, 7, 0.5, work, slopes)
    assert (count, total) == (0, 0.0)
    assert not slopes.any()
    count, total = patch_slopes(planes(ONE, 0), grey[0], grey[0], *cameras, chosen, away, 7, 0.5, work, slopes)
    assert count == 3
    assert total == pytest.approx(0.0, abs=1e-4)
