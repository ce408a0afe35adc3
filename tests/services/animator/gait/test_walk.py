import dataclasses

import numpy as np
import pytest

from readygo.benchmarks.motion.paths import (
    circle,
    dash,
    floor,
    hard_stops,
    line,
    reversal,
    s_curve,
    stop_and_go,
    times,
    turn_in_place,
)
from readygo.common.errors import MotionError
from readygo.common.frames import matrix_from_axis_angle
from readygo.services.animator import measure, skeleton_of
from readygo.services.animator.gait.path import run_share
from readygo.services.animator.gait.quality import cadence_per_min, heights_above, joints_of, sole_points
from tests.services.animator.bodies import make_avatar

FLAT = floor()
SLOPE = floor(lambda x, y: 0.10 * x + 0.05 * y)
BUMPS = floor(lambda x, y: 0.03 * np.sin(2.0 * x) * np.cos(1.5 * y))

# At 20 Hz CMU mocap 02_01 and 02_02 (1.2 and 1.6 m/s) reach 427 deg/s at the knee, and 135..190 m/s3 mean and
# 826 m/s3 largest jerk at the joints of the legs.
JOINT_SPEED_MAX_DEGPS = 650.0
JERK_MAX_MPS3 = 1600.0
# A root that stops and starts from one row to the next is no mocap; the legs still have to catch up with it.
ABRUPT = {"short pause": 1.4, "long pause": 1.3}

PATHS = {
    "line": line,
    "circle": circle,
    "s-curve": s_curve,
    "stop-and-go": stop_and_go,
    "turn": turn_in_place,
    "short pause": lambda v: hard_stops(v, 0.5),
    "long pause": lambda v: hard_stops(v, 2.0),
}


def yaw(R):
    """Heading of the forward axis of rotations whose third column is forward, in the z-up world."""
    return np.arctan2(R[..., 1, 2], R[..., 0, 2])


def side_yaw(R):
    """Heading across the left axis: does not see the pitch of a rolling foot."""
    return np.arctan2(-R[..., 0, 0], R[..., 1, 0])


