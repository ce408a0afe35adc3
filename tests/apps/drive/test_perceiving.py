import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.drive.perceiving import PerceivingPolicy, acting, planning
from readygo.common.errors import ConfigError, RunError
from readygo.common.perception import PeopleTracker
from readygo.common.perception.people import NOBODY
from readygo.common.policy import PolicyMemory
from readygo.common.robot.kinematics import STEP_NS
from readygo.common.state_policy.actor import StateActor
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.observe import PEOPLE
from readygo.runs.config import RunConfig
from readygo.runs.state_world import state_world_of
from tests.common.perception.test_tracker import seen
from tests.common.state_policy.state_policies import make_state_policy
from tests.services.planner.worlds import make_robot_planner

IMAGE = np.zeros((1, 144, 256, 3), np.uint8)
T0 = 1_700_000_000_000_000_000


class FakePerception:
    """Tells of people, and counts its looks."""

    def __init__(self):
        self.people, self.looks = NOBODY, 0

    def start(self):
        return PolicyMemory(4 * STEP_NS, frame_count=3)

    def perceive(self, memory, command):
        self.looks += 1
        return SimpleNamespace(people=self.people)


@pytest.fixture(scope="module")
def planner():
    return make_robot_planner(mode="spacetime")


class Trial:
    """A robot that does what it is told, with its odometry in a frame of its own."""

    def __init__(self, policy, goal_m, pose=(0.0, 0.0, 0.0)):
        self.policy, self.memory, self.goal_m, self.pose = policy, policy.start(), goal_m, pose
        self.command, self.now_ns = np.zeros(2, np.float32), T0

    def step(self):
        x, y, yaw = self.pose
        self.memory.move(self.now_ns, self.pose)
        self.policy.see([self.memory], IMAGE, [self.now_ns])
        dx, dy = self.goal_m[0] - x, self.goal_m[1] - y
        c, s = math.cos(yaw), math.sin(yaw)
        goal = np.array([[c * dx + s * dy, c * dy - s * dx]], np.float32)
        self.command = self.policy.decide([self.memory], self.command[None], goal)[0]
        v, w = self.command.tolist()
        yaw += 0.05 * w
        self.pose = x + 0.05 * v * math.cos(yaw), y + 0.05 * v * math.sin(yaw), yaw
        self.now_ns += STEP_NS


START = (-1.5, 5.0, math.pi / 2)
"""In the lower left room; a door leads to the upper left one."""


def planned(perception, planner, start=None):
    return PerceivingPolicy(perception, planner, planning(planner), start)


def in_scene(pose):
    """A pose of odometry that begins at `START`."""
    x, y, yaw = pose
    return START[0] - y, START[1] + x, yaw + START[2]


def test_robot_drives_through_a_door_to_its_goal_from_where_the_trial_begins(planner):
    perception = FakePerception()
    # 4 m ahead, behind the wall.
    trial = Trial(planned(perception, planner, START), (4.0, 0.0))
    wall_x = []
    for _ in range(240):
        trial.step()
        x, y, _ = in_scene(trial.pose)
        wall_x += [x] if abs(y - 6.98) < 0.1 else []
        if math.dist(trial.pose[:2], trial.goal_m) < 1.0:
            break
    assert math.dist(trial.pose[:2], trial.goal_m) < 1.0
    assert all(-0.5 < x < 0.7 for x in wall_x), "through the door"
    assert wall_x


def test_images_are_looked_at_ten_times_a_second(planner):
    perception = FakePerception()
    trial = Trial(planned(perception, planner, START), (4.0, 0.0))
    for _ in range(20):
        trial.step()
    assert perception.looks == 10


def test_robot_keeps_away_from_a_human_that_it_perceives(planner):
    perception, human = FakePerception(), (-1.5, 4.0)
    trial = Trial(planned(perception, planner), (-1.5, 2.6), pose=(-1.5, 6.2, -math.pi / 2))
    nearest_m = math.inf
    for _ in range(120):
        x, y, yaw = trial.pose
        dx, dy, c, s = human[0] - x, human[1] - y, math.cos(yaw), math.sin(yaw)
        ahead, left = c * dx + s * dy, c * dy - s * dx
        perception.people = seen((ahead, left, 0.0, 0.0)) if ahead > abs(left) else NOBODY
        trial.step()
        nearest_m = min(nearest_m, math.dist(trial.pose[:2], human))
        if math.dist(trial.pose[:2], trial.goal_m) < 0.9:
            break
    assert math.dist(trial.pose[:2], trial.goal_m) < 0.9
    assert nearest_m > 0.55


class Acting:
    """A state policy with its world."""

    def __init__(self, planner):
        maps, robot = planner.maps, planner.robot
        self.planner, self.policy = planner, make_state_policy(robot=robot)
        self.world = state_world_of(maps, RunConfig(robot=robot), self.policy.spec.observation)
        self.distances = GoalDistances(maps.robot, robot.planning_radius_m)
        self.actors = []

    def trial_policy(self, perception, start=None):
        make = acting(self.policy, self.world, self.distances, self.planner)

        def noted(pose, goal):
            self.actors.append(make(pose, goal))
            return self.actors[-1]

        return PerceivingPolicy(perception, self.planner, noted, start)


def test_state_policy_decides_as_on_the_map_wherever_the_odometry_begins(planner):
    known = Acting(planner)
    trial = Trial(known.trial_policy(FakePerception(), START), (4.0, 0.0))
    direct = StateActor(known.policy, known.world, known.distances, PeopleTracker(None, None), (-1.5, 9.0))
    commands = []
    for step in range(30):
        x, y, yaw = in_scene(trial.pose)
        moving = trial.command.tolist()
        trial.step()
        state = SimpleNamespace(step=step, x_m=x, y_m=y, yaw_rad=yaw, v_mps=moving[0], w_radps=moving[1])
        assert trial.command == pytest.approx(direct.act(state), abs=1e-6)
        commands.append(tuple(trial.command.tolist()))
    assert len(set(commands)) > 1
    changed = [k for k in range(1, 30) if commands[k] != commands[k - 1]]
    assert all(k % known.policy.spec.hold_steps == 0 for k in changed)


def test_state_policy_is_told_the_people_that_are_perceived(planner):
    known, perception = Acting(planner), FakePerception()
    trial = Trial(known.trial_policy(perception), (-1.5, 2.6), pose=(-1.5, 6.2, -math.pi / 2))
    perception.people = seen((1.5, 0.2, 0.0, 0.0))
    for _ in range(9):
        trial.step()
    (actor,) = known.actors
    there, ahead, left = actor.told[0, PEOPLE : PEOPLE + 3]
    assert there == 1.0
    assert 4.0 * math.hypot(ahead, left) == pytest.approx(1.5, abs=0.4)


@pytest.mark.parametrize(("start", "what"), [((-3.0, 5.0, 0.0), "start"), ((-1.0, 4.0, 0.0), "goal")])
def test_places_that_are_not_free_are_refused(planner, start, what):
    trial = Trial(planned(FakePerception(), planner, start), (1.5, 0.0))
    with pytest.raises(ConfigError, match=f"The {what} .* is not free on the scene's map"):
        trial.step()


def test_robot_beyond_the_map_ends_the_trial(planner):
    trial = Trial(planned(FakePerception(), planner, START), (4.0, 0.0))
    trial.step()
    trial.pose = (100.0, 0.0, 0.0)
    with pytest.raises(RunError, match="beyond the scene's map"):
        trial.step()
