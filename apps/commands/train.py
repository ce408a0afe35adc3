"""`readygo train`: trains a policy on recorded episodes."""

import json as json_module
import math
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from tyro.conf import Fixed, Positional

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.identity import TRAINER
from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError
from readygo.common.robot import RobotConfig
from readygo.runs.evaluation import closed_loop
from readygo.runs.methods import NETWORKS, PERCEPTION
from readygo.runs.origin import note_origin, origin_of_data
from readygo.runs.perception import train_perception
from readygo.runs.scene_argument import open_scene
from readygo.runs.sections import Keys, Sections, with_file, with_keys
from readygo.runs.trained import check_out
from readygo.runs.training import (
    default_recipe,
    make_config,
    make_network_config,
    run_network_training,
    run_training,
)
from readygo.services.trainer import PerceptionConfig, TrainConfig, chosen_images

if TYPE_CHECKING:
    from readygo.services.trainer import PerceptionProgress, TrainProgress

HISTORY_KEYS = ("history",)
"""Metrics that are too long for the terminal; `metrics.json` has them."""
NETWORK_KEYS = ("threads", "cache_mb", "batch_size", "learning_rate", "validation_fraction")
"""Keys that the training of a published network has as well."""
PERCEPTION_KEYS = (
    "threads",
    "device",
    "precision",
    "perception",
    "memory_mb",
    "batch_size",
    "learning_rate",
    "weight_decay",
    "validation_fraction",
)
"""Keys that the training of perception has as well."""


@dataclass(frozen=True, kw_only=True)
class TrainDetailOptions:
    """Cameras and closed-loop validation."""

    val_episodes: int = 30
    """Episodes per such measurement, from the split val."""
    scene: tuple[str, ...] = ()
    """Scenes of the data, for "perception", where they are not at the places at which the data were recorded."""
    cameras: str = ""
    """Cameras of the robot that the policy uses, by their names in robot.toml, separated by commas, including the
    first one; only the first one by default."""


@dataclass(frozen=True, kw_only=True)
class TrainFleetOptions:
    """Training while a fleet records."""

    live: str = ""
    """Endpoint of a fleet's router, such as tcp/127.0.0.1:7447: train while the fleet records, and offer the
    trained policies to it. `data` then are the folders to catch up from, also while they grow; the first is the
    fleet's own."""
    run: str = ""
    """Name of the fleet's run, as `readygo generate --listen` prints it."""
    certs: Path | None = None
    """Folder with a trainer's certificate, for a tls/ endpoint."""


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """Train a policy on recorded episodes; run again to resume, or with more minutes or samples to train longer."""

    data: Positional[tuple[Path, ...]]
    """Data folders."""
    out: Path
    """Folder of the policy: policy.onnx, policy.toml, weights.safetensors, metrics.json, loss.svg, checkpoint."""
    minutes: float | None = None
    """Processor time per thread [min], 10 by default; includes earlier calls with the same folder."""
    samples: int | None = None
    """Training budget in samples, repeats counted, instead of minutes; the result is then reproducible."""
    val: tuple[Path, ...] = ()
    """Data folders for validation; by default a tenth of the episodes is held out."""
    val_scene: str = ""
    """Scene ("embedded" or a bundle) whose closed-loop success rate selects the checkpoint; its time is not
    counted. By default the last weights are used."""
    recipe: Literal["best", "fast", "paper", "pretrained", "perception", "gnm", "vint", "nomad"] | None = None
    """"best" learns most from data with expert labels at every state, and is the default for such data; "fast" is
    the paper's network adapted to minutes on a CPU, the default for other data; "paper" trains that network as in
    the paper, with Adam at a constant 1e-4; "pretrained" is "best" with the network of perception (--perception FOLDER)
    as its encoder. "perception" trains the network that sees people and free space, which
    the method perceive-and-plan of `readygo evaluate --checkpoints` reads from the folder `perception` there. "gnm",
    "vint" and "nomad" train these published networks with their own losses on the expert's trajectories: `out` is
    then a folder for `readygo evaluate --checkpoints`, and training starts from published weights if they lie
    there."""
    config: Path | None = None
    """TOML file with settings that override the recipe's; `--KEY VALUE` and `--SECTION.KEY VALUE` override it."""
    inputs: str = ""
    """Images that the policy uses, separated by commas: rgb, and depth if the data have it; rgb by default."""
    goal: Literal["point", "image", "both"] | None = None
    """Goal input of the policy: "point" (the default) is its position, "image" the robot's view at the goal, which
    the data must have (goal_image under [renderer]), or "both"."""
    seed: int | None = None
    """Seed of weights, order and augmentation; 0 by default."""
    json: bool = False
    """Print the metrics as JSON."""
    details: TrainDetailOptions = field(default_factory=TrainDetailOptions)
    fleet: TrainFleetOptions = field(default_factory=TrainFleetOptions)
    keys: Annotated[Keys, Sections(TrainConfig), Fixed] = field(default_factory=dict)


