from dataclasses import replace
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.drawing.files import write_png
from readygo.services.reconstructor.training.between import points_between
from readygo.services.reconstructor.training.photos import Posed

COLOUR = (200, 100, 50)
SIZE_PX = (128, 96)
K_PX = np.array([[120.0, 0.0, 64.0], [0.0, 120.0, 48.0], [0.0, 0.0, 1.0]])


def posed_wall(folder: Path, depth_m: Float64Array) -> Posed:
    """Three cameras beside each other that all see nine points, as far away as told."""
    x, y = np.meshgrid([-0.7, 0.0, 0.7], [-0.5, 0.0, 0.5])
    points = np.column_stack([x.reshape(-1), y.reshape(-1), depth_m])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = (-0.1, 0.0, 0.1)
    names = ("a.png", "b.png", "c.png")
    for name in names:
        write_png(folder / name, np.full((*SIZE_PX[::-1], 3), COLOUR, np.uint8))
    views = CapturedViews(
        images=names, sizes_px=np.tile(SIZE_PX, (3, 1)), K_px=np.tile(K_PX, (3, 1, 1)), T_world_camera=poses
    )
    seen = np.array([(view, point) for view in range(3) for point in range(9)])
    return Posed(
        views=views,
        folder=folder,
        points_m=points,
        points_rgb=np.zeros((9, 3), np.uint8),
        seen=seen,
        moments=np.arange(3),
    )


def slanted(x: Float64Array) -> Float64Array:
    return 2.0 + 0.3 * x


def test_points_lie_on_the_wall_between_those_of_the_map(tmp_path: Path) -> None:
    posed = posed_wall(tmp_path, slanted(np.tile([-0.7, 0.0, 0.7], 3)))
    points_m, rgb = points_between(posed, (0, 1, 2), 10_000)
    assert len(points_m) > 200
    np.testing.assert_allclose(points_m[:, 2], slanted(points_m[:, 0]), atol=1e-6)
    assert np.abs(points_m[:, 0]).max() <= 0.7
    assert (rgb == COLOUR).all()


def test_no_more_points_than_there_is_room_for(tmp_path: Path) -> None:
    posed = posed_wall(tmp_path, slanted(np.tile([-0.7, 0.0, 0.7], 3)))
    assert 30 <= len(points_between(posed, (0, 1, 2), 60)[0]) <= 60


def test_nothing_lies_between_things_at_different_depths(tmp_path: Path) -> None:
    posed = posed_wall(tmp_path, np.array([1.0, 2.0, 4.0, 2.0, 4.0, 1.0, 4.0, 1.0, 2.0]))
    assert not len(points_between(posed, (0, 1, 2), 10_000)[0])


def test_nothing_is_added_where_one_view_alone_shows_it_or_none_has_points(tmp_path: Path) -> None:
    posed = posed_wall(tmp_path, np.full(9, 2.0))
    assert not len(points_between(posed, (1,), 10_000)[0])
    bare = replace(posed, seen=np.empty((0, 2), np.int64))
    assert points_between(bare, (0, 1, 2), 10_000)[0].shape == (0, 3)


def test_two_views_of_one_360_degree_image_do_not_agree_on_anything(tmp_path: Path) -> None:
    posed = posed_wall(tmp_path, np.full(9, 2.0))
    assert len(points_between(posed, (0, 1), 10_000)[0])
    rig = replace(posed, moments=np.array([0, 0, 1]))
    assert not len(points_between(rig, (0, 1), 10_000)[0])
    assert len(points_between(rig, (0, 1, 2), 10_000)[0])


def test_planes_go_on_to_the_images_borders(tmp_path: Path) -> None:
    posed = posed_wall(tmp_path, slanted(np.tile([-0.7, 0.0, 0.7], 3)))
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.3, 0.3, 5))
    points = np.column_stack([x.reshape(-1), y.reshape(-1), slanted(x.reshape(-1))])
    seen = np.array([(view, point) for view in range(3) for point in range(25)])
    posed = replace(posed, points_m=points, points_rgb=np.zeros((25, 3), np.uint8), seen=seen)
    points_m, _ = points_between(posed, (0, 1, 2), 10_000)
    assert points_m[:, 0].min() < -0.8
    assert points_m[:, 0].max() > 0.8
    np.testing.assert_allclose(points_m[:, 2], slanted(points_m[:, 0]), atol=0.02)
