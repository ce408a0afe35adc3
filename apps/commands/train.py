"""`readygo train`: trains a policy on recorded episodes."""

import json as json_module
import math
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.run.evaluation import closed_loop
from readygo.apps.run.methods import NETWORKS
from readygo.apps.run.origin import note_origin, origin_of_data
from readygo.apps.run.sight import chosen_images
from readygo.apps.run.training import (
    default_recipe,
    make_config,
    make_network_config,
    run_network_training,
    run_training,
)
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.identity import TRAINER
from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError
from readygo.common.robot import RobotConfig
from readygo.services.trainer import TrainConfig

if TYPE_CHECKING:
    from readygo.services.trainer.run import TrainProgress

HISTORY_KEYS = ("history",)
"""Metrics that are too long for the terminal; `metrics.json` has them."""


def train(
    data: tuple[Path, ...],
    /,
    *,
    out: Path,
    minutes: float | None = None,
    samples: int | None = None,
    val: tuple[Path, ...] = (),
    val_scene: str = "",
    val_episodes: int = 30,
    recipe: Literal["best", "fast", "paper", "gnm", "vint", "nomad"] | None = None,
    config: Path | None = None,
    inputs: str = "",
    cameras: str = "",
    goal: Literal["point", "image", "both"] | None = None,
    learning_rate: float | None = None,
    batch_size: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    device: Literal["auto", "cpu", "cuda"] | None = None,
    memory_mb: int | None = None,
    cache_mb: int | None = None,
    live: str = "",
    run: str = "",
    certs: Path | None = None,
    json: bool = False,
) -> None:
    """Train a policy on recorded episodes; run again to resume, or with more minutes or samples to train longer.

    Args:
        data: Data folders.
        out: Folder of the policy: policy.onnx, policy.toml, weights.safetensors, metrics.json, loss.svg, checkpoint.
        minutes: Processor time per thread [min], 10 by default; includes earlier calls with the same folder.
        samples: Training budget in samples, repeats counted, instead of minutes; the result is then reproducible.
        val: Data folders for validation; by default a tenth of the episodes is held out.
        val_scene: Scene ("embedded" or a bundle) whose closed-loop success rate selects the checkpoint; its time is not
            counted. By default the last weights are used.
        val_episodes: Episodes per such measurement, from the split val.
        recipe: "best" learns most from data with expert labels at every state, and is the default for such data; "fast"
            is the paper's network adapted to minutes on a CPU, the default for other data; "paper" trains that network
            as in the paper, with Adam at a constant 1e-4. "gnm", "vint" and "nomad" train these published networks with
            their own losses on the expert's trajectories: `out` is then a folder for `readygo evaluate --checkpoints`,
            and training starts from published weights if they lie there.
        config: TOML file with fields of `TrainConfig` that override the recipe's.
        inputs: Images that the policy uses, separated by commas: rgb, and depth if the data have it; rgb by default.
        cameras: Cameras of the robot that the policy uses, by their names in robot.toml, separated by commas, including
            the first one; only the first one by default.
        goal: Goal input of the policy: "point" (the default) is its position, "image" the robot's view at the goal,
            which the data must have (goal_image under [renderer]), or "both".
        learning_rate: Learning rate; the recipe's by default.
        batch_size: Samples per step; the recipe's by default.
        seed: Seed of weights, order and augmentation; 0 by default.
        threads: CPU threads; 0, the default, uses all cores.
        device: Device to train on; "auto", the default, uses a CUDA device if there is one.
        memory_mb: Memory limit for recorded episodes [MB], 2048 by default; beyond it they are subsampled.
        cache_mb: Memory limit for decoded frames [MB], 1024 by default.
        live: Endpoint of a fleet's router, such as tcp/127.0.0.1:7447: train while the fleet records, and offer the
            trained policies to it. `data` then are the folders to catch up from, also while they grow; the first is the
            fleet's own.
        run: Name of the fleet's run, as `readygo generate --listen` prints it.
        certs: Folder with a trainer's certificate, for a tls/ endpoint.
        json: Print the metrics as JSON.
    """
    settings = {
        "minutes": minutes,
        "samples": samples,
        "batch_size": batch_size,
        "seed": seed,
        "threads": threads,
        "device": device,
        "memory_mb": memory_mb,
        "cache_mb": cache_mb,
        "learning_rate": learning_rate,
        "goal": goal,
    }
    console = PlainConsole(stderr=True)
    if recipe in NETWORKS:
        if live or run or val or val_scene or config or inputs or cameras or goal:
            raise ConfigError(
                f"--recipe {recipe} takes no --val, --val-scene, --config, --live, --run, --inputs, --cameras "
                "and --goal."
            )
        unused = ("memory_mb", "device", "goal")
        _train_network(recipe, data, out, {k: v for k, v in settings.items() if k not in unused}, as_json=json)
        return
    if live:
        if cameras:
            raise ConfigError('--live takes no --cameras: say [network] images = ["rgb", "left.rgb"] in --config.')
        images = chosen_images(inputs, "", RobotConfig()) if inputs else None
        chosen = make_config(recipe or "best", config, images=images, **settings)
        metrics = _train_live(chosen, out, live, run, data, certs)
    else:
        dataset = _open(data)
        images = chosen_images(inputs, cameras, dataset.robot or RobotConfig()) if inputs or cameras else None
        chosen = make_config(recipe or _default_recipe(dataset, console, quiet=json), config, images=images, **settings)
        origin = origin_of_data(data)
        if len(origin.scenes) > 1 and not json:
            console.print(f"Data of {len(origin.scenes)} scenes: {', '.join(origin.scenes.values())}.", markup=False)
        evaluate = closed_loop(val_scene, episodes=val_episodes, seed=seed or 0, origin=origin) if val_scene else None
        with _progress(console, quiet=json) as show:
            metrics = run_training(dataset, chosen, out, val=val, evaluate=evaluate, show=show)
        if metrics:
            note_origin(out, origin)
    if metrics:
        _report(metrics, out, as_json=json)


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


