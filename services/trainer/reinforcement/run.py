"""The training of a state policy: drive and update until a budget is spent, measure on split val, keep the best.

Everything needed to resume is in the folder's `checkpoint.pt`; a resumed training with a budget of decisions ends with
the same weights as one without interruption.
"""

import dataclasses
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import torch

from readygo.common.arrays import AnyArray, Float32Array, Float64Array, Int8Array
from readygo.common.config import section_to_mapping
from readygo.common.documents import write_json
from readygo.common.drawing.charts import Curve, line_chart, write_chart
from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.state_policy.commands import StateCommands
from readygo.common.state_policy.state_policy import (
    STATE_POLICY_FORMAT,
    StatePolicy,
    StatePolicySpec,
    grid_weights,
)
from readygo.common.state_simulation.bank import EpisodeBank
from readygo.common.state_simulation.joined import JoinedSimulation
from readygo.common.state_simulation.simulation import (
    HUMAN_COLLISION,
    RUNNING,
    STATIC_COLLISION,
    SUCCESS,
    TIMEOUT,
    StateSimulation,
    StateSimulationConfig,
)
from readygo.common.state_simulation.tracks import has_no_tracks, tracker_numbers
from readygo.common.state_simulation.world import StateWorld
from readygo.services.trainer.checkpoint import read_state, refuse_damaged, write_state
from readygo.services.trainer.config import CHECKPOINT_FILE
from readygo.services.trainer.reinforcement.config import ReinforcementConfig
from readygo.services.trainer.reinforcement.networks import layers_of
from readygo.services.trainer.reinforcement.ppo import Learner, UpdateFigures

CURVE_FILE, CHART_FILE, METRICS_FILE = "curve.jsonl", "curve.svg", "metrics.json"
CHECKPOINT_S = 60.0
"""Wall time between two checkpoints [s]."""
TASKS = {"static": False, "dynamic": True}
_FALLS_TO = 0.05
SEED_STEP = 1_000_003
"""From the seed of one scene's robots to that of the next."""
Show = Callable[[Mapping[str, Any]], None]


@dataclass(frozen=True, kw_only=True)
class Budget:
    """When a training ends: by decisions of all robots, or by processor time."""

    decisions: int | None = None
    minutes: float | None = None

    def share(self, decisions: int, spent_s: float) -> float:
        """How much of it is spent, 0..1."""
        if self.decisions is not None:
            return min(decisions / self.decisions, 1.0)
        return min(spent_s / (60.0 * (self.minutes or 10.0)), 1.0)


