"""The loop of every closed-loop episode: a driver commands the robot, observers look on.

| who runs it | driver | observers |
|---|---|---|
| `generate`, `plan` | the expert | its decisions, the journal |
| `generate --policy` (stage `drive`) | a policy, or the expert with noise | camera, expert labels and risks |
| `evaluate`, `learn` | any method, many episodes in lockstep | none: the simulation keeps what is scored |
| films and pages of an evaluation | the actions that were kept | the journal |
| `drive --rehearse`, `simulate-robot` | a pilot behind a simulated network, a client of the transport | none |
| `rl` | the expert or the policy that it teaches, with the expert's labels | none |
| Gymnasium | the caller, by `EpisodeRun.advance` | the reward |
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from readygo.common.episode.simulation import EpisodeSimulation

Command = tuple[float, float]
"""v [m/s] and w [rad/s] for the next step."""
State = TypeVar("State")
"""What a driver remembers of one episode."""


@dataclass(frozen=True)
class DriverFailure:
    """Returned instead of a command: the driver gives the episode up, and the robot stands until it ends."""

    reason: str


class Driver(Protocol[State]):
    """Commands one or many robots; its state of an episode comes and goes with the episode."""

    looks: bool
    """True if it wants images: then episodes run in lockstep, and their views share a request."""

    def start(self, simulation: EpisodeSimulation) -> State:
        """Return the state for a new episode."""
        ...

    def act(self, running: Sequence[tuple[EpisodeSimulation, State]]) -> list[Command | DriverFailure]:
        """Command the next step of each episode; called once per step."""
        ...


class Observer:
    """Looks on at one episode. Every method may be overridden, none has to be."""

    def begin(self, simulation: EpisodeSimulation) -> None:
        """The robot stands at its start; `step` follows."""

    def step(self, simulation: EpisodeSimulation) -> None:
        """The robot is at the state of a step, before the driver decides what follows from there."""

    def end(self, simulation: EpisodeSimulation) -> None:
        """The episode has ended, as `simulation.outcome` says."""


class EpisodeRun:
    """One episode under way, with its observers."""

    def __init__(self, simulation: EpisodeSimulation, observers: Sequence[Observer] = (), *, row: int = 0) -> None:
        """Begin an episode.

        Args:
            simulation: The episode at its start.
            observers: Told of every state, in this order.
            row: The episode's number among those that run together.
        """
        self.simulation, self.row = simulation, row
        self.failure = ""
        """Why the driver gave up; empty if it did not."""
        self._observers = observers
        for observer in observers:
            observer.begin(simulation)
        self._tell()

    @property
    def ended(self) -> bool:
        """True if the episode has an outcome."""
        return self.simulation.outcome is not None

    def advance(self, command: Command) -> None:
        """Command the robot for one step and tell the observers of the state that follows.

        Raises:
            ValueError: If the episode has ended or the command is not finite.
        """
        self.simulation.advance(*command)
        self._tell()

    def give_up(self, reason: str) -> None:
        """Let the robot stand until the episode ends, because its driver failed."""
        self.failure = reason
        while not self.ended:
            self.advance((0.0, 0.0))

    def _tell(self) -> None:
        for observer in self._observers:
            (observer.end if self.ended else observer.step)(self.simulation)


def run_episodes(
    simulations: Iterable[EpisodeSimulation],
    driver: Driver[Any],
    observe: Callable[[EpisodeSimulation], Sequence[Observer]] = lambda _: (),
    *,
    lockstep: int = 1,
) -> Iterator[EpisodeRun]:
    """Drive through episodes, `lockstep` of them at a time; the next one starts as soon as one ends.

    An episode whose driver fails, or commands what is not finite, ends with the robot standing; the others continue.

    Args:
        simulations: Episodes at their start, taken one by one.
        driver: Commands all robots.
        observe: Makes the observers of an episode.
        lockstep: Most episodes at a time.

    Yields:
        Episodes in the order in which they end.
    """
    waiting = enumerate(simulations)
    running: dict[int, tuple[EpisodeRun, Any]] = {}
    while True:
        while len(running) < lockstep and (following := next(waiting, None)) is not None:
            row, simulation = following
            run = EpisodeRun(simulation, observe(simulation), row=row)
            running[row] = run, driver.start(simulation)
        if not running:
            return
        commands = driver.act([(run.simulation, state) for run, state in running.values()])
        for (run, _), command in zip(list(running.values()), commands, strict=True):
            _obey(run, command)
            if run.ended:
                del running[run.row]
                yield run


def run_episode(simulation: EpisodeSimulation, driver: Driver[Any], observers: Sequence[Observer] = ()) -> EpisodeRun:
    """Drive through one episode, see `run_episodes`."""
    (run,) = run_episodes([simulation], driver, lambda _: observers)
    return run


def _obey(run: EpisodeRun, command: Command | DriverFailure) -> None:
    if isinstance(command, DriverFailure):
        run.give_up(command.reason)
    elif not all(map(math.isfinite, command)):
        run.give_up(f"it commanded ({command[0]:g}, {command[1]:g})")
    else:
        run.advance(command)
