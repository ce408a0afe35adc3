import time

import numpy as np
import pytest

from readygo.apps.drive import trial
from readygo.apps.drive.free_space import scan_of
from readygo.apps.drive.messages import PeopleMessage, ScanMessage, VelocityMessage
from readygo.apps.drive.pilot import TrialEnding
from readygo.apps.drive.trial import Measures, run_trial, trial_end
from readygo.common.errors import BusError
from tests.apps.drive.conftest import CAMERA, odometry, picture


class FakeRobot:
    """Sends an image at every call, and keeps what it is told."""

    def __init__(self, *, sends=True, after=lambda robot: None):
        self.sends, self.after, self.told = sends, after, []
        self.broken, self.outcome = "", ""

    def next_picture(self, until_s):
        time.sleep(0.001)
        self.after(self)
        return (picture(time.time_ns()), time.monotonic_ns()) if self.sends else None

    def beside(self):
        return []

    def odometry(self):
        return [(odometry(time.time_ns()), time.monotonic_ns())] if self.sends else []

    def send(self, command):
        self.told.append(command)

    def tell(self, people, scan):
        self.told += [people, scan]

    def absent(self):
        return "no node publishes /odom"


def test_trial_ends_with_the_robot_standing_and_says_what_it_took(make_ride):
    ride, said = make_ride(time_limit_s=0.2), []
    robot = FakeRobot()
    measures = run_trial(robot, ride.pilot, rate_hz=20, say=said.append)
    assert ride.pilot.ending is TrialEnding.LATE
    assert robot.told[-1] == VelocityMessage()
    assert max(command.v_mps for command in robot.told) > 0
    assert said[0].startswith("goal 5.0 m")
    end = trial_end(ride.pilot, measures)
    assert end["measures"]["inference_hz"] > 20
    assert end["measures"]["latency_p99_ms"] >= end["measures"]["latency_median_ms"] > 0
    assert (end["ending"], end["straight_m"]) == ("late", 4.0)


def test_people_are_published_after_the_command_of_their_image(make_ride):
    class Finder:
        def __init__(self):
            self.heard = 0

        def hear(self, odometry, arrived_ns):
            self.heard += 1

        def look(self, picture, arrived_ns):
            scan = scan_of(np.full(32, 2.0), CAMERA, stamp_ns=picture.stamp_ns, frame="base_link")
            return PeopleMessage(stamp_ns=picture.stamp_ns, people=()), scan

    ride, robot, finder = make_ride(time_limit_s=0.1), FakeRobot(), Finder()
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None, people=finder)
    kinds = [type(each) for each in robot.told[:6]]
    assert kinds == 2 * [VelocityMessage, PeopleMessage, ScanMessage]
    assert finder.heard > 1
    assert robot.told[-1] == VelocityMessage()


def test_ctrl_c_and_failures_leave_the_robot_standing(make_ride):
    def press(robot):
        if len(robot.told) > 5:
            raise KeyboardInterrupt

    ride, robot = make_ride(), FakeRobot(after=press)
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert (ride.pilot.ending, robot.told[-1]) == (TrialEnding.STOPPED, VelocityMessage())

    def break_down(robot):
        if len(robot.told) > 5:
            raise ZeroDivisionError

    ride, robot = make_ride(), FakeRobot(after=break_down)
    with pytest.raises(ZeroDivisionError):
        run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert (ride.pilot.ending, robot.told[-1]) == (TrialEnding.FAILED, VelocityMessage())


def test_robot_that_sends_nothing_is_not_there(make_ride, monkeypatch):
    monkeypatch.setattr(trial, "PATIENCE_S", 0.05)
    robot = FakeRobot(sends=False)
    with pytest.raises(BusError, match=r"no images and no odometry after 0\.05 s; no node publishes /odom\."):
        run_trial(robot, make_ride().pilot, rate_hz=20, say=lambda words: None)
    assert robot.told[-1] == VelocityMessage()


