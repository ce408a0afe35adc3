"""Robots of several scenes side by side."""

import numpy as np
import pytest

from readygo.common.perception.noise import PERCEIVED
from readygo.common.state_simulation.joined import JoinedSimulation
from readygo.common.state_simulation.simulation import StateSimulation
from readygo.common.state_simulation.tracks import tracker_numbers
from tests.common.state_simulation.episodes import Drawn, draw


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(6)


def part(drawn: Drawn, robots: int, seed: int) -> StateSimulation:
    """Robots in the first episodes."""
    bank = drawn.bank.first(3 + seed % 2)
    numbers = tracker_numbers(PERCEIVED, drawn.world.config.robot.clock)
    return StateSimulation(drawn.state_world, bank, numbers, robots, seed=seed)


def test_robots_of_each_scene_drive_as_they_do_alone(drawn: Drawn) -> None:
    alone, joined = [part(drawn, 3, 0), part(drawn, 5, 1)], JoinedSimulation([part(drawn, 3, 0), part(drawn, 5, 1)])
    for simulation in (*alone, joined):
        simulation.begin_anywhere()
    assert len(joined) == 8
    rng, ended = np.random.default_rng(0), 0
    for _ in range(120):
        commands = rng.uniform((0.3, -1.2), (1.0, 1.2), size=(8, 2))
        one, two, both = alone[0].advance(commands[:3]), alone[1].advance(commands[3:]), joined.advance(commands)
        for name in ("reward", "ended", "outcome", "length", "dynamic"):
            expected = np.concatenate([getattr(one, name), getattr(two, name)])
            assert np.array_equal(getattr(both, name), expected), name
        ended += int(both.ended.sum())
        assert np.array_equal(joined.told, np.concatenate([alone[0].told, alone[1].told]))
        assert np.array_equal(joined.truth, np.concatenate([alone[0].truth, alone[1].truth]))
    assert ended > 8


def test_snapshot_continues_where_it_was_taken(drawn: Drawn) -> None:
    first, other = (JoinedSimulation([part(drawn, 2, k), part(drawn, 4, k + 1)]) for k in (0, 6))
    first.begin_anywhere()
    commands = np.tile([0.6, 0.3], (6, 1))
    for _ in range(20):
        first.advance(commands)
    other.restore(first.snapshot())
    assert np.array_equal(first.told, other.told)
    for _ in range(40):
        first.advance(commands)
        other.advance(commands)
    assert np.array_equal(first.told, other.told)
    assert np.array_equal(first.last.reward, other.last.reward)
