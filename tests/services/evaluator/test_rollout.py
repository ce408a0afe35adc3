"""Lockstep with stand-ins: an episode of n steps ends after n commands."""

from dataclasses import dataclass, field

import pytest

from readygo.services.evaluator.rollout import roll_out


@dataclass
class Simulation:
    steps: int
    commands: list = field(default_factory=list)

    def advance(self, v_mps, w_radps):
        self.commands.append((v_mps, w_radps))
        return "ended" if len(self.commands) == self.steps else None

    def trajectory(self):
        return self.commands


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
    runs = dict(roll_out(lengths, Counting(), Simulation, lockstep=lockstep))
    assert runs == {row: [(k + 1, length) for k in range(length)] for row, length in enumerate(lengths)}


def test_the_next_episode_starts_as_soon_as_one_ends():
    driver = Counting()
    ended = [row for row, _ in roll_out([3, 1, 4, 1, 5], driver, Simulation, lockstep=2)]
    assert ended == [1, 0, 3, 2, 4]
    assert driver.batches == [2, 2, 2, 2, 2, 1, 1, 1, 1]
