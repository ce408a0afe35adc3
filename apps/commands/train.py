"""`readygo train`: from recorded episodes to a policy."""

import dataclasses
import json as json_module
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError, PolicyError
from readygo.services.trainer import TrainConfig, paper_recipe

if TYPE_CHECKING:
    from readygo.services.trainer.run import Evaluate, TrainProgress

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
    evaluate = closed_loop(val_scene, episodes=val_episodes, seed=seed) if val_scene else None
    console = Console(stderr=True)
    with _progress(console, quiet=json) as show:
        metrics = run_training(data, config, out, val=val, evaluate=evaluate, show=show)
    _report(metrics, out, as_json=json)


def make_config(recipe: str, **settings: Any) -> TrainConfig:
    """The recipe's configuration with the settings that are not None.

    Raises:
        ConfigError: If a setting makes no sense.
    """
    try:
        config = paper_recipe(TrainConfig()) if recipe == "paper" else TrainConfig()
        return dataclasses.replace(config, **{name: value for name, value in settings.items() if value is not None})
    except ValueError as error:
        raise ConfigError(str(error)) from error


def run_training(
    data: tuple[Path, ...],
    config: TrainConfig,
    out: Path,
    *,
    val: tuple[Path, ...] = (),
    evaluate: "Evaluate | None" = None,
    show: "Callable[[TrainProgress], None] | None" = None,
) -> dict[str, Any]:
    """Train on data folders; returns what `metrics.json` holds.

    Raises:
        PolicyError: If torch or onnx is not installed, or `out` belongs to another run.
        DatasetError: If the data cannot be used.
    """
    # Threads that wait by spinning take the cores that the working ones need: on a shared machine training is 2.5
    # times faster without. libgomp reads this once, when torch loads it.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        from readygo.services.trainer.train import train as train_policy
    except ImportError as error:
        raise PolicyError(f"Training needs {error.name}; run `pip install 'readygo[train]'`.") from error
    validation = Dataset(val) if val else None
    return train_policy(Dataset(data), config, out, validation=validation, evaluate=evaluate, report=show)


def closed_loop(scene: str, *, episodes: int, seed: int) -> "Evaluate":
    """Measures the static and dynamic success rate of a policy on the split val of a scene; their mean counts."""
    from readygo.apps.commands.evaluate import make_evaluator, make_request
    from readygo.apps.commands.scene_argument import open_scene
    from readygo.apps.run.config import RunConfig
    from readygo.common.messages import Split
    from readygo.common.policy import load_policy
    from readygo.services.evaluator import handle_evaluate

    # What is wrong with these is said now, not when the first checkpoint is measured.
    request = make_request(episodes, ("static", "dynamic"), ("policy",), Split.VAL, seed)
    open_scene(scene)
    evaluators: dict[str, Any] = {}

    def success_rate(folder: Path) -> float:
        policy = load_policy(folder)
        if scene not in evaluators:
            evaluators[scene] = make_evaluator(
                scene, RunConfig(robot=policy.spec.robot), avatars=None, seed=seed, renders=True
            )
        evaluator = dataclasses.replace(evaluators[scene], policy=policy)
        rates = [summary.success_rate for summary in handle_evaluate(evaluator, request).summaries.values()]
        return sum(rates) / len(rates)

    return success_rate


@contextmanager
def _progress(console: Console, *, quiet: bool) -> "Iterator[Callable[[TrainProgress], None]]":
    columns = (
        TextColumn("training"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn(
            "step {task.fields[step]}, loss {task.fields[train]:.4f}, held out {task.fields[held_out]:.4f}, ETA"
        ),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=quiet) as progress:
        nan = float("nan")
        task = progress.add_task("training", total=1.0, step=0, train=nan, held_out=nan)

        def show(state: "TrainProgress") -> None:
            progress.update(
                task,
                completed=state.fraction,
                step=state.step,
                train=state.train_loss,
                held_out=state.validation_loss,
            )

        yield show


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
