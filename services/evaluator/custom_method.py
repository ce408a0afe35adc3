"""A user's method in an evaluation: a class that is imported by name; its errors affect only its episode."""

import importlib
import importlib.util
import queue
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.errors import RunError
from readygo.common.policy.observation import Observation
from readygo.common.robot import RobotConfig
from readygo.services.evaluator import Evaluator
from readygo.services.evaluator.eyes import Eyes

LIMIT_S = 10.0
"""Longest time of a command [s]; the first one may load a model."""


class Method(Protocol):
    """Interface of a user's class; it is constructed once, with the robot that it drives.

    An attribute `trained_on` of the class says in the benchmark's table what it has learned from: "" for nothing.
    """

    def start(self) -> Any:
        """The memory of a new episode."""
        ...

    def act(self, memory: Any, observation: Observation) -> tuple[float, float]:
        """The command for the next 0.05 s: v [m/s], w [rad/s]."""
        ...


@dataclass
class CustomState:
    """State of one episode of a user's method."""

    memory: Any = None
    failure: DriverFailure | None = None


class CustomDriver:
    """Driver with a user's method; an episode fails if the method raises, times out or returns no command."""

    looks = True

    def __init__(self, method: Method, eyes: Eyes, *, limit_s: float = LIMIT_S) -> None:
        self._method, self._eyes = method, eyes
        self._calls = TimedCalls(limit_s)

    def start(self, simulation: EpisodeSimulation) -> CustomState:
        """Begin an episode: the method's memory and its state."""
        memory = self._calls.run(self._method.start)
        return CustomState(failure=memory) if isinstance(memory, DriverFailure) else CustomState(memory=memory)

    def act(self, running: Sequence[tuple[EpisodeSimulation, CustomState]]) -> list[Command | DriverFailure]:
        """The method's command or failure for each running episode."""
        images = self._eyes.look([simulation for simulation, _ in running])
        return [
            state.failure or self._command(state, _observation(simulation, rgb))
            for (simulation, state), rgb in zip(running, images, strict=True)
        ]

    def _command(self, state: CustomState, observation: Observation) -> Command | DriverFailure:
        answer = self._calls.run(self._method.act, state.memory, observation)
        if isinstance(answer, DriverFailure):
            return answer
        try:
            v_mps, w_radps = (float(value) for value in answer)
        except (TypeError, ValueError):
            return DriverFailure(f"it commanded {_short(answer)}, not two numbers")
        return v_mps, w_radps


class TimedCalls:
    """Calls functions on a separate thread, so that a function that never returns costs only its time limit."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._asked: queue.SimpleQueue[tuple[Callable[..., Any], tuple[Any, ...]]] | None = None
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """The result of a function, or a `DriverFailure` if it raises or takes too long."""
        if self._asked is None:
            self._asked, self._answers = queue.SimpleQueue(), queue.SimpleQueue()
            threading.Thread(target=_work, args=(self._asked, self._answers), daemon=True).start()
        self._asked.put((function, arguments))
        try:
            return self._answers.get(timeout=self._limit_s)
        except queue.Empty:
            # The thread is abandoned; its late result is discarded.
            self._asked = None
            return DriverFailure(f"it took longer than {self._limit_s:g} s for a command")


def load_custom_method(name: str, evaluator: Evaluator) -> CustomDriver:
    """Import a user's method, and make its driver.

    Args:
        name: `my_package:MyDriver`, or `folder/file.py:MyDriver`.
        evaluator: Evaluator in which it drives.

    Raises:
        RunError: If it cannot be imported or made, or lacks `start` or `act`.
    """
    method = _make(_find(name), name, evaluator.robot)
    missing = [part for part in ("start", "act") if not callable(getattr(method, part, None))]
    if missing:
        raise RunError(f"The method {name} has no {missing[0]}(): it needs start() and act(memory, observation).")
    return CustomDriver(method, evaluator.eyes())


def stated_training(name: str) -> str | None:
    """What a user's class says that it has learned from, in its attribute `trained_on`.

    Args:
        name: `my_package:MyDriver`, or `folder/file.py:MyDriver`.

    Returns:
        Its words, empty if it has learned from nothing; None if it has no such attribute.

    Raises:
        RunError: If it cannot be imported, or the attribute is no text.
    """
    stated = getattr(_find(name), "trained_on", None)
    if stated is not None and not isinstance(stated, str):
        raise RunError(f"The attribute trained_on of {name} must be a text, got {_short(stated)}.")
    return stated


def _find(name: str) -> Callable[[RobotConfig], Any]:
    place, _, attribute = name.rpartition(":")
    try:
        module = _module_of_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
        found: Callable[[RobotConfig], Any] = getattr(module, attribute)
    except Exception as error:  # a user's module may raise anything
        raise RunError(f"The method {name} cannot be imported: {_line(error)}") from error
    return found


def _module_of_file(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ImportError(f"there is no file {path}")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses and pickles look up their module by name.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _make(found: Callable[[RobotConfig], Any], name: str, robot: RobotConfig) -> Any:
    try:
        return found(robot)
    except Exception as error:
        raise RunError(f"The method {name} cannot be made of the robot: {_line(error)}") from error


def _observation(simulation: EpisodeSimulation, rgb: Any) -> Observation:
    return Observation(
        rgb=rgb.copy(),
        goal_xy_m=simulation.goal_xy_robot_m,
        v_mps=simulation.v_mps,
        w_radps=simulation.w_radps,
        time_s=simulation.time_s,
    )


def _work(asked: "queue.SimpleQueue[Any]", answers: "queue.SimpleQueue[Any]") -> None:
    while True:
        function, arguments = asked.get()
        try:
            answer = function(*arguments)
        except Exception as error:
            answer = DriverFailure(_line(error))
        answers.put(answer)


def _line(error: Exception) -> str:
    return _short(" ".join(f"{type(error).__name__}: {error}".split()))


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
