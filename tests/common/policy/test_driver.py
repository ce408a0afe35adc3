import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.messages import EpisodeKey, EpisodeMotions, Scenario, Split
from readygo.common.policy import PolicyMemory, PolicySpec
from readygo.common.policy.driver import PolicyDriver
from readygo.common.policy.graph import Given, GraphSpec
from readygo.common.robot import RobotConfig
from tests.services.evaluator.conftest import hall


class RecordingPolicy:
    """A policy that notes what it is given."""

    def __init__(self):
        self.spec = PolicySpec(robot=RobotConfig())
        self.given = []
        self.started = 0
        self.images = None

    def start(self, robot):
        self.started += 1
        return Memory(self.started)

    def see(self, memories, images):
        self.images = images.copy()

    def decide(self, memories, previous, goals):
        names = [f"memory {memory.number}" for memory in memories]
        self.given.append((names, self.images, previous.copy(), goals.copy()))
        return np.array([[0.5, 0.25]] * len(memories), np.float32)


class Memory:
    """Knows its number."""

    def __init__(self, number):
        self.number = number

    def advance(self, command):
        self.command = command


class Eyes:
    """Images whose value is the step of the episode."""

    def arrives(self, simulation):
        return simulation.clock.sees(simulation.step, 0)

    def look(self, simulations):
        return np.array([np.full((2, 2, 3), simulation.step, np.uint8) for simulation in simulations])


@pytest.fixture
def simulation():
    def make(index=0, y_m=2.0, robot=None):
        scenario = Scenario(
            episode=EpisodeKey(seed=0, split=Split.TEST, index=index),
            start_xyyaw=np.array([2.0, y_m, np.pi / 2]),
            goal_xy_m=np.array([2.0, 5.0]),
            humans=(),
        )
        motions = EpisodeMotions(humans=())
        return EpisodeSimulation(scenario, motions, hall(), robot or RobotConfig(), EpisodeConfig())

    return make


def test_policy_is_given_the_command_that_was_executed_last(simulation):
    policy = RecordingPolicy()
    driver, episode = PolicyDriver(policy, Eyes()), simulation()
    state = driver.start(episode)
    executed = [(0.0, 0.0)]
    for _ in range(3):
        for v, w in driver.act([(episode, state)]):
            episode.advance(v, w)
        executed.append((episode.v_mps, episode.w_radps))
    driver.act([(episode, state)])
    given = np.concatenate([previous for _, _, previous, _ in policy.given])
    assert given == pytest.approx(np.array(executed), abs=1e-6)
    assert len({v for v, _ in executed}) == 4, "the acceleration limit makes each command differ from what is asked"


def test_each_episode_has_its_own_memory_image_and_goal(simulation):
    policy = RecordingPolicy()
    driver, one, other = PolicyDriver(policy, Eyes()), simulation(), simulation(1, y_m=1.0)
    first = driver.start(one)
    one.advance(0.0, 0.0)
    second = driver.start(other)
    assert driver.act([(other, second), (one, first)]) == [(0.5, 0.25)] * 2
    memories, images, _, goals = policy.given[-1]
    assert memories == ["memory 2", "memory 1"]
    assert images[:, 0, 0, 0].tolist() == [0, 1]
    assert goals == pytest.approx(np.array([[4.0, 0.0], [3.0, 0.0]]), abs=1e-6)


def test_episode_that_starts_again_has_forgotten(simulation):
    policy = RecordingPolicy()
    driver, episode = PolicyDriver(policy, Eyes()), simulation()
    driver.start(episode)
    state = driver.start(episode)
    driver.act([(episode, state)])
    assert policy.given[-1][0] == ["memory 2"]


def test_command_is_held_between_decisions_while_the_policy_sees_every_image(simulation):
    policy = RecordingPolicy()
    policy.decide = lambda memories, previous, goals: (
        policy.given.append((policy.images, previous)) or np.array([[0.1 * policy.images[0, 0, 0, 0], 0.0]], np.float32)
    )
    driver, episode = PolicyDriver(policy, Eyes(), hold_steps=5), simulation()
    state = driver.start(episode)
    commands = []
    for _ in range(12):
        commands += driver.act([(episode, state)])
        episode.advance(*commands[-1])
    assert [v for v, _ in commands] == pytest.approx([0.0] * 5 + [0.5] * 5 + [1.0] * 2)
    assert [images[0, 0, 0, 0] for images, _ in policy.given] == list(range(12))
    assert policy.given[7][1][0, 0] == pytest.approx(0.05 * 2), "it is told what was executed, not what it decided"


