"""Compilation of all kernels of the stages, before they are needed."""

import importlib.metadata
import itertools
import math
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from readygo.common.files import cache_folder
from readygo.common.locks import held
from readygo.common.messages import (
    AnimateRequest,
    EpisodeKey,
    HumanPlanRequest,
    HumanTrajectory,
    RobotPlanRequest,
    Scenario,
    Split,
)
from readygo.common.perception.noise import PERCEIVED
from readygo.common.rasterizer.warm import warm as warm_rasterizer
from readygo.common.state_simulation.bank import make_bank
from readygo.common.state_simulation.simulation import StateSimulation
from readygo.common.state_simulation.tracks import tracker_numbers
from readygo.common.state_simulation.world import ObservationConfig
from readygo.runs.config import RunConfig
from readygo.runs.scenarios import accepted_scenarios
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.state_world import goal_distances, state_world
from readygo.runs.world import World
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import HumanPlanner, handle_human_plan, handle_robot_plan


def warm_once() -> None:
    """Compile all kernels once per version and machine; other processes wait meanwhile."""
    with held(_marker().parent / "lock", patience_s=math.inf):
        if not _marker().exists():
            warm_all()


def warm_all() -> None:
    """Take one short episode of the embedded scene through all stages; kernels are compiled in two processes."""
    with _beside(warm_walking):
        warm_rasterizer()
        world = _embedded_world()
        planner, animator = world.human_planner(), world.animator()
        handle_human_plan(planner, HumanPlanRequest(episode=_episode(0)))
    _take_an_episode(world, planner, animator)
    _marker().touch()


def _marker() -> Path:
    """The file that marks this version's kernels as compiled on this machine."""
    numba, ours = importlib.metadata.version("numba"), importlib.metadata.version("readygo")
    return cache_folder("warm") / f"readygo-{ours}-numba-{numba}-{platform.machine()}-{platform.node()}"


def _take_an_episode(world: World, planner: HumanPlanner, animator: Animator) -> None:
    for scenario, motions in accepted_scenarios(planner, animator, 0, Split.TRAIN, range(100)):
        handle_robot_plan(world.robot_planner, RobotPlanRequest(scenario=scenario, motions=motions))
        return


def warm_walking() -> None:
    """Animate a walk of 3 m: the kernels of motions take about half of all compilation, and share little code."""
    animator = _embedded_world().animator()
    animator.obstacles = None
    frame, (rows, columns) = animator.floor.frame, animator.floor.height_m.shape
    middle_m = np.array([frame.origin_x_m, frame.origin_y_m]) + 0.5 * frame.resolution_m * np.array([columns, rows])
    xy_m = middle_m + np.linspace(0.0, 3.0, 60)[:, None] * np.array([1.0, 0.0])
    walker = HumanTrajectory(avatar=min(animator.skeletons), encounter="crossing", speed_mps=1.0, xy_m=xy_m)
    start = np.array([*middle_m, 0.0])
    scenario = Scenario(episode=_episode(0), start_xyyaw=start, goal_xy_m=middle_m, humans=(walker,))
    handle_animate(animator, AnimateRequest(scenario=scenario))


def warm_states() -> None:
    """Drive a robot in the simulation in which policies on states learn; what `warm_all` compiles is needed."""
    world = _embedded_world()
    scenarios = accepted_scenarios(world.human_planner(), world.animator(), 0, Split.TRAIN, range(100))
    observed, distances = state_world(world, ObservationConfig()), goal_distances(world)
    bank = make_bank(list(itertools.islice(scenarios, 1)), distances, world.config.episode.human_count_max)
    numbers = tracker_numbers(PERCEIVED, world.config.robot.clock)
    StateSimulation(observed, bank, numbers, robot_count=1).advance(np.zeros((1, 2)))


def _embedded_world() -> World:
    return World(make_spec(open_scene("embedded"), None, RunConfig(), seed=0, split=Split.TRAIN, static=False))


def _episode(index: int) -> EpisodeKey:
    return EpisodeKey(seed=0, split=Split.TRAIN, index=index)


@contextmanager
def _beside(work: Callable[[], None]) -> Iterator[None]:
    """Do work in another process while the context is active; this process compiles the kernels that it missed."""
    process = get_context("spawn").Process(target=work, daemon=True)
    process.start()
    try:
        yield
        process.join()
    finally:
        process.kill()
