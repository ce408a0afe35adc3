import numpy as np
import pytest

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Observer, run_episode
from readygo.common.state_policy.state_driver import StateDriver
from readygo.services.driver import EpisodeDrive, StateTeacher, drive
from readygo.services.driver.handlers import Commands, executable
from tests.common.state_policy.state_policies import make_state_policy
from tests.common.state_simulation.episodes import Drawn, draw

IMAGE_EVERY = 5
"""No multiple of the four steps that the policy holds a command."""
EPISODES = range(3)


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(len(EPISODES))


class _Weigher:
    def risks(self, simulation: EpisodeSimulation) -> bytes:
        return b"1"


class _Wanders:
    """Drives in curves, whatever the teacher says."""

    looks = False

    def start(self, simulation: EpisodeSimulation) -> None:
        return None

    def act(self, running: list[tuple[EpisodeSimulation, None]]) -> list[tuple[float, float]]:
        return [(0.5, float(np.sin(0.1 * simulation.step))) for simulation, _ in running]


class _Follower(Observer):
    """Notes what a state driver of its own would decide at every step, as labels, and what the expert sees."""

    def __init__(self, drawn: Drawn, simulation: EpisodeSimulation) -> None:
        self._driver = _driver(drawn)
        self._episode = self._driver.start(simulation)
        self._expert = drawn.world.robot_planner.expert(simulation.scenario, simulation.motions)
        self.decided: list[Commands] = []
        self.seen: list[bool] = []

    def step(self, simulation: EpisodeSimulation) -> None:
        self._driver.perceive(simulation, self._episode)
        self.decided.append(executable(np.array([self._driver.decide(simulation, self._episode)]), simulation))
        self.seen.append(self._expert.watch(simulation))


def _driver(drawn: Drawn, **changes: float) -> StateDriver:
    return StateDriver(make_state_policy(**changes), drawn.state_world, drawn.distances)


def _taught(
    drawn: Drawn, k: int, driver: object = None, observer: Observer | None = None, image_every: int = IMAGE_EVERY
) -> EpisodeDrive:
    simulation = drawn.simulation(k)
    teacher = StateTeacher(_driver(drawn), simulation)
    return drive(simulation, teacher, _Weigher(), driver, camera=observer, image_every=image_every)  # type: ignore[arg-type]


def test_teacher_that_drives_drives_as_its_policy_does_without_holding_commands(drawn: Drawn) -> None:
    for k in EPISODES:
        driven, alone = _taught(drawn, k).trajectory, drawn.simulation(k)
        run_episode(alone, _driver(drawn, hold_s=alone.clock.dt_s))
        assert driven.outcome is alone.outcome
        assert np.array_equal(driven.xyyaw, alone.path_xyyaw(0, alone.step)[:-1])
        assert driven.replan_times_s.size == 0
        assert not driven.replanned.any()
        assert not driven.expert_cost.any()


def test_label_of_a_teacher_that_drives_is_what_the_robot_executes(drawn: Drawn) -> None:
    driven = _taught(drawn, 0)
    labelled = {step: label[0] for step, label in enumerate(driven.expert_commands) if label}
    assert list(labelled) == list(range(0, len(driven.trajectory.actions), IMAGE_EVERY))
    assert all(tuple(driven.trajectory.actions[step].tolist()) == label for step, label in labelled.items())


def test_states_that_another_driver_comes_to_are_labelled_by_the_decision_there(drawn: Drawn) -> None:
    stale = seen = 0
    for k in EPISODES:
        simulation = drawn.simulation(k)
        follower = _Follower(drawn, simulation)
        driven = _taught(drawn, k, _Wanders(), follower)
        steps = range(0, len(driven.trajectory.actions), IMAGE_EVERY)
        assert [driven.expert_commands[step] for step in steps] == [follower.decided[step] for step in steps]
        assert driven.trajectory.human_visible.tolist() == follower.seen
        stale += sum(follower.decided[step] != follower.decided[step - step % 4] for step in steps)
        seen += sum(follower.seen)
    assert stale > 0
    assert seen > 0


def test_same_episode_has_the_same_labels_at_any_rate_of_images(drawn: Drawn) -> None:
    first, second, often = (_taught(drawn, 1, _Wanders(), None, every) for every in (IMAGE_EVERY, IMAGE_EVERY, 1))
    assert first.expert_commands == second.expert_commands
    assert first.expert_commands[::IMAGE_EVERY] == often.expert_commands[::IMAGE_EVERY]


def test_teacher_that_is_asked_again_at_the_same_step_says_the_same(drawn: Drawn) -> None:
    simulation = drawn.simulation(2)
    once, twice = (StateTeacher(_driver(drawn), simulation) for _ in range(2))
    for _ in range(30):
        twice.watch(simulation)
        again = [twice.act(simulation) for _ in range(2)]
        advice = once.act(simulation)
        for other in again:
            assert np.array_equal(other.commands, advice.commands)
            assert other.visible == advice.visible
        assert advice.commands.shape == (1, 2)
        simulation.advance(*advice.commands[0].tolist())
