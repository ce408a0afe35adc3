from dataclasses import replace

import numpy as np

from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses.joining import placed_by_markers, pose_of_points
from tests.services.reconstructor.synthetic import floor_points, mapped, marker_at, ring, sighted, some_similarity

CAMERAS = ring(6)
MAP = mapped(CAMERAS, floor_points(20), some_similarity())


def part(images: PosedImages, numbers: list[int]) -> PosedImages:
    return replace(images, names=tuple(images.names[n] for n in numbers), T_world_camera=images.T_world_camera[numbers])


def seen_in(marker: int, numbers: list[int]) -> list[MarkerSighting]:
    corners_m = marker_at((0.3 * marker, 0.2 * marker, 0.0))
    names = {MAP.names[n] for n in numbers}
    return [each for each in sighted(CAMERAS, corners_m, marker) if each.image in names]


def test_images_without_a_pose_are_placed_by_markers_from_one_to_the_next() -> None:
    sightings = [*seen_in(0, [0, 1, 2, 3]), *seen_in(1, [3, 4]), *seen_in(2, [4, 5])]
    poses = placed_by_markers([part(MAP, [0, 1, 2])], sightings)
    np.testing.assert_allclose([poses[name] for name in MAP.names], MAP.T_world_camera, atol=1e-4)


def test_piece_is_moved_to_where_markers_say() -> None:
    other = mapped(CAMERAS, floor_points(20), replace(some_similarity(), scale=2.0, t=np.ones(3)))
    poses = placed_by_markers([part(MAP, [0, 1, 2]), part(other, [3, 4, 5])], seen_in(0, [0, 1, 3, 4]))
    np.testing.assert_allclose([poses[name] for name in MAP.names], MAP.T_world_camera, atol=1e-4)


def test_what_markers_do_not_tie_stays_out() -> None:
    assert set(placed_by_markers([part(MAP, [0, 1])], seen_in(0, [0, 1]))) == set(MAP.names[:2])
    assert set(placed_by_markers([part(MAP, [0, 1])], seen_in(0, [3, 4]))) == set(MAP.names[:2])


def test_points_that_do_not_fit_give_no_pose() -> None:
    rays = np.random.default_rng(0).uniform(-0.3, 0.3, (8, 2))
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (8, 3))
    assert pose_of_points(points, rays, 0.005) is None
