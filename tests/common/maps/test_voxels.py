import itertools

import numpy as np
import pytest

from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import GridFrame, opacity_sums, voxels
from readygo.common.maps.voxels import OPACITY_MIN, occupied_bands

H_M = 0.1
SHAPE = (9, 10, 11)
FRAME = GridFrame(origin_x_m=-0.5, origin_y_m=-0.4, resolution_m=H_M)
BOTTOM_M = -0.45


def random_cloud(rng, count):
    scales = np.exp(rng.normal(np.log(0.08), 0.8, (count, 3)))
    scales[np.arange(count), rng.integers(0, 3, count)] *= 0.02
    return GaussianCloud(
        means_m=rng.uniform(-0.6, 0.6, (count, 3)).astype(np.float32),
        quats_wxyz=rng.normal(size=(count, 4)).astype(np.float32),
        scales_m=scales.astype(np.float32),
        opacities=rng.uniform(0.1, 1, count).astype(np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def smallest_distance(P, low, high):
    """Minimum of x^T P x over a box, by trying every set of active faces."""
    best = np.inf
    for state in itertools.product((0, 1, 2), repeat=3):
        x = np.array([low[k] if state[k] == 0 else high[k] if state[k] == 1 else 0.0 for k in range(3)])
        free = [k for k in range(3) if state[k] == 2]
        fixed = [k for k in range(3) if state[k] != 2]
        if free:
            x[free] = np.linalg.solve(P[np.ix_(free, free)], -P[np.ix_(free, fixed)] @ x[fixed]) if fixed else 0.0
            if (x[free] < low[free]).any() or (x[free] > high[free]).any():
                continue
        best = min(best, x @ P @ x)
    return best


def test_voxels_are_those_that_the_ellipsoid_touches():
    rng = np.random.default_rng(3)
    cloud = random_cloud(rng, 6)
    for n in range(len(cloud)):
        touched = opacity_sums(cloud.select(np.array([n])), FRAME, BOTTOM_M, SHAPE) > 0
        R = matrix_from_quat(cloud.quats_wxyz[n])
        s = np.maximum(cloud.scales_m[n].astype(np.float64), 1e-4)
        P = R @ np.diag(1 / s**2) @ R.T
        mean = cloud.means_m[n].astype(np.float64)
        for k, j, i in np.ndindex(*SHAPE):
            low = np.array([FRAME.origin_x_m + i * H_M, FRAME.origin_y_m + j * H_M, BOTTOM_M + k * H_M]) - mean
            distance = smallest_distance(P, low, low + H_M)
            if abs(distance - 1) > 1e-6:
                assert touched[k, j, i] == (distance < 1), (n, k, j, i, distance)


def test_opacities_add_up_and_the_order_of_axes_is_zyx():
    cloud = random_cloud(np.random.default_rng(0), 1)
    small = GaussianCloud(
        means_m=np.float32([[0.25, -0.15, 0.12], [0.26, -0.16, 0.13]]),
        quats_wxyz=np.float32([[1, 0, 0, 0], [1, 0, 0, 0]]),
        scales_m=np.full((2, 3), 0.005, np.float32),
        opacities=np.float32([0.25, 0.5]),
        sh=np.repeat(cloud.sh, 2, axis=0),
    )
    sums = opacity_sums(small, FRAME, BOTTOM_M, SHAPE)
    assert np.argwhere(sums).tolist() == [[5, 2, 7]]
    assert sums[5, 2, 7] == pytest.approx(0.75)


def test_gaussian_that_reaches_in_from_outside_counts():
    cloud = random_cloud(np.random.default_rng(0), 1)
    outside = GaussianCloud(
        means_m=np.float32([[-0.7, 0.0, 0.0]]),
        quats_wxyz=np.float32([[1, 0, 0, 0]]),
        scales_m=np.float32([[0.35, 0.01, 0.01]]),
        opacities=np.float32([1]),
        sh=cloud.sh,
    )
    assert (
        opacity_sums(outside, FRAME, BOTTOM_M, SHAPE).sum(axis=(0, 1)).astype(bool).tolist() == [True] * 2 + [False] * 9
    )


def test_smaller_grid_gets_the_sums_of_its_part_of_a_larger_one():
    cloud = random_cloud(np.random.default_rng(7), 400)
    whole = opacity_sums(cloud, FRAME, BOTTOM_M, SHAPE)
    inner = GridFrame(origin_x_m=FRAME.origin_x_m + 3 * H_M, origin_y_m=FRAME.origin_y_m + 2 * H_M, resolution_m=H_M)
    part = opacity_sums(cloud, inner, BOTTOM_M + 4 * H_M, (3, 5, 4))
    assert part.any()
    np.testing.assert_array_equal(part > 0, whole[4:7, 2:7, 3:7] > 0)


def test_bands_hold_the_occupied_voxels_of_the_whole_without_haze(monkeypatch):
    cloud = random_cloud(np.random.default_rng(8), 400)
    sums = opacity_sums(cloud.select(cloud.opacities >= OPACITY_MIN), FRAME, BOTTOM_M, SHAPE)
    ((rows, whole),) = occupied_bands(cloud, FRAME, BOTTOM_M, SHAPE, 0.5)
    assert rows == slice(0, SHAPE[1])
    np.testing.assert_array_equal(whole, sums > 0.5)
    monkeypatch.setattr(voxels, "VOXELS_PER_BAND", 4 * SHAPE[0] * SHAPE[2])
    bands = list(occupied_bands(cloud, FRAME, BOTTOM_M, SHAPE, 0.5))
    assert [rows.stop - rows.start for rows, _ in bands] == [4, 4, 2]
    for rows, occupied in bands:
        assert (occupied != whole[:, rows]).mean() < 0.01, "rounding at faces of voxels apart"
