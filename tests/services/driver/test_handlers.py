from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.loop import DriverFailure, Observer
from readygo.common.errors import PolicyError
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import DriverKind, EpisodeKey, EpisodeMotions, Outcome, Scenario, Split
from readygo.common.robot import RobotConfig
from readygo.services.driver import Disturbance, drive, driver_of

START_X_M = 2.0
CALM = {"push": 0.0, "late_max_s": 0.0}


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


class _Camera(Observer):
    """Notes when it is told of a state at which an image is due."""

    def __init__(self, image_every: int = 1) -> None:
        self.taken: list[int] = []
        self._image_every = image_every

    def step(self, simulation: EpisodeSimulation) -> None:
        if simulation.step % self._image_every == 0:
            self.taken.append(simulation.step)


class _Weigher:
    """The step, as the risk of the only command."""

    def risks(self, simulation: EpisodeSimulation) -> bytes:
        return bytes([simulation.step])


class _Turns:
    """Drives: it turns on the spot, and notes when it is asked."""

    looks = True

    def __init__(self, last: int | None = None) -> None:
        self.asked_at: list[int] = []
        self._last = last

    def start(self, simulation: EpisodeSimulation) -> None:
        return None

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[tuple[float, float] | DriverFailure]:
        ((simulation, _),) = running
        self.asked_at.append(simulation.step)
        return [DriverFailure("it is dizzy") if simulation.step == self._last else (0.0, 9.0)]


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
    camera = _Camera()
    driven = drive(simulation, expert, _Weigher(), camera=camera)
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
    for disturbance in (None, Disturbance(EpisodeKey(seed=0, split=Split.TRAIN, index=0), robot, **CALM)):
        simulation = make_simulation(time_limit_s=1.0, robot=robot)
        driven = drive(simulation, _Expert(), _Weigher(), disturbance=disturbance)
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
    first = np.array(drive(simulation, _Expert(), _Weigher()).expert_commands[0])
    assert first.shape == (1 + 20, 2)
    changes = np.abs(np.diff(np.vstack([[0.0, 0.0], first]), axis=0))
    assert changes[:, 0].max() <= robot.a_max_mps2 * 0.05 + 1e-9
    assert changes[:, 1].max() <= robot.alpha_max_radps2 * 0.05 + 1e-9
    # Two steps ahead, then the turn that the last command holds.
    assert first[1, 0] > first[0, 0] > 0.0
    assert tuple(first[-1]) == (0.0, 1.0)


def test_collision_is_kept_with_the_advice_before_it(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    simulation = make_simulation(goal_x_m=11.0)
    driven = drive(simulation, _Expert(), _Weigher())
    assert driven.trajectory.outcome is Outcome.STATIC_COLLISION
    assert len(driven.expert_commands) == len(driven.trajectory.actions) > 20


def test_expert_labels_every_state_that_another_driver_comes_to(
    make_simulation: Callable[..., EpisodeSimulation],
) -> None:
    expert, driver = _Expert(), _Turns()
    driven = drive(make_simulation(time_limit_s=1.0), expert, _Weigher(), driver)
    assert driven.trajectory.outcome is Outcome.TIMEOUT
    assert expert.asked_at == driver.asked_at == list(range(20))
    assert not driven.trajectory.actions[:, 0].any()
    assert driven.expert_commands[5][0][0] > 0.0


def test_expert_watches_between_images_while_another_driver_drives(
    make_simulation: Callable[..., EpisodeSimulation],
) -> None:
    expert, camera, driver = _Expert(), _Camera(5), _Turns()
    driven = drive(make_simulation(time_limit_s=1.0), expert, _Weigher(), driver, camera=camera, image_every=5)
    taken = [0, 5, 10, 15]
    assert camera.taken == expert.asked_at == taken
    assert driver.asked_at == list(range(20))
    assert expert.watched_at == [step for step in range(20) if step % 5]
    assert [step for step in range(20) if driven.expert_commands[step]] == taken
    assert [step for step in range(20) if driven.risks[step]] == taken
    assert driven.trajectory.human_visible.tolist() == [step % 5 > 0 for step in range(20)]
    assert driven.trajectory.expert_cost.tolist() == [2.5] * 20


def test_driver_that_gives_up_is_an_error(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    with pytest.raises(PolicyError, match="gave up: it is dizzy"):
        drive(make_simulation(time_limit_s=1.0), _Expert(), _Weigher(), _Turns(last=7))


def test_expert_that_drives_decides_between_pictures_too(make_simulation: Callable[..., EpisodeSimulation]) -> None:
    often, seldom = (make_simulation() for _ in range(2))
    first = drive(often, _Expert(), _Weigher())
    expert, camera = _Expert(), _Camera(4)
    second = drive(seldom, expert, _Weigher(), camera=camera, image_every=4)
    assert np.array_equal(first.trajectory.actions, second.trajectory.actions)
    assert expert.asked_at == list(range(seldom.step))
    assert camera.taken == list(range(0, seldom.step, 4))
    assert [bool(commands) for commands in second.expert_commands] == [k % 4 == 0 for k in range(seldom.step)]


def test_disturbed_expert_says_what_it_would_do_at_the_states_that_it_comes_to(
    make_simulation: Callable[..., EpisodeSimulation],
) -> None:
    simulation, expert = make_simulation(time_limit_s=1.0), _Expert()
    disturbance = Disturbance(simulation.scenario.episode, simulation.robot, push=2.0)
    driven = drive(simulation, expert, _Weigher(), disturbance=disturbance)
    assert expert.asked_at == list(range(20))
    executed = driven.trajectory.actions
    assert not np.array_equal(executed, [commands[0] for commands in driven.expert_commands])
    before = np.vstack([np.zeros(2), executed])
    for commands, speeds in zip(driven.expert_commands, before[:-1], strict=True):
        assert abs(commands[0][1] - speeds[1]) <= 0.15 + 1e-9


def test_share_of_the_policys_episodes_is_the_mix_and_depends_on_the_key_alone() -> None:
    keys = [EpisodeKey(seed=1, split=Split.TRAIN, index=index) for index in range(400)]
    drivers = [driver_of(key, 0.25) for key in keys]
    assert 70 <= drivers.count(DriverKind.POLICY) <= 130
    assert drivers == [driver_of(key, 0.25) for key in keys]
    assert {driver_of(key, 0.0) for key in keys} == {DriverKind.EXPERT}
    assert {driver_of(key, 1.0) for key in keys} == {DriverKind.POLICY}
    of_the_smaller = [key for key, driver in zip(keys, drivers, strict=True) if driver is DriverKind.POLICY]
    assert {driver_of(key, 0.5) for key in of_the_smaller} == {DriverKind.POLICY}
