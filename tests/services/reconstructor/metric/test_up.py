import numpy as np

from readygo.services.reconstructor.metric.up import Floor, floor_of_points, held_up, lean_deg, world_from_map
from tests.services.reconstructor.synthetic import floor_points, mapped, ring, some_similarity

UP_IN_MAP = some_similarity().R[:, 2]


def test_level_cameras_tell_up() -> None:
    poses = some_similarity().moved_poses(ring())
    assert lean_deg(held_up(poses), UP_IN_MAP) < 1e-4


def test_floor_is_found_among_other_points() -> None:
    images = mapped(ring(), floor_points(), some_similarity())
    tilted = UP_IN_MAP + 0.1 * some_similarity().R[:, 0]
    floor = floor_of_points(images, tilted / np.linalg.norm(tilted))
    assert floor is not None
    assert lean_deg(floor.up, UP_IN_MAP) < 0.3
    assert floor.point_count >= 300


def test_no_floor_is_found_where_there_are_hardly_any_points() -> None:
    assert floor_of_points(mapped(ring(), floor_points(12), some_similarity()), UP_IN_MAP) is None


def test_floor_comes_to_z_0_in_metres() -> None:
    moved = some_similarity()
    floor = Floor(up=UP_IN_MAP, point=moved.apply([1.0, 2.0, 0.0]), source="")
    world = world_from_map(floor, moved.R[:, 0], moved.apply([0.5, 0.5, 1.0]), 1.0 / moved.scale)
    np.testing.assert_allclose(world.apply(moved.apply([0.5, 0.5, 0.7])), [0.0, 0.0, 0.7], atol=1e-12)
    np.testing.assert_allclose(world.apply(moved.apply([1.5, 0.5, 0.0])), [1.0, 0.0, 0.0], atol=1e-12)
