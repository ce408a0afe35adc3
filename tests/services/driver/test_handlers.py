from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import Driver, EpisodeKey, EpisodeMotions, Outcome, Scenario, Split
from readygo.common.policy.memory import Kept
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.driver import Disturbance, DriverConfig, PolicyDriver, drive, driver_of

START_X_M = 2.0
CALM = DriverConfig(push=0.0, late_max_s=0.0)


def late(latency_s: float) -> RobotConfig:
    return RobotConfig(camera=CameraConfig(latency_s=latency_s))


class _Expert:
    """Wants to go ahead at full speed, then to turn."""

    def __init__(self) -> None:
        self.replan_times_s: list[float] = []
        self.asked_at: list[int] = []
        self.watched_at: list[int] = []

    def act(self, simulation: EpisodeSimulation) -> SimpleNamespace:
        self.asked_at.append(simulation.step)
        commands = np.array([(1.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
        return SimpleNamespace(commands=commands, replanned=simulation.step == 1, cost=2.5, visible=False)

    def watch(self, simulation: EpisodeSimulation) -> bool:
        self.watched_at.append(simulation.step)
        return True


class _Memory:
    """Notes what was executed."""

    def __init__(self) -> None:
        self.told: list[tuple[float, float]] = []
        self.kept = Kept()

    def advance(self, command: np.ndarray) -> None:
        self.told.append(tuple(command.tolist()))


class _Camera:
    """Pictures whose value is the step."""

    def __init__(self, simulation: EpisodeSimulation) -> None:
        self._simulation = simulation
        self.taken: list[int] = []

    def take(self) -> np.ndarray:
        self.taken.append(self._simulation.step)
        return np.full((2, 2, 3), self._simulation.step, np.uint8)


class _Weigher:
    """The step, as the risk of the only command."""

    def risks(self, simulation: EpisodeSimulation) -> bytes:
        return bytes([simulation.step])


class _Policy:
    """Turns on the spot, and notes what it is given."""

    def __init__(self) -> None:
        self.given: list[tuple[int, tuple[float, float]]] = []
        self.memory = _Memory()

    def start(self, robot: RobotConfig) -> _Memory:
        return self.memory

    def see(self, memories: list[_Memory], images: np.ndarray) -> None:
        self.seen = int(images[0, 0, 0, 0])

    def decide(self, memories: list[_Memory], previous: np.ndarray, goals: np.ndarray) -> np.ndarray:
        self.given.append((self.seen, tuple(previous[0].tolist())))
        return np.array([[0.0, 9.0]], np.float32)


@pytest.fixture
def make_simulation() -> Callable[..., EpisodeSimulation]:
    def make(goal_x_m: float = 4.0, time_limit_s: float = 50.0, robot: RobotConfig | None = None) -> EpisodeSimulation:
        occupied = np.zeros((60, 120), np.bool_)
        occupied[[0, -1]] = occupied[:, [0, -1]] = True
        occupied[:, 80] = True
        frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)
        scenario = Scenario(
            episode=EpisodeKey(seed=0, split=Split.TRAIN, index=0),
            start_xyyaw=np.array([START_X_M, 3.0, 0.0]),
            goal_xy_m=np.array([goal_x_m, 3.0]),
            humans=(),
        )
        robot_map = OccupancyMap(frame=frame, occupied=occupied)
        config = EpisodeConfig(time_limit_s=time_limit_s)
        return EpisodeSimulation(scenario, EpisodeMotions(humans=()), robot_map, robot or RobotConfig(), config)

    return make


def test_expert_that_drives_does_what_it_says(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    simulation, expert = make_simulation(), _Expert()
    camera = _Camera(simulation)
    driven = drive(simulation, expert, camera, _Weigher())
    steps = list(range(len(driven.trajectory.actions)))
    assert [risks[0] for risks in driven.risks] == steps
    assert driven.trajectory.outcome is Outcome.SUCCESS
    assert camera.taken == expert.asked_at == steps
    assert [commands[0] for commands in driven.expert_commands] == [*map(tuple, driven.trajectory.actions.tolist())]
    assert driven.trajectory.replanned.tolist() == [step == 1 for step in steps]
    assert driven.trajectory.expert_cost[0] == 2.5


@pytest.mark.parametrize(("control_hz", "held"), [(10, 3), (15, 2), (30, 1)])
def test_robot_that_holds_commands_has_the_planned_speeds_at_the_end_of_each(
    make_simulation: Callable[..., EpisodeSimulation], control_hz: int, held: int
) -> None:
    robot = RobotConfig(control_hz=control_hz, camera_hz=30)
    for disturbance in (None, Disturbance(EpisodeKey(seed=0, split=Split.TRAIN, index=0), CALM, robot)):
        simulation = make_simulation(time_limit_s=1.0, robot=robot)
        driven = drive(simulation, _Expert(), _Camera(simulation), _Weigher(), disturbance=disturbance)
        assert len(driven.trajectory.actions) == 30
        assert {len(commands) for commands in driven.expert_commands} == {1 + 30}
        for step in range(0, 30, held):
            reached = tuple(driven.trajectory.actions[step + held - 1].tolist())
            assert reached == pytest.approx(driven.expert_commands[step][held - 1])
        assert driven.trajectory.actions[-1, 0] > 0


def test_what_the_expert_goes_on_with_is_within_the_robots_reach(
    make_simulation: Callable[..., EpisodeSimulation],
) -> None:
    simulation = make_simulation()
    robot = simulation.robot
    first = np.array(drive(simulation, _Expert(), _Camera(simulation), _Weigher()).expert_commands[0])
    assert first.shape == (1 + 20, 2)
    changes = np.abs(np.diff(np.vstack([[0.0, 0.0], first]), axis=0))
    assert changes[:, 0].max() <= robot.a_max_mps2 * 0.05 + 1e-9
    assert changes[:, 1].max() <= robot.alpha_max_radps2 * 0.05 + 1e-9
    # Two steps ahead, then the turn that the last command holds.
    assert first[1, 0] > first[0, 0] > 0.0
    assert tuple(first[-1]) == (0.0, 1.0)


def test_collision_is_kept_with_the_advice_before_it(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    simulation = make_simulation(goal_x_m=11.0)
    driven = drive(simulation, _Expert(), _Camera(simulation), _Weigher())
    assert driven.trajectory.outcome is Outcome.STATIC_COLLISION
    assert len(driven.expert_commands) == len(driven.trajectory.actions) > 20


def test_policy_drives_and_the_expert_is_asked_all_the_same(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    simulation, expert, policy = make_simulation(time_limit_s=1.0), _Expert(), _Policy()
    driven = drive(simulation, expert, _Camera(simulation), _Weigher(), PolicyDriver(policy, late(0.1), 1))
    assert driven.trajectory.outcome is Outcome.TIMEOUT
    assert expert.asked_at == list(range(20))
    assert not driven.trajectory.actions[:, 0].any()
    assert driven.expert_commands[5][0][0] > 0.0
    # Pictures are two steps late, and the first one stands in until there is one so old.
    assert [picture for picture, _ in policy.given[:5]] == [0, 0, 0, 1, 2]
    assert [previous for _, previous in policy.given[1:]] == [
        tuple(np.float32(row).tolist()) for row in driven.trajectory.actions[:-1]
    ]


def test_policy_is_shown_its_goal_before_it_decides() -> None:
    policy, shown = _Policy(), np.full((2, 2, 3), 7, np.uint8)
    PolicyDriver(policy, late(0.0), 1, shown)
    assert policy.memory.kept.goal_image is shown


def test_policy_holds_its_command_between_pictures_and_the_expert_watches(
    make_simulation: Callable[..., EpisodeSimulation],
) -> None:
    simulation, expert, policy = make_simulation(time_limit_s=1.0), _Expert(), _Policy()
    camera = _Camera(simulation)
    driver = PolicyDriver(policy, late(0.25), 5)
    driven = drive(simulation, expert, camera, _Weigher(), driver, image_every=5)
    taken = [0, 5, 10, 15]
    assert camera.taken == expert.asked_at == taken
    assert expert.watched_at == [step for step in range(20) if step % 5]
    assert [picture for picture, _ in policy.given] == [0, 0, 5, 10]
    executed = [tuple(np.float32(row).tolist()) for row in driven.trajectory.actions]
    assert policy.memory.told[1:] == executed[:-1]
    assert [step for step in range(20) if driven.expert_commands[step]] == taken
    assert [step for step in range(20) if driven.risks[step]] == taken
    assert driven.trajectory.human_visible.tolist() == [step % 5 > 0 for step in range(20)]
    # It turns ever faster: the held command is the one wanted, not what was reached.
    assert np.all(np.diff(driven.trajectory.actions[:6, 1]) > 0)


def test_expert_that_drives_decides_between_pictures_too(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    often, seldom = (make_simulation() for _ in range(2))
    first = drive(often, _Expert(), _Camera(often), _Weigher())
    expert, camera = _Expert(), _Camera(seldom)
    second = drive(seldom, expert, camera, _Weigher(), image_every=4)
    assert np.array_equal(first.trajectory.actions, second.trajectory.actions)
    assert expert.asked_at == list(range(seldom.step))
    assert camera.taken == list(range(0, seldom.step, 4))
    assert [bool(commands) for commands in second.expert_commands] == [k % 4 == 0 for k in range(seldom.step)]


def test_disturbed_expert_says_what_it_would_do_at_the_states_that_it_comes_to(
    make_simulation: Callable[..., EpisodeSimulation],
) -> None:
    simulation, expert = make_simulation(time_limit_s=1.0), _Expert()
    disturbance = Disturbance(simulation.scenario.episode, DriverConfig(push=2.0), simulation.robot)
    driven = drive(simulation, expert, _Camera(simulation), _Weigher(), disturbance=disturbance)
    assert expert.asked_at == list(range(20))
    executed = driven.trajectory.actions
    assert not np.array_equal(executed, [commands[0] for commands in driven.expert_commands])
    before = np.vstack([np.zeros(2), executed])
    for commands, speeds in zip(driven.expert_commands, before[:-1], strict=True):
        assert abs(commands[0][1] - speeds[1]) <= 0.15 + 1e-9


def test_share_of_the_policys_episodes_is_the_mix_and_depends_on_the_key_alone() -> None:
    keys = [EpisodeKey(seed=1, split=Split.TRAIN, index=index) for index in range(400)]
    drivers = [driver_of(key, 0.25) for key in keys]
    assert 70 <= drivers.count(Driver.POLICY) <= 130
    assert drivers == [driver_of(key, 0.25) for key in keys]
    assert {driver_of(key, 0.0) for key in keys} == {Driver.EXPERT}
    assert {driver_of(key, 1.0) for key in keys} == {Driver.POLICY}
    of_the_smaller = [key for key, driver in zip(keys, drivers, strict=True) if driver is Driver.POLICY]
    assert {driver_of(key, 0.5) for key in of_the_smaller} == {Driver.POLICY}
