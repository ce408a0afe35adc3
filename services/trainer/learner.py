"""The weights of a training run, and what changes them: one optimisation step on a batch."""

import copy
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from readygo.common.robot import RobotConfig
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.hardware import device_of, dtype_of
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.objective import Objective, Shown
from readygo.services.trainer.parts import timing_of
from readygo.services.trainer.pretrained import PretrainedEncoder
from readygo.services.trainer.ranks import Ranks


class Learner:
    """Network, averaged network and optimizer."""

    def __init__(
        self, robot: RobotConfig, config: TrainConfig, ranks: Ranks, encoder: Mapping[str, Tensor] | None = None
    ) -> None:
        """New weights, a function of the seed.

        Args:
            robot: The policy's.
            config: Settings of the training.
            ranks: Processes that train together.
            encoder: Weights of trained perception, for a pretrained encoder.

        Raises:
            PolicyError: If the device that is asked for is not there.
        """
        device = device_of(config.device)
        dtype = dtype_of(config, device, (robot.camera.height_px, robot.camera.width_px))
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.model = PolicyNet(robot, config.network, reads_humans=config.sampling.humans_weight > 0)
        looks = self.model.encoder if isinstance(self.model.encoder, PretrainedEncoder) else None
        if encoder is not None:
            assert looks is not None
            looks.perception.load_state_dict(encoder)
        self.objective = Objective(robot, config, timing_of(robot, config), dtype, looks)
        self.model.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.model).requires_grad_(False)
        """The weights that are validated and exported."""
        if self.average.memory is not None:
            self.average.memory.flatten_parameters()
        self.optimizer = torch.optim.AdamW(
            self.model.parameters(),
            lr=config.optimizer.learning_rate,
            weight_decay=config.optimizer.weight_decay,
            fused=True,
        )
        self._network = ranks.wrap(self.model)
        if device.type == "cuda":
            self._network = torch.compile(self._network, dynamic=True)  # type: ignore[assignment]
        self.device, self._ema_decay = device, config.optimizer.ema_decay

    def learn(self, shown: Shown, rate: float, step: int) -> float:
        """One step of the optimizer; the loss of the batch before it, which is not finite if there was none.

        Args:
            shown: The batch.
            rate: Learning rate.
            step: Number of the step, from 0.
        """
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.model.train()
        loss = self.objective.loss(self._network, self.model.bins, shown.to(self.device))
        value = loss.item()
        if not torch.isfinite(loss):
            return value
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        self._update_average(step)
        return value

    @property
    def is_finite(self) -> bool:
        """True if all weights are numbers."""
        return all(bool(torch.isfinite(value).all()) for value in self.model.parameters())

    def state(self) -> dict[str, Any]:
        """All that `restore` needs."""
        return {
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Resume from what `state` gave.

        Raises:
            RuntimeError: If it is of another network.
        """
        self.model.load_state_dict(state["model"])
        self.average.load_state_dict(state["average"])
        self.optimizer.load_state_dict(state["optimizer"])

    @torch.no_grad()
    def _update_average(self, step: int) -> None:
        decay = min(self._ema_decay, (2 + step) / (11 + step))
        latest = [value for value in self.model.state_dict().values() if value.is_floating_point()]
        average = [value for value in self.average.state_dict().values() if value.is_floating_point()]
        torch._foreach_lerp_(average, latest, 1 - decay)
