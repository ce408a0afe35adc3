import dataclasses
import math

import numpy as np
import pytest

from readygo.apps.drive.calibration import Rectifier
from readygo.apps.drive.messages import GoalMessage, ImageMessage, OdometryMessage, VelocityMessage
from readygo.apps.drive.pilot import DriveConfig, Pilot, TrialEnding, limit_speeds, words_of
from readygo.common.frames import goal_in_robot_frame
from readygo.common.messages import Outcome
from readygo.common.policy import load_policy
from readygo.common.robot import RobotConfig, limit_command, step_unicycle
from readygo.common.robot.kinematics import STEP_NS
from tests.apps.drive.conftest import CAMERA, T0, S, odometry, picture
from tests.common.policy.artifacts import graph_seeing, write_policy


def test_robot_is_driven_as_in_an_evaluation_step_by_step(tmp_path):
    policy, robot = load_policy(write_policy(tmp_path)), RobotConfig()
    goal, now_ns = (5.0, 1.0), 10**9
    config = DriveConfig(v_max_mps=1.0, w_max_radps=1.2, goal_in_start_frame=False)
    pilot = Pilot(policy, {"": Rectifier(CAMERA, CAMERA)}, config, GoalMessage(x_m=goal[0], y_m=goal[1]))
    memory, pose, moving, driven, expected = policy.start(), (0.0, 0.0, 0.0), (0.0, 0.0), [], []
    for step in range(60):
        image = np.random.default_rng(step).integers(0, 256, (8, 10, 3), dtype=np.uint8)
        pilot.hear(
            OdometryMessage(
                stamp_ns=T0 + now_ns,
                **dict(zip(("x_m", "y_m", "yaw_rad"), pose, strict=True)),
                v_mps=moving[0],
                w_radps=moving[1],
            ),
            now_ns,
        )
        pilot.look(ImageMessage(stamp_ns=T0 + now_ns, decode=lambda image=image: image[..., ::-1]), now_ns)
        command = pilot.command(now_ns)
        there = np.array([goal_in_robot_frame(*pose, goal)], np.float32)
        v, w = policy.step([memory], image[None], np.array([moving], np.float32), there)[0].tolist()
        moving = limit_command(v, w, *moving, robot, 0.05)
        driven.append((command.v_mps, command.w_radps))
        expected.append(moving)
        pose, now_ns = step_unicycle(*pose, *moving, 0.05), now_ns + STEP_NS
    assert np.abs(np.array(expected)).max(axis=0).min() > 0
    assert np.allclose(driven, expected, atol=1e-5)


def test_robot_stands_until_it_has_images_and_odometry_and_then_speeds_up_within_its_limits(make_ride):
    ride = make_ride()
    assert ride.step(images=False) == VelocityMessage()
    assert ride.pilot.waiting_for == "no images"
    second, third = ride.step(), ride.step()
    assert ride.pilot.started_ns is not None
    assert (second.v_mps, second.w_radps) == pytest.approx((0.05, 0.15))
    assert (third.v_mps, third.w_radps) == pytest.approx((0.10, 0.30))
    assert (ride.steps(40).v_mps, ride.commands[-1].w_radps) == pytest.approx((1.0, 0.5))


def test_lower_limits_hold_and_higher_ones_are_refused(make_ride):
    last = make_ride(v_max_mps=0.3, w_max_radps=0.2).steps(40)
    assert (last.v_mps, last.w_radps) == pytest.approx((0.3, 0.2))
    with pytest.raises(ValueError, match="v_max_mps must be above 0 and at most 1, what the policy learned, got 2"):
        limit_speeds(RobotConfig(), DriveConfig(v_max_mps=2.0, w_max_radps=1.0))


@pytest.mark.parametrize(("missing", "words"), [("images", "no new images"), ("moves", "no new odometry")])
def test_robot_stands_while_something_is_older_than_a_third_of_a_second_and_goes_on_after(make_ride, missing, words):
    ride = make_ride()
    ride.steps(20)
    assert ride.steps(6, **{missing: False}).v_mps > 0
    assert ride.step(**{missing: False}) == VelocityMessage()
    assert ride.pilot.waiting_for == words
    assert ride.steps(3).v_mps == pytest.approx(0.15)
    assert ride.pilot.ending is None


def test_trial_is_over_when_nothing_comes_for_long(make_ride):
    ride = make_ride()
    ride.steps(20)
    ride.steps(220, images=False)
    assert ride.pilot.ending is TrialEnding.STALE
    assert ride.pilot.reason == "no new images for 10 s"
    assert ride.commands[-1] == VelocityMessage()


