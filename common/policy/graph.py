"""Policies of any shape: one ONNX graph whose inputs `policy.toml` names, with a recurrent state if it has one.

    format = "readygo-policy/3"
    frame_spacing_s = 0.5
    [inputs]
    frame_count = 2
    [graph]
    rate_hz = 10.0                  # how often it decides; in between its command is held
    [graph.inputs]                  # input of the graph -> what it is given
    image = "rgb"
    goal = "goal"
    [graph.state]                   # input of the graph -> output that it is given at the next decision, zeros at first
    hidden = "hidden_next"
    [robot]                         # as in robot.toml, with [robot.camera]

| given | type and shape |
|---|---|
| `rgb` | frames, the oldest first: uint8 bytes, or float32 0..1; (1, H, W, 3 F), (1, 3 F, H, W), (1, F, H, W, 3) or (1, F, 3, H, W) |
| `depth` | the same with one channel: nearness, see `readygo.common.policy.sight` |
| `goal` | float32 (1, 2): the goal in the robot's frame, x forward, y left [m] |
| `goal_image` | as `rgb` with one frame: what the robot would see at the goal |
| `motion` | float32 (1, 3 (F - 1) + 2): own motion, see `MotionInput.POSES` |
| `command` | float32 (1, 2): v [m/s], w [rad/s] executed last |
| `robot` | float32 (1, 6): which robot it drives, of those in `[robot.ranges]`; `readygo.common.policy.traits.TRAITS` |

The graph's output `action` is float32 (1, 2), v [m/s] and w [rad/s]; what exceeds the robot's limits is cut off. Types and
shapes of states are the graph's; dimensions that it leaves open are 1.
"""  # noqa: E501

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.robot.kinematics import RATE_HZ

GRAPH_FILE = "policy.onnx"


class Given(enum.Enum):
    """What a graph may be given."""

    RGB = "rgb"
    DEPTH = "depth"
    GOAL = "goal"
    GOAL_IMAGE = "goal_image"
    MOTION = "motion"
    COMMAND = "command"
    ROBOT = "robot"


@dataclass(frozen=True, kw_only=True)
class GraphSpec:
    """What a graph takes and gives."""

    inputs: Mapping[str, Given]
    """What each input is given, by its name in the graph."""
    state: Mapping[str, str] = field(default_factory=dict)
    """Inputs that are given an output of the decision before, by their names in the graph."""
    action: str = "action"
    """Name of the output that is the command."""
    rate_hz: float = float(RATE_HZ)
    """How often it decides [Hz], by the times of its images."""

    def __post_init__(self) -> None:
        if not 0.1 <= self.rate_hz <= 1000.0:
            raise ValueError(f"rate_hz must be 0.1..1000, got {self.rate_hz:g}.")
        if Given.RGB not in self.inputs.values():
            raise ValueError('a policy sees: one of [graph.inputs] must be "rgb".')
        if both := sorted(set(self.inputs) & set(self.state)):
            raise ValueError(f"{both[0]} stands in [graph.inputs] and in [graph.state].")

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> "GraphSpec":
        """The graph of a `policy.toml`.

        Raises:
            ValueError: If an input asks for a quantity that does not exist.
        """
        return cls(
            inputs={str(name): Given(given) for name, given in mapping["inputs"].items()},
            state={str(name): str(output) for name, output in mapping.get("state", {}).items()},
            action=str(mapping.get("action", "action")),
            rate_hz=float(mapping.get("rate_hz", RATE_HZ)),
        )

    def to_mapping(self) -> dict[str, Any]:
        """Plain values for `policy.toml`."""
        return {
            "action": self.action,
            "rate_hz": self.rate_hz,
            "inputs": {name: given.value for name, given in self.inputs.items()},
            "state": dict(self.state),
        }

    @property
    def images(self) -> tuple[str, ...]:
        """What each frame is of, see `PolicyInputs.images`."""
        return ("rgb", "depth") if Given.DEPTH in self.inputs.values() else ("rgb",)


@dataclass(frozen=True)
class Port:
    """An input of a graph, as onnxruntime tells it."""

    dtype: type[np.generic]
    shape: tuple[int | str | None, ...]

    def zeros(self) -> npt.NDArray[Any]:
        """What a state begins with."""
        return np.zeros([size if isinstance(size, int) and size > 0 else 1 for size in self.shape], self.dtype)

    def images(self, frames: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Frames, shape (F, H, W, C), as the graph takes them."""
        count, height, width, channels = frames.shape
        values: npt.NDArray[Any] = frames
        if self.dtype is not np.uint8:
            values = (frames / np.float32(255.0)).astype(self.dtype)
        if len(self.shape) == 5:
            first = self.shape[2] == channels and self.shape[4] != channels
            return (values.transpose(0, 3, 1, 2) if first else values)[None]
        stacked = values.transpose(1, 2, 0, 3).reshape(height, width, count * channels)
        first = len(self.shape) == 4 and self.shape[1] == count * channels and self.shape[3] != count * channels
        return np.ascontiguousarray(stacked.transpose(2, 0, 1) if first else stacked)[None]
