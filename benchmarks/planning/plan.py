"""`readygo bench plan`: how often, how fast and how smoothly the experts arrive, and what planning costs.

Every mode drives through the same scenarios with the same motions. Times are CPU time of the thread.
"""

import json as json_module
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from readygo.apps.terminal import PlainConsole
from readygo.benchmarks.planning.maps import default_data_folder, find_map
from readygo.benchmarks.planning.pool import draws, processes
from readygo.benchmarks.planning.runs import Draw, PlanningJob
from readygo.benchmarks.planning.summary import map_row, rows_of, text
from readygo.benchmarks.rasterizer.render import machine
from readygo.common.errors import ConfigError
from readygo.services.planner.humans.mixes import MixName

Mode = Literal["paper", "spacetime", "near_field", "oracle"]
Task = Literal["dynamic", "static"]


@dataclass(frozen=True, kw_only=True)
class BenchPlanOptions:
    """Measure success, times and smoothness of the robot experts."""

    maps: tuple[str, ...] = ("embedded",)
    """Where to drive: "embedded", scene bundles, map files (.yaml, MovingAI .map), or names in the data folder:
    willow, home, any other map there, and scenes, which are imported into the user's cache once."""
    episodes: int = 200
    """Accepted test episodes per map."""
    modes: tuple[Mode, ...] = ("paper", "spacetime", "near_field", "oracle")
    """Experts that drive through each of them."""
    tasks: tuple[Task, ...] = ("dynamic", "static")
    """With people and without, between the same starts and goals."""
    people: MixName = "paper"
    """Mix of the people: a recipe of the planner."""
    workers: int = 2
    """Processes; only the time that it takes depends on them."""
    seed: int = 2
    """Seed of the episodes."""
    data: Path | None = None
    """Folder with scenes/ and maps/; ../shared/data beside the checkout by default, if it is there."""
    pictures: Path | None = None
    """Folder for a picture of every failure, by map, task, mode and category."""
    json: bool = False
    """Print one JSON object instead of a table."""


def bench_plan(options: BenchPlanOptions) -> None:
    """Measure success, times and smoothness of the robot experts."""
    for name, value in (("--episodes", options.episodes), ("--workers", options.workers)):
        if value < 1:
            raise ConfigError(f"{name} must be at least 1, got {value}.")
    if options.seed < 0:
        raise ConfigError(f"--seed must not be negative, got {options.seed}.")
    if options.data is not None and not options.data.is_dir():
        raise ConfigError(f"--data {options.data} is no folder.")
    if not options.maps:
        raise ConfigError("--maps needs at least one map.")
    data = options.data or default_data_folder()
    sources = [find_map(name, data) for name in options.maps]
    job = PlanningJob(
        source=sources[0],
        modes=options.modes,
        tasks=options.tasks,
        seed=options.seed,
        people=options.people,
        pictures=options.pictures,
    )
    jobs = [replace(job, source=source) for source in sources]
    result = measure(jobs, options.episodes, process_count=options.workers, quiet=options.json)
    sys.stdout.write(json_module.dumps(result) + "\n" if options.json else text(result))


def measure(jobs: list[PlanningJob], episodes: int, *, process_count: int, quiet: bool) -> dict[str, Any]:
    """Run jobs one after the other, each by all processes.

    Raises:
        SceneError: If a map cannot be used.
    """
    places: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    with processes(process_count) as submit, _progress(jobs, episodes, quiet=quiet) as show:
        for job in jobs:
            drawn: list[Draw] = []
            for draw in draws(job, episodes, submit, ahead=2 * process_count if process_count > 1 else 1):
                drawn.append(draw)
                show(job, not draw.rejected)
            places.append(map_row(job, drawn))
            rows += rows_of(job, drawn)
    head = {"machine": machine(), "episodes": episodes, "seed": jobs[0].seed, "people": jobs[0].people}
    return {**head, "maps": places, "rows": rows}


@contextmanager
def _progress(jobs: list[PlanningJob], episodes: int, *, quiet: bool) -> Iterator[Callable[[PlanningJob, bool], None]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = PlainConsole(stderr=True)
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal, transient=True) as progress:
        bar = progress.add_task("episodes", total=episodes * len(jobs))
        yield lambda job, accepted: progress.update(bar, description=job.source.name, advance=int(accepted))