def turned_deg(a, b):
    return np.degrees((a - b + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.parametrize("speed", [0.4, 0.8, 1.2, 1.4])
@pytest.mark.parametrize("name", PATHS)
def test_feet_stay_planted_and_legs_stay_human(name, speed, avatar, animate):
    xy = PATHS[name](speed)
    quality = measure(animate(xy, FLAT, style=1.0), avatar, FLAT, xy)
    assert quality.skate_mean_cmps <= 1.0
    assert quality.skate_max_cmps <= 5.0
    assert quality.penetration_max_mm <= 5.0
    assert quality.hover_max_mm <= 10.0
    assert quality.root_error_max_cm <= 2.0
    assert quality.knee_min_deg >= 0.5
    assert quality.knee_max_deg <= 80.0
    assert quality.elbow_min_deg >= 0.0
    assert quality.joint_speed_max_degps <= JOINT_SPEED_MAX_DEGPS * ABRUPT.get(name, 1.0)
    assert quality.jerk_max_mps3 <= JERK_MAX_MPS3 * ABRUPT.get(name, 1.0)


@pytest.mark.parametrize("name", ["line", "circle", "s-curve", "stop-and-go", "turn"])
def test_fast_walks_hold_the_gates_of_feet_and_knees(name, avatar, animate):
    xy = PATHS[name](2.0)
    quality = measure(animate(xy, FLAT, style=1.0), avatar, FLAT, xy)
    assert quality.skate_mean_cmps <= 1.0
    assert quality.skate_max_cmps <= 5.0
    assert quality.penetration_max_mm <= 5.0
    assert quality.airborne_max_mm <= 10.0
    assert quality.root_error_max_cm <= 2.0
    assert quality.knee_min_deg >= 0.5
    assert quality.knee_max_deg <= 80.0


@pytest.mark.parametrize("speed", [2.5, 3.0, 3.5])
def test_runs_have_flight_and_feet_that_stay_where_they_land(speed, avatar, animate):
    xy = dash(speed)
    motion = animate(xy, FLAT, style=1.0)
    quality = measure(motion, avatar, FLAT, xy)
    assert quality.skate_mean_cmps <= 1.0
    assert quality.skate_max_cmps <= 10.0
    assert quality.penetration_max_mm <= 5.0
    assert quality.hover_max_mm <= 10.0
    assert quality.root_error_max_cm <= 2.0
    assert 95.0 <= quality.knee_max_deg <= 126.0
    heights = heights_above(sole_points(*joints_of(motion, avatar), skeleton_of(avatar)), FLAT)
    flying = heights[60:140].min(axis=(1, 2)) > 0.01
    assert 0.15 <= flying.mean() <= 0.5
    assert not (heights[:10].min(axis=(1, 2)) > 0.01).any()


def test_run_has_the_cadence_and_the_bounce_of_runners(avatar, animate):
    motion = animate(line(2.9), floor(half_m=20.0))
    rows = slice(50, 160)
    run = dataclasses.replace(motion, root_m=motion.root_m[rows], pose_axis_angle=motion.pose_axis_angle[rows])
    assert cadence_per_min(run, avatar) == pytest.approx(157.0, rel=0.10)
    assert 0.08 <= np.ptp(run.root_m[:, 2]) <= 0.14


def test_walk_turns_into_a_run_once_not_at_every_change_of_pace():
    pace = 2.1 + 0.08 * np.sin(np.linspace(0.0, 30.0, 200))
    assert run_share(pace, 1.0).max() < 1e-9
    pace[:20] = 3.0
    assert run_share(pace, 1.0).min() > 1.0 - 1e-9
    assert run_share(np.full(20, 1.9), 1.0).max() == 0.0
    # Longer legs run later.
    assert run_share(np.full(20, 2.3), 1.2).max() == 0.0


@pytest.mark.parametrize("ground", [SLOPE, BUMPS], ids=["slope", "bumps"])
@pytest.mark.parametrize("path", [line, circle], ids=["line", "circle"])
def test_soles_lie_on_uneven_floor(path, ground, avatar, animate):
    xy = path(1.2)
    motion = animate(xy, ground)
    quality = measure(motion, avatar, ground, xy)
    assert quality.penetration_max_mm <= 5.0
    assert quality.hover_max_mm <= 10.0
    assert quality.skate_max_cmps <= 5.0
    heights = heights_above(sole_points(*joints_of(motion, avatar), skeleton_of(avatar)), ground)
    planted = np.sort(heights.reshape(len(heights), 2, 5), axis=2)
    whole = planted[:, :, 1].min(axis=1) < 0.003
    assert whole.mean() > 0.3
    flat = planted[:, :, 4] < 0.02
    assert planted[:, :, 4][flat].max() <= 0.02
    assert np.median(np.abs(planted[:, :, 4][flat])) <= 0.01


@pytest.mark.parametrize("speed", [0.9, 1.2, 1.6])
def test_cadence_and_step_length_match_the_mocap_fits(speed, avatar, animate):
    motion = animate(line(speed, 12.0), FLAT)
    rows = slice(0, 240)
    walked = dataclasses.replace(motion, root_m=motion.root_m[rows], pose_axis_angle=motion.pose_axis_angle[rows])
    size = skeleton_of(avatar).size
    scaled = speed / np.sqrt(size)
    cadence = cadence_per_min(walked, avatar)
    assert cadence == pytest.approx((66.4 + 38.9 * scaled) / np.sqrt(size), rel=0.10)
    assert 60.0 * speed / cadence == pytest.approx((0.158 + 0.417 * scaled) * size, rel=0.10)


def test_pelvis_oscillates_as_in_mocap(avatar, animate):
    motion = animate(line(1.2, 12.0), FLAT)
    steady = motion.root_m[40:220, 2]
    assert 0.025 <= np.ptp(steady) <= 0.045


def test_leg_curves_follow_mocap(avatar, animate):
    _, P = joints_of(animate(line(1.2, 12.0), FLAT), avatar)
    P = P[40:220]

    def from_vertical_deg(a, b):
        bone = P[:, b] - P[:, a]
        return np.degrees(np.arctan2(bone[:, 0], -bone[:, 2]))

    thigh, shin = from_vertical_deg(1, 4), from_vertical_deg(4, 7)
    # CMU 02_01 at 1.18 m/s: thigh -18..31 deg, knee 10..73 deg.
    assert -22.0 < thigh.min() < -10.0
    assert 26.0 < thigh.max() < 40.0
    assert 5.0 < (thigh - shin).min() < 15.0
    assert 62.0 < (thigh - shin).max() < 80.0


def test_arms_hang_at_the_sides_and_swing_against_the_legs(avatar, animate):
    G, P = joints_of(animate(line(1.2, 12.0), FLAT), avatar)
    P, across = P[40:220], G[40:220, 0, :, 0]
    for side, sign in ((0, 1.0), (1, -1.0)):
        wrist = P[:, 20 + side] - P[:, 16 + side]
        assert (wrist[:, 2] < -0.38).all(), "hands hang well below the shoulders"
        out = sign * np.einsum("ti,ti->t", wrist, across)
        assert out.min() > -0.02
        assert out.max() < 0.22
        swing, step = P[:, 20 + side, 0] - P[:, 0, 0], P[:, 7 + side, 0] - P[:, 0, 0]
        assert np.ptp(swing) > 0.2
        assert np.corrcoef(swing, step)[0, 1] < -0.5


def test_palms_face_the_thighs(avatar, animate):
    G, _ = joints_of(animate(np.zeros((40, 2)), FLAT), avatar)
    left_palm, right_palm = -G[:, 20, :, 1], -G[:, 21, :, 1]
    left = G[:, 0, :, 0]
    assert (np.einsum("ti,ti->t", left_palm, left) < -0.8).all()
    assert (np.einsum("ti,ti->t", right_palm, left) > 0.8).all()


def test_head_and_chest_stay_upright(avatar, animate):
    G, _ = joints_of(animate(s_curve(1.3), FLAT), avatar)
    for joint in (9, 15):
        assert np.degrees(np.arccos(G[:, joint, 2, 1])).max() < 15.0


def test_heading_follows_the_path(avatar, animate):
    xy = circle(1.0)
    G, _ = joints_of(animate(xy, FLAT), avatar)
    way = np.diff(xy, axis=0)
    rows = slice(20, 180)
    off = turned_deg(yaw(G[:-1, 15])[: len(way)][rows], np.arctan2(way[:, 1], way[:, 0])[rows])
    assert np.abs(off).max() < 25.0
    chest = turned_deg(yaw(G[:-1, 9])[: len(way)][rows], np.arctan2(way[:, 1], way[:, 0])[rows])
    assert np.abs(chest).max() < 15.0


def test_starts_in_mid_gait_when_the_first_rows_move(avatar, animate):
    reach = []
    for seed in range(8):
        _, P = joints_of(animate(line(1.2), FLAT, seed=seed, style=1.0), avatar)
        reach.append(abs(P[0, 7, 0] - P[0, 8, 0]))
        assert np.linalg.norm(P[1, 0, :2] - P[0, 0, :2]) == pytest.approx(0.06, abs=0.012)
    assert np.ptp(reach) > 0.15, "people do not march in step"


def test_starts_from_a_stand_when_the_first_rows_stand(avatar, animate):
    _, P = joints_of(animate(stop_and_go(1.2), FLAT), avatar)
    assert np.linalg.norm(P[0, 7, :2] - P[0, 8, :2]) < 0.3
    assert abs(P[0, 7, 0] - P[0, 8, 0]) < 0.06


@pytest.mark.parametrize("speed", [0.3, 0.8, 1.2, 1.4])
def test_ends_in_a_stand_at_the_end_of_the_trajectory(speed, avatar, animate):
    xy = line(speed)
    motion = animate(xy, FLAT, style=1.0)
    G, P = joints_of(motion, avatar)
    assert len(xy) <= len(motion.root_m) <= len(xy) + 30
    assert np.linalg.norm(motion.root_m[-1, :2] - xy[-1]) < 0.02
    assert abs(P[-1, 7, 0] - P[-1, 8, 0]) < 0.08, "feet side by side"
    assert 0.12 < abs(P[-1, 7, 1] - P[-1, 8, 1]) < 0.30
    heights = heights_above(sole_points(G, P, skeleton_of(avatar)), FLAT)
    assert heights[-1].max() < 0.01
    assert np.linalg.norm(P[-1] - P[-2], axis=1).max() < 0.02, "nothing freezes in full motion"


def test_stands_through_a_pause(avatar, animate):
    _, P = joints_of(animate(hard_stops(1.2, 3.0), FLAT), avatar)
    still = P[90:105]
    assert np.ptp(still[:, 7:9], axis=0).max() < 0.005
    assert abs(still[0, 7, 0] - still[0, 8, 0]) < 0.08
    assert np.ptp(still[:, 15, :2], axis=0).max() < 0.03


def test_turns_in_place_before_setting_off_in_another_direction(avatar, animate):
    G, _ = joints_of(animate(stop_and_go(1.0), FLAT), avatar)
    assert abs(turned_deg(yaw(G[90, 9]), 0.0)) < 12.0
    assert abs(turned_deg(yaw(G[140, 9]), np.pi / 2)) < 20.0
    assert abs(turned_deg(yaw(G[-1, 9]), np.pi / 2)) < 5.0


@pytest.mark.parametrize("path", [circle, stop_and_go, reversal], ids=["circle", "stop-and-go", "reversal"])
def test_body_never_twists(path, avatar, animate):
    G, _ = joints_of(animate(path(1.0), FLAT), avatar)
    for joint in (7, 8):
        assert np.abs(turned_deg(side_yaw(G[:, joint]), side_yaw(G[:, 0]))).max() < 70.0
    assert np.abs(turned_deg(side_yaw(G[:, 9]), side_yaw(G[:, 0]))).max() < 20.0


def test_feet_never_cross_on_curves(avatar, animate):
    for path in (circle, s_curve):
        G, P = joints_of(animate(path(1.2), FLAT), avatar)
        apart = np.einsum("ti,ti->t", P[:, 7] - P[:, 8], G[:, 0, :, 0])
        assert apart.min() > 0.04


def test_one_point_stands_and_idles_for_a_whole_episode(avatar, animate):
    motion = animate(np.array([[2.0, -1.0]]), SLOPE)
    assert len(motion.root_m) == 1000
    assert np.ptp(motion.root_m[500:, 0]) > 0.002
    assert motion.root_m[0, :2] == pytest.approx([2.0, -1.0], abs=0.02)
    heights = heights_above(sole_points(*joints_of(motion, avatar), skeleton_of(avatar)), SLOPE)
    assert np.abs(heights).max() < 0.01


def test_standing_human_sways_but_does_not_step(avatar, animate):
    _, P = joints_of(animate(np.zeros((200, 2)), FLAT), avatar)
    assert 0.002 < np.ptp(P[:, 0, :2], axis=0).max() < 0.03
    assert np.ptp(P[:, 7:9], axis=0).max() < 1e-5


def test_standing_human_shifts_the_weight_from_one_leg_to_the_other(avatar, animate):
    G, P = joints_of(animate(np.array([[0.0, 0.0]]), FLAT), avatar)
    list_deg = np.degrees(np.arcsin(G[:, 0, 2, 0]))
    assert list_deg.max() > 1.0
    assert list_deg.min() < -1.0
    assert np.linalg.norm(P[:, 0, :2], axis=1).max() < 0.02
    hips = np.linalg.norm(P[:, 1:3] - P[:, 7:9], axis=2)
    assert hips.max() <= skeleton_of(avatar).leg_m


def test_slow_creep_is_stepped_after_not_slid(avatar, animate):
    xy = np.stack([0.02 * times(20.0), 0.0 * times(20.0)], axis=1)
    quality = measure(animate(xy, FLAT), avatar, FLAT, xy)
    assert quality.skate_max_cmps <= 5.0
    assert quality.knee_max_deg <= 80.0


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda xy: xy.__setitem__((7, 1), np.nan), r"Row 7 .* not finite"),
        (lambda xy: xy.__setitem__((7, 0), np.inf), r"Row 7 .* not finite"),
        (lambda xy: xy.__iadd__((np.arange(len(xy)) > 30)[:, None] * 0.5), r"jumps at .* m/s from row 30 to 31"),
    ],
)
def test_impossible_trajectories_are_refused(spoil, message, animate):
    xy = line(1.2)
    spoil(xy)
    with pytest.raises(MotionError, match=message):
        animate(xy, FLAT)


