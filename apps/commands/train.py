"""`readygo train`: from recorded episodes to a policy."""

import json as json_module
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from readygo.apps.run.evaluation import closed_loop
from readygo.apps.run.origin import origin_of_data
from readygo.apps.run.training import make_config, run_training
from readygo.common.errors import ConfigError

if TYPE_CHECKING:
    from readygo.services.trainer.run import TrainProgress

HISTORY_KEYS = ("history",)
"""Metrics that are too long for the terminal; `metrics.json` has them."""


def train(
    data: tuple[Path, ...],
    /,
    *,
    out: Path,
    minutes: float = 10.0,
    epochs: int | None = None,
    val: tuple[Path, ...] = (),
    val_scene: str = "",
    val_episodes: int = 30,
    recipe: Literal["fast", "paper"] = "fast",
    learning_rate: float | None = None,
    batch_size: int = 64,
    seed: int = 0,
    threads: int = 0,
    cache_mb: int = 2048,
    previous_dropout: float | None = None,
    mirror: float | None = None,
    json: bool = False,
) -> None:
    """Learn a policy from recorded episodes; run again to continue, with more minutes or epochs to go further.

    Args:
        data: Data folders.
        out: Folder of the policy: encoder.onnx, head.onnx, policy.toml, metrics.json, loss.png and the checkpoint.
        minutes: Training time [min]; counts the time of earlier runs into the same folder.
        epochs: Passes over the data instead of minutes; the result is then reproducible.
        val: Data folders to validate on; by default a fifth of the episodes is held out.
        val_scene: Scene ("embedded" or a bundle) whose closed-loop success rate chooses the checkpoint; its time is
            not counted. By default the validation loss chooses.
        val_episodes: Episodes per such measurement, from the split val.
        recipe: "fast" is made for minutes on a CPU; "paper" is Adam at a constant 1e-4.
        learning_rate: Learning rate instead of the recipe's.
        batch_size: Samples per step.
        seed: Seed of weights, order and augmentation.
        threads: CPU threads; 0 takes all cores.
        cache_mb: Most memory for decoded frames [MB].
        previous_dropout: Share of samples that do not see the previous action.
        mirror: Share of batches that are mirrored left to right.
        json: Print the metrics as JSON.
    """
    if not data:
        raise ConfigError("No data folder is given; record one with `readygo generate`.")
    config = make_config(
        recipe,
        minutes=minutes,
        epochs=epochs,
        batch_size=batch_size,
        seed=seed,
        threads=threads,
        cache_mb=cache_mb,
        learning_rate=learning_rate,
        previous_dropout=previous_dropout,
        mirror=mirror,
    )
    origin = origin_of_data(data) if val_scene else None
    evaluate = closed_loop(val_scene, episodes=val_episodes, seed=seed, origin=origin) if val_scene else None
    console = Console(stderr=True)
    with _progress(console, quiet=json) as show:
        metrics = run_training(data, config, out, val=val, evaluate=evaluate, show=show)
    _report(metrics, out, as_json=json)


@contextmanager
def _progress(console: Console, *, quiet: bool) -> "Iterator[Callable[[TrainProgress], None]]":
    columns = (
        TextColumn("training"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[reached]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=quiet) as progress:
        task = progress.add_task("training", total=1.0, reached="")

        def show(state: "TrainProgress") -> None:
            progress.update(task, completed=state.fraction, reached=f"{_reached(state)}, ETA")

        yield show


def _reached(state: "TrainProgress") -> str:
    """How far training is; losses are left out until they are known."""
    losses = {"loss": state.train_loss, "held out": state.validation_loss}
    known = [f"{name} {loss:.4f}" for name, loss in losses.items() if math.isfinite(loss)]
    return ", ".join([f"step {state.step}", *known])


def _report(metrics: dict[str, Any], out: Path, *, as_json: bool) -> None:
    short = {name: value for name, value in metrics.items() if name not in HISTORY_KEYS}
    if as_json:
        sys.stdout.write(json_module.dumps(short | {"policy": str(out)}) + "\n")
        return
    console = Console(highlight=False, soft_wrap=True)
    console.print(
        f"{metrics['parameters']} parameters, {metrics['samples_seen']} samples in {metrics['elapsed_s']:.0f} s "
        f"({metrics['samples_per_s']:.0f} samples/s); step {metrics['chosen_step']} of {metrics['steps']} chosen."
    )
    console.print(
        f"Held out ({metrics['validation_episodes']} episodes): v {metrics['rmse_v_mps']:.3f} m/s = "
        f"{100 * metrics['ratio_v']:.0f} %, w {metrics['rmse_w_radps']:.3f} rad/s = {100 * metrics['ratio_w']:.0f} % "
        "of predicting the mean."
    )
    console.print(f"Next: readygo evaluate SCENE {out}", markup=False)
