"""Losses between two views of a wall against float64 computations of their own."""

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.training.neighbours import (
    Side,
    choose_neighbours,
    neighbour_distances,
    neighbour_losses,
    patch_differences,
    there_and_back,
)
from readygo.services.reconstructor.training.planes import rays_of

SIZE_PX = (30, 40)
K = np.array([[50.0, 0.0, 20.0], [0.0, 50.0, 15.0], [0.0, 0.0, 1.0]])
NORMAL = np.array([0.2, 0.1, -np.sqrt(0.95)])
OFFSET_M = 3.0
"""The wall is n . x = -3 in the world."""


def pose(x_m: float, yaw_rad: float) -> np.ndarray:
    T = np.eye(4)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    T[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    T[0, 3] = x_m
    return T


def texture(points: np.ndarray) -> np.ndarray:
    """Grey of the wall at points of the world."""
    return 0.5 + 0.2 * np.sin(3.1 * points[..., 0] + 1.3 * points[..., 1]) + 0.2 * np.cos(2.7 * points[..., 1])


def side(T: np.ndarray, error_m: float = 0.0) -> Side:
    """A view of the wall whose planes are wrong by `error_m`."""
    rays_W = rays_of(K, SIZE_PX, dtype=torch.float64).numpy() @ T[:3, :3].T
    distance = OFFSET_M + NORMAL @ T[:3, 3]
    depth = -distance / (rays_W @ NORMAL)
    planes = np.broadcast_to([*NORMAL, distance + error_m], (*SIZE_PX, 4)).copy()
    grey = texture(T[:3, 3] + rays_W * depth[..., None])
    return Side(
        planes=torch.tensor(planes, requires_grad=True),
        grey=torch.tensor(grey),
        K_px=torch.tensor(K),
        T_world_camera=torch.tensor(T),
        rays_W=torch.tensor(rays_W),
    )


ONE, OTHER = pose(0.0, 0.0), pose(0.4, -0.1)


def test_true_planes_come_back_to_their_pixels() -> None:
    away_px, counts = there_and_back(side(ONE), side(OTHER), 1.0)
    # Depths are sampled linearly between pixels, which a wall's are not.
    assert float(away_px.detach()[counts].max()) < 0.01
    assert counts[:, 12:34].float().mean() > 0.9
    assert not counts[:, 0].any()


def test_wrong_planes_come_back_elsewhere_by_as_much_as_geometry_says() -> None:
    error_m = 0.05
    away_px, counts = there_and_back(side(ONE), side(OTHER, error_m), 10.0)
    v, u = 15, 20
    ray = np.array([(u + 0.5 - 20) / 50, (v + 0.5 - 15) / 50, 1.0])
    point = ray * (-OFFSET_M / (NORMAL @ ray))
    p = OTHER[:3, 3]
    towards = point - p
    distance = OFFSET_M + NORMAL @ p
    back = p + towards * ((distance + error_m) / -(NORMAL @ towards))
    pixel = (K @ (back / back[2]))[:2]
    assert counts[v, u]
    assert float(away_px.detach()[v, u]) == pytest.approx(np.hypot(*(pixel - [u + 0.5, v + 0.5])), rel=0.01)


def reference_difference(one: Side, other: Side, v: int, u: int, error_m: float) -> float:
    """1 - NCC^2 of the patch around a pixel: its pixels on the plane, seen by the other camera."""
    plane_m = OFFSET_M + NORMAL @ ONE[:3, 3] + error_m
    a, b = [], []
    for dv in range(-3, 4):
        for du in range(-3, 4):
            ray = ONE[:3, :3] @ [(u + du + 0.5 - 20) / 50, (v + dv + 0.5 - 15) / 50, 1.0]
            point = ONE[:3, 3] + ray * (plane_m / -(NORMAL @ ray))
            seen = K @ (OTHER[:3, :3].T @ (point - OTHER[:3, 3]))
            x, y = seen[0] / seen[2] - 0.5, seen[1] / seen[2] - 0.5
            i, j = int(np.floor(y)), int(np.floor(x))
            fy, fx = y - i, x - j
            grey = other.grey.numpy()
            b.append(
                (1 - fy) * ((1 - fx) * grey[i, j] + fx * grey[i, j + 1])
                + fy * ((1 - fx) * grey[i + 1, j] + fx * grey[i + 1, j + 1])
            )
            a.append(one.grey.numpy()[v + dv, u + du])
    a, b = np.array(a) - np.mean(a), np.array(b) - np.mean(b)
    return float(1 - np.mean(a * b) ** 2 / (np.mean(a * a) * np.mean(b * b) + 1e-8))


@pytest.mark.parametrize("error_m", [0.0, 0.2])
def test_patches_are_carried_by_the_homography_of_the_plane(error_m: float) -> None:
    one, other = side(ONE, error_m), side(OTHER)
    v, u = 14, 22
    found = patch_differences(one, other, torch.tensor([v * SIZE_PX[1] + u]))
    assert float(found.detach()) == pytest.approx(reference_difference(one, other, v, u, error_m), abs=1e-5)


def test_losses_pull_wrong_planes_to_the_right_ones() -> None:
    one, other = side(ONE, 0.1), side(OTHER)
    far_px, differs = neighbour_losses(one, other, noise_px=5.0, patches_max=50, rng=np.random.default_rng(0))
    (far_px + differs).backward()
    assert one.planes.grad is not None
    assert float(one.planes.grad[..., 3].sum()) > 0


def test_views_that_share_nothing_have_no_loss() -> None:
    far_px, differs = neighbour_losses(
        side(ONE), side(pose(0.0, 1.2)), noise_px=1.0, patches_max=50, rng=np.random.default_rng(0)
    )
    assert float(far_px.detach()) == float(differs.detach()) == 0.0


def test_neighbours_are_near_and_look_the_same_way() -> None:
    poses = np.array([pose(0.0, 0.0), pose(0.5, 0.1), pose(0.3, 2.0), pose(3.0, 0.0), pose(0.2, 0.0)])
    found = choose_neighbours(poses, angle_max_deg=30, distance_m=(0.01, 1.5), count=8)
    assert found[0] == (4, 1)
    assert found[3] == ()
    assert choose_neighbours(poses, angle_max_deg=30, distance_m=(0.01, 1.5), count=1)[0] == (4,)


def chosen(poses: np.ndarray, farthest_m: float | np.ndarray) -> list[tuple[int, ...]]:
    return choose_neighbours(poses, angle_max_deg=30, distance_m=(0.01, farthest_m), count=8)


def distances_m(poses: np.ndarray, depth_m: float) -> np.ndarray:
    return neighbour_distances(poses, depth_m, angle_max_deg=30, distance_min_m=0.01)


def test_views_with_neighbours_near_by_keep_them_whatever_the_others_do() -> None:
    rng = np.random.default_rng(4)
    close = [pose(x, yaw) for x, yaw in zip(rng.uniform(0, 6, 40), rng.uniform(-1, 1, 40), strict=True)]
    poses = np.stack([*close, pose(30.0, 0.0), pose(33.0, 0.0)])
    before, after = chosen(poses, 1.5), chosen(poses, distances_m(poses, 8.0))
    assert after[:40] == before[:40]
    assert sum(map(bool, before[:40])) == 40
    assert before[40:] == [(), ()]


def test_cameras_far_apart_find_neighbours_as_far_as_the_depth_of_the_scene_allows() -> None:
    poses = np.stack([pose(2.5 * number, 0.0) for number in range(6)])
    assert chosen(poses, 1.5) == [()] * 6
    assert chosen(poses, distances_m(poses, 12.0))[2] == (1, 3)
    np.testing.assert_array_equal(distances_m(poses, 12.0), np.full(6, 5.0))
    np.testing.assert_array_equal(distances_m(poses, 4.0), np.full(6, 2.0))
    assert chosen(poses, distances_m(poses, 4.0)) == [()] * 6


def test_distances_follow_the_unit_of_the_poses() -> None:
    poses = np.stack([pose(100.0 * number, 0.0) for number in range(6)])
    assert chosen(poses, distances_m(poses, 800.0))[0] == (1,)


def test_views_that_look_alone_leave_the_distance_as_it_was() -> None:
    poses = np.stack([pose(0.0, 0.0), pose(0.1, 3.0)])
    np.testing.assert_array_equal(distances_m(poses, 9.0), [1.5, 1.5])
