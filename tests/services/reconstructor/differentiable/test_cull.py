"""Chunks that may touch the image, next to projecting every single Gaussian."""

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.tiles import unpack_box
from readygo.common.rasterizer.cpu.view import make_view
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.services.reconstructor.differentiable.cull import bound_chunks
from readygo.services.reconstructor.differentiable.memory import CHUNK, Chunks, Cloud

HEIGHT, WIDTH = 64, 96


def bounded(cloud: GaussianCloud, T: np.ndarray, K: np.ndarray) -> Chunks:
    """The chunks of a cloud that may touch the image."""
    arrays = (cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities, cloud.sh)
    flat = Cloud(*(np.ascontiguousarray(array).reshape(-1) for array in arrays), 3, 1)
    room = -(-len(cloud) // CHUNK)
    number, box, first_group, group_count = (np.zeros(room, np.int64) for _ in range(4))
    chunks = Chunks(number, np.zeros(room), box, np.zeros(room * CHUNK // 16, np.int64), first_group, group_count)
    count = bound_chunks(make_view(T, K, HEIGHT, WIDTH), flat, np.empty(80, np.float32), chunks)
    return Chunks(*(array[: count * len(array) // room] for array in chunks))


def test_what_touches_the_image_is_in_the_bounds_of_its_chunk(make_cloud, camera) -> None:
    cloud = make_cloud(1500, scale_m=0.1)
    T, K = camera(-3.0, 1.0, 0.4, WIDTH, HEIGHT)
    chunks = bounded(cloud, T, K)
    places = {number: k for k, number in enumerate(chunks.number.tolist())}
    depth_m = (cloud.means_m - T[:3, 3]) @ T[:3, 2]
    hidden = 0
    for number in range(0, 1500, 5):
        alpha = rasterize_reference(cloud.select(np.array([number])), T, K, HEIGHT, WIDTH).alpha
        if alpha.max() == 0:
            hidden += 1
            continue
        k = places[number // CHUNK]
        x0, x1, y0, y1 = unpack_box(int(chunks.box[k]))
        rows, columns = np.nonzero(alpha)
        assert x0 <= columns.min() // 4
        assert columns.max() // 4 <= x1
        assert y0 <= rows.min() // 4
        assert rows.max() // 4 <= y1
        assert chunks.depth_m[k] <= depth_m[number] + 1e-4
        assert chunks.lanes[(CHUNK * k + number % CHUNK) // 16] >> (number % 16) & 1
    assert 50 < hidden < 250


@pytest.mark.parametrize("place_m", [(-9.0, 0.0, 1.2), (3.0, 30.0, 1.2), (3.0, 0.0, 30.0)])
def test_chunk_beside_or_behind_the_image_is_left_out(make_cloud, camera, place_m: tuple[float, ...]) -> None:
    near = make_cloud(CHUNK, low=(3.0, -0.2, 1.0), high=(3.4, 0.2, 1.4))
    away = make_cloud(CHUNK, low=place_m, high=tuple(x + 0.4 for x in place_m), seed=1)
    both = GaussianCloud(
        **{
            name: np.concatenate([getattr(away, name), getattr(near, name)])
            for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")
        }
    )
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)
    assert bounded(both, T, K).number.tolist() == [1]


def test_faint_gaussians_are_left_out(make_cloud, camera) -> None:
    cloud = make_cloud(64, low=(3.0, -0.2, 1.0), high=(3.4, 0.2, 1.4))
    cloud.opacities[:] = 0.5
    cloud.opacities[14:35] = 0.003
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)
    assert bounded(cloud, T, K).lanes.tolist() == [0x3FFF, 0, 0xFFF8, 0xFFFF, *[0] * 12]


def test_bounds_hold_what_the_dilation_adds_to_a_point(camera) -> None:
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT, pitch=0.0)
    for k in range(24):
        point = GaussianCloud(
            means_m=np.float32([[3.0, 0.02 * k, 1.2 + 0.02 * k]]),
            quats_wxyz=np.float32([[1.0, 0.0, 0.0, 0.0]]),
            scales_m=np.full((1, 3), 1e-4, np.float32),
            opacities=np.float32([1.0]),
            sh=np.zeros((1, 1, 3), np.float32),
        )
        rows, columns = np.nonzero(rasterize_reference(point, T, K, HEIGHT, WIDTH).alpha)
        x0, x1, y0, y1 = unpack_box(int(bounded(point, T, K).box[0]))
        assert x0 <= columns.min() // 4 <= columns.max() // 4 <= x1 <= columns.max() // 4 + 1
        assert y0 <= rows.min() // 4 <= rows.max() // 4 <= y1 <= rows.max() // 4 + 1
