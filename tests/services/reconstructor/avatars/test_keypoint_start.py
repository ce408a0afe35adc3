"""Headings and sides over time are those that cost least; a standing person is placed where the keypoints are."""

import dataclasses

import numpy as np
import pytest

from readygo.services.reconstructor.avatars.keypoint_start import HEADINGS, KeypointViews, cheapest_path, find_start
from readygo.services.reconstructor.avatars.keypoints import COCO17, Keypoints

FRAMES, HEIGHT_M = 16, 0.9
K_PX = np.array([[800.0, 0.0, 256.0], [0.0, 800.0, 256.0], [0.0, 0.0, 1.0]])
LEFT_M = {
    "nose": (0.0, 0.12, 0.7), "eye": (0.03, 0.1, 0.73), "ear": (0.08, 0.0, 0.72), "shoulder": (0.17, 0.0, 0.5),
    "elbow": (0.22, 0.0, 0.2), "wrist": (0.25, 0.05, 0.0), "hip": (0.1, 0.0, 0.0), "knee": (0.1, 0.0, -0.4),
    "ankle": (0.1, 0.0, -0.8),
}  # fmt: skip


def _standing() -> np.ndarray:
    """A person who faces -y at heading 0 and turns to the left, shape (HEADINGS, 17, 3)."""
    rows = []
    for name in COCO17:
        x, forward, z = LEFT_M[name.removeprefix("left_").removeprefix("right_")]
        rows.append((-x if name.startswith("right") else x, -forward, z))
    angles = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
    c, s, o = np.cos(angles), np.sin(angles), np.zeros(HEADINGS)
    R = np.stack([np.stack([c, -s, o], 1), np.stack([s, c, o], 1), np.stack([o, o, o + 1.0], 1)], 1)
    return np.einsum("hij,kj->hki", R, np.array(rows))


def _views(scale: float = 1.0) -> tuple[KeypointViews, np.ndarray, np.ndarray]:
    """A person who turns slowly, seen from 4 m and 1.5 m above the floor; pelvises and headings."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), (0.0, -4.0, 1.5)
    number = np.arange(FRAMES)
    roots = np.stack([0.05 * number - 0.4, 0.0 * number, 0.0 * number + scale * HEIGHT_M], axis=1)
    points = roots[:, None] + scale * _standing()[number + 2]
    p = (points - T[:3, 3]) @ T[:3, :3]
    uv = p[..., :2] / p[..., 2:] * K_PX[[0, 1], [0, 1]] + K_PX[:2, 2]
    keypoints = Keypoints(names=COCO17, uv_px=uv, confidence=np.full(uv.shape[:2], 0.9))
    tiled = np.tile(K_PX, (FRAMES, 1, 1)), np.tile(T, (FRAMES, 1, 1))
    views = KeypointViews(keypoints=keypoints, K_px=tiled[0], T_world_camera=tiled[1], times=number.astype(np.float64))
    return views, roots, number + 2


@pytest.mark.parametrize("scale", [1.0, 0.8])
def test_place_heading_and_size_are_found(scale: float) -> None:
    views, roots, heading = _views(scale)
    start = find_start(views, _standing(), HEIGHT_M, views.sigma_px(0.01))
    assert start.scale == pytest.approx(scale, abs=1e-3)
    np.testing.assert_allclose(start.root_m, roots, atol=5e-3)
    np.testing.assert_allclose(start.heading_rad % (2 * np.pi), 2 * np.pi * heading / HEADINGS, atol=1e-9)
    assert not start.swapped.any()


def test_exchanged_sides_are_found_in_some_and_in_all_frames() -> None:
    views, _, _ = _views()
    for frames in ([5, 6], [12], list(range(FRAMES))):
        swapped = np.zeros(FRAMES, dtype=bool)
        swapped[frames] = True
        other = dataclasses.replace(views, keypoints=views.keypoints.with_swapped(swapped[:, None]))
        start = find_start(other, _standing(), HEIGHT_M, views.sigma_px(0.01))
        np.testing.assert_array_equal(start.swapped, swapped)


def test_cheapest_path_is_that_of_all_paths() -> None:
    rng = np.random.default_rng(0)
    costs, change = rng.random((4, 3)), rng.random((3, 3, 3))
    paths = np.stack(np.meshgrid(*[np.arange(3)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    totals = [
        sum(costs[k, s] for k, s in enumerate(path)) + sum(change[k, path[k], path[k + 1]] for k in range(3))
        for path in paths
    ]
    np.testing.assert_array_equal(cheapest_path(costs, change), paths[int(np.argmin(totals))])


def test_deviation_grows_with_the_person() -> None:
    views, _, _ = _views()
    span = np.ptp(views.keypoints.uv_px[..., 1], axis=1)
    assert views.sigma_px(0.01) == pytest.approx(0.01 * np.median(span))
    assert views.sigma_px(1e-6) == 1.0


def test_turn_costs_less_where_more_time_passed() -> None:
    views, _, headings = _views()
    # One frame hints weakly at a heading far from those around it.
    odd = FRAMES // 2
    keypoints = dataclasses.replace(views.keypoints, uv_px=views.keypoints.uv_px.copy())
    points = _standing()[(headings[odd] + 9) % HEADINGS]
    T = views.T_world_camera[odd]
    p = (points + np.array([0.05 * odd - 0.4, 0.0, HEIGHT_M]) - T[:3, 3]) @ T[:3, :3]
    keypoints.uv_px[odd] = p[:, :2] / p[:, 2:] * K_PX[[0, 1], [0, 1]] + K_PX[:2, 2]
    keypoints.confidence[odd] = 0.4
    off = []
    for gap in (1.0, 6.0):
        times = np.arange(FRAMES) + (gap - 1.0) * ((np.arange(FRAMES) >= odd) + 1.0 * (np.arange(FRAMES) > odd))
        apart = dataclasses.replace(views, keypoints=keypoints, times=times)
        start = find_start(apart, _standing(), HEIGHT_M, views.sigma_px(0.01))
        turned = start.heading_rad[odd] - 2.0 * np.pi * headings[odd] / HEADINGS
        off.append(abs((turned + np.pi) % (2.0 * np.pi) - np.pi))
    assert off[0] < 0.3
    assert off[1] > 1.0