@dataclass
class Progress:
    """How far a training is."""

    decisions: int = 0
    spent_s: float = 0.0
    """Processor time of driving and learning [s]."""
    curve: list[dict[str, Any]] = field(default_factory=list)
    best: float = -math.inf
    """Best mean of static and dynamic success on split val."""
    taught: bool = False
    """True if the actor has had its demonstrations."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """A scene in which robots learn."""

    world: StateWorld
    """Scene, robot and rules."""
    train: EpisodeBank
    """Episodes of split train."""
    val: EpisodeBank
    """Episodes of split val."""


class Training:
    """One training in one folder."""

    def __init__(
        self,
        places: Sequence[Place],
        spec: StatePolicySpec,
        config: ReinforcementConfig,
        out: Path,
        *,
        seed: int,
        origin: str,
    ) -> None:
        """Begin, or continue from the folder's checkpoint.

        Args:
            places: Scenes, one or more, with as many people in an episode at most.
            spec: Spec of the policy.
            config: How it learns.
            out: Folder of the policy.
            seed: Seed of weights, episodes and decisions.
            origin: What the episodes follow from besides settings and seed; the same when the training continues.

        Raises:
            PolicyError: If the folder has a training with other settings, or from other episodes.
        """
        self._spec, self._config, self._out = spec, config, out
        self.progress = Progress()
        numbers = tracker_numbers(spec.noise, spec.robot.clock)
        plays = StateSimulationConfig(
            hold_steps=spec.hold_steps,
            static_share=config.static_share,
            repeats=config.repeats,
            reward=config.reward,
        )
        parts = [
            StateSimulation(place.world, place.train, numbers, len(robots), config=plays, seed=seed + SEED_STEP * k)
            for k, (place, robots) in enumerate(
                zip(places, np.array_split(np.arange(config.ppo.robots), len(places)), strict=True)
            )
        ]
        simulation = parts[0] if len(parts) == 1 else JoinedSimulation(parts)
        simulation.begin_anywhere()
        commands = StatePolicy(spec=spec, layers=[]).commands
        self.learner = Learner(simulation, commands, config.ppo, seed=seed)
        self._val = [
            StateSimulation(place.world, place.val, numbers, len(place.val), config=plays, knows_truth=False)
            for place in places
        ]
        self._identity = json.dumps(
            {"format": STATE_POLICY_FORMAT, "config": section_to_mapping(config), "seed": seed, "origin": origin},
            sort_keys=True,
        )
        if (out / CHECKPOINT_FILE).exists():
            self._resume()

    @property
    def policy(self) -> StatePolicy:
        """The policy so far."""
        return StatePolicy(spec=self._spec, layers=layers_of(self.learner.actor))

    def teach(self, told: Float32Array, shares: Float64Array, *, epochs: int) -> StatePolicy:
        """Teach the actor what an expert did, before `run`.

        Args:
            told: What robots were told, shape (S, I).
            shares: Commands in shares of the robot's limits, shape (S, 2).
            epochs: Passes over them.

        Returns:
            The policy so far.
        """
        self.learner.imitate(told, grid_weights(shares, self._spec.robot), epochs=epochs)
        return self.policy

    def run(self, budget: Budget, show: Show = lambda _: None) -> dict[str, Any]:
        """Learn until the budget is spent.

        Args:
            budget: Includes what earlier calls spent.
            show: Told of every measurement.

        Returns:
            The metrics, which `metrics.json` has as well.
        """
        config, progress, ppo = self._config, self.progress, self._config.ppo
        saved_s, per_update = time.monotonic(), ppo.robots * ppo.stretch
        while (share := budget.share(progress.decisions, progress.spent_s)) < 1.0:
            began_s = time.process_time()
            stretch = self.learner.drive()
            entropy = ppo.entropy_first + (ppo.entropy_last - ppo.entropy_first) * share
            rate = ppo.learning_rate * max(1.0 - share, _FALLS_TO)
            alone = config.demonstrations > 0 and share < config.critic_first
            figures = self.learner.update(stretch, learning_rate=rate, entropy=entropy, critic_only=alone)
            before, progress.decisions = progress.decisions, progress.decisions + per_update
            progress.spent_s += time.process_time() - began_s
            if progress.decisions // config.val_every > before // config.val_every:
                show(self._measure(figures))
            if time.monotonic() - saved_s > CHECKPOINT_S:
                self.save()
                saved_s = time.monotonic()
        if not progress.curve or progress.curve[-1]["decisions"] < progress.decisions:
            show(self._measure(UpdateFigures()))
        self.save()
        return self._finish()

    def _measure(self, figures: UpdateFigures) -> dict[str, Any]:
        """Measure on split val, note it, keep the weights if they are the best."""
        progress, policy = self.progress, self.policy
        val = {
            task: fmean(success_rate(policy, simulation, dynamic=dynamic) for simulation in self._val)
            for task, dynamic in TASKS.items()
        }
        row = {
            "decisions": progress.decisions,
            "minutes": round(progress.spent_s / 60.0, 3),
            "val_static": val["static"],
            "val_dynamic": val["dynamic"],
            **_train_shares(self.learner.ended),
            **{name: round(value, 5) for name, value in dataclasses.asdict(figures).items()},
        }
        self.learner.ended.clear()
        progress.curve.append(row)
        self._out.mkdir(parents=True, exist_ok=True)
        write_whole(
            self._out / CURVE_FILE, "".join(json.dumps(each) + "\n" for each in progress.curve), raises=PolicyError
        )
        score = (val["static"] + val["dynamic"]) / 2.0
        if score >= progress.best:
            progress.best = score
            training = {
                **self._spec.training,
                "chosen": {k: row[k] for k in ("decisions", "val_static", "val_dynamic")},
            }
            dataclasses.replace(policy, spec=dataclasses.replace(self._spec, training=training)).save(self._out)
        if not (self._out / CHECKPOINT_FILE).exists():
            # A policy without a checkpoint cannot be resumed.
            self.save()
        return row

    def _finish(self) -> dict[str, Any]:
        progress, curve = self.progress, self.progress.curve
        chosen = max(curve, key=lambda row: (row["val_static"] + row["val_dynamic"], row["decisions"]))
        metrics = {
            "decisions": progress.decisions,
            "minutes": round(progress.spent_s / 60.0, 2),
            "decisions_per_s": round(progress.decisions / max(progress.spent_s, 1e-9)),
            "chosen_decisions": chosen["decisions"],
            "val_static": chosen["val_static"],
            "val_dynamic": chosen["val_dynamic"],
            "val_episodes": sum(map(len, self._val)),
            "parameters": sum(weight.numel() for weight in self.learner.actor.parameters()),
        }
        write_json(self._out / METRICS_FILE, metrics, raises=PolicyError)
        write_chart(self._out / CHART_FILE, _chart(curve))
        return metrics

    def save(self) -> None:
        """Write the checkpoint."""
        self._out.mkdir(parents=True, exist_ok=True)
        state = {
            "identity": self._identity,
            "learner": self.learner.state(),
            "robots": {name: _tensor(array) for name, array in self.learner.simulation.snapshot().items()},
            "progress": dataclasses.asdict(self.progress),
        }
        write_state(state, self._out / CHECKPOINT_FILE)

    def _resume(self) -> None:
        path = self._out / CHECKPOINT_FILE
        state = read_state(path)
        with refuse_damaged(path):
            if state["identity"] != self._identity:
                raise PolicyError(
                    f"{self._out} has a training with other settings, seed, scene, robot or people; "
                    "choose another folder with --out."
                )
            self.learner.load_state(state["learner"])
            kinds = {name: array.dtype for name, array in self.learner.simulation.snapshot().items()}
            arrays = {name: tensor.numpy().view(kinds[name]) for name, tensor in state["robots"].items()}
            self.learner.simulation.restore(arrays)
            self.progress = Progress(**state["progress"])


def success_rate(policy: StatePolicy, simulation: StateSimulation, *, dynamic: bool) -> float:
    """Share of a bank's episodes in which a policy reaches the goal; the errors of perception are always the same.

    Args:
        policy: The policy.
        simulation: As many robots as its bank has episodes.
        dynamic: True with people.
    """
    outcomes = play(policy, simulation, dynamic=dynamic)
    return round(float(np.mean(outcomes == SUCCESS)), 5)


def play(policy: StatePolicy, simulation: StateSimulation, *, dynamic: bool) -> Int8Array:
    """Codes of the outcomes of a bank's episodes, shape (E,), see `success_rate`."""
    count = len(simulation)
    simulation.begin(np.arange(count), np.full(count, dynamic), seeds=np.arange(count) + 1)
    commands, dt_s = StateCommands(policy, count), simulation.world.dt_s
    while (simulation.last.outcome == RUNNING).any():
        time_s, alone = dt_s * simulation.step.astype(np.float64), has_no_tracks(simulation.tracks)
        simulation.advance(commands.decide(simulation.told, time_s, simulation.state[:, :2], alone), again=False)
    return simulation.last.outcome.copy()


