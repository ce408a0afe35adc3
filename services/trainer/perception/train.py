"""Training of perception: steps, validation, and how all of it is kept."""

import dataclasses
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.config import section_to_mapping
from readygo.common.cores import available_cores
from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.perception.artifact import PerceptionSpec
from readygo.common.perception.grid import polar_grid
from readygo.services.trainer.checkpoint import load_checkpoint, refuse_damaged, save_checkpoint
from readygo.services.trainer.config import CHECKPOINT_FILE
from readygo.services.trainer.hardware import cpu_has_bf16, device_of
from readygo.services.trainer.perception.config import PerceptionConfig
from readygo.services.trainer.perception.export import export_perception
from readygo.services.trainer.perception.looks import Looks, grey_of, held_out
from readygo.services.trainer.perception.loss import perception_loss, targets_of
from readygo.services.trainer.perception.metrics import PerceptionMetrics, measure_perception
from readygo.services.trainer.perception.network import PerceptionModule, PerceptionNet
from readygo.services.trainer.perception.weights import trained_weights

METRICS_FILE = "metrics.json"
EMA_DECAY = 0.998
SAVE_EVERY_S = 60.0
"""Processor time between checkpoints [s]."""
WARM_UP = 0.02
"""Share of the budget in which the learning rate rises."""
VALIDATION_IMAGES = 2000
"""Most held-out images that are looked at, spread evenly."""
PEOPLE_SHARE = 0.6
"""Share of the images with a visible human in a batch: in most recorded images there is none."""
LIGHT = 0.3
"""Largest change of brightness, contrast and colour that a window is shown in."""
Tensors = tuple[Tensor, ...] | list[Tensor]
BUDGET_FIELDS = ("minutes", "samples", "threads", "device", "perception")
"""Settings that may change when a run resumes; of `perception` the weights must stay, not the place."""


@dataclass(frozen=True, kw_only=True)
class PerceptionProgress:
    """How far training is."""

    fraction: float
    step: int
    train_loss: float
    validation_loss: float = math.nan
    """Not measured while it is trained."""


