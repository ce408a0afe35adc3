import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import run_episode
from readygo.common.perception import PeopleTracker
from readygo.common.perception.people import NOBODY, People
from readygo.common.policy.memory import PolicyMemory
from readygo.common.state_policy.perceiving_driver import PerceivingStateDriver
from readygo.common.state_simulation.observe import PEOPLE, PERSON_COUNT
from tests.common.state_policy.state_policies import make_state_policy
from tests.common.state_simulation.episodes import Drawn, draw


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(2)


class Seeing:
    """Perceives one human in the world, or nobody."""

    def __init__(self, place: tuple[float, float] | None) -> None:
        self.place = place
        self.looks: list[int] = []

    def start(self) -> PolicyMemory:
        return PolicyMemory(200_000_000)

    def arrives(self, simulation: EpisodeSimulation) -> bool:
        return True

    def look(self, simulations: list[EpisodeSimulation]) -> np.ndarray:
        (self.simulation,) = simulations
        self.looks.append(self.simulation.step)
        return np.zeros((1, 2, 2, 3), np.uint8)

    def perceive(self, memory: PolicyMemory, command: np.ndarray) -> SimpleNamespace:
        if self.place is None:
            return SimpleNamespace(people=NOBODY)
        one = self.simulation
        dx, dy = self.place[0] - one.x_m, self.place[1] - one.y_m
        c, s = math.cos(one.yaw_rad), math.sin(one.yaw_rad)
        people = People(
            presence=np.array([0.95]),
            xy_m=np.array([[c * dx + s * dy, c * dy - s * dx]]),
            place_cov=0.05**2 * np.eye(2)[None],
            v_mps=np.zeros((1, 2)),
            velocity_cov=0.1**2 * np.eye(2)[None],
        )
        return SimpleNamespace(people=people)


def driver_of(drawn: Drawn, seeing: Seeing) -> PerceivingStateDriver:
    return PerceivingStateDriver(
        make_state_policy(),
        seeing,  # type: ignore[arg-type]
        seeing,
        drawn.state_world,
        drawn.distances,
        lambda: PeopleTracker(None, None),
    )


def told_at_the_end(drawn: Drawn, seeing: Seeing, steps: int = 9) -> np.ndarray:
    driver, one = driver_of(drawn, seeing), drawn.simulation(0)
    state = driver.start(one)
    for _ in range(steps):
        (command,) = driver.act([(one, state)])
        one.advance(*command)  # type: ignore[misc]
    driver.act([(one, state)])
    return state.actor.told[0].copy()


def test_policy_is_told_the_perceived_human_where_it_is(drawn: Drawn) -> None:
    one = drawn.simulation(0)
    place = (one.x_m + 1.5 * math.cos(one.yaw_rad), one.y_m + 1.5 * math.sin(one.yaw_rad))
    told, alone = told_at_the_end(drawn, Seeing(place)), told_at_the_end(drawn, Seeing(None))
    arcs = PEOPLE + 3 * PERSON_COUNT
    np.testing.assert_array_equal(alone[PEOPLE:arcs], 0.0)
    person = told[PEOPLE : PEOPLE + PERSON_COUNT]
    assert person[0] == 1.0
    assert 4.0 * math.hypot(person[1], person[2]) == pytest.approx(1.5, abs=0.5)
    assert not told[PEOPLE + PERSON_COUNT : arcs].any()


def test_it_looks_ten_times_a_second_and_drives_to_an_end(drawn: Drawn) -> None:
    seeing = Seeing(None)
    run = run_episode(drawn.simulation(1), driver_of(drawn, seeing))
    assert run.simulation.outcome is not None
    assert seeing.looks == list(range(0, run.simulation.step, 2))


def test_policy_knows_nothing_of_people_that_are_not_perceived(drawn: Drawn) -> None:
    """Among people who are not seen it drives as with nobody there."""
    driver, one = driver_of(drawn, Seeing(None)), drawn.simulation(0)
    assert one.human_xy_m.size > 0
    state = driver.start(one)
    driver.act([(one, state)])
    assert (state.actor.tracks.seen_step == -1).all()
