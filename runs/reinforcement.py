"""Trains a state policy: makes its worlds, and episodes of planner and animator, kept in the user's cache."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import itertools
import json
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

from readygo.common.config import section_to_mapping
from readygo.common.errors import ConfigError, RunError, SceneError
from readygo.common.files import cache_folder
from readygo.common.messages import RunSpec, Split
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.state_policy.state_policy import StatePolicySpec, hold_steps_of
from readygo.common.state_simulation.bank import EpisodeBank, join_banks, load_bank, make_bank
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.runs.config import RunConfig
from readygo.runs.demonstrations import Teacher
from readygo.runs.identity import identity
from readygo.runs.scenarios import accepted_scenarios
from readygo.runs.sections import NO_KEYS, Keys, with_keys
from readygo.runs.state_world import goal_distances, state_world
from readygo.runs.training import torch_needed
from readygo.runs.world import World
from readygo.services.animator import Animator
from readygo.services.planner import HumanPlanner
from readygo.services.trainer import ReinforcementConfig

if TYPE_CHECKING:
    from readygo.services.trainer import Training

BANK_FORMAT = 2
PART = 64
"""Indices, accepted or not, of one file of a bank."""
ROUNDS, EPOCHS = 5, 12
"""Rounds of demonstrations, and passes over all of them after each."""
REJECTED_PARTS_MAX = 16
"""Parts in a row without an accepted episode after which the scene is called unusable."""
_SECTIONS = ("robot", "episode", "human_planner", "animator")
"""Sections of settings that episodes depend on."""
Show = Callable[[int, int], None]
"""Told how many episodes of how many there are."""
DrawShow = Callable[[Split, int, int], None]
"""Told of which split how many episodes of how many there are."""


def make_reinforcement_config(noise: PerceptionNoise, keys: Keys = NO_KEYS) -> ReinforcementConfig:
    """How to learn.

    Args:
        noise: Errors of perception.
        keys: Keys of the command line.

    Raises:
        ConfigError: If a key is unknown or a value makes no sense.
    """
    return with_keys(ReinforcementConfig(noise=noise), keys)


def with_standing(config: RunConfig, standing_max: int) -> RunConfig:
    """The settings of a run with up to `standing_max` people who stand in the way, or as many as they have."""
    people = config.human_planner
    people = dataclasses.replace(people, standing_max=max(people.standing_max, standing_max))
    return dataclasses.replace(config, human_planner=people)


def run_reinforcement(
    worlds: Sequence[World],
    config: ReinforcementConfig,
    out: Path,
    *,
    decisions: int | None,
    minutes: float | None,
    workers: int = 1,
    draws: DrawShow = lambda split, done, total: None,
    show: Callable[[Mapping[str, Any], float], None] = lambda row, share: None,
) -> dict[str, Any]:
    """Train a state policy in some scenes, with the seed of the first world's run, or continue.

    Args:
        worlds: Worlds of runs with equal settings, each of another scene, which share episodes and robots equally.
        config: How to learn.
        out: Folder of the policy.
        decisions: Budget in decisions, including earlier calls; None takes the minutes.
        minutes: Budget in processor time [min].
        workers: Processes that draw episodes.
        draws: Told of episodes that are drawn.
        show: Told of every measurement, and of the share of the budget that is spent.

    Returns:
        The content of `metrics.json`.

    Raises:
        PolicyError: If torch is not installed, `out` has another training, or a command cannot be held as long.
        SceneError: If a scene yields no episodes.
        ConfigError: If there are fewer robots than scenes.
        RunError: If a process that draws episodes ends early.
    """
    with torch_needed():
        from readygo.services.trainer import Budget, Place, Training
    first, robots = worlds[0], config.ppo.robots
    if robots < len(worlds):
        raise ConfigError(f"--ppo.robots {robots} are too few for {len(worlds)} scenes: each has one or more.")
    spec = StatePolicySpec(
        robot=first.config.robot,
        scenes={world.spec.scene_hash: world.scene.name for world in worlds},
        hold_s=config.hold_s,
        observation=config.observation,
        noise=config.noise,
        training={"seed": first.spec.seed, "settings": section_to_mapping(config)},
    )
    seen = [state_world(world, config.observation) for world in worlds]
    budget = Budget(decisions=decisions, minutes=minutes)
    hold_steps_of(spec.robot, spec.hold_s)
    places = []
    for world, of_scene in zip(worlds, seen, strict=True):
        train, val = (
            draw_bank(world, split, math.ceil(count / len(worlds)), functools.partial(draws, split), workers=workers)
            for split, count in ((Split.TRAIN, config.train_episodes), (Split.VAL, config.val_episodes))
        )
        places.append(Place(world=of_scene, train=train, val=val))
    origin = "+".join(_digest(world, Split.TRAIN) for world in worlds)
    training = Training(places, spec, config, out, seed=first.spec.seed, origin=origin)
    if config.demonstrations and not (training.progress.taught or training.progress.decisions):
        teachers = [Teacher(world, each, goal_distances(world)) for world, each in zip(worlds, seen, strict=True)]
        _teach(teachers, training, config.demonstrations)
    return training.run(budget, lambda row: show(row, budget.share(row["decisions"], 60.0 * row["minutes"])))


def _teach(teachers: Sequence[Teacher], training: "Training", count: int) -> None:
    """Let the experts of all scenes teach the actor, in `ROUNDS` rounds in which the policy drives more and more."""
    policy, known = training.policy, None
    for part in range(ROUNDS):
        for teacher in teachers:
            new = teacher.teach(policy, max(count // (ROUNDS * len(teachers)), 1), alone=part == 0)
            known = new if known is None else known.joined(new)
        assert known is not None
        policy = training.teach(known.told, known.shares, epochs=EPOCHS)
    training.progress.taught = True
    training.save()


def draw_bank(
    world: World, split: Split, count: int, show: Show = lambda done, total: None, *, workers: int = 1
) -> EpisodeBank:
    """The first episodes of a split that planner and animator accept, as arrays.

    They are drawn in parts, and every part is kept in the user's cache: an interrupted call continues.

    Args:
        world: World of a run, with its seed.
        split: Split of the episodes.
        count: Episodes.
        show: Told of the progress.
        workers: Processes that draw; 1 draws in this one. The episodes are the same.

    Raises:
        SceneError: If the planner rejects part after part.
        RunError: If a part cannot be read or written, or a process that draws ends early.
    """
    folder = cache_folder("episodes") / _digest(world, split)
    folder.mkdir(exist_ok=True)
    banks: list[EpisodeBank] = []
    done = rejected = 0
    with _Drawers(world, split, folder, workers) as drawers:
        numbers, waiting = itertools.count(), deque[Callable[[], EpisodeBank]]()
        while done < count:
            # A part has at most PART episodes: none is begun that is not needed.
            while len(waiting) < workers and done + PART * len(waiting) < count:
                waiting.append(drawers.begin(next(numbers)))
            bank = waiting.popleft()()
            rejected = 0 if len(bank) else rejected + 1
            if rejected == REJECTED_PARTS_MAX:
                raise SceneError(f"The last {PART * rejected} scenarios of {world.scene.name} were rejected.")
            if len(bank):
                banks.append(bank)
            done += len(bank)
            show(min(done, count), count)
    return join_banks(banks).first(count)


class _Drawers:
    """Draws the missing parts of a split, in this process or in others."""

    def __init__(self, world: World, split: Split, folder: Path, workers: int) -> None:
        self._here, self._split, self._folder, self._workers = _Makers(world), split, folder, workers
        self._spec = world.spec
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> "_Drawers":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._pool is None:
            return
        if kind is not None:
            # Parts are written whole or not at all.
            for process in active_children():
                process.terminate()
        self._pool.shutdown(cancel_futures=True)

    def begin(self, part: int) -> Callable[[], EpisodeBank]:
        """Begin a part; what is returned waits for its episodes."""
        path, indices = self._folder / f"part-{part:05d}.npz", range(PART * part, PART * (part + 1))
        if path.exists():
            return functools.partial(load_bank, path)
        if self._workers == 1:
            return functools.partial(self._here.draw, self._split, indices, path)
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._workers, get_context("spawn"), initializer=_open, initargs=(self._spec,)
            )
        return functools.partial(_wait, self._pool.submit(_draw, self._split, indices, path), path)


_opened: list["_Makers"] = []
"""Makers of a process of the pool."""


def _open(spec: RunSpec) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _opened.append(_Makers(World(spec)))


def _end_with_parent() -> None:
    """End this process of the pool with the one that began it, also where that was killed."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _draw(split: Split, indices: range, path: Path) -> None:
    (makers,) = _opened
    makers.draw(split, indices, path)


