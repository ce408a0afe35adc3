import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.perception import PeopleTracker
from readygo.common.perception.episode import EpisodePerception, SteppedTracker, perceive_step
from readygo.common.perception.people import NOBODY, People
from readygo.common.policy.memory import PolicyMemory
from readygo.common.robot import RobotConfig

ONE = People(
    presence=np.array([0.95]),
    xy_m=np.array([[2.0, 0.0]]),
    place_cov=0.05**2 * np.eye(2)[None],
    v_mps=np.array([[0.0, 1.0]]),
    velocity_cov=0.1**2 * np.eye(2)[None],
)


def test_stepped_tracker_predicts_once_per_step() -> None:
    shown: list[tuple[float, float, float]] = []
    stepped = SteppedTracker(PeopleTracker(None, None), 0.05, lambda pose, x, y: bool(shown.append(pose)))
    plain = PeopleTracker(None, None)
    for step in (0, 2, 3):
        stepped.look(step, (0.0, 0.0, 0.0), ONE if step < 3 else NOBODY)
        stepped.advance(step)
    plain.fuse((0.0, 0.0, 0.0), ONE, lambda x, y: False)
    for _ in range(2):
        plain.predict(0.05)
    plain.fuse((0.0, 0.0, 0.0), ONE, lambda x, y: False)
    plain.predict(0.05)
    np.testing.assert_array_equal(stepped.tracker.tracks[0].mean, plain.tracks[0].mean)
    np.testing.assert_array_equal(stepped.tracker.tracks[0].cov, plain.tracks[0].cov)
    # Who was not detected was asked for from where the image was taken.
    assert shown == [(0.0, 0.0, 0.0)]


class Sink:
    def __init__(self) -> None:
        self.looks: list[tuple[int, tuple[float, float, float]]] = []

    def look(self, step: int, pose: tuple[float, float, float], people: People) -> None:
        self.looks.append((step, pose))


class Camera:
    """Notes how many views each request has."""

    def __init__(self, robot: RobotConfig) -> None:
        self.late = robot.clock.steps(robot.camera.latency_s)
        self.robot, self.asked = robot, list[int]()

    def arrives(self, simulation: SimpleNamespace) -> bool:
        return self.robot.clock.sees(simulation.step, self.late)

    def look(self, simulations: list[SimpleNamespace]) -> np.ndarray:
        self.asked.append(len(simulations))
        return np.zeros((len(simulations), 2, 2, 3), np.uint8)


class Network:
    def start(self) -> PolicyMemory:
        return PolicyMemory(200_000_000)

    def perceive(self, memory: PolicyMemory, command: np.ndarray) -> SimpleNamespace:
        return SimpleNamespace(people=NOBODY)


def drive(robot: RobotConfig, steps: int, count: int = 1) -> tuple[Camera, list[Sink]]:
    """Robots that drive along x at 1 m/s, 0.05 m a step."""
    camera, sinks = Camera(robot), [Sink() for _ in range(count)]
    perceptions = [EpisodePerception(Network(), sink, robot) for sink in sinks]  # type: ignore[arg-type]
    path = np.stack([0.05 * np.arange(steps), np.zeros(steps), np.zeros(steps)], axis=1)
    for step in range(steps):
        one = SimpleNamespace(
            step=step, v_mps=1.0, w_radps=0.0, path_xyyaw=lambda first, last: path[first : last + 1], clock=robot.clock
        )
        perceive_step(camera, [(one, perception) for perception in perceptions])  # type: ignore[list-item, arg-type]
    return camera, sinks


def test_looks_are_a_tenth_of_a_second_apart_and_share_a_request() -> None:
    camera, sinks = drive(RobotConfig(), 7, count=3)
    assert camera.asked == [3, 3, 3, 3]
    assert [step for step, _ in sinks[0].looks] == [0, 2, 4, 6]
    assert sinks[0].looks == sinks[2].looks


@pytest.mark.parametrize(("camera_hz", "latency_s"), [(20, 0.1), (5, 0.2), (5, 0.05)])
def test_late_images_are_fused_where_the_robot_was_when_they_were_taken(camera_hz: int, latency_s: float) -> None:
    robot = RobotConfig(camera_hz=camera_hz, camera=CameraConfig(latency_s=latency_s))
    every, late = 20 // camera_hz, robot.clock.steps(latency_s)
    _, (sink,) = drive(robot, 20)
    assert len(sink.looks) > 2
    for step, (x, _, _) in sink.looks:
        assert (step % every, x) == (0, pytest.approx(0.05 * step))
    assert sink.looks[-1][0] == (19 - late) // max(every, 2) * max(every, 2)


@pytest.mark.parametrize(
    ("camera_hz", "control_hz", "looks_hz"), [(20, 20, 10), (20, 40, 10), (30, 60, 10), (60, 120, 10), (5, 20, 5)]
)
def test_looks_are_a_tenth_of_a_second_apart_at_every_clock(camera_hz: int, control_hz: int, looks_hz: int) -> None:
    robot = RobotConfig(camera_hz=camera_hz, control_hz=control_hz)
    _, (sink,) = drive(robot, robot.clock.rate_hz)
    assert len(sink.looks) == looks_hz


@pytest.mark.parametrize("late_steps", [0, 2, 6])
def test_tracks_of_late_images_do_not_lag_behind(late_steps: int) -> None:
    dt_s, v_mps = 0.05, 1.4
    stepped = SteppedTracker(PeopleTracker(None, None), dt_s, lambda pose, x, y: True)
    for step in range(80):
        stepped.advance(step)
        taken = step - late_steps
        if taken >= 0 and step % 2 == 0:
            stepped.look(taken, (0.0, 0.0, 0.0), dataclasses.replace(ONE, xy_m=np.array([[2.0, v_mps * dt_s * taken]])))
    (track,) = stepped.tracker.known
    np.testing.assert_allclose(track.mean, [2.0, v_mps * dt_s * 79, 0.0, v_mps], atol=0.03)
    # The later an image is, the less is known of where the human is now.
    assert 0.02 < np.sqrt(track.cov[1, 1]) < 0.2 + 0.1 * late_steps