def test_policy_decides_between_the_images_of_a_slower_camera(simulation):
    policy, robot = RecordingPolicy(), RobotConfig(control_hz=30, camera_hz=10)
    driver, episode = PolicyDriver(policy, Eyes()), simulation(robot=robot)
    state = driver.start(episode)
    for _ in range(7):
        episode.advance(*driver.act([(episode, state)])[0])
    assert [images[0, 0, 0, 0] for _, images, _, _ in policy.given] == [0, 0, 0, 3, 3, 3, 6]
    assert episode.time_ns == 233_333_333


def test_policy_that_wants_an_image_of_the_goal_has_it_from_the_start(simulation):
    class LooksAhead(Eyes):
        def goal_image(self, simulation):
            self.asked = simulation
            return np.full((2, 2, 3), 7, np.uint8)

    policy, eyes, episode = RecordingPolicy(), LooksAhead(), simulation()
    graph = GraphSpec(inputs={"image": "rgb", "there": Given.GOAL_IMAGE}, cache={})
    policy.spec = PolicySpec(robot=RobotConfig(), graph=graph)
    policy.start = lambda robot: PolicyMemory(10**8)
    state = PolicyDriver(policy, eyes).start(episode)
    assert state.memory.kept.goal.image.tolist() == np.full((2, 2, 3), 7).tolist()
    assert eyes.asked is episode


def test_policy_without_a_rhythm_decides_when_an_image_arrives(simulation):
    policy = RecordingPolicy()
    decided = []
    policy.decide = lambda memories, previous, goals: (
        decided.append(episode.step) or np.array([[0.1 * len(policy.given), 0.0]], np.float32)
    )
    see = policy.see
    policy.see = lambda memories, images: (see(memories, images), policy.given.append(None))

    class Seldom(Eyes):
        def arrives(self, simulation):
            return simulation.step in (0, 3, 4)

    driver, episode = PolicyDriver(policy, Seldom(), hold_steps=None), simulation()
    state, commands = driver.start(episode), []
    for _ in range(6):
        commands += driver.act([(episode, state)])
        episode.advance(*commands[-1])
    assert [v for v, _ in commands] == pytest.approx([0.1, 0.1, 0.1, 0.2, 0.3, 0.3])
    assert decided == [0, 3, 4], "in between nothing is computed"


def test_held_command_is_computed_when_it_is_adopted_or_an_image_arrives(simulation):
    policy = RecordingPolicy()

    class Seldom(Eyes):
        def arrives(self, simulation):
            return simulation.step in (0, 1, 6)

    driver, episode = PolicyDriver(policy, Seldom(), hold_steps=4), simulation()
    state, decided = driver.start(episode), []
    for _ in range(8):
        before = len(policy.given)
        episode.advance(*driver.act([(episode, state)])[0])
        decided += [episode.step - 1] * (len(policy.given) - before)
    assert decided == [0, 1, 4, 6]


def test_episodes_side_by_side_decide_each_at_its_own_steps(simulation):
    policy = RecordingPolicy()

    class Once(Eyes):
        def arrives(self, simulation):
            return simulation.step == 0

    driver, one, other = PolicyDriver(policy, Once(), hold_steps=3), simulation(), simulation(1, y_m=1.0)
    first = driver.start(one)
    one.advance(0.0, 0.0)
    second = driver.start(other)
    assert driver.act([(one, first), (other, second)]) == [(0.0, 0.0), (0.5, 0.25)]
    names, images, previous, goals = policy.given[-1]
    assert names == ["memory 2"]
    assert (images.shape[0], previous.shape, goals.shape) == (1, (1, 2), (1, 2))
    assert goals[0] == pytest.approx([4.0, 0.0], abs=1e-6)