def test_what_somebody_says_of_the_trial_and_wrong_messages_end_it(make_ride):
    ride, robot = make_ride(), FakeRobot()
    robot.outcome = "human_collision"
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert ride.pilot.ending is TrialEnding.HUMAN_COLLISION
    ride, robot = make_ride(), FakeRobot()
    robot.broken = "/odom carries sensor_msgs/msg/Imu; it must be nav_msgs/msg/Odometry"
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert ride.pilot.ending is TrialEnding.BROKEN_MESSAGE
    assert ride.pilot.reason.startswith("the robot sends what cannot be used: /odom carries sensor_msgs/msg/Imu")


def test_measures_of_no_drive_are_none():
    assert Measures().summary() == {}


def test_measures_are_rates_and_latencies_of_the_drive():
    measures = Measures(
        latencies_ms=[10.0, 20.0, 60.0], thinking_ms=[4.0, 6.0], frame_ages_s=[0.1, 0.2, 0.6], sent=9, duration_s=1.5
    )
    assert measures.summary() == {
        "inference_hz": 2.0, "inference_hz_possible": 200.0, "command_hz": 6.0, "latency_median_ms": 20.0,
        "latency_p99_ms": 59.2, "latency_max_ms": 60.0, "frame_age_median_s": 0.2,
    }  # fmt: skip
    assert Measures(latencies_ms=[1.0], duration_s=0.0).summary() == {}


class StepPilot:
    """Notes what it hears and sees, and has no will of its own."""

    def __init__(self, *, started_ns=None):
        self.told, self.seen, self.frame_age_s, self.seen_arrived_ns = [], 4, 0.25, 3_000_000
        self.started_ns = started_ns
        self.endings = []

    def hear(self, odometry, arrived_ns):
        self.told.append(("odometry", odometry, arrived_ns))

    def look(self, picture, arrived_ns, name="rgb"):
        self.told.append((name, picture, arrived_ns))
        self.seen += 1

    def end(self, ending, reason=""):
        self.endings.append((ending, reason))

    def command(self, now_ns):
        return ("command", now_ns)


@pytest.mark.parametrize(("pictures", "started_ns"), [(True, 1), (True, None), (False, 1)])
def test_step_hears_and_sees_all_that_came_before_it_commands(monkeypatch, pictures, started_ns):
    clock_ns = iter([1_000_000, 6_000_000, 9_000_000, 11_000_000] if pictures else [1_000_000, 9_000_000])
    monkeypatch.setattr(trial.time, "monotonic_ns", lambda: next(clock_ns))
    robot, pilot, measures, until = FakeRobot(), StepPilot(started_ns=started_ns), Measures(), []
    robot.odometry = lambda: [("o1", 5), ("o2", 6)]
    robot.beside = lambda: [("depth", "d", 7)] if pictures else []
    robot.next_picture = lambda until_s: until.append(until_s) or (("p", 8) if pictures else None)
    trial._step(robot, pilot, measures, 12.5)
    heard = [("odometry", "o1", 5), ("odometry", "o2", 6)]
    assert pilot.told == [*heard, *([("depth", "d", 7), ("rgb", "p", 8)] if pictures else [])]
    assert (until, robot.told, pilot.endings) == ([12.5], [("command", 9_000_000)], [])
    assert (measures.thinking_ms, measures.frame_ages_s) == (([5.0], [0.25]) if pictures else ([], []))
    assert measures.latencies_ms == ([8.0] if pictures and started_ns else [])
    assert measures.sent == (1 if started_ns else 0)


@pytest.mark.parametrize(
    ("outcome", "ending"),
    [
        ("success", TrialEnding.GOAL),
        ("timeout", TrialEnding.LATE),
        ("static_collision", TrialEnding.STATIC_COLLISION),
        ("human_collision", TrialEnding.HUMAN_COLLISION),
    ],
)
def test_outcome_that_somebody_says_ends_the_trial(outcome, ending):
    robot, pilot = FakeRobot(sends=False), StepPilot()
    robot.outcome = outcome
    trial._step(robot, pilot, Measures(), 0.0)
    assert pilot.endings == [(ending, "")]
