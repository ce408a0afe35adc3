"""PPO on robots of a state simulation: drive a stretch, estimate advantages, update actor and critic. Needs torch.

Legend: T decisions of N robots; A advantage, V value, r reward, g = 1 unless the episode ended:

    delta_t = r_t + gamma g_t V_t+1 - V_t,   A_t = delta_t + gamma lambda g_t A_t+1

Source: Schulman et al., Proximal policy optimization algorithms, 2017; High-dimensional continuous control using
generalized advantage estimation, 2016.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.state_simulation.joined import JoinedSimulation
from readygo.common.state_simulation.simulation import StateSimulation
from readygo.services.trainer.reinforcement.config import PpoConfig
from readygo.services.trainer.reinforcement.networks import make_network


@dataclass
class Stretch:
    """Decisions of all robots between two updates."""

    told: torch.Tensor
    """Shape (T, N, I)."""
    truth: torch.Tensor
    """One more row than decisions, shape (T + 1, N, J)."""
    action: torch.Tensor
    """Number of the command, shape (T, N)."""
    log_probability: torch.Tensor
    """Of the action when it was taken, shape (T, N)."""
    reward: torch.Tensor
    goes: torch.Tensor
    """0 where the decision ended an episode, else 1, shape (T, N)."""


@dataclass
class UpdateFigures:
    """How an update went."""

    kl: float = 0.0
    clipped: float = 0.0
    entropy: float = 0.0
    value_loss: float = 0.0
    explained: float = 0.0
    """Share of the returns' variance that the critic explains."""


class _Batch(NamedTuple):
    """B decisions."""

    told: torch.Tensor
    truth: torch.Tensor
    action: torch.Tensor
    before: torch.Tensor
    """Logarithm of the action's probability when it was taken, shape (B,)."""
    gain: torch.Tensor
    """Advantage, normalised, shape (B,)."""
    returns: torch.Tensor