def test_late_images_make_the_robot_stand_though_many_come(make_ride):
    ride = make_ride()
    ride.steps(20)
    for _ in range(10):
        ride.pilot.hear(odometry(T0 + ride.now_ns), ride.now_ns)
        ride.step(moves=False, shift_ns=-600_000_000)
    assert ride.commands[-1] == VelocityMessage()


def test_goal_is_where_the_robot_looked_at_the_start_and_is_reached_within_its_radius(make_ride):
    ride = make_ride(goal=(3.0, 0.5))
    ride.step(x_m=10.0, y_m=0.0, yaw_rad=math.pi / 2)
    assert (ride.pilot.goal.x_m, ride.pilot.goal.y_m) == pytest.approx((9.5, 3.0))
    assert ride.policy.goals[0] == pytest.approx((3.0, 0.5))
    for k in range(60):
        ride.step(x_m=10.0, y_m=0.05 * k, yaw_rad=math.pi / 2)
        if ride.pilot.ending:
            break
    assert ride.pilot.ending is TrialEnding.GOAL
    assert ride.pilot.goal_distance_m <= 1.0
    assert ride.commands[-1] == VelocityMessage()
    assert ride.pilot.driven_m == pytest.approx(2.15, abs=0.1)


def test_goal_of_the_odometrys_frame_stays_where_it_is(make_ride):
    ride = make_ride(goal=(3.0, 1.0), goal_in_start_frame=False)
    ride.step(x_m=1.0, yaw_rad=math.pi / 2)
    assert ride.policy.goals[0] == pytest.approx((1.0, -2.0))


def test_time_runs_out(make_ride):
    ride = make_ride(time_limit_s=2.0)
    ride.steps(42)
    assert ride.pilot.ending is TrialEnding.LATE
    assert ride.pilot.ending.outcome is Outcome.TIMEOUT


@pytest.mark.parametrize("answer", [(math.nan, 0.0), (0.5, math.inf)])
def test_policy_that_answers_no_number_stops_the_robot(make_ride, fake_policy, answer):
    ride = make_ride(fake_policy(answer))
    assert ride.steps(3) == VelocityMessage()
    assert ride.pilot.ending is TrialEnding.NOT_FINITE


def test_odometry_that_is_no_number_or_leaps_stops_the_robot(make_ride):
    ride = make_ride()
    ride.steps(5)
    assert ride.step(x_m=math.nan) == VelocityMessage()
    assert ride.pilot.ending is TrialEnding.NOT_FINITE
    ride = make_ride()
    ride.steps(5)
    assert ride.step(x_m=4.0) == VelocityMessage()
    assert ride.pilot.reason == "the odometry leapt by 4.0 m"


@pytest.mark.parametrize(("shift_s", "words"), [(-30, "went back by 29"), (30, "jumped ahead by 30.0 s")])
def test_clock_that_is_set_stops_the_robot(make_ride, shift_s, words):
    ride = make_ride()
    ride.steps(5)
    assert ride.step(shift_ns=shift_s * 10**9) == VelocityMessage()
    assert ride.pilot.ending is TrialEnding.CLOCK
    assert words in ride.pilot.reason


def test_images_of_another_size_stop_the_robot(make_ride):
    ride = make_ride()
    ride.steps(5)
    assert ride.step(image_size=(16, 20)) == VelocityMessage()
    assert ride.pilot.reason == "the robot sends images of 16x20 px, and its calibration is of 8x10"


@pytest.mark.parametrize("every", [1, 2, 4])
def test_slower_cameras_lead_to_fewer_decisions_and_no_fewer_commands(make_ride, every):
    ride = make_ride()
    for k in range(41):
        ride.step(images=k % every == 0)
    assert len(ride.policy.seen_ns) == 40 // every + 1
    assert ride.commands[-1].v_mps == pytest.approx(1.0)


def test_heading_is_followed_around_the_circle(make_ride):
    ride = make_ride()
    for k in range(80):
        ride.step(yaw_rad=math.atan2(math.sin(0.1 * k), math.cos(0.1 * k)))
    turned = 7.9 % (2 * math.pi)
    assert ride.policy.goals[-1] == pytest.approx((5 * math.cos(turned), -5 * math.sin(turned)), abs=1e-4)