class PerceptionRun:
    """State of one training."""

    def __init__(
        self, looks: Looks, spec: PerceptionSpec, config: PerceptionConfig, out: Path, data: dict[str, str]
    ) -> None:
        """Begin, or resume from the checkpoint in `out`.

        Args:
            looks: The images.
            spec: Robot and frames.
            config: Budget and settings.
            out: Folder of the run.
            data: Names and hashes of the data, the same when the run resumes.

        Raises:
            PolicyError: If `out` belongs to a run of other data or settings, or the weights that it begins with cannot
                be used.
        """
        self.looks, self.spec, self.config, self.out = looks, spec, config, out
        torch.manual_seed(config.seed)
        camera = spec.robot.camera
        self._device = device_of(config.device)
        net = PerceptionNet(camera, config.widths)
        if config.perception:
            weights, sha256 = trained_weights(Path(config.perception), camera, config.widths)
            net.load_state_dict(weights)
            data = data | {"perception weights": sha256}
        self.net = net.to(device=self._device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.averaged = torch.optim.swa_utils.AveragedModel(self.net, multi_avg_fn=_moving_averages, use_buffers=True)
        self.optimizer = torch.optim.AdamW(
            self.net.parameters(),
            lr=config.learning_rate,
            weight_decay=config.weight_decay,
            fused=self._device.type == "cuda",
        )
        self.grid = polar_grid(camera)
        self.held_out = held_out(looks, config.validation_fraction, config.seed)
        with_people = looks.labels.visible.any(axis=1)
        parts = (~self.held_out & with_people, ~self.held_out & ~with_people)
        self._rows: list[Int64Array] = [np.flatnonzero(part) for part in parts]
        self.steps, self.samples_seen, self.elapsed_s, self.loss = 0, 0, 0.0, math.nan
        settings = section_to_mapping(config)
        self._identity = data | {k: json.dumps(v) for k, v in settings.items() if k not in BUDGET_FIELDS}
        self._now_s = time.perf_counter if self._device.type == "cuda" else time.thread_time
        has_half = self._device.type == "cuda" or cpu_has_bf16()
        half = config.precision == "bf16" or (config.precision == "auto" and has_half)
        self._dtype = torch.bfloat16 if half else torch.float32
        torch.set_num_threads(config.threads or available_cores())
        self._saved_s = 0.0
        out.mkdir(parents=True, exist_ok=True)
        self._restore()

    @property
    def fraction(self) -> float:
        """Share of the budget that is spent."""
        if self.config.samples is not None:
            return self.samples_seen / self.config.samples
        return self.elapsed_s / (60.0 * self.config.minutes)

    def go(self, report: Callable[[PerceptionProgress], None] = lambda _: None) -> dict[str, Any]:
        """Train until the budget is spent, export, and return the content of metrics.json."""
        self.net.train()
        while self.fraction < 1.0:
            self.step()
            report(PerceptionProgress(fraction=self.fraction, step=self.steps, train_loss=self.loss))
            if self.elapsed_s - self._saved_s >= SAVE_EVERY_S:
                self.save()
        self.save()
        return self.finish()

    def step(self) -> None:
        """One step of the optimizer.

        Raises:
            PolicyError: If the loss is not finite; the last checkpoint is left as it is.
        """
        started_s = self._now_s()
        rng = np.random.default_rng([self.config.seed, self.steps])
        rows = self._draw(rng)
        for group in self.optimizer.param_groups:
            group["lr"] = self.config.learning_rate * _rate(self.fraction)
        shown, motion, targets = self._batch(rows, rng)
        with torch.autocast(self._device.type, dtype=self._dtype, enabled=self._dtype != torch.float32):
            people, free = self.net(shown, motion)
        loss = perception_loss(people, free, targets)
        if not torch.isfinite(loss):
            raise PolicyError(f"The loss of step {self.steps} is not finite; train with a smaller learning_rate.")
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimizer.step()
        self.averaged.update_parameters(self.net)
        value = float(loss.detach())
        self.loss = value if math.isnan(self.loss) else 0.98 * self.loss + 0.02 * value
        self.steps, self.samples_seen = self.steps + 1, self.samples_seen + len(rows)
        self.elapsed_s += self._now_s() - started_s

    def finish(self) -> dict[str, Any]:
        """Export the averaged weights, and measure them on what is held out."""
        net: PerceptionNet = self.averaged.module.eval()  # type: ignore[assignment]
        export_perception(net, self.spec, self.out)
        metrics: dict[str, Any] = {
            "steps": self.steps,
            "samples_seen": self.samples_seen,
            "elapsed_s": round(self.elapsed_s, 1),
            "images": len(self.looks),
            "parameters": sum(p.numel() for p in net.parameters()),
        }
        chosen = np.flatnonzero(self.held_out)
        if len(chosen):
            spread = chosen[np.unique(np.linspace(0, len(chosen) - 1, VALIDATION_IMAGES).round().astype(int))]
            metrics["held_out"] = dataclasses.asdict(measure(net, self.looks, spread, self.spec))
        write_whole(self.out / METRICS_FILE, json.dumps(metrics, indent=2).encode(), raises=PolicyError)
        return metrics

    def save(self) -> None:
        """Write the checkpoint."""
        state = {
            "identity": self._identity,
            "net": self.net.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "steps": self.steps,
            "samples_seen": self.samples_seen,
            "elapsed_s": self.elapsed_s,
            "loss": self.loss,
        }
        save_checkpoint(state, self.out)
        self._saved_s = self.elapsed_s

    def _restore(self) -> None:
        state = load_checkpoint(self.out, self._identity)
        if state is None:
            return
        with refuse_damaged(self.out / CHECKPOINT_FILE):
            self.net.load_state_dict(state["net"])
            self.averaged.load_state_dict(state["averaged"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.steps, self.samples_seen = state["steps"], state["samples_seen"]
            self.elapsed_s, self.loss = state["elapsed_s"], state["loss"]
            self._saved_s = self.elapsed_s

    def _draw(self, rng: np.random.Generator) -> Int64Array:
        """Images of a batch: `PEOPLE_SHARE` of them with people, as far as there are such."""
        shares = (PEOPLE_SHARE, 1.0 - PEOPLE_SHARE)
        if any(len(rows) == 0 for rows in self._rows):
            return rng.choice(np.concatenate(self._rows), self.config.batch_size)
        counts = [round(share * self.config.batch_size) for share in shares]
        return np.concatenate([rng.choice(rows, count) for rows, count in zip(self._rows, counts, strict=True)])

    def _batch(
        self, rows: Int64Array, rng: np.random.Generator
    ) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor, Tensor, Tensor]]:
        looks, motion = self.looks, self.looks.motion[rows].copy()
        people, rays = looks.labels.people[rows].copy(), looks.labels.rays_m[rows].copy()
        shown = _lit(shown_of(self.net, looks, rows), rng)
        mirrored = rng.random(len(rows)) < 0.5
        if self._is_symmetric:
            flip = torch.from_numpy(mirrored).to(self._device)
            shown = torch.where(flip[:, None, None, None], shown.flip(3), shown)
            people[mirrored] *= np.array([-1.0, 1.0, 1.0, -1.0], np.float32)
            rays[mirrored] = rays[mirrored, ::-1]
            motion[mirrored] *= np.array([1, -1, -1] * 2 + [1, -1], np.float32)
        targets = targets_of(people, looks.labels.visible[rows], rays, self.grid)
        told = (targets.heat, targets.peak, targets.values, targets.rays_log_m)
        heat, peak, values, log_m = (torch.from_numpy(array).to(self._device) for array in told)
        shown = shown.contiguous(memory_format=torch.channels_last)
        return shown, torch.from_numpy(motion).to(self._device), (heat, peak, values, log_m)

    @property
    def _is_symmetric(self) -> bool:
        """True if a mirrored image is one that the camera could take."""
        return bool(np.allclose(self.grid.bearings_rad, -self.grid.bearings_rad[::-1], atol=1e-6)) and (
            self.spec.robot.camera.mount_y_m == 0.0 and self.spec.robot.camera.mount_yaw_deg == 0.0
        )


def measure(net: PerceptionNet, looks: Looks, rows: Int64Array, spec: PerceptionSpec) -> PerceptionMetrics:
    """How well a network perceives some images."""
    maps, free_m = perceive(net, looks, rows, spec)
    labels = looks.labels
    return measure_perception(maps, free_m, labels.people[rows], labels.visible[rows], labels.rays_m[rows])


@torch.no_grad()
def perceive(
    net: PerceptionNet, looks: Looks, rows: Int64Array, spec: PerceptionSpec
) -> tuple[list[Float64Array], Float64Array]:
    """What the exported network would answer for pooled frames: maps of people, and free distances [m]."""
    module = PerceptionModule(net, spec.robot.camera).to(device_of_net(net)).eval()
    maps: list[Float64Array] = []
    free: list[Float64Array] = []
    for first in range(0, len(rows), 64):
        part = rows[first : first + 64]
        motion = torch.from_numpy(looks.motion[part]).to(device_of_net(net))
        people, rays = module.decoded(*net(shown_of(net, looks, part), motion))
        maps += list(people.double().cpu().numpy())
        free.append(rays[:, 0].double().cpu().numpy())
    return maps, np.concatenate(free)


@torch.no_grad()
def shown_of(net: PerceptionNet, looks: Looks, rows: Int64Array) -> Tensor:
    """What the network is shown of some images, see `PerceptionNet.stack`."""
    device = device_of_net(net)
    newest = torch.from_numpy(looks.frames[rows]).to(device).permute(0, 3, 1, 2).float() / 255.0
    grey = torch.from_numpy(grey_of(looks.frames[looks.window[rows]])).to(device).float() / 255.0
    return net.stack(newest, grey, torch.from_numpy(looks.motion[rows]).to(device))


def device_of_net(net: PerceptionNet) -> torch.device:
    """Where a network computes."""
    return net.rays.device


def _lit(shown: Tensor, rng: np.random.Generator) -> Tensor:
    """What is shown, each in another light: contrast, brightness and colour."""
    count = len(shown)
    contrast = 1.0 + rng.uniform(-LIGHT, LIGHT, (count, 1))
    colour = 1.0 + rng.uniform(-LIGHT, LIGHT, (count, 3)) / 2
    factor = np.concatenate([contrast * colour, contrast, contrast], axis=1)
    offset = np.concatenate([rng.uniform(-LIGHT, LIGHT, (count, 1)).repeat(3, axis=1), np.zeros((count, 2))], axis=1)
    factor_, offset_ = (
        torch.from_numpy(array).float().to(shown.device)[:, :, None, None] for array in (factor, offset)
    )
    return torch.addcmul(offset_, shown, factor_)


@torch.no_grad()
def _moving_averages(averages: Tensors, weights: Tensors, count: Tensor | int) -> None:
    """Advance moving averages, faster over the first steps: the weights at the start say nothing."""
    if not averages[0].is_floating_point():
        torch._foreach_copy_(averages, weights)
        return
    steps = float(count)
    changes = torch._foreach_sub(weights, averages)
    torch._foreach_mul_(changes, 1.0 - min(EMA_DECAY, (1.0 + steps) / (10.0 + steps)))
    torch._foreach_add_(averages, changes)


def _rate(fraction: float) -> float:
    if fraction < WARM_UP:
        return max(fraction / WARM_UP, 0.02)
    return 0.5 * (1.0 + math.cos(math.pi * min((fraction - WARM_UP) / (1.0 - WARM_UP), 1.0))) + 0.005
