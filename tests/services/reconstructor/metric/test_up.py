import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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


def rotation(*axis_angle: float) -> np.ndarray:
    return Rotation.from_rotvec(axis_angle).as_matrix()


def turned(poses: np.ndarray, *, nod_deg: np.ndarray, roll_deg: np.ndarray) -> np.ndarray:
    """Cameras that nod about their x axis and roll about the way that they look."""
    found = poses.copy()
    for row, (nod, roll) in enumerate(np.radians(np.stack([nod_deg, roll_deg], axis=1))):
        found[row, :3, :3] = found[row, :3, :3] @ rotation(nod, 0, 0) @ rotation(0, 0, roll)
    return found


def test_cameras_that_nod_far_tell_up_and_rolls_to_both_sides_even_out() -> None:
    poses = ring(24)
    nod_deg = np.linspace(-70.0, 20.0, 24)
    level = some_similarity().moved_poses(turned(poses, nod_deg=nod_deg, roll_deg=np.zeros(24)))
    assert lean_deg(held_up(level), UP_IN_MAP) < 1e-4
    roll_deg = 5.0 * (-1.0) ** np.arange(24)
    rolled = some_similarity().moved_poses(turned(poses, nod_deg=nod_deg, roll_deg=roll_deg))
    assert lean_deg(held_up(rolled), UP_IN_MAP) < 3.0


def test_cameras_that_all_look_one_way_take_their_own_up() -> None:
    poses = np.repeat(ring(1), 9, axis=0)
    poses[:, 0, 3] += np.arange(9)
    moved = some_similarity().moved_poses(poses)
    assert lean_deg(held_up(moved), -moved[0, :3, 1]) < 1e-6


def test_floor_is_the_plane_below_which_there_is_nothing_though_a_table_has_more_points() -> None:
    rng = np.random.default_rng(3)
    floor = np.column_stack([rng.uniform(-2, 2, (200, 2)), np.full(200, 0.25)])
    table = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.full(500, 0.95)])
    strays = rng.uniform([-2, -2, -1.0], [2, 2, 0.1], (10, 3))
    poses = ring()
    poses[:, 2, 3] += 0.5
    images = mapped(poses, np.concatenate([floor, table, strays]), some_similarity())
    found = floor_of_points(images, UP_IN_MAP)
    assert found is not None
    assert found.point_count == 200
    height_m = (found.point - some_similarity().apply(np.zeros(3))) @ UP_IN_MAP / some_similarity().scale
    assert height_m == pytest.approx(0.25, abs=1e-6)
    assert lean_deg(found.up, UP_IN_MAP) < 1e-4


@pytest.mark.parametrize("forward", [(0.3, -0.8, 0.9), (0.0, 0.0, -1.0)])
def test_world_is_right_handed_with_x_ahead_as_far_as_that_is_level(forward: tuple[float, float, float]) -> None:
    R = rotation(0.4, -1.1, 0.7)
    up, point, origin = R[:, 2], np.array([3.0, -4.0, 5.0]), np.array([-1.0, 2.0, 0.5])
    ahead = R @ forward
    world = world_from_map(Floor(up=2.0 * up, point=point, source=""), ahead, origin, 2.5)
    np.testing.assert_allclose(world.R @ world.R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(world.R) == pytest.approx(1.0)
    assert world.scale == 2.5
    np.testing.assert_allclose(world.R @ up, [0, 0, 1], atol=1e-12)
    assert world.apply(point)[2] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(world.apply(origin), [0, 0, 2.5 * (origin - point) @ up], atol=1e-9)
    if forward[0]:
        along = world.R @ ahead
        assert along[0] == pytest.approx(np.hypot(0.3, 0.8))
        assert along[1] == pytest.approx(0.0, abs=1e-12)


def test_lean_is_the_angle_between_two_directions() -> None:
    a, b = np.array([0.0, 0.6, 0.8]), np.array([0.0, -0.8, 0.6])
    assert lean_deg(a, b) == pytest.approx(90.0)
    assert lean_deg(a, -a) == pytest.approx(180.0)
    assert lean_deg(a, a) == 0.0


def rough_floor(count: int, noise_m: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-2, 2, (count, 2)), rng.normal(0.0, noise_m, count)])


def test_floor_tells_how_well_its_direction_is_known() -> None:
    inside, errors_deg = 0, []
    for seed in range(30):
        found = floor_of_points(mapped(ring(), rough_floor(200, 0.004, seed), some_similarity()), UP_IN_MAP)
        assert found is not None
        errors_deg.append(found.error_deg)
        inside += lean_deg(found.up, UP_IN_MAP) < found.error_deg
    assert inside >= 27
    assert 0.02 < np.median(errors_deg) < 0.1
    few = floor_of_points(mapped(ring(), rough_floor(80, 0.01, 0), some_similarity()), UP_IN_MAP)
    assert few is not None
    assert few.error_deg > 2.0 * np.median(errors_deg)