class DepthRide:
    """A pilot whose policy sees depths, and a robot that sends them beside its images."""

    def __init__(self, fake_policy):
        self.policy, self.sights = fake_policy((1.0, 0.0)), []
        spec = self.policy.spec
        self.policy.spec = dataclasses.replace(spec, graph=graph_seeing(("rgb", "depth")))
        see = self.policy.see
        self.policy.see = lambda memories, images, times: (self.sights.append(images[0]), see(memories, images, times))
        config = DriveConfig(v_max_mps=1.0, w_max_radps=1.2)
        camera = spec.robot.camera
        self.pilot = Pilot(self.policy, {"": Rectifier(camera, camera)}, config, GoalMessage(x_m=5.0, y_m=0.0))

    def tell(self, now_ns, *, image=True, depth_m=5.0, depth_late_ns=0):
        stamp_ns = T0 + now_ns
        self.pilot.hear(odometry(stamp_ns), now_ns)
        if image:
            self.pilot.look(picture(stamp_ns), now_ns)
        if depth_m is not None:
            depths = np.full((8, 10), depth_m, np.float32)
            self.pilot.look(ImageMessage(stamp_ns=stamp_ns, decode=lambda: depths), now_ns + depth_late_ns, "depth")
        return self.pilot.command(now_ns + depth_late_ns)


def test_policy_sees_depths_of_the_images_time_whichever_comes_first(fake_policy):
    ride = DepthRide(fake_policy)
    assert ride.tell(0, depth_m=None).v_mps == 0.0
    assert ride.pilot.waiting_for == "no depths"
    for step in range(1, 4):
        ride.tell(step * STEP_NS, depth_m=5.0 if step < 3 else np.inf)
    assert ride.pilot.seen == 3
    assert [sight[0, 0].tolist() for sight in ride.sights] == [[0, 0, 0, level] for level in (128, 128, 0)]
    assert ride.pilot.command(4 * STEP_NS).v_mps > 0


def test_robot_whose_depths_stay_away_stands(fake_policy):
    ride = DepthRide(fake_policy)
    for step in range(20):
        command = ride.tell(step * STEP_NS, depth_m=5.0 if step < 5 else None)
    assert command.v_mps == 0.0
    assert ride.pilot.waiting_for == "no new depths"


class ThreeCameraRide:
    """A pilot whose policy sees with three cameras, and a robot that stands and sends their images."""

    def __init__(self, fake_policy, camera_hz=20):
        self.policy = fake_policy((1.0, 0.0))
        camera = self.policy.spec.robot.camera
        robot = RobotConfig(camera=camera, camera_hz=camera_hz, cameras={"left": camera, "right": camera})
        graph = graph_seeing(("rgb", "left.rgb", "right.rgb"))
        self.policy.spec = dataclasses.replace(self.policy.spec, robot=robot, graph=graph)
        rectify = dict.fromkeys(("", "left", "right"), Rectifier(camera, camera))
        config = DriveConfig(v_max_mps=1.0, w_max_radps=1.2)
        self.pilot = Pilot(self.policy, rectify, config, GoalMessage(x_m=5.0, y_m=0.0))
        self.due = []

    def run(self, seconds, *, every_ns=STEP_NS, taken_ns=None, late_ns=None, without=()):
        """Send images by name: taken so long after the first camera's, and so long on their way [ns]."""
        begin_ns = self.due[-1][0] if self.due else 0
        for now_ns in range(begin_ns, begin_ns + round(seconds * S), every_ns):
            self.due.append((now_ns, None, now_ns))
            for name in set(self.pilot.images) - set(without):
                stamp_ns = now_ns + (taken_ns or {}).get(name, 0)
                self.due.append((stamp_ns + (late_ns or {}).get(name, 0), name, stamp_ns))
        self.due.sort(key=lambda each: each[0])
        for now_ns, name, stamp_ns in self.due:
            if name is None:
                self.pilot.hear(odometry(T0 + stamp_ns), now_ns)
            else:
                self.pilot.look(picture(T0 + stamp_ns), now_ns, name)
            command = self.pilot.command(now_ns)
        self.due = self.due[-1:]
        return command


def test_images_of_a_camera_that_come_a_whole_image_later_are_seen_together(fake_policy):
    ride = ThreeCameraRide(fake_policy)
    assert ride.run(2.0, late_ns={"left.rgb": 120_000_000, "right.rgb": 30_000_000}).v_mps > 0
    assert ride.pilot.seen >= 36
    assert ride.policy.seen_ns[10] - T0 == 10 * STEP_NS, "the stamps are the first camera's"
    assert ride.pilot.frame_age_s == pytest.approx(0.12, abs=1e-6)