def _wait(drawn: "Future[None]", path: Path) -> EpisodeBank:
    try:
        drawn.result()
    except BrokenProcessPool:
        raise RunError(
            "A process that draws episodes ended early; if memory is short, use fewer with --workers."
        ) from None
    return load_bank(path)


class _Makers:
    """Planner and animator, made when a part is missing."""

    def __init__(self, world: World) -> None:
        self._world = world

    @functools.cached_property
    def _made(self) -> tuple[HumanPlanner, Animator, GoalDistances]:
        world = self._world
        return world.human_planner(react=False), world.animator(), goal_distances(world)

    def draw(self, split: Split, indices: range, path: Path) -> EpisodeBank:
        """Draw a part and keep it."""
        planner, animator, distances = self._made
        pairs = list(accepted_scenarios(planner, animator, self._world.spec.seed, split, indices))
        config = self._world.config
        bank = make_bank(pairs, distances, config.episode.human_count_max + config.human_planner.standing_max)
        bank.save(path)
        return bank


def _digest(world: World, split: Split) -> str:
    """Names the episodes of a split: equal for equal episodes, which also means for equal scene, robot and people."""
    known = identity(world.spec)
    parts = {name: known[name] for name in ("scene", "avatars", "seed", "scenarios")}
    config = {name: known["config"].get(name) for name in _SECTIONS}
    version = importlib.metadata.version("readygo")
    text = json.dumps([BANK_FORMAT, version, split.value, parts, config], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]
