"""Lockstep with stand-ins: an episode of n steps ends after n commands."""

import math
from dataclasses import dataclass, field

import pytest

from readygo.common.episode.loop import DriverFailure, EpisodeRun, Observer, run_episode, run_episodes


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

    def act(self, running):
        self.batches.append(len(running))
        for _, memory in running:
            memory.append(None)
        return [(len(memory), simulation.steps) for simulation, memory in running]


@pytest.mark.parametrize("lockstep", [1, 2, 8])
def test_every_episode_keeps_its_own_memory(lockstep):
    lengths = [3, 1, 4, 1, 5]
    runs = {
        run.row: run.simulation.commands
        for run in run_episodes(map(Simulation, lengths), Counting(), lockstep=lockstep)
    }
    assert runs == {row: [(k + 1, length) for k in range(length)] for row, length in enumerate(lengths)}


def test_the_next_episode_starts_as_soon_as_one_ends():
    driver = Counting()
    ended = [run.row for run in run_episodes(map(Simulation, [3, 1, 4, 1, 5]), driver, lockstep=2)]
    assert ended == [1, 0, 3, 2, 4]
    assert driver.batches == [2, 2, 2, 2, 2, 1, 1, 1, 1]


@pytest.mark.parametrize("wrong", [DriverFailure("no idea"), (math.nan, 0.0), (0.1, math.inf)])
def test_robot_whose_driver_fails_stands_until_its_episode_is_over(wrong):
    driver = Counting()
    ask = driver.act
    driver.act = lambda running: [wrong if command == (2, 4) else command for command in ask(running)]
    runs = {run.row: run for run in run_episodes(map(Simulation, [4, 3]), driver, lockstep=2)}
    assert runs[0].simulation.commands == [(1, 4), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)]
    assert runs[0].failure in ("no idea", "it commanded (nan, 0)", "it commanded (0.1, inf)")
    assert runs[1].simulation.commands == [(1, 3), (2, 3), (3, 3)]
    assert runs[1].failure == ""


class Diary(Observer):
    """Notes what it is told."""

    def __init__(self, name, pages):
        self.name, self.pages = name, pages

    def begin(self, simulation):
        self.pages.append((self.name, "begin", len(simulation.commands)))

    def step(self, simulation):
        self.pages.append((self.name, "step", len(simulation.commands)))

    def end(self, simulation):
        self.pages.append((self.name, simulation.outcome, len(simulation.commands)))


def test_observers_see_every_state_before_the_driver_decides():
    pages = []

    class Writing(Counting):
        def start(self, simulation):
            pages.append(("driver", "start", len(simulation.commands)))
            return super().start(simulation)

        def act(self, running):
            pages.append(("driver", "act", len(running[0][0].commands)))
            return super().act(running)

    run = run_episode(Simulation(2), Writing(), [Diary("a", pages), Diary("b", pages)])
    assert (run.row, run.failure, run.ended) == (0, "", True)
    assert [page for page in pages if page[0] == "a"] == [
        ("a", "begin", 0), ("a", "step", 0), ("a", "step", 1), ("a", "ended", 2),
    ]  # fmt: skip
    assert pages[:2] == [("a", "begin", 0), ("b", "begin", 0)]
    assert pages[2:6] == [("a", "step", 0), ("b", "step", 0), ("driver", "start", 0), ("driver", "act", 0)]
    assert pages[6:9] == [("a", "step", 1), ("b", "step", 1), ("driver", "act", 1)]


def test_each_episode_has_observers_of_its_own_and_begins_when_there_is_room():
    pages = []
    simulations = map(Simulation, [2, 1, 1])
    ended = [
        run.row for run in run_episodes(simulations, Counting(), lambda one: [Diary(one.steps, pages)], lockstep=2)
    ]
    assert ended == [1, 0, 2]
    begun = [index for index, page in enumerate(pages) if page[1] == "begin"]
    assert begun[2] == pages.index((1, "ended", 1)) + 1, (
        "the third one begins when there is room, before anybody drives on"
    )


def test_caller_may_drive_and_what_it_does_is_told():
    pages = []
    run = EpisodeRun(Simulation(2), [Diary("a", pages)])
    run.advance((0.5, 0.0))
    assert not run.ended
    run.give_up("tired")
    assert run.simulation.commands == [(0.5, 0.0), (0.0, 0.0)]
    assert (run.failure, run.ended) == ("tired", True)
    assert pages[-2:] == [("a", "step", 1), ("a", "ended", 2)]


def test_plain_observer_does_nothing():
    run = run_episode(Simulation(1), Counting(), [Observer()])
    assert run.simulation.commands == [(1, 1)]