def test_cameras_that_take_their_images_at_other_times_are_seen_up_to_half_an_image_apart(fake_policy):
    assert ThreeCameraRide(fake_policy).run(1.0, taken_ns={"left.rgb": 25_000_000}).v_mps > 0
    slow = ThreeCameraRide(fake_policy, camera_hz=10)
    assert slow.run(2.0, every_ns=2 * STEP_NS, taken_ns={"right.rgb": 45_000_000}).v_mps > 0


def test_cameras_that_all_stay_away_are_not_named(fake_policy):
    ride = ThreeCameraRide(fake_policy)
    ride.run(1.0)
    ride.run(0.5, without=ride.pilot.images)
    assert ride.pilot.waiting_for == "no new images"


def test_cameras_whose_clocks_differ_are_told(fake_policy):
    ride = ThreeCameraRide(fake_policy)
    assert ride.run(1.0, taken_ns={"left.rgb": 40_000_000}, every_ns=2 * STEP_NS) == VelocityMessage()
    assert ride.pilot.waiting_for == "no images of one time: images of left are 0.04 s from the first camera's"


@pytest.mark.parametrize(
    ("name", "words"), [("rgb", "images of front"), ("left.rgb", "images of left"), ("right.rgb", "images of right")]
)
def test_robot_stands_without_one_of_its_cameras_and_goes_on_with_it(fake_policy, name, words):
    ride = ThreeCameraRide(fake_policy)
    assert ride.run(0.5, without=(name,)) == VelocityMessage()
    assert ride.pilot.waiting_for == f"no {words}"
    assert ride.run(1.0).v_mps > 0
    assert ride.run(0.5, without=(name,)) == VelocityMessage()
    assert ride.pilot.waiting_for == f"no new {words}"
    assert ride.run(1.0).v_mps > 0
    ride.run(12.0, without=(name,))
    assert (ride.pilot.ending, ride.pilot.reason) == (TrialEnding.STALE, f"no new {words} for 10 s")


def crooked_robot(fake_policy, answer=(0.9, -0.4), **changes):
    """A policy of a robot that drives backwards as well, with other limits and rates."""
    policy = fake_policy(answer)
    limits = {"v_max_mps": 0.9, "v_min_mps": -0.4, "w_max_radps": 0.7, "a_max_mps2": 0.6, "alpha_max_radps2": 1.1}
    robot = RobotConfig(camera=CAMERA, **{**limits, **changes})
    policy.spec = dataclasses.replace(policy.spec, robot=robot)
    return policy


def test_limits_of_a_drive_are_at_most_the_robots_also_backwards():
    robot = RobotConfig(v_max_mps=0.9, v_min_mps=-0.4, w_max_radps=0.7)
    for v_max_mps, v_min_mps in ((0.9, -0.4), (0.25, -0.25)):
        found = limit_speeds(robot, DriveConfig(v_max_mps=v_max_mps, w_max_radps=0.7))
        assert found == dataclasses.replace(robot, v_max_mps=v_max_mps, v_min_mps=v_min_mps)
    for v_max_mps, w_max_radps in ((0.0, 0.5), (0.5, -0.1), (0.91, 0.5), (0.5, 0.71)):
        with pytest.raises(ValueError, match=r"must be above 0 and at most 0\.[79], what the policy learned"):
            limit_speeds(robot, DriveConfig(v_max_mps=v_max_mps, w_max_radps=w_max_radps))


def test_first_command_is_one_step_of_the_robots_clock_and_later_ones_go_by_the_time_between(make_ride, fake_policy):
    ride = make_ride(crooked_robot(fake_policy), v_max_mps=0.9, w_max_radps=0.7)
    ride.now_ns = 20 * S
    ride.step()
    first = ride.commands[-1]
    assert (first.v_mps, first.w_radps) == pytest.approx((0.6 * 0.05, -1.1 * 0.05))
    second = ride.pilot.command(20 * S + 20_000_000)
    assert (second.v_mps, second.w_radps) == pytest.approx((0.6 * 0.07, -1.1 * 0.07))
    third = ride.pilot.command(20 * S + 190_000_000)
    assert (third.v_mps, third.w_radps) == pytest.approx((0.6 * 0.12, -1.1 * 0.12)), "one step at most"


