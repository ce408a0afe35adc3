"""`readygo rl`: trains a state policy by reinforcement."""

import json as json_module
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from tyro.conf import Fixed, Positional

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.terminal import PlainConsole
from readygo.common.cores import available_cores
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.common.perception.noise import EXACT, PERCEIVED
from readygo.common.robot import load_robot
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.reinforcement import DrawShow, make_reinforcement_config, run_reinforcement, with_standing
from readygo.runs.scene_argument import open_scenes
from readygo.runs.sections import Keys, Sections
from readygo.runs.spec import make_spec
from readygo.runs.trained import check_out
from readygo.runs.world import World
from readygo.services.planner import MixName
from readygo.services.trainer import MINUTES, ReinforcementConfig

NOISE = {"exact": EXACT, "perceived": PERCEIVED}
DEFAULT_MINUTES = 10.0
Show = Callable[[Mapping[str, Any], float], None]


@dataclass(frozen=True, kw_only=True)
class RlOptions:
    """Train a policy by reinforcement (PPO) in some scenes, without images; run again to resume.

    The robot knows the scene's map and its pose; pedestrians are told by a tracker, from simulated detections. Then
    `readygo evaluate SCENE --methods rl expert --checkpoints FOLDER`, with the policy in FOLDER/rl.
    """

    scenes: Positional[tuple[str, ...]]
    """Scene bundles, "embedded", "embedded:SEED" or "embedded:plan-SEED"; one policy learns in all of them, which share
    its robots and episodes equally."""
    out: Path
    """Folder of the policy: state_policy.toml, actor.npz, metrics.json, curve.jsonl, curve.svg, checkpoint."""
    minutes: float | None = None
    """Processor time [min], 10 by default; includes earlier calls with the same folder."""
    decisions: int | None = None
    """Training budget in decisions of all robots, instead of minutes; the result is then reproducible."""
    seed: int = 0
    """Seed of episodes, weights and decisions."""
    avatars: Path | None = None
    """Avatar file or folder of avatars; by default the embedded ones. The suffix ":train" or ":test", also after
    "embedded", selects one part."""
    noise: Literal["exact", "perceived"] = "perceived"
    """Errors of the detections: none, or those of a network that looks at images."""
    robot: Path | None = None
    """robot.toml; by default the robot in `config`."""
    people: MixName | None = None
    """Scenario mix: how many pedestrians there are and how they meet the robot; "paper" by default."""
    config: Path | None = None
    """TOML file with sections of settings, as for `readygo generate`."""
    workers: int = 0
    """Processes that draw the episodes, one per core by default; learning itself is on one core."""
    json: bool = False
    """Print the metrics as JSON."""
    keys: Annotated[Keys, Sections(ReinforcementConfig), Fixed] = field(default_factory=dict)


def rl(options: RlOptions) -> None:
    """Train a policy by reinforcement (PPO) in some scenes, without images; run again to resume."""
    check_out(options.out, resumes=True)
    minutes = _minutes(options)
    if options.workers < 0:
        raise RunError(f"--workers must be at least 0, got {options.workers}.")
    settings = make_reinforcement_config(NOISE[options.noise], options.keys)
    robot = load_robot(options.robot) if options.robot else None
    config = with_standing(load_run_config(options.config, robot, None, options.people), settings.standing_max)
    worlds = _worlds(options, config)
    with _drawn_kept(options.out), _progress(PlainConsole(stderr=True), quiet=options.json) as (say, show):
        metrics = run_reinforcement(
            worlds,
            settings,
            options.out,
            decisions=options.decisions,
            minutes=minutes,
            workers=options.workers or available_cores(),
            draws=say,
            show=show,
        )
    _report(metrics, options, ", ".join(world.scene.name for world in worlds))


def _worlds(options: RlOptions, config: RunConfig) -> list[World]:
    """The worlds of all scenes.

    Raises:
        RunError: If no scene is named, or one twice.
        SceneError: If there is no such scene.
    """
    return [
        World(make_spec(scene, options.avatars, config, seed=options.seed, split=Split.TRAIN, static=False))
        for scene in open_scenes(options.scenes)
    ]


def _minutes(options: RlOptions) -> float | None:
    """Processor time to learn for [min]; None with a budget of decisions.

    Raises:
        RunError: If both budgets are given, or one is out of range.
    """
    if options.minutes is not None and options.decisions is not None:
        raise RunError("Give --minutes or --decisions, not both.")
    if options.minutes is not None and options.minutes not in MINUTES:
        raise RunError(f"--minutes must be {MINUTES}, got {options.minutes:g}.")
    if options.decisions is not None and options.decisions < 1:
        raise RunError(f"--decisions must be at least 1, got {options.decisions}.")
    return None if options.decisions is not None else options.minutes or DEFAULT_MINUTES


@contextmanager
def _drawn_kept(out: Path) -> Iterator[None]:
    """At Ctrl-C before anything is in the folder, say where the episodes are that were drawn."""
    try:
        yield
    except KeyboardInterrupt:
        if out.exists() and any(out.iterdir()):
            raise
        raise KeyboardInterrupt(
            "drawn episodes stay in the user's cache, run the same command again to resume."
        ) from None


@contextmanager
def _progress(console: PlainConsole, *, quiet: bool) -> Iterator[tuple[DrawShow, Show]]:
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with SteadyProgress(*columns, console=console, quiet=quiet) as progress:
        task = progress.add_task("Begins", total=1.0)

        def say(split: Split, done: int, total: int) -> None:
            progress.update(task, description=f"Drawing episodes of split {split.value}: {done} of {total}")

        def show(row: Mapping[str, Any], share: float) -> None:
            progress.update(task, completed=share, description=_text(row))

        yield say, show


def _text(row: Mapping[str, Any]) -> str:
    """A measurement in words."""
    done = f"{row['decisions'] / 1e6:.1f}M decisions, {row['minutes']:.1f} min"
    return f"{done}: val static {100 * row['val_static']:.0f} %, dynamic {100 * row['val_dynamic']:.0f} %"


def _report(metrics: Mapping[str, Any], options: RlOptions, scene: str) -> None:
    if options.json:
        sys.stdout.write(json_module.dumps({**metrics, "policy": str(options.out)}) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    console.print(
        f"{metrics['decisions']:,} decisions in {metrics['minutes']:.1f} min ({metrics['decisions_per_s']:,}/s); "
        f"chosen at {metrics['chosen_decisions']:,}: {metrics['val_episodes']} episodes of split val in {scene}, "
        f"static {100 * metrics['val_static']:.1f} %, dynamic {100 * metrics['val_dynamic']:.1f} %."
    )
    methods = f"--methods {options.out.name} expert --checkpoints {options.out.parent}"
    console.print(f"Next: readygo evaluate {options.scenes[0]} {methods}", markup=False)
