import math
from types import SimpleNamespace

import pytest

from readygo.services.evaluator.rollout import roll_out


class Run:
    """An episode that ends after some steps."""

    def __init__(self, name, steps):
        self.name, self.steps, self.commands = name, steps, []

    def advance(self, v_mps, w_radps):
        self.commands.append((v_mps, w_radps))
        return "over" if len(self.commands) == self.steps else None

    def trajectory(self):
        return SimpleNamespace(name=self.name, commands=self.commands)


class Watch:
    """A driver that notes who asks, and answers with the place in the batch."""

    def __init__(self):
        self.asked, self.running = [], []

    def start(self, simulation):
        self.running.append(simulation.name)

    def stop(self, simulation):
        self.running.remove(simulation.name)

    def commands(self, simulations):
        assert [simulation.name for simulation in simulations] == self.running
        self.asked.append("".join(simulation.name for simulation in simulations))
        return [(math.nan if simulation.name == "?" else ord(simulation.name), 0.0) for simulation in simulations]


@pytest.mark.parametrize(
    ("lockstep", "asked"),
    [(1, ["a", "a", "a", "b", "c", "c"]), (2, ["ab", "ac", "ac"]), (9, ["abc", "ac", "a"])],
)
def test_as_many_as_allowed_run_at_a_time_and_the_next_starts_when_one_ends(lockstep, asked):
    driver = Watch()
    episodes = [("a", 3), ("b", 1), ("c", 2)]
    runs = list(roll_out(episodes, driver, lambda episode: Run(*episode), lockstep=lockstep))
    assert driver.asked == asked
    assert driver.running == []
    assert {row: run.name for row, run in runs} == {0: "a", 1: "b", 2: "c"}
    assert [run.commands for _, run in sorted(runs)] == [[(97, 0.0)] * 3, [(98, 0.0)], [(99, 0.0)] * 2]


def test_runs_come_in_the_order_in_which_they_end():
    episodes = [("a", 3), ("b", 1), ("c", 1)]
    assert [row for row, _ in roll_out(episodes, Watch(), lambda e: Run(*e), lockstep=2)] == [1, 2, 0]


def test_no_episodes_ask_nobody():
    driver = Watch()
    assert list(roll_out([], driver, lambda e: Run(*e), lockstep=4)) == []
    assert driver.asked == []