@pytest.mark.parametrize(("control_hz", "camera_hz", "decided"), [(10, 20, 6), (20, 20, 11), (20, 10, 11), (5, 20, 3)])
def test_policy_decides_as_often_as_the_robot_is_commanded(make_ride, fake_policy, control_hz, camera_hz, decided):
    policy = crooked_robot(fake_policy, control_hz=control_hz, camera_hz=camera_hz)
    ride = make_ride(policy, v_max_mps=0.9, w_max_radps=0.7)
    ride.now_ns = S
    for k in range(11):
        ride.step(images=k % (20 // camera_hz) == 0, x_m=0.01 * k)
    assert len(policy.goals) == decided
    assert len(policy.seen_ns) == -(-11 // (20 // camera_hz))


def test_decision_is_taken_with_four_fifths_of_its_time_passed(make_ride, fake_policy):
    for late_ns, decided in ((80_000_000, 1), (80_000_001, 2)):
        policy = crooked_robot(fake_policy, control_hz=10, camera_hz=20)
        ride = make_ride(policy, v_max_mps=0.9, w_max_radps=0.7)
        for now_ns in (S, S + late_ns):
            ride.now_ns = now_ns
            ride.step()
        assert len(policy.goals) == decided


def test_goal_and_what_moves_are_told_as_the_robot_stands(make_ride, fake_policy):
    policy = crooked_robot(fake_policy)
    told = []
    decide = policy.decide
    policy.decide = lambda memories, moving, goals: (told.append((moving, goals)), decide(memories, moving, goals))[1]
    ride = make_ride(policy, goal=(2.0, -1.5), v_max_mps=0.9, w_max_radps=0.7)
    ride.now_ns = S
    ride.pilot.hear(OdometryMessage(stamp_ns=T0 + S, x_m=-3.2, y_m=7.1, yaw_rad=2.5, v_mps=0.35, w_radps=-0.21), S)
    ride.step(moves=False)
    c, s = math.cos(2.5), math.sin(2.5)
    assert (ride.pilot.goal.x_m, ride.pilot.goal.y_m) == pytest.approx((-3.2 + 2 * c + 1.5 * s, 7.1 + 2 * s - 1.5 * c))
    moving, goals = told[0]
    assert moving.tolist() == [pytest.approx([0.35, -0.21])]
    assert goals.tolist() == [pytest.approx([2.0, -1.5], abs=1e-6)]
    assert ride.pilot.straight_m == pytest.approx(2.5 - 1.0)
    assert ride.pilot.moving_mps == 0.35
    assert ride.pilot.words == "goal 2.5 m, v 0.03 m/s, w -0.06 rad/s"


@pytest.mark.parametrize(("away_m", "ending"), [(0.75, TrialEnding.GOAL), (0.76, None)])
def test_robot_has_arrived_on_the_circle_around_the_goal(make_ride, away_m, ending):
    ride = make_ride(goal=(3.0, 1.0), goal_radius_m=0.75, goal_in_start_frame=False)
    ride.step(x_m=3.0 - away_m, y_m=1.0)
    assert ride.pilot.ending is ending


def test_trial_is_late_when_its_time_is_over_and_not_a_step_before(make_ride):
    ride = make_ride(time_limit_s=1.5)
    ride.step(images=False)
    ride.steps(30)
    assert ride.pilot.ending is None
    ride.step()
    assert ride.pilot.ending is TrialEnding.LATE
    ride.pilot.end(TrialEnding.FAILED, "later")
    assert ride.pilot.reason == "out of time", "the first reason counts"


def test_trial_is_given_up_10_seconds_after_something_was_missed_first(make_ride):
    ride = make_ride()
    ride.steps(20)
    ride.steps(207, images=False)
    assert ride.pilot.ending is None
    ride.step(images=False)
    assert ride.pilot.ending is TrialEnding.STALE
    waiting = make_ride()
    waiting.steps(300, images=False)
    assert waiting.pilot.ending is None, "it has not begun"


@pytest.mark.parametrize(("leap_m", "leaps"), [(0.57, False), (0.59, True)])
def test_odometry_may_move_half_a_metre_beyond_twice_what_the_robot_drives(make_ride, leap_m, leaps):
    ride = make_ride(v_max_mps=0.8)
    ride.steps(5, x_m=0.3, y_m=-0.2)
    ride.step(x_m=0.3 + 0.6 * leap_m, y_m=-0.2 - 0.8 * leap_m)
    assert (ride.pilot.ending is TrialEnding.LEAP) == leaps
    assert ride.pilot.driven_m == pytest.approx(leap_m)
    slow = make_ride(v_max_mps=0.8)
    slow.steps(5)
    slow.steps(3, moves=False)
    slow.step(x_m=leap_m + 2 * 0.8 * 0.15)
    assert (slow.pilot.ending is TrialEnding.LEAP) == leaps
    before = make_ride(v_max_mps=0.8)
    for x_m in (0.0, 30.0):
        before.step(images=False, x_m=x_m)
    assert (before.pilot.ending, before.pilot.driven_m) == (None, 0.0), "it has not begun"


def test_messages_without_stamps_count_from_when_they_come_and_old_ones_change_nothing(make_ride):
    ride = make_ride()
    ride.now_ns = S
    for k in range(3):
        ride.pilot.hear(odometry(0, x_m=0.01 * k), ride.now_ns)
        ride.pilot.look(picture(0), ride.now_ns)
        assert ride.pilot.command(ride.now_ns).v_mps == pytest.approx(0.05 * (k + 1))
        ride.now_ns += STEP_NS
    assert ride.policy.seen_ns == [S, S + STEP_NS, S + 2 * STEP_NS]
    driven_m, distance_m = ride.pilot.driven_m, ride.pilot.goal_distance_m
    ride.pilot.hear(odometry(S + 2 * STEP_NS, x_m=0.4), ride.now_ns)
    ride.pilot.look(picture(S + 2 * STEP_NS), ride.now_ns)
    ride.pilot.look(picture(S + 3 * STEP_NS), ride.now_ns, "rear.rgb")
    assert (ride.pilot.driven_m, ride.pilot.goal_distance_m, ride.pilot.seen) == (driven_m, distance_m, 3)


def test_what_a_trial_that_ends_counts_as():
    counts = {ending: ending.outcome for ending in TrialEnding}
    assert counts.pop(TrialEnding.GOAL) is Outcome.SUCCESS
    assert counts.pop(TrialEnding.STATIC_COLLISION) is Outcome.STATIC_COLLISION
    assert counts.pop(TrialEnding.HUMAN_COLLISION) is Outcome.HUMAN_COLLISION
    assert set(counts.values()) == {Outcome.TIMEOUT}


def test_images_are_called_after_their_camera_where_there_are_several():
    robot = RobotConfig(camera_name="middle")
    both = dataclasses.replace(robot, cameras={"left": robot.camera})
    assert [words_of(name, robot) for name in ("rgb", "depth")] == ["images", "depths"]
    names = ("rgb", "depth", "left.rgb", "left.depth")
    assert [words_of(name, both) for name in names] == [
        "images of middle", "depths of middle", "images of left", "depths of left"
    ]  # fmt: skip


@pytest.mark.parametrize(("camera_hz", "apart_ns"), [(20, 30_000_000), (10, 50_000_000)])
@pytest.mark.parametrize("beyond_ns", [0, 1_000_000])
def test_images_are_of_one_time_up_to_the_limit(fake_policy, camera_hz, apart_ns, beyond_ns):
    ride = ThreeCameraRide(fake_policy, camera_hz=camera_hz)
    ride.run(1.0, every_ns=4 * STEP_NS, taken_ns={"left.rgb": apart_ns + beyond_ns})
    assert (ride.pilot.seen > 0) == (beyond_ns == 0)


@pytest.mark.parametrize(("leap_rad", "leaps"), [(0.57, False), (0.59, True), (2.5, True)])
def test_heading_may_turn_half_a_radian_beyond_twice_what_the_robot_turns(make_ride, leap_rad, leaps):
    ride = make_ride(w_max_radps=0.8)
    ride.steps(5, yaw_rad=3.0)
    ride.step(yaw_rad=3.0 + leap_rad - 2 * math.pi)
    assert (ride.pilot.ending is TrialEnding.LEAP) == leaps
    assert not leaps or ride.pilot.reason == f"the odometry's heading leapt by {leap_rad:.1f} rad"
    before = make_ride(w_max_radps=0.8)
    for yaw_rad in (0.0, 2.5):
        before.step(images=False, yaw_rad=yaw_rad)
    assert before.pilot.ending is None, "it has not begun"


def test_distance_to_the_goal_is_known_if_images_come_before_the_odometry(make_ride):
    ride = make_ride(goal=(5.0, 0.0))
    ride.step(moves=False)
    ride.step(images=False, x_m=2.0)
    assert ride.pilot.started_ns is not None
    assert ride.pilot.straight_m == pytest.approx(4.0)
    assert (ride.pilot.goal.x_m, ride.pilot.goal.y_m) == pytest.approx((7.0, 0.0))