def train(options: TrainOptions) -> None:
    """Train a policy on recorded episodes; run again to resume, or with more minutes or samples to train longer."""
    check_out(options.out, resumes=True)
    if options.recipe in NETWORKS:
        _train_network(options.recipe, options)
        return
    if options.recipe == PERCEPTION:
        _train_perception(options)
        return
    metrics = _train_live(options) if options.fleet.live else _train_on_data(options)
    if metrics:
        _report(metrics, options.out, as_json=options.json)


def _settings(options: TrainOptions) -> dict[str, Any]:
    """The settings that have an option."""
    return {
        "minutes": options.minutes,
        "samples": options.samples,
        "seed": options.seed,
        "goal": options.goal,
    }


def _train_on_data(options: TrainOptions) -> dict[str, Any]:
    """Train on recorded episodes; returns the metrics, empty in helper processes of a training."""
    console, cameras = PlainConsole(stderr=True), options.details.cameras
    dataset = _open(options.data)
    images = None
    if options.inputs or cameras:
        images = chosen_images(options.inputs, cameras, dataset.robot or RobotConfig())
    recipe = options.recipe or _default_recipe(dataset, console, quiet=options.json)
    config = make_config(recipe, options.config, options.keys, images=images, **_settings(options))
    origin = origin_of_data(options.data)
    if len(origin.scenes) > 1 and not options.json:
        console.print(f"Data of {len(origin.scenes)} scenes: {', '.join(origin.scenes.values())}.", markup=False)
    evaluate, evaluated = None, ""
    if options.val_scene:
        count, seed = options.details.val_episodes, options.seed or 0
        evaluate = closed_loop(options.val_scene, episodes=count, seed=seed, origin=origin)
        evaluated = f"scene {open_scene(options.val_scene).content_hash}, {count} episodes, seed {seed}"
    with _progress(console, quiet=options.json) as show:
        metrics = run_training(
            dataset, config, options.out, val=options.val, evaluate=evaluate, evaluated=evaluated, show=show
        )
    if metrics:
        note_origin(options.out, origin)
    return metrics


def _open(data: tuple[Path, ...]) -> Dataset:
    if not data:
        raise ConfigError("No data folder is given; record one with `readygo generate`.")
    return Dataset(data)


def _default_recipe(dataset: Dataset, console: PlainConsole, *, quiet: bool) -> str:
    recipe = default_recipe(dataset)
    if not quiet:
        why = "asked at every state" if dataset.has_expert else "not asked"
        console.print(f"Recipe {recipe}: the expert was {why} in these data.")
    return recipe


def _train_live(options: TrainOptions) -> dict[str, Any]:
    """Train while a fleet records, until the budget is spent, Ctrl-C or SIGTERM."""
    fleet = options.fleet
    if options.details.cameras:
        raise ConfigError("--live takes no --cameras: say --network.images rgb,left.rgb.")
    images = chosen_images(options.inputs, "", RobotConfig()) if options.inputs else None
    recipe = options.recipe or "best"
    config = make_config(recipe, options.config, options.keys, images=images, **_settings(options))
    if not fleet.run:
        raise ConfigError("--live needs the name of the fleet's run: pass --run.")
    from readygo.apps.fleet.access import join
    from readygo.apps.fleet.trainer import train_beside

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    bus = join(fleet.live, fleet.run, TRAINER, certs=fleet.certs)
    try:
        return train_beside({fleet.run: bus}, config, options.out, data=options.data, stop=stop)
    finally:
        bus.close()


def _network_settings(name: str, options: TrainOptions) -> dict[str, Any]:
    """The settings of training a published network: some options and keys, by their names there.

    Raises:
        ConfigError: If an option or key does not go with it.
    """
    fleet = options.fleet
    others = (fleet.live, fleet.run, options.val, options.val_scene, options.config, options.inputs)
    if any(others) or options.details.cameras or options.goal:
        raise ConfigError(
            f"--recipe {name} takes no --val, --val-scene, --config, --live, --run, --inputs, --cameras and --goal."
        )
    keys = _plain_keys(options, NETWORK_KEYS)
    return keys | {"minutes": options.minutes, "samples": options.samples, "seed": options.seed}


def _plain_keys(options: TrainOptions, known: tuple[str, ...]) -> dict[str, Any]:
    """The keys of the command line without their sections, for recipes whose settings have none.

    Raises:
        ConfigError: If the recipe has no such key.
    """
    keys = {key: value for key, value in options.keys.items() if not isinstance(value, Mapping)}
    keys |= {key: value for part in options.keys.values() if isinstance(part, Mapping) for key, value in part.items()}
    if unknown := sorted(set(keys) - set(known)):
        dashed = (name.replace("_", "-") for name in (unknown[0], *known))
        first, *others = dashed
        raise ConfigError(f"--recipe {options.recipe} takes no key {first}; it takes {', '.join(others)}.")
    return keys