def _train_live(
    config: TrainConfig, out: Path, live: str, run: str, data: tuple[Path, ...], certs: Path | None
) -> dict[str, Any]:
    """Train while a fleet records, until the budget is spent, Ctrl-C or SIGTERM."""
    if not run:
        raise ConfigError("--live needs the name of the fleet's run: pass --run.")
    from readygo.apps.fleet.access import join
    from readygo.apps.fleet.trainer import train_beside

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    bus = join(live, run, TRAINER, certs=certs)
    try:
        return train_beside({run: bus}, config, out, data=data, stop=stop)
    finally:
        bus.close()


def _train_network(name: str, data: tuple[Path, ...], out: Path, settings: dict[str, Any], *, as_json: bool) -> None:
    """Train a published network, and print its waypoint error against the expert."""
    dataset, config = _open(data), make_network_config(name, settings)
    with _progress(PlainConsole(stderr=True), quiet=as_json) as show:
        metrics = run_network_training(dataset, config, out, show)
    if as_json:
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
    console.print(f"Next: readygo evaluate SCENE --methods {name} --checkpoints {out}", markup=False)


@contextmanager
def _progress(console: PlainConsole, *, quiet: bool) -> "Iterator[Callable[[TrainProgress], None]]":
    columns = (
        TextColumn("training"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[reached]}"),
        TimeRemainingColumn(),
    )
    with SteadyProgress(*columns, console=console, quiet=quiet) as progress:
        task = progress.add_task("training", total=1.0, reached="")

        def show(state: "TrainProgress") -> None:
            progress.update(task, completed=state.fraction, reached=f"{_reached(state)}, ETA")

        yield show


def _reached(state: "TrainProgress") -> str:
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
