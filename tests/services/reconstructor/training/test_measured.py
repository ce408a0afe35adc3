from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.frames.depths import to_steps
from readygo.services.reconstructor.training.measured import points_of_depths
from readygo.services.reconstructor.training.photos import Posed
from tests.services.reconstructor.training.test_between import COLOUR, K_PX, SIZE_PX, posed_wall, slanted


def measured_wall(folder: Path) -> Posed:
    """The slanted wall of `posed_wall` with depth images of half the size, but for the lower right quarter."""
    posed = posed_wall(folder, np.full(9, 2.0))
    (folder / "depth").mkdir()
    v, u = (np.mgrid[:48, :64] + 0.5) * 2
    ray_x = (u - K_PX[0, 2]) / K_PX[0, 0]
    for name, T in zip(posed.views.images, posed.views.T_world_camera, strict=True):
        # z = slanted(x) with x = camera's x + ray_x z
        depth_m = slanted(T[0, 3]) / (1.0 - 0.3 * ray_x)
        depth_m[24:, 32:] = 0.0
        cv2.imwrite(str(folder / "depth" / f"{name}.png"), to_steps(depth_m))
    assert v.shape == (48, 64)
    return replace(posed, depths=folder / "depth")


def inside(points_m: Float64Array) -> Float64Array:
    """Points away from the edges of the depth images, whose pixels are twice as large as the photos'."""
    return points_m[np.abs(points_m[:, 0]) < 0.7]


def test_points_lie_on_the_measured_surface_alone(tmp_path: Path) -> None:
    points_m, rgb = points_of_depths(measured_wall(tmp_path), (0, 1, 2), 10_000)
    assert len(points_m) > 300
    off_m = points_m[:, 2] - slanted(points_m[:, 0])
    assert np.abs(off_m).max() < 0.015
    assert np.abs(off_m.mean()) < 0.001
    assert (rgb == COLOUR).all()
    assert not ((points_m[:, 0] > 0.15) & (points_m[:, 1] > 0.05)).any()
    apart_m = np.linalg.norm(points_m[:, None] - points_m[None], axis=2)
    assert np.median(np.sort(apart_m, axis=1)[:, 1]) > 0.03, "one point in each cell of 4 cm"


def test_points_are_the_same_again_and_no_more_than_there_is_room_for(tmp_path: Path) -> None:
    posed = measured_wall(tmp_path)
    first, again = (points_of_depths(posed, (0, 1, 2), 60) for _ in range(2))
    assert 30 <= len(first[0]) <= 60
    np.testing.assert_array_equal(first[0], again[0])


def test_what_one_moment_alone_measured_is_left_out(tmp_path: Path) -> None:
    posed = measured_wall(tmp_path)
    assert points_of_depths(posed, (1,), 10_000)[0].shape == (0, 3)
    (tmp_path / "depth" / "a.png.png").unlink()
    assert len(points_of_depths(posed, (0, 1, 2), 10_000)[0]) > 200
    (tmp_path / "depth" / "b.png.png").unlink()
    assert not len(points_of_depths(posed, (0, 1, 2), 10_000)[0])
    (tmp_path / "depth" / "c.png.png").unlink()
    assert points_of_depths(posed, (0, 1, 2), 10_000)[0].shape == (0, 3)


def test_masked_pixels_are_no_points(tmp_path: Path) -> None:
    posed = measured_wall(tmp_path)
    (tmp_path / "masks").mkdir()
    mask = np.full(SIZE_PX[::-1], 255, np.uint8)
    mask[:, :64] = 0
    for name in posed.views.images:
        cv2.imwrite(str(tmp_path / "masks" / f"{name}.png"), mask)
    points_m, _ = points_of_depths(replace(posed, masks=tmp_path / "masks"), (0, 1, 2), 10_000)
    assert len(points_m) > 50
    assert points_m[:, 0].min() > -0.15