def _train_network(name: str, options: TrainOptions) -> None:
    """Train a published network, and print its waypoint error against the expert."""
    config = make_network_config(name, _network_settings(name, options))
    dataset = _open(options.data)
    with _progress(PlainConsole(stderr=True), quiet=options.json) as show:
        metrics = run_network_training(dataset, config, options.out, show)
    if options.json:
        sys.stdout.write(json_module.dumps(metrics) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    console.print(
        f"{metrics['parameters']:,} parameters, {metrics['samples_seen']:,} samples learned from in "
        f"{metrics['elapsed_s']:.0f} s."
    )
    if "waypoint_error_m" in metrics:
        console.print(
            f"Held out ({metrics['held_out_episodes']} episodes): {metrics['waypoint_error_m']:.3f} m from where the "
            f"expert went to where it steers; {metrics['waypoint_error_of_mean_m']:.3f} m to the mean."
        )
    console.print(f"Next: readygo evaluate SCENE --methods {name} --checkpoints {options.out}", markup=False)


def _train_perception(options: TrainOptions) -> None:
    """Train perception, and print how well it sees what is held out."""
    if not options.data:
        raise ConfigError("No data folder is given; record one with `readygo generate`.")
    fleet, details = options.fleet, options.details
    if any((fleet.live, fleet.run, options.val, options.val_scene, options.inputs, details.cameras, options.goal)):
        raise ConfigError(
            f"--recipe {PERCEPTION} takes no --val, --val-scene, --live, --run, --inputs, --cameras and --goal."
        )
    given = {"minutes": options.minutes, "samples": options.samples, "seed": options.seed}
    config = with_file(PerceptionConfig(), options.config)
    config = with_keys(config, {name: value for name, value in given.items() if value is not None})
    config = with_keys(config, _plain_keys(options, PERCEPTION_KEYS))
    with _progress(PlainConsole(stderr=True), quiet=options.json) as show:
        metrics = train_perception(options.data, config, options.out, scenes=details.scene, show=show)
    if options.json:
        sys.stdout.write(json_module.dumps(metrics | {"perception": str(options.out)}) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    console.print(
        f"{metrics['parameters']:,} parameters, {metrics['samples_seen']:,} images learned from in "
        f"{metrics['elapsed_s']:.0f} s ({metrics['images']:,} different ones)."
    )
    if "held_out" in metrics:
        told = metrics["held_out"]
        console.print(
            f"Held out ({told['images']} images, {told['people']} people): AP {told['average_precision']:.2f}, bearing "
            f"{told['bearing_deg']:.1f} deg, distance {100 * told['distance']:.0f} %, {100 * told['missed']:.0f} % "
            f"missed, velocity R2 {told['along_r2']:.2f} along and {told['across_r2']:.2f} across, free distance "
            f"{100 * told['rays']:.0f} %."
        )
    console.print(
        f"Next: readygo evaluate SCENE --methods perceive-and-plan expert --checkpoints {options.out.parent}",
        markup=False,
    )


@contextmanager
def _progress(
    console: PlainConsole, *, quiet: bool
) -> "Iterator[Callable[[TrainProgress | PerceptionProgress], None]]":
    columns = (
        TextColumn("training"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[reached]}"),
        TimeRemainingColumn(),
    )
    with SteadyProgress(*columns, console=console, quiet=quiet) as progress:
        task = progress.add_task("training", total=1.0, reached="")

        def show(state: "TrainProgress | PerceptionProgress") -> None:
            progress.update(task, completed=state.fraction, reached=f"{_progress_text(state)}, ETA")

        yield show


def _progress_text(state: "TrainProgress | PerceptionProgress") -> str:
    """Step and losses of the training in words; losses are left out until they are known."""
    losses = {"loss": state.train_loss, "held out": state.validation_loss}
    known = [f"{name} {loss:.4f}" for name, loss in losses.items() if math.isfinite(loss)]
    return ", ".join([f"step {state.step}", *known])


def _report(metrics: dict[str, Any], out: Path, *, as_json: bool) -> None:
    short = {name: value for name, value in metrics.items() if name not in HISTORY_KEYS}
    if as_json:
        sys.stdout.write(json_module.dumps(short | {"policy": str(out)}) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    console.print(
        f"{metrics['parameters']:,} parameters, {metrics['samples_seen']:,} samples learned from in "
        f"{metrics['elapsed_s']:.0f} s ({metrics['samples_per_s']:,.0f} samples/s); "
        f"step {metrics['chosen_step']} of {metrics['steps']} chosen."
    )
    if metrics.get("validation_samples"):
        console.print(
            f"Held out ({metrics['validation_episodes']} episodes): v {metrics['rmse_v_mps']:.3f} m/s = "
            f"{100 * metrics['ratio_v']:.0f} %, w {metrics['rmse_w_radps']:.3f} rad/s = "
            f"{100 * metrics['ratio_w']:.0f} % of predicting the mean."
        )
    console.print(f"Next: readygo evaluate SCENE {out}", markup=False)
