import numpy as np
import pytest

from readygo.apps.drive.calibration import Rectifier
from readygo.apps.drive.messages import GoalMessage, ImageMessage, OdometryMessage
from readygo.apps.drive.pilot import DriveConfig, Pilot
from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeKey, EpisodeMotions, Scenario, Split
from readygo.common.policy import PolicyMemory, PolicySpec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.kinematics import STEP_NS

CAMERA = CameraConfig(height_px=8, width_px=10)
S = 1_000_000_000
T0 = 1_700_000_000 * S
"""The robot's clock when ours is at 0."""


class FakePolicy:
    """Answers what it is told to, and remembers what it was asked."""

    def __init__(self, answer=(1.0, 0.5)):
        self.spec, self.answer = PolicySpec(robot=RobotConfig(camera=CAMERA)), answer
        self.goals, self.seen_ns = [], []

    def start(self):
        return PolicyMemory(10 * STEP_NS)

    def see(self, memories, images, times_ns):
        self.seen_ns += times_ns
        memories[0].see(images[0], times_ns[0])

    def decide(self, memories, commands, goals_xy_m):
        assert len(memories[0].window()) == 3
        self.goals.append(tuple(goals_xy_m[0].tolist()))
        return np.array([self.answer], np.float32)


def picture(time_ns, size=(8, 10)):
    return ImageMessage(stamp_ns=time_ns, decode=lambda: np.zeros((*size, 3), np.uint8))


def odometry(time_ns, x_m=0.0, y_m=0.0, yaw_rad=0.0, v_mps=0.0):
    return OdometryMessage(stamp_ns=time_ns, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, v_mps=v_mps, w_radps=0.0)


class Ride:
    """A pilot and a robot that stands at the origin, in steps of 0.05 s."""

    def __init__(self, policy=None, *, goal=(5.0, 0.0), **settings):
        self.policy = policy or FakePolicy()
        config = DriveConfig(**{"v_max_mps": 1.0, "w_max_radps": 1.2, **settings})
        self.pilot = Pilot(self.policy, {"": Rectifier(CAMERA, CAMERA)}, config, GoalMessage(x_m=goal[0], y_m=goal[1]))
        self.now_ns, self.commands = 0, []

    def step(self, *, images=True, moves=True, shift_ns=0, image_size=(8, 10), **pose):
        stamp_ns = T0 + self.now_ns + shift_ns
        if moves:
            self.pilot.hear(odometry(stamp_ns, **pose), self.now_ns)
        if images:
            self.pilot.look(picture(stamp_ns, image_size), self.now_ns)
        self.commands.append(self.pilot.command(self.now_ns))
        self.now_ns += STEP_NS
        return self.commands[-1]

    def steps(self, count, **what):
        for _ in range(count):
            self.step(**what)
        return self.commands[-1]


@pytest.fixture
def make_ride():
    return Ride


@pytest.fixture
def fake_policy():
    return FakePolicy


def open_ground():
    """An episode without obstacles or people: 2 m straight ahead."""
    frame = GridFrame(origin_x_m=-4.0, origin_y_m=-4.0, resolution_m=0.1)
    scenario = Scenario(
        episode=EpisodeKey(seed=0, split=Split.TEST, index=0),
        start_xyyaw=np.array([0.0, 0.0, 0.0]),
        goal_xy_m=np.array([2.0, 0.0]),
        humans=(),
    )
    free = OccupancyMap(frame=frame, occupied=np.zeros((80, 160), np.bool_))
    return EpisodeSimulation(scenario, EpisodeMotions(humans=()), free, RobotConfig(camera=CAMERA), EpisodeConfig())
