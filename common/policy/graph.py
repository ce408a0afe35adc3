"""The graph of a policy: one ONNX file whose inputs, state and cache `policy.toml` names.

    format = "readygo-policy/5"
    frame_spacing_s = 0.5
    [graph]
    frame_count = 3                 # F, the frames that it sees together, one spacing apart
    rate_hz = 10.0                  # how often it decides, its command is held in between; left out: whenever asked
    [graph.inputs]                  # input of the graph -> what it is given
    image = "rgb"
    window = "window"
    goal = "goal"
    [graph.state]                   # input of the graph -> output that it is given at the next decision, zeros at first
    hidden = "hidden_next"
    [graph.cache]                   # input of the graph -> output with a row for each frame, kept as long as the frame
    latents = "latent"
    [robot]                         # as in robot.toml, with [robot.camera]

| given | type and shape |
|---|---|
| `rgb`, `left.rgb` | frames, the oldest first: uint8 bytes, or float32 0..1; (1, H, W, 3 F), (1, 3 F, H, W), (1, F, H, W, 3) or (1, F, 3, H, W) |
| `depth`, `left.depth` | the same with one channel: nearness, see `readygo.common.policy.sight` |
| `goal` | float32 (1, 2): the goal in the robot's frame, x forward, y left [m] |
| `goal_image` | as `rgb` with one frame: what the robot would see at the goal |
| `motion` | float32 (1, 3 (F - 1) + 2): ego-motion, see `readygo.common.policy.motion.own_motion` |
| `image_motion` | the same up to the newest frame, instead of the present |
| `command` | float32 (1, 2): v [m/s], w [rad/s] executed last |
| `robot` | float32 (1, 6): which robot it drives, of those in `[robot.ranges]`; `readygo.common.policy.traits.TRAITS` |
| `window` | int64 (F): with a cache, the row of each frame, the oldest first |
| `goal_frame` | int64 (1): with a cache, the row of the image of the goal |

The graph's output `action` is float32 (1, 2), v [m/s] and w [rad/s]; what exceeds the robot's limits is cut off. Types and
shapes of states are the graph's; dimensions that it leaves open are 1.

**Moving.** A graph may have a further output of that form, which `moving` of `[graph]` names: its best command that moves. A
robot that has stood for `readygo.common.robot.standing.WAIT_S` follows that one.

**Cache.** A graph with a cache encodes each frame once. Its images are then only the N frames of the window that it was not
given before, N = 0, 1, ..., each for itself: (N, H, W, 3) or (N, 3, H, W). Its cache inputs have a row for each of the K
frames of the window that it was given before, its cache outputs one for each of the N new ones. `window` numbers the rows of
both together, known ones first. A frame may stand for several: at the start of an episode for those before it.
"""  # noqa: E501

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.images.names import RGB, cameras_of, image_name, kinds_of
from readygo.common.policy.sight import check_images
from readygo.common.policy.windows import FRAME_COUNT

GRAPH_FILE = "policy.onnx"


class Given(enum.StrEnum):
    """What a graph may be given besides images."""

    GOAL = "goal"
    GOAL_IMAGE = "goal_image"
    MOTION = "motion"
    IMAGE_MOTION = "image_motion"
    COMMAND = "command"
    ROBOT = "robot"
    WINDOW = "window"
    GOAL_FRAME = "goal_frame"


def _paper_inputs() -> dict[str, str]:
    return {name: name for name in (RGB, "window", "command", "goal")}


