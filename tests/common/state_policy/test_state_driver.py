import numpy as np
import pytest

from readygo.common.episode.loop import Observer, run_episode
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.state_policy.commands import StateCommands
from readygo.common.state_policy.state_driver import StateDriver, detection_seed
from readygo.common.state_simulation.simulation import OUTCOMES, RUNNING, StateSimulation
from readygo.common.state_simulation.tracks import has_no_tracks, tracker_numbers
from tests.common.state_policy.state_policies import make_state_policy
from tests.common.state_simulation.episodes import Drawn, draw

NOISE = PerceptionNoise(false_alarms_hz=0.3, measures_velocity=True, velocity_mps=0.2)


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(8)


class Told(Observer):
    """Notes what the robot is told at every decision."""

    def __init__(self, driver: StateDriver) -> None:
        self.rows: list[np.ndarray] = []
        self._driver, self._told = driver, driver.told
        driver.told = self._note  # type: ignore[method-assign]

    def _note(self, simulation, episode):
        told = self._told(simulation, episode)
        self.rows.append(told[0].copy())
        return told


def test_robot_is_told_the_same_numbers_as_in_the_state_simulation(drawn: Drawn) -> None:
    policy, clock = make_state_policy(NOISE), drawn.world.config.robot.clock
    fast = StateSimulation(drawn.state_world, drawn.bank, tracker_numbers(NOISE, clock), 8, knows_truth=False)
    exact = [drawn.simulation(k) for k in range(8)]
    fast.begin(np.arange(8), np.ones(8, bool), [detection_seed(one) for one in exact])
    told: list[list[np.ndarray]] = [[] for _ in exact]
    commands = StateCommands(policy, 8)
    while (running := fast.last.outcome == RUNNING).any():
        for k in np.flatnonzero(running):
            told[k].append(fast.told[k].copy())
        alone = has_no_tracks(fast.tracks)
        wanted = commands.decide(fast.told, fast.step * clock.dt_s, fast.state[:, :2], alone)
        fast.advance(wanted, again=False)
    people = 0.0
    for k, one in enumerate(exact):
        driver = StateDriver(policy, drawn.state_world, drawn.distances)
        seen = Told(driver)
        run_episode(one, driver)
        assert OUTCOMES[fast.last.outcome[k]] is one.outcome
        assert fast.last.length[k] == one.step
        assert np.array_equal(np.array(seen.rows), np.array(told[k]))
        people += np.array(told[k])[:, 45].sum()
    assert people > 20


def test_same_episode_repeats_its_errors(drawn: Drawn) -> None:
    paths = []
    for _ in range(2):
        one, driver = drawn.simulation(0), StateDriver(make_state_policy(), drawn.state_world, drawn.distances)
        run_episode(one, driver)
        paths.append(one.path_xyyaw(0, one.step))
    assert np.array_equal(*paths)