def test_empty_trajectory_is_refused(animate):
    with pytest.raises(MotionError, match="at least one row"):
        animate(np.empty((0, 2)), FLAT)


def test_same_seed_same_motion_other_seed_other_style(animate):
    xy = s_curve(1.1)
    one, again, other = (animate(xy, FLAT, seed=seed, style=1.0) for seed in (3, 3, 4))
    assert np.array_equal(one.root_m, again.root_m)
    assert np.array_equal(one.pose_axis_angle, again.pose_axis_angle)
    assert not np.array_equal(one.pose_axis_angle, other.pose_axis_angle)


def test_read_only_inputs_are_fine(avatar, animate):
    xy, ground = line(1.2), floor()
    expected = animate(xy, ground)
    xy.setflags(write=False)
    ground.height_m.setflags(write=False)
    assert np.array_equal(animate(xy, ground).pose_axis_angle, expected.pose_axis_angle)


@pytest.mark.parametrize("scale", [0.8, 1.15])
def test_small_and_tall_humans_walk_too(scale, animate):
    body = make_avatar(scale=scale)
    xy = line(1.1)
    quality = measure(animate(xy, FLAT, body=body, style=1.0), body, FLAT, xy)
    assert quality.skate_max_cmps <= 5.0
    assert quality.penetration_max_mm <= 5.0
    assert quality.root_error_max_cm <= 2.0
    assert quality.knee_max_deg <= 80.0


