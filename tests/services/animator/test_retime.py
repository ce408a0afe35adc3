import numpy as np
import pytest

from readygo.benchmarks.motion.paths import s_curve
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.messages import Motion
from readygo.services.animator.retime import BODY_TURN_RADPS, RetimedWalk

FLOOR = FloorMap(
    frame=GridFrame(origin_x_m=-5.0, origin_y_m=-5.0, resolution_m=0.5), height_m=np.zeros((40, 60), np.float32)
)


@pytest.fixture(scope="module")
def motion(animate):
    return animate(np.stack([np.arange(100) * 0.06, np.zeros(100)], axis=1), FLOOR)


def steps(walk, velocities):
    xy = np.zeros(2)
    for velocity in velocities:
        xy = xy + 0.05 * np.asarray(velocity)
        yield walk.advance(xy, np.asarray(velocity, float))


def test_same_pace_is_the_same_walk(motion):
    roots, poses = zip(*steps(RetimedWalk(motion, FLOOR), [(1.2, 0.0)] * 60), strict=True)
    assert np.array(poses)[:, 1:] == pytest.approx(motion.pose_axis_angle[1:61, 1:].astype(float), abs=0.4)
    assert np.array(roots)[:, 2] == pytest.approx(motion.root_m[1:61, 2].astype(float), abs=0.02)


def test_half_the_pace_takes_twice_as_long_for_the_same_steps(motion):
    slow = [pose for _, pose in steps(RetimedWalk(motion, FLOOR), [(0.6, 0.0)] * 80)]
    assert slow[79][1:] == pytest.approx(motion.pose_axis_angle[40, 1:].astype(float), abs=0.15)


def test_who_stands_has_the_standing_pose(motion):
    *_, (root, pose) = steps(RetimedWalk(motion, FLOOR), [(1.2, 0.0)] * 30 + [(0.0, 0.0)] * 2)
    assert pose[1:] == pytest.approx(motion.pose_axis_angle[-1, 1:].astype(float), abs=1e-5)
    assert root[2] == pytest.approx(float(motion.root_m[-1, 2]), abs=1e-4)


def test_who_goes_farther_than_was_drawn_keeps_walking_without_jumps(motion):
    poses = np.array([pose for _, pose in steps(RetimedWalk(motion, FLOOR), [(1.2, 0.0)] * 200)])
    changes = np.abs(np.diff(poses[:, 1:], axis=0)).max(axis=(1, 2))
    assert changes[110:].mean() > 0.02, "still walking long after the drawn way is over"
    assert changes.max() < 0.9


def test_body_turns_to_where_it_goes_no_faster_than_bodies_turn(motion):
    walk = RetimedWalk(motion, FLOOR)
    before = walk._yaw_rad
    list(steps(walk, [(0.0, 1.0)]))
    assert walk._yaw_rad - before == pytest.approx(BODY_TURN_RADPS * 0.05)
    list(steps(walk, [(0.0, 1.0)] * 20))
    assert walk._yaw_rad == pytest.approx(np.pi / 2, abs=1e-6)


def test_way_of_somebody_else_is_walked_as_it_was(animate, golden_figures):
    """Of a bent walk over uneven ground: slow, fast, on the spot, backwards and far beyond the drawn way."""
    height = np.random.default_rng(1).uniform(0.0, 0.1, (40, 60)).astype(np.float32)
    uneven = FloorMap(frame=FLOOR.frame, height_m=height)
    drawn = animate(s_curve(1.1)[:130], uneven, seed=3, style=1.0)
    walk = RetimedWalk(drawn, uneven)
    at_rest = walk.advance(np.zeros(2), np.zeros(2))
    assert at_rest[0][2] - uneven.at(0.0, 0.0) == pytest.approx(float(walk._height_m[-1]))
    velocities = [(0.7, 0.3)] * 40 + [(1.6, -0.2)] * 90 + [(0.05, 0.02)] * 15 + [(-0.9, 0.5)] * 60 + [(0.2, 0.25)] * 20
    rows = [[*root, *pose.ravel()] for root, pose in steps(walk, velocities)]
    golden_figures("animator/retimed", np.array(rows))


def test_somebody_who_only_idles_goes_through_the_rows_one_by_one_and_stays_at_the_last():
    pose = np.zeros((3, 24, 3), np.float32)
    pose[:, 5, 0] = 0.1, 0.2, 0.3
    idle = RetimedWalk(Motion(root_m=np.full((3, 3), 0.9, np.float32), pose_axis_angle=pose), FLOOR)
    assert [turned[5, 0] for _, turned in steps(idle, [(0.0, 0.0)] * 4)] == pytest.approx([0.2, 0.3, 0.3, 0.3])
