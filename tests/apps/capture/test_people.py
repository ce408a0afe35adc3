import numpy as np
import pytest

from readygo.apps.capture import people
from readygo.apps.capture.ground import WalkableGround
from readygo.apps.capture.people import APART_M, CAMERA_M, LENGTHS_M, SPEED_MPS, TURN_M, lane, people_mask, plan_people
from readygo.common.errors import SceneError
from readygo.common.maps import FloorMap, GridFrame


def ground(side_m: float) -> WalkableGround:
    """A square around the origin."""
    count = round(side_m / 0.05)
    frame = GridFrame(origin_x_m=-0.5 * side_m, origin_y_m=-0.5 * side_m, resolution_m=0.05)
    return WalkableGround(cells=np.ones((count, count), np.bool_), frame=frame)


def walks(monkeypatch: pytest.MonkeyPatch, side_m: float, camera: np.ndarray, count: int) -> list[np.ndarray]:
    """Where people are over time, without their bodies."""
    seen: list[np.ndarray] = []

    def walked(_: object, xy_m: np.ndarray, *__: object) -> np.ndarray:
        seen.append(xy_m)
        return xy_m

    monkeypatch.setattr(people, "walk", walked)
    monkeypatch.setattr(people, "skeleton_of", lambda avatar: avatar)
    monkeypatch.setattr(people, "HumanMotion", lambda avatar, motion: (avatar, motion))
    floor: FloorMap = None  # type: ignore[assignment]
    found = plan_people(ground(side_m), floor, camera, {"b": None, "a": None}, count, np.random.default_rng(0))  # type: ignore[dict-item]
    assert [name for name, _ in found] == ["a", "b", "a"][:count]  # type: ignore[misc]
    return seen


def test_lane_is_closed_even_and_as_wide_as_its_turns() -> None:
    path = lane(np.array([3.0, -1.0]), 0.4, 2.0)
    steps_m = np.hypot(*(np.roll(path, -1, axis=0) - path).T)
    assert 0.01 < steps_m.min() <= steps_m.max() < 0.03
    assert steps_m.sum() == pytest.approx(2.0 * (2.0 + np.pi * TURN_M), rel=0.01)
    np.testing.assert_allclose(path.mean(axis=0), [3.0, -1.0], atol=0.01)
    across = (path - [3.0, -1.0]) @ [-np.sin(0.4), np.cos(0.4)]
    assert abs(across).max() == pytest.approx(TURN_M, abs=0.01)


def test_people_walk_on_the_ground_and_keep_away_from_the_camera_and_each_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    angle = np.linspace(0.0, 6.0, 400)
    camera = 2.2 * np.column_stack([np.cos(angle), np.sin(angle)])
    first, second, third = walks(monkeypatch, 6.0, camera, 3)
    for xy_m in (first, second, third):
        assert len(xy_m) == 400
        assert ground(6.0).holds(xy_m).all()
        assert np.hypot(*(xy_m - camera).T).min() >= CAMERA_M
        speed_mps = 20.0 * np.hypot(*np.diff(xy_m, axis=0).T)
        np.testing.assert_allclose(speed_mps, SPEED_MPS, atol=0.1)
    assert np.hypot(*(first - second).T).min() >= APART_M
    assert np.ptp(first, axis=0).max() > 1.0


def test_long_lanes_are_given_up_where_they_leave_no_room_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    far = np.full((400, 2), 9.0)
    place, rng = ground(1.8), np.random.default_rng(0)
    assert len(people._free_walks(place, far, 3, LENGTHS_M, rng)) == 2
    first, second, third = walks(monkeypatch, 1.8, far, 3)
    for one, other in ((first, second), (first, third), (second, third)):
        assert np.hypot(*(one - other).T).min() >= APART_M


def test_too_small_a_ground_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SceneError, match="room for 0 of 1 people"):
        walks(monkeypatch, 1.0, np.zeros((40, 2)), 1)


def test_masks_hide_people_and_a_little_around_them() -> None:
    whose = np.zeros((100, 160), np.uint8)
    whose[40:60, 50:55] = 2
    mask = people_mask(whose)
    rows, columns = np.nonzero(mask == 0)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (38, 61, 48, 56)
    assert (people_mask(np.zeros((10, 10), np.uint8)) == 255).all()