def _train_shares(ended: Counter[tuple[bool, int]]) -> dict[str, float]:
    """Shares of success and of collisions with people in the episodes that ended while learning."""
    shares: dict[str, float] = {}
    for task, dynamic in TASKS.items():
        counts = {code: ended[dynamic, code] for code in (SUCCESS, STATIC_COLLISION, HUMAN_COLLISION, TIMEOUT)}
        total = max(sum(counts.values()), 1)
        shares[f"train_{task}"] = round(counts[SUCCESS] / total, 4)
        if dynamic:
            shares["train_human"] = round(counts[HUMAN_COLLISION] / total, 4)
    return shares


def _chart(curve: list[dict[str, Any]]) -> str:
    decisions = np.array([row["decisions"] for row in curve]) / 1e6
    lines = [
        Curve(name=f"{part}, {task}", x=decisions, y=np.array([100.0 * row[f"{part}_{task}"] for row in curve]))
        for part in ("val", "train")
        for task in TASKS
    ]
    return line_chart(lines, x_name="million decisions", what="Success [%]", y_max=100.0)


def _tensor(array: AnyArray) -> torch.Tensor:
    """An array as a tensor; torch stores unsigned integers as signed ones."""
    return torch.from_numpy(array.view(np.int64) if array.dtype == np.uint64 else array)
