"""A policy that is told states instead of images: a small network that picks a command of the robot's grid.

A folder with `state_policy.toml`, which says which robot it drives in which scene and what it is told, and `actor.npz`,
the layers of its network. It runs in NumPy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_toml, write_toml
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.files import write_then_rename
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import TURN_SHARES, command_grid, speed_shares
from readygo.common.state_simulation.world import ObservationConfig

STATE_POLICY_FORMAT = "readygo-state-policy/2"
STATE_POLICY_FILE, ACTOR_FILE = "state_policy.toml", "actor.npz"
_ACTOR_BYTES_MAX = 64 << 20

Layers = Sequence[tuple[Float32Array, Float32Array]]
"""Weights, shape (outputs, inputs), and biases of each layer."""


@dataclass(frozen=True, kw_only=True)
class StatePolicySpec:
    """What a state policy was trained for."""

    robot: RobotConfig
    scenes: Mapping[str, str]
    """Name of each scene where it was trained, by its content hash."""
    hold_s: float = 0.2
    """Time that a command is held [s]."""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    noise: PerceptionNoise = field(default_factory=PerceptionNoise)
    """Errors of perception that it learned with."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Settings and figures of the training."""

    @property
    def hold_steps(self) -> int:
        """Steps that a command is held.

        Raises:
            PolicyError: If the robot's clock has no such time.
        """
        return hold_steps_of(self.robot, self.hold_s)


def hold_steps_of(robot: RobotConfig, hold_s: float) -> int:
    """Steps of a robot's clock that a command is held.

    Raises:
        PolicyError: If the time is no multiple of that between two commands.
    """
    clock = robot.clock
    steps = clock.steps(hold_s)
    if steps < 1 or steps % clock.control_every or abs(steps * clock.dt_s - hold_s) > 1e-6:
        raise PolicyError(
            f"A command cannot be held for {hold_s:g} s by a robot that is commanded every "
            f"{clock.control_every * clock.dt_s:g} s: choose a multiple of that."
        )
    return steps


def commands_of(robot: RobotConfig) -> Float64Array:
    """The commands that a state policy picks from: v [m/s], w [rad/s], shape (A, 2)."""
    commands: Float64Array = command_grid(robot) * (robot.v_max_mps, robot.w_max_radps)
    return commands


def grid_weights(shares: Float64Array, robot: RobotConfig) -> Float32Array:
    """Commands as weights of the robot's commands around them (bilinear), shape (N, 2) -> (N, A).

    Args:
        shares: Commands in shares of the robot's largest speed and yaw rate.
        robot: Whose commands.
    """
    parts = []
    for values, knots in ((shares[:, 0], np.array(speed_shares(robot))), (shares[:, 1], np.array(TURN_SHARES))):
        at = np.clip((values - knots[0]) / (knots[1] - knots[0]), 0.0, len(knots) - 1.0)
        low = np.minimum(at.astype(np.int64), len(knots) - 2)
        rows, part = np.arange(len(at)), np.zeros((len(at), len(knots)))
        part[rows, low], part[rows, low + 1] = 1.0 - (at - low), at - low
        parts.append(part)
    weights: Float32Array = (parts[0][:, :, None] * parts[1][:, None, :]).reshape(len(shares), -1).astype(np.float32)
    return weights


@dataclass(frozen=True, kw_only=True, eq=False)
class StatePolicy:
    """A state policy that drives."""

    spec: StatePolicySpec
    layers: Layers

    @cached_property
    def commands(self) -> Float64Array:
        """The commands that it picks from, see `commands_of`."""
        return commands_of(self.spec.robot)

    def logits(self, told: Float32Array) -> Float32Array:
        """Scores of all commands, shape (N, I) -> (N, A)."""
        return forward(self.layers, told)

    def choose(self, told: Float32Array) -> Float64Array:
        """The best command for each robot: v [m/s], w [rad/s], shape (N, 2)."""
        best: Int64Array = self.logits(told).argmax(axis=1)
        chosen: Float64Array = self.commands[best]
        return chosen

    def save(self, folder: Path) -> None:
        """Write the artifact.

        Raises:
            PolicyError: If it cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, Any] = {
            f"{name}{k}": array for k, layer in enumerate(self.layers) for name, array in zip("wb", layer, strict=True)
        }
        with write_then_rename(folder / ACTOR_FILE, raises=PolicyError) as made, made.open("wb") as file:
            np.savez(file, **arrays)
        tables = {"format": STATE_POLICY_FORMAT, **section_to_mapping(self.spec)}
        write_toml(folder / STATE_POLICY_FILE, tables, raises=PolicyError)


def forward(layers: Layers, told: Float32Array) -> Float32Array:
    """Answers of a network with ReLU between its layers, shape (N, inputs) -> (N, outputs)."""
    values = told
    for k, (weight, bias) in enumerate(layers):
        values = values @ weight.T + bias
        if k < len(layers) - 1:
            values = np.maximum(values, np.float32(0.0))
    return values


def is_state_policy(folder: Path) -> bool:
    """True if a folder holds a state policy."""
    return (folder / STATE_POLICY_FILE).is_file()


def load_state_policy(folder: Path) -> StatePolicy:
    """Read an artifact.

    Raises:
        PolicyError: If it is missing, damaged, or of another format.
    """
    try:
        tables = read_toml(folder / STATE_POLICY_FILE)
        found = tables.pop("format", "")
        if found != STATE_POLICY_FORMAT:
            raise PolicyError(f"{folder} is {found!r}, this version reads {STATE_POLICY_FORMAT!r}; train it again.")
        spec = section_from_mapping(StatePolicySpec, tables)
    except (OSError, ConfigError, ValueError, TypeError) as error:
        raise PolicyError(f"{folder} holds no usable state policy: {error}") from error
    arrays = load_npz(folder / ACTOR_FILE, None, bytes_max=_ACTOR_BYTES_MAX, raises=PolicyError)
    count = len(arrays) // 2
    if count < 1 or set(arrays) != {f"{name}{k}" for k in range(count) for name in "wb"}:
        raise PolicyError(f"{folder / ACTOR_FILE} does not hold the layers of an actor.")
    layers = [(arrays[f"w{k}"].astype(np.float32), arrays[f"b{k}"].astype(np.float32)) for k in range(count)]
    _check_shapes(layers, spec, folder)
    return StatePolicy(spec=spec, layers=layers)


def _check_shapes(layers: Layers, spec: StatePolicySpec, folder: Path) -> None:
    sizes = [weight.shape[1] for weight, _ in layers if weight.ndim == 2] + [len(commands_of(spec.robot))]
    fits = len(sizes) == len(layers) + 1 and all(
        weight.shape == (after, before) and bias.shape == (after,)
        for (weight, bias), before, after in zip(layers, sizes[:-1], sizes[1:], strict=True)
    )
    if not fits:
        raise PolicyError(f"The layers in {folder / ACTOR_FILE} do not fit each other, or the robot's commands.")
