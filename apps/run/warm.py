"""Every kernel of the stages, compiled before it is needed."""

import fcntl
import importlib.metadata
import platform
import subprocess
import sys
from pathlib import Path

from readygo.apps.run.config import RunConfig
from readygo.apps.run.scene_argument import open_scene
from readygo.apps.run.spec import make_spec
from readygo.apps.run.world import World
from readygo.common.files import cache_folder
from readygo.common.messages import AnimateRequest, EpisodeKey, HumanPlanRequest, RobotPlanRequest, Split
from readygo.common.rasterizer.warm import warm as warm_rasterizer
from readygo.services.animator import handle_animate
from readygo.services.planner import handle_human_plan, handle_robot_plan

_RASTERIZER = "from readygo.common.rasterizer.warm import warm; warm()"


def warm_once() -> None:
    """Compile all kernels if this version has not done so on this machine; processes that come meanwhile wait."""
    with (_marker().parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not _marker().exists():
            warm_all()


def warm_all() -> None:
    """Take one short episode of the embedded scene through all stages, while another process draws something."""
    # What it compiles is loaded below; if it fails, it is compiled there, and what is wrong is told.
    rasterizer = subprocess.Popen(
        [sys.executable, "-c", _RASTERIZER],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        _take_an_episode()
        rasterizer.wait()
    finally:
        rasterizer.kill()
        rasterizer.wait()
    warm_rasterizer()
    _marker().touch()


def _marker() -> Path:
    """The file that says that this version's kernels are compiled on this machine."""
    numba, ours = importlib.metadata.version("numba"), importlib.metadata.version("readygo")
    return cache_folder("warm") / f"readygo-{ours}-numba-{numba}-{platform.machine()}-{platform.node()}"


def _take_an_episode() -> None:
    world = World(make_spec(open_scene("embedded"), None, RunConfig(), seed=0, split=Split.TRAIN, static=False))
    planner, animator = world.human_planner(), world.animator()
    for index in range(100):
        key = EpisodeKey(seed=0, split=Split.TRAIN, index=index)
        scenario = handle_human_plan(planner, HumanPlanRequest(episode=key)).scenario
        motions = handle_animate(animator, AnimateRequest(scenario=scenario)).motions if scenario else None
        if scenario and motions:
            handle_robot_plan(world.robot_planner, RobotPlanRequest(scenario=scenario, motions=motions))
            return