def test_pose_rotations_are_continuous_in_joint_zero(animate):
    motion = animate(circle(1.2), FLAT)
    R = matrix_from_axis_angle(motion.pose_axis_angle[:, 0])
    step = np.degrees(np.arccos(np.clip((np.einsum("tab,tab->t", R[:-1], R[1:]) - 1.0) / 2.0, -1.0, 1.0)))
    assert step.max() < 8.0


@pytest.mark.parametrize(
    ("name", "xy", "ground", "scale"),
    [
        ("winding", s_curve(0.9), BUMPS, 0.83), ("turning", turn_in_place(1.3) * [-1.0, 1.0], SLOPE, 1.0),
        ("running", dash(3.1), FLAT, 1.07), ("pausing", hard_stops(1.2, 0.9) * [1.0, -1.0], BUMPS, 1.0),
        ("going back", reversal(0.7), SLOPE, 0.9), ("standing", np.array([[0.4, -0.3]]), BUMPS, 1.0),
    ],
)  # fmt: skip
def test_motion_of_a_seed_is_as_it_was(name, xy, ground, scale, animate, golden_figures):
    motion = animate(xy, ground, body=make_avatar(scale=scale), seed=7, style=1.0)
    golden_figures(f"gait/{name}", 5.0 * motion.root_m[:240], motion.pose_axis_angle[:240])