@dataclass(frozen=True, kw_only=True)
class GraphSpec:
    """What a graph takes and gives; by default the paper's policy."""

    frame_count: int = FRAME_COUNT
    """Frames that it sees together, one frame spacing apart."""
    inputs: Mapping[str, str] = field(default_factory=_paper_inputs)
    """What each input is given, by its name in the graph: a `Given`, or the name of an image."""
    state: Mapping[str, str] = field(default_factory=dict)
    """Inputs that are given an output of the decision before, by their names in the graph."""
    cache: Mapping[str, str] = field(default_factory=lambda: {"latents": "latent"})
    """Inputs that are given an output's rows of earlier frames, by their names in the graph."""
    action: str = "action"
    """Name of the output that is the command."""
    moving: str = ""
    """Name of the output that is the best command that moves; empty: there is none."""
    rate_hz: float | None = None
    """How often it decides [Hz], by the times of its images; None decides whenever it is asked."""

    def __post_init__(self) -> None:
        if self.frame_count < 1:
            raise ValueError(f"frame_count must be at least 1, got {self.frame_count}.")
        if self.rate_hz is not None and not 0.1 <= self.rate_hz <= 1000.0:
            raise ValueError(f"rate_hz must be 0.1..1000, got {self.rate_hz:g}.")
        if RGB not in self.inputs.values():
            raise ValueError('a policy sees: one of [graph.inputs] must be "rgb".')
        check_images(self.images)
        names = [*self.inputs, *self.state, *self.cache]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{twice[0]} stands in more than one of [graph.inputs], [graph.state] and [graph.cache].")
        if self.state and self.rate_hz is None:
            raise ValueError("a graph with a state needs rate_hz: how often the state advances.")
        if bool(self.cache) != (Given.WINDOW in self.inputs.values()):
            raise ValueError('a graph with a cache has an input "window", one without has none.')
        if self.cache and Given.GOAL_IMAGE in self.inputs.values():
            raise ValueError('a graph with a cache takes the image of its goal as "goal_frame".')
        if Given.GOAL_FRAME in self.inputs.values() and (not self.cache or self.images != (RGB,)):
            raise ValueError('an input "goal_frame" goes with a cache and "rgb" alone.')

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> "GraphSpec":
        """The graph of a `policy.toml`.

        Raises:
            ValueError: If an input asks for a quantity that does not exist.
        """
        names = {
            key: {str(name): str(value) for name, value in mapping.get(key, {}).items()}
            for key in ("inputs", "state", "cache")
        }
        rate_hz = mapping.get("rate_hz")
        return cls(
            **names,
            frame_count=int(mapping.get("frame_count", 1)),
            action=str(mapping.get("action", "action")),
            moving=str(mapping.get("moving", "")),
            rate_hz=None if rate_hz is None else float(rate_hz),
        )

    def to_mapping(self) -> dict[str, Any]:
        """Plain values for `policy.toml`."""
        return {
            "frame_count": self.frame_count,
            "action": self.action,
            **({"moving": self.moving} if self.moving else {}),
            "rate_hz": self.rate_hz,
            "inputs": dict(self.inputs),
            "state": dict(self.state),
            "cache": dict(self.cache),
        }

    @property
    def outputs(self) -> list[str]:
        """Its outputs: command, the one that moves, state, cache."""
        return [self.action, *filter(None, [self.moving]), *self.state.values(), *self.cache.values()]

    @property
    def images(self) -> tuple[str, ...]:
        """What each frame is of, in the order of `readygo.common.policy.sight`: the first camera's images first."""
        names = [value for value in self.inputs.values() if value not in list(Given)]
        cameras = sorted(cameras_of(names), key=bool)
        return tuple(
            image_name(camera, kind)
            for camera in cameras
            for kind in sorted(dict.fromkeys(kinds_of(camera, names)), key=lambda kind: kind != RGB)
        )


@dataclass(frozen=True)
class Port:
    """An input of a graph, as onnxruntime tells it."""

    dtype: type[np.generic]
    shape: tuple[int | str | None, ...]

    def zeros(self) -> AnyArray:
        """What a state begins with."""
        return np.zeros(self._sizes(), self.dtype)

    def rows(self, rows: Sequence[AnyArray]) -> AnyArray:
        """Rows of a cache, one below the other; there may be none."""
        return np.stack(rows) if rows else np.empty((0, *self._sizes()[1:]), self.dtype)

    def images(self, frames: UInt8Array, *, together: bool = True) -> AnyArray:
        """Frames as the graph takes them.

        Args:
            frames: Shape (F, H, W, C).
            together: True for one window of them all, False for each frame by itself.
        """
        count, height, width, channels = frames.shape
        values: AnyArray = frames
        if self.dtype is not np.uint8:
            values = (frames / np.float32(255.0)).astype(self.dtype)
        if together and len(self.shape) != 5:
            values = values.transpose(1, 2, 0, 3).reshape(1, height, width, count * channels)
            channels *= count
        first = len(self.shape) >= 4 and self.shape[-3] == channels and self.shape[-1] != channels
        values = np.ascontiguousarray(values.transpose(0, 3, 1, 2) if first else values)
        return values[None] if together and len(self.shape) == 5 else values

    def _sizes(self) -> list[int]:
        return [size if isinstance(size, int) and size > 0 else 1 for size in self.shape]
