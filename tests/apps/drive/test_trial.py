import time

import pytest

from readygo.apps.drive import trial
from readygo.apps.drive.messages import Command
from readygo.apps.drive.pilot import Ending
from readygo.apps.drive.trial import Measures, ended, run_trial
from readygo.common.errors import BusError
from tests.apps.drive.conftest import odometry, picture


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

    def absent(self):
        return "nobody publishes /odom"


def test_trial_ends_with_the_robot_standing_and_says_what_it_took(make_ride):
    ride, said = make_ride(time_limit_s=0.2), []
    robot = FakeRobot()
    measures = run_trial(robot, ride.pilot, rate_hz=20, say=said.append)
    assert ride.pilot.ending is Ending.LATE
    assert robot.told[-1] == Command()
    assert max(command.v_mps for command in robot.told) > 0
    assert said[0].startswith("goal 5.0 m")
    end = ended(ride.pilot, measures)
    assert end["measures"]["inference_hz"] > 20
    assert end["measures"]["latency_p99_ms"] >= end["measures"]["latency_median_ms"] > 0
    assert (end["ending"], end["straight_m"]) == ("late", 4.0)


def test_ctrl_c_and_failures_leave_the_robot_standing(make_ride):
    def press(robot):
        if len(robot.told) > 5:
            raise KeyboardInterrupt

    ride, robot = make_ride(), FakeRobot(after=press)
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert (ride.pilot.ending, robot.told[-1]) == (Ending.STOPPED, Command())

    def break_down(robot):
        if len(robot.told) > 5:
            raise ZeroDivisionError

    ride, robot = make_ride(), FakeRobot(after=break_down)
    with pytest.raises(ZeroDivisionError):
        run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert (ride.pilot.ending, robot.told[-1]) == (Ending.FAILED, Command())


def test_robot_that_sends_nothing_is_not_there(make_ride, monkeypatch):
    monkeypatch.setattr(trial, "PATIENCE_S", 0.05)
    robot = FakeRobot(sends=False)
    with pytest.raises(BusError, match=r"no images and no odometry after 0\.05 s; nobody publishes /odom\."):
        run_trial(robot, make_ride().pilot, rate_hz=20, say=lambda words: None)
    assert robot.told[-1] == Command()


def test_what_somebody_says_of_the_trial_and_wrong_messages_end_it(make_ride):
    ride, robot = make_ride(), FakeRobot()
    robot.outcome = "human_collision"
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert ride.pilot.ending is Ending.HUMAN_COLLISION
    ride, robot = make_ride(), FakeRobot()
    robot.broken = "/odom carries sensor_msgs/msg/Imu; it must be nav_msgs/msg/Odometry"
    run_trial(robot, ride.pilot, rate_hz=20, say=lambda words: None)
    assert ride.pilot.ending is Ending.BROKEN_IMAGES
    assert "Imu" in ride.pilot.reason


def test_measures_of_no_drive_are_none():
    assert Measures().summary() == {}
