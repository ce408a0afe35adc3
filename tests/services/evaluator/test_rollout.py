"""Lockstep with stand-ins: an episode of n steps ends after n commands."""

import math
from dataclasses import dataclass, field

import pytest

from readygo.services.evaluator.drivers import DriverFailure
from readygo.services.evaluator.rollout import roll_out


@dataclass
class Simulation:
    steps: int
    commands: list = field(default_factory=list)

    outcome = None

    def advance(self, v_mps, w_radps):
        self.commands.append((v_mps, w_radps))
        self.outcome = "ended" if len(self.commands) == self.steps else None
        return self.outcome


class Counting:
    """Commands how often it was asked about an episode, and of which one."""

    def __init__(self):
        self.batches = []

    def start(self, simulation):
        return []

    def commands(self, running):
        self.batches.append(len(running))
        for _, memory in running:
            memory.append(None)
        return [(len(memory), simulation.steps) for simulation, memory in running]


@pytest.mark.parametrize("lockstep", [1, 2, 8])
def test_every_episode_keeps_its_own_memory(lockstep):
    lengths = [3, 1, 4, 1, 5]
    runs = {run.row: run.simulation.commands for run in roll_out(lengths, Counting(), Simulation, lockstep=lockstep)}
    assert runs == {row: [(k + 1, length) for k in range(length)] for row, length in enumerate(lengths)}


def test_the_next_episode_starts_as_soon_as_one_ends():
    driver = Counting()
    ended = [run.row for run in roll_out([3, 1, 4, 1, 5], driver, Simulation, lockstep=2)]
    assert ended == [1, 0, 3, 2, 4]
    assert driver.batches == [2, 2, 2, 2, 2, 1, 1, 1, 1]


@pytest.mark.parametrize("wrong", [DriverFailure("no idea"), (math.nan, 0.0), (0.1, math.inf)])
def test_robot_whose_driver_fails_stands_until_its_episode_is_over(wrong):
    driver = Counting()
    ask = driver.commands
    driver.commands = lambda running: [wrong if command == (2, 4) else command for command in ask(running)]
    runs = {run.row: run for run in roll_out([4, 3], driver, Simulation, lockstep=2)}
    assert runs[0].simulation.commands == [(1, 4), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)]
    assert runs[0].failure in ("no idea", "it commanded (nan, 0)", "it commanded (0.1, inf)")
    assert runs[1].simulation.commands == [(1, 3), (2, 3), (3, 3)]
    assert runs[1].failure == ""
