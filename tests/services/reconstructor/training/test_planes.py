"""Plane depths and normals against float64 computations of their own."""

import numpy as np
import torch

from readygo.services.reconstructor.training.planes import (
    depth_normals,
    edge_weights,
    normal_loss,
    plane_depth,
    plane_features,
    rays_of,
)

K = np.array([[40.0, 0.0, 16.5], [0.0, 42.0, 11.0], [0.0, 0.0, 1.0]])
SIZE_PX = (24, 32)
NORMAL = np.array([0.3, -0.4, -np.sqrt(0.75)])
"""Of a tilted wall, towards a camera at the origin that looks along z."""
DISTANCE_M = 2.5


def wall_depth_m() -> np.ndarray:
    """Where each pixel's ray meets the wall n . x = -d."""
    depth = np.empty(SIZE_PX)
    for v in range(SIZE_PX[0]):
        for u in range(SIZE_PX[1]):
            ray = np.array([(u + 0.5 - K[0, 2]) / K[0, 0], (v + 0.5 - K[1, 2]) / K[1, 1], 1.0])
            depth[v, u] = -DISTANCE_M / (NORMAL @ ray)
    return depth


def test_depth_of_a_wall_does_not_depend_on_opacity() -> None:
    opacity = torch.tensor(np.random.default_rng(0).uniform(0.2, 1.0, SIZE_PX))
    planes = torch.tensor([*NORMAL, DISTANCE_M]) * opacity[..., None]
    depth, known = plane_depth(planes, rays_of(K, SIZE_PX, dtype=torch.float64))
    assert known.all()
    np.testing.assert_allclose(depth.numpy(), wall_depth_m(), rtol=1e-9)


def test_no_depth_where_nothing_faces_the_camera() -> None:
    planes = torch.tensor([*-NORMAL, DISTANCE_M]).expand(*SIZE_PX, 4)
    depth, known = plane_depth(planes, rays_of(K, SIZE_PX, dtype=torch.float64))
    assert not known.any()
    assert torch.isfinite(depth).all()


def test_normals_of_a_walls_depth_are_the_walls() -> None:
    normals = depth_normals(torch.tensor(wall_depth_m()), rays_of(K, SIZE_PX, dtype=torch.float64)).numpy()
    np.testing.assert_allclose(normals[1:-1, 1:-1], np.broadcast_to(NORMAL, (22, 30, 3)), atol=1e-9)
    assert not normals[0].any()
    assert not normals[:, -1].any()


def test_normals_of_a_bumpy_depth_are_cross_products() -> None:
    rng = np.random.default_rng(1)
    depth = 2.0 + 0.1 * rng.normal(size=SIZE_PX)
    rays = rays_of(K, SIZE_PX, dtype=torch.float64)
    points = rays.numpy() * depth[..., None]
    v, u = 5, 9
    wanted = np.cross(points[v, u + 1] - points[v, u - 1], points[v - 1, u] - points[v + 1, u])
    np.testing.assert_allclose(
        depth_normals(torch.tensor(depth), rays)[v, u].numpy(), wanted / np.linalg.norm(wanted), atol=1e-9
    )


def test_features_are_the_shortest_axis_towards_the_camera_and_its_planes_distance() -> None:
    angle = 0.7
    quats = torch.tensor([[np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0]], dtype=torch.float64)
    scales = torch.tensor([[0.2, 0.3, 0.01]], dtype=torch.float64)
    means = torch.tensor([[0.1, 0.2, 3.0]], dtype=torch.float64)
    camera = torch.tensor([1.0, 0.0, -1.0], dtype=torch.float64)
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    away = float(normal @ (camera - means[0]).numpy())
    wanted = np.array([*(np.sign(away) * normal), abs(away)])
    np.testing.assert_allclose(plane_features(means, quats, scales, camera)[0].numpy(), wanted, atol=1e-12)


def test_gradients_of_features_are_those_of_differences() -> None:
    rng = np.random.default_rng(2)
    means = torch.tensor(rng.normal(size=(3, 3)), requires_grad=True)
    quats = torch.tensor(rng.normal(size=(3, 4)), requires_grad=True)
    scales, camera = torch.tensor(rng.uniform(0.1, 1.0, (3, 3))), torch.tensor([5.0, 0.5, -4.0], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda m, q: plane_features(m, q, scales, camera), (means, quats))


def test_a_flat_wall_has_no_normal_loss_and_a_wrong_normal_has_one() -> None:
    rays, flat = rays_of(K, SIZE_PX, dtype=torch.float64), torch.ones(SIZE_PX, dtype=torch.float64)
    planes = torch.tensor([*NORMAL, DISTANCE_M]).expand(*SIZE_PX, 4)
    weights = edge_weights(torch.full((3, *SIZE_PX), 0.5, dtype=torch.float64))
    assert float(normal_loss(planes, flat, rays, weights)) < 1e-9
    turned = planes.clone()
    turned[..., 0] += 0.2 * torch.linspace(-1, 1, SIZE_PX[1], dtype=torch.float64)
    assert float(normal_loss(turned, flat, rays, weights)) > 1e-3


def test_edges_of_a_photo_have_no_weight() -> None:
    photo = torch.zeros((3, *SIZE_PX))
    photo[:, :, 16:] = 1.0
    weights = edge_weights(photo)
    assert weights[10, 15] == weights[10, 16] == 0.0
    assert weights[10, 5] == 1.0
    assert not weights[0].any()
