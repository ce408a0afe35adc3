import math

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.maps import GridFrame
from readygo.common.perception.people import NOBODY, People
from readygo.common.perception.tracker import PeopleTracker

FRAME = GridFrame(origin_x_m=-5.0, origin_y_m=-5.0, resolution_m=0.1)
DT_S = 0.1


def seen(*rows: tuple[float, float, float, float], sd: float = 0.1, presence: float = 0.9) -> People:
    told = np.array(rows).reshape(-1, 4)
    cov = np.tile(sd**2 * np.eye(2), (len(told), 1, 1))
    return People(
        presence=np.full(len(told), presence),
        xy_m=told[:, :2],
        place_cov=cov,
        v_mps=told[:, 2:],
        velocity_cov=cov + 0.2**2 * np.eye(2),
    )


def everywhere(x_m: float, y_m: float) -> bool:
    return True


def nowhere(x_m: float, y_m: float) -> bool:
    return False


def clearance(wall_x_m: float = 1.5) -> Float64Array:
    """A wall to the right of a line."""
    x = -5.0 + 0.1 * (np.arange(100) + 0.5)
    return np.tile(np.clip(wall_x_m - x, 0.0, None), (100, 1))


def walk(tracker: PeopleTracker, steps: int, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    for step in range(steps):
        if step:
            tracker.predict(DT_S)
        tracker.fuse(pose, seen((-1.0 + 0.1 * step, 2.0, 1.0, 0.0)), everywhere)


def test_human_who_walks_is_one_track_with_its_velocity() -> None:
    tracker = PeopleTracker(None, None)
    walk(tracker, 12)
    (track,) = tracker.known
    np.testing.assert_allclose(track.mean, [0.1, 2.0, 1.0, 0.0], atol=0.02)
    assert track.hits == 12


def test_velocity_follows_from_places_alone_where_told_ones_are_left_out() -> None:
    """People who walk at 1 m/s, of whom every look tells that they stand."""
    velocities = []
    for told in (True, False):
        tracker = PeopleTracker(None, None, velocities=told)
        for step in range(12):
            if step:
                tracker.predict(DT_S)
            tracker.fuse((0.0, 0.0, 0.0), seen((-1.0 + 0.1 * step, 2.0, 0.0, 0.0), sd=0.03), everywhere)
        velocities.append(tracker.known[0].mean[2])
    assert velocities[0] < 0.7
    assert velocities[1] == pytest.approx(1.0, abs=0.05)
    first = PeopleTracker(None, None, velocities=False)
    first.fuse((0.0, 0.0, 0.0), seen((2.0, 0.0, 1.0, 0.0)), everywhere)
    assert first.tracks[0].mean[2:].tolist() == [0.0, 0.0]


def test_detections_are_turned_from_the_robots_frame() -> None:
    tracker = PeopleTracker(None, None, velocities=True)
    tracker.fuse((1.0, 1.0, math.pi / 2), seen((2.0, 0.0, 1.0, 0.0)), everywhere)
    np.testing.assert_allclose(tracker.tracks[0].mean[:2], [1.0, 3.0], atol=1e-9)
    assert tracker.tracks[0].mean[3] > 0.8


def test_two_who_cross_stay_two() -> None:
    tracker = PeopleTracker(None, None)
    for step in range(20):
        if step:
            tracker.predict(DT_S)
        x = -1.0 + 0.1 * step
        tracker.fuse((0.0, 0.0, 0.0), seen((x, 2.0, 1.0, 0.0), (-x, 2.2, -1.0, 0.0)), everywhere)
    assert sorted(round(float(track.mean[2]), 1) for track in tracker.known) == [-1.0, 1.0]
    assert [track.number for track in tracker.tracks] == [0, 1]


def test_one_doubtful_detection_is_not_told_and_a_second_one_is() -> None:
    tracker = PeopleTracker(None, None)
    tracker.fuse((0.0, 0.0, 0.0), seen((1.0, 0.0, 0.0, 0.0), presence=0.2), everywhere)
    assert tracker.tracks
    assert not tracker.known
    tracker.predict(DT_S)
    tracker.fuse((0.0, 0.0, 0.0), seen((1.0, 0.0, 0.0, 0.0), presence=0.8), everywhere)
    assert tracker.known


def test_who_should_be_seen_and_is_not_is_forgotten_before_who_is_hidden() -> None:
    shown, hidden = (PeopleTracker(None, None, velocities=True) for _ in range(2))
    for tracker, sight in ((shown, everywhere), (hidden, nowhere)):
        walk(tracker, 5)
        for _ in range(12):
            tracker.predict(DT_S)
            tracker.fuse((0.0, 0.0, 0.0), NOBODY, sight)
    assert not shown.known
    assert hidden.known[0].mean[0] == pytest.approx(-0.6 + 1.2, abs=0.1)
    for _ in range(30):
        hidden.predict(DT_S)
    assert not hidden.tracks


def test_nobody_walks_into_a_wall() -> None:
    tracker = PeopleTracker(clearance(), FRAME)
    walk(tracker, 12)
    for _ in range(30):
        tracker.predict(DT_S)
    assert tracker.known[0].mean[0] < 1.5
    assert tracker.known[0].mean[2] == 0.0
    free = PeopleTracker(None, None)
    walk(free, 12)
    for _ in range(30):
        free.predict(DT_S)
    assert free.known[0].mean[0] > 2.5


@pytest.mark.parametrize("late_s", [0.2, 0.3])
def test_tracks_of_late_images_do_not_walk_into_walls(late_s: float) -> None:
    tracker = PeopleTracker(clearance(), FRAME)
    for step in range(8):
        if step:
            tracker.predict(DT_S)
        # In front of the wall at 1.5 m when the image was taken, behind it by now at that velocity.
        look = seen((0.25 + 0.14 * step, 2.0, 1.4, 0.0), sd=0.03)
        tracker.fuse((0.0, 0.0, 0.0), look, everywhere, late_s=late_s)
    assert tracker.known[0].age_s == pytest.approx(late_s)
    for _ in range(30):
        tracker.predict(DT_S)
    assert tracker.known[0].mean[0] < 1.5


def test_detection_inside_of_a_wall_is_not_believed() -> None:
    tracker = PeopleTracker(clearance(), FRAME)
    tracker.fuse((0.0, 0.0, 0.0), seen((2.5, 0.0, 0.0, 0.0)), everywhere)
    assert not tracker.tracks
    tracker.fuse((0.0, 0.0, 0.0), seen((1.6, 0.0, 0.0, 0.0)), everywhere)
    assert tracker.tracks


def test_track_of_few_detections_ends_soon() -> None:
    for hits, lasts in ((2, False), (3, True)):
        tracker = PeopleTracker(None, None)
        walk(tracker, hits)
        for _ in range(7):
            tracker.predict(DT_S)
        assert bool(tracker.tracks) is lasts


def test_of_two_tracks_in_one_place_the_better_known_one_stays() -> None:
    tracker = PeopleTracker(None, None)
    walk(tracker, 6)
    x = float(tracker.tracks[0].mean[0])
    # Far from where the track may be, and then on it.
    tracker.fuse((0.0, 0.0, 0.0), seen((x, 3.5, 0.0, 0.0)), nowhere)
    assert len(tracker.tracks) == 2
    tracker.tracks[1].mean[:] = x, 2.1, 1.0, 0.0
    tracker.fuse((0.0, 0.0, 0.0), NOBODY, nowhere)
    assert [track.number for track in tracker.tracks] == [0]
