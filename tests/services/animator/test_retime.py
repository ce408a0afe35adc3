import numpy as np
import pytest

from readygo.common.maps import FloorMap, GridFrame
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