@dataclass
class Learner:
    """Actor, critic and their optimizer, with the robots that they learn from."""

    simulation: StateSimulation | JoinedSimulation
    commands: Float64Array
    """v [m/s], w [rad/s] of every action, shape (A, 2)."""
    config: PpoConfig
    seed: int = 0
    actor: nn.Sequential = field(init=False)
    critic: nn.Sequential = field(init=False)
    optimizer: torch.optim.Optimizer = field(init=False)
    ended: Counter[tuple[bool, int]] = field(init=False, default_factory=Counter)
    """Episodes that ended, by whether people took part and by code of the outcome."""

    def __post_init__(self) -> None:
        self._random = torch.Generator().manual_seed(self.seed)
        torch.manual_seed(self.seed)
        self.actor = make_network(
            self.simulation.told.shape[1], self.config.actor_widths, len(self.commands), last_gain=0.01
        )
        self.critic = make_network(self.simulation.truth.shape[1], self.config.critic_widths, 1, last_gain=1.0)
        parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.optimizer = torch.optim.Adam(parameters, lr=self.config.learning_rate, eps=1e-5)

    @torch.no_grad()
    def drive(self) -> Stretch:
        """Let all robots take `PpoConfig.stretch` decisions, drawn from the actor's distributions."""
        simulation, (count, robots) = self.simulation, (self.config.stretch, len(self.simulation))
        stretch = Stretch(
            told=torch.empty(count, robots, simulation.told.shape[1]),
            truth=torch.empty(count + 1, robots, simulation.truth.shape[1]),
            action=torch.empty(count, robots, dtype=torch.int64),
            log_probability=torch.empty(count, robots),
            reward=torch.empty(count, robots),
            goes=torch.empty(count, robots),
        )
        for t in range(count):
            stretch.told[t] = torch.from_numpy(simulation.told)
            stretch.truth[t] = torch.from_numpy(simulation.truth)
            logits = torch.log_softmax(self.actor(stretch.told[t]), 1)
            action = torch.multinomial(logits.exp(), 1, generator=self._random)
            stretch.action[t], stretch.log_probability[t] = action[:, 0], logits.gather(1, action)[:, 0]
            last = simulation.advance(self.commands[action[:, 0].numpy()])
            stretch.reward[t] = torch.from_numpy(last.reward)
            stretch.goes[t] = 1.0 - torch.from_numpy(last.ended.astype(np.float32))
            rows = np.flatnonzero(last.ended)
            self.ended.update(zip(last.dynamic[rows].tolist(), last.outcome[rows].tolist(), strict=True))
        stretch.truth[count] = torch.from_numpy(simulation.truth)
        return stretch

    @torch.no_grad()
    def advantages(self, stretch: Stretch) -> tuple[torch.Tensor, torch.Tensor, float]:
        """Advantages, returns, shape (T, N) each, and the share of the returns' variance that the critic explains."""
        config, values = self.config, self.critic(stretch.truth)[..., 0]
        advantages, carry = torch.empty_like(stretch.reward), torch.zeros(stretch.reward.shape[1])
        for t in reversed(range(len(advantages))):
            delta = stretch.reward[t] + config.gamma * stretch.goes[t] * values[t + 1] - values[t]
            advantages[t] = carry = delta + config.gamma * config.lam * stretch.goes[t] * carry
        returns = advantages + values[:-1]
        explained = 1.0 - float(advantages.var() / returns.var())
        return advantages, returns, explained

    def imitate(self, told: Float32Array, weights: Float32Array, *, epochs: int, batch: int = 512) -> float:
        """Teach the actor by cross-entropy; returns the mean loss of the last epoch.

        Args:
            told: What robots are told, shape (S, I).
            weights: Weights of all commands, which sum to 1, shape (S, A).
            epochs: Passes.
            batch: States of a step.
        """
        optimizer = torch.optim.Adam(self.actor.parameters(), lr=1e-3)
        states, targets, loss_sum = torch.from_numpy(told), torch.from_numpy(weights), 0.0
        for epoch in range(epochs):
            loss_sum = 0.0
            for group in optimizer.param_groups:
                group["lr"] = 1e-3 * (1.0 - 0.9 * epoch / max(epochs - 1, 1))
            for rows in torch.randperm(len(states), generator=self._random).chunk(-(-len(states) // batch)):
                loss = nn.functional.cross_entropy(self.actor(states[rows]), targets[rows])
                optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                optimizer.step()
                loss_sum += float(loss.detach()) * len(rows)
        return loss_sum / max(len(states), 1)

    def update(
        self, stretch: Stretch, *, learning_rate: float, entropy: float, critic_only: bool = False
    ) -> UpdateFigures:
        """Learn from a stretch.

        Args:
            stretch: From `drive`.
            learning_rate: Of this update.
            entropy: Weight of the entropy.
            critic_only: True leaves the actor as it is.
        """
        config = self.config
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        advantages, returns, explained = self.advantages(stretch)
        gain = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        parts = (stretch.told, stretch.truth[:-1], stretch.action, stretch.log_probability, gain, returns)
        decisions = _Batch(*(part.flatten(0, 1) for part in parts))
        figures = UpdateFigures()
        for _ in range(config.epochs):
            for rows in torch.randperm(len(decisions.action), generator=self._random).chunk(config.minibatches):
                figures = self._step(_Batch(*(part[rows] for part in decisions)), entropy, critic_only)
        figures.explained = explained
        return figures

    def _step(self, batch: _Batch, entropy: float, critic_only: bool) -> UpdateFigures:
        """One step of the optimizer."""
        config, (told, truth, action, before, gain, returns) = self.config, batch
        logits = torch.log_softmax(self.actor(told), 1)
        log_probability = logits.gather(1, action[:, None])[:, 0]
        ratio = torch.exp(log_probability - before)
        clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
        spread = -(logits.exp() * logits).sum(1).mean()
        value_loss = nn.functional.mse_loss(self.critic(truth)[:, 0], returns)
        loss = 0.5 * value_loss
        if not critic_only:
            loss = loss - torch.min(ratio * gain, clipped * gain).mean() - entropy * spread
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for network in (self.actor, self.critic):
            nn.utils.clip_grad_norm_(network.parameters(), config.gradient_max)
        self.optimizer.step()
        with torch.no_grad():
            return UpdateFigures(
                kl=float((before - log_probability).mean()),
                clipped=float(((ratio - 1.0).abs() > config.clip).float().mean()),
                entropy=float(spread),
                value_loss=float(value_loss),
            )

    def state(self) -> dict[str, Any]:
        """All that continues the training, besides where the robots are."""
        return {
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "random": self._random.get_state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Continue from a state; the robots begin new episodes."""
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        self.optimizer.load_state_dict(state["optimizer"])
        self._random.set_state(state["random"])
