"""The policy artifact: a folder with `policy.toml`, `encoder.onnx`, `head.onnx` and `metrics.json`.

Policies of any other shape are one graph that names its inputs, see `readygo.common.policy.graph`.

encoder.onnx: `image` uint8 (B, H, W, C) RGB -> `latent` float32 (B, L). With late fusion it sees one frame, C = 3; with
early fusion all of them stacked along the channels, oldest first, C = 3 `frame_count`. Beside it, where the policy
takes it, `depth` uint8 (B, H, W, C / 3), and of further cameras `image_left`, `depth_left`, see
`readygo.common.policy.sight`.
head.onnx: `features` float32 (B, F) -> `action` float32 (B, 2), v [m/s] and w [rad/s] within the robot's limits.
The features are the latents (late fusion: of ..., t - 2 spacings, t - 1 spacing and t), then the ego-motion
(`MotionInput`), then the goal in the robot's frame (dx, dy) [m]. Every normalisation lies inside of the two graphs.

The head of a policy for several robots has a second input, `robot` float32 (B, 6): what
`readygo.common.policy.traits.TRAITS` names of the robot, in SI units. Its commands are within that robot's limits.
`[robot.ranges]` of `policy.toml` says which robots it knows.
"""

import dataclasses
import enum
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.camera import SensorConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_toml
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.files import write_whole
from readygo.common.images.names import RGB
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.policy.sight import channels_of, check_cameras, check_images
from readygo.common.policy.windows import FRAME_COUNT
from readygo.common.robot import RobotConfig

POLICY_FORMAT = "readygo-policy/2"
ROBOTS_FORMAT = "readygo-policy/4"
"""Format of policies for several robots: like the second format, but the head is told which robot it drives."""
GRAPH_FORMAT = "readygo-policy/3"
"""Format of policies of one graph, see `readygo.common.policy.graph`."""
FIRST_FORMAT = "readygo-policy/1"
"""Format of policies that name no inputs: theirs are `FIRST_INPUTS`."""
GOAL_SCALE_M = 10.0
"""Goals are divided by this and clipped to [-1, 1] [m]."""
ENCODER_FILE = "encoder.onnx"
HEAD_FILE = "head.onnx"
SPEC_FILE = "policy.toml"
METRICS_FILE = "metrics.json"


class Fusion(enum.Enum):
    """Where the frames of a policy meet."""

    LATE = "late"
    """The encoder sees one frame; the latents of all are put side by side."""
    EARLY = "early"
    """The encoder sees all frames stacked: one latent."""


class Goal(enum.Enum):
    """What a policy is told of its goal."""

    POINT = "point"
    """Position of the goal in the robot's frame: dx, dy [m]."""
    IMAGE = "image"
    """Image that the robot would see at the goal."""
    BOTH = "both"


class MotionInput(enum.Enum):
    """Ego-motion that a policy is given."""

    POSES = "poses"
    """Poses of the older frames in the present robot frame (dx, dy [m], dyaw [rad] each), the oldest first, then
    v [m/s] and w [rad/s] executed over the last step."""
    COMMAND = "command"
    """v [m/s], w [rad/s] executed over the last step, then 1 where they are known; 0, 0, 0 where they are not."""
    BARE_COMMAND = "bare-command"
    """v and w alone, as policies of the first format take them."""

    def width(self, frame_count: int) -> int:
        """Number of features of a policy that sees some frames together."""
        poses = 3 * (frame_count - 1) + 2
        return {MotionInput.POSES: poses, MotionInput.COMMAND: 3, MotionInput.BARE_COMMAND: 2}[self]


@dataclass(frozen=True, kw_only=True)
class PolicyInputs:
    """What the two graphs of a policy take."""

    fusion: Fusion = Fusion.LATE
    latent_count: int = 20
    """Numbers that the encoder answers."""
    motion: MotionInput = MotionInput.POSES
    frame_count: int = FRAME_COUNT
    """Frames that it sees together, one frame spacing apart."""
    images: tuple[str, ...] = (RGB,)
    """What each frame is of, in this order: see `readygo.common.policy.sight`."""
    goal: Goal = Goal.POINT
    """Form in which the policy gets its goal; images of goals are for policies of one graph."""
    robot: bool = False
    """True if the head is told which robot it drives."""

    def __post_init__(self) -> None:
        check_images(self.images)
        for name in ("latent_count", "frame_count"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}.")

    @property
    def frames_together(self) -> int:
        """Frames that the encoder sees at once."""
        return self.frame_count if self.fusion is Fusion.EARLY else 1

    @property
    def image_channels(self) -> int:
        """Channels of all images that the encoder sees at once."""
        return channels_of(self.images) * self.frames_together

    @property
    def latents_width(self) -> int:
        """Latents that the head takes: of the frames, and after them of the goal's image."""
        frames = 1 if self.fusion is Fusion.EARLY else self.frame_count
        return self.latent_count * (frames + (self.goal is not Goal.POINT))

    @property
    def feature_count(self) -> int:
        """Numbers that the head takes: latents, own motion, goal."""
        return self.latents_width + self.motion.width(self.frame_count) + (0 if self.goal is Goal.IMAGE else 2)


FIRST_INPUTS = PolicyInputs(motion=MotionInput.BARE_COMMAND)


@dataclass(frozen=True, kw_only=True)
class PolicySpec:
    """What a policy was trained for."""

    robot: RobotConfig
    """The robot, with the camera whose images the policy saw."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """What varied of that camera from episode to episode."""
    frame_spacing_s: float = 0.5
    """Time between the frames [s]; a multiple of the time between two images of the robot's camera."""
    inputs: PolicyInputs = field(default_factory=PolicyInputs)
    """Inputs of its encoder and head."""
    graph: GraphSpec | None = None
    """Graph of a policy that has one instead of encoder and head; `inputs` then names only its frames and images."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Origin of the policy: data hashes, seed, versions."""

    def __post_init__(self) -> None:
        self.robot.clock.spacing_steps(self.frame_spacing_s)
        check_cameras(self.inputs.images, self.robot)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of all that the policy is loaded from."""
        return (GRAPH_FILE, SPEC_FILE) if self.graph else (ENCODER_FILE, HEAD_FILE, SPEC_FILE)

    @property
    def wants_goal_image(self) -> bool:
        """True if it is given an image of the goal."""
        return self.graph is not None and Given.GOAL_IMAGE in self.graph.inputs.values()

    @property
    def frame_spacing_steps(self) -> int:
        """Simulation steps between the frames."""
        return self.robot.clock.spacing_steps(self.frame_spacing_s)


def save_spec(spec: PolicySpec, folder: Path) -> None:
    """Write `policy.toml` in one piece."""
    mapping = {
        "format": GRAPH_FORMAT if spec.graph else ROBOTS_FORMAT if spec.inputs.robot else POLICY_FORMAT,
        "frame_spacing_s": spec.frame_spacing_s,
        "inputs": {
            "fusion": spec.inputs.fusion.value,
            "latent_count": spec.inputs.latent_count,
            "motion": spec.inputs.motion.value,
            "frame_count": spec.inputs.frame_count,
            **({"images": spec.inputs.images} if spec.inputs.images != (RGB,) else {}),
        },
        **({"graph": spec.graph.to_mapping()} if spec.graph else {}),
        "robot": section_to_mapping(spec.robot),
        "sensor": section_to_mapping(spec.sensor),
        "training": dict(spec.training),
    }
    write_whole(folder / SPEC_FILE, "\n".join(_toml_lines(mapping)) + "\n", raises=PolicyError)


def load_spec(folder: Path) -> PolicySpec:
    """Read `policy.toml`.

    Raises:
        PolicyError: If the file is missing, broken, or of another format.
    """
    path = folder / SPEC_FILE
    try:
        mapping = read_toml(path)
    except OSError as error:
        raise PolicyError(
            f"{folder} holds no {SPEC_FILE}; give the folder that `readygo train --out` wrote."
        ) from error
    except ValueError as error:
        raise PolicyError(f"{path} is no TOML file: {error}; export the policy again.") from error
    if mapping.get("format") not in (FIRST_FORMAT, POLICY_FORMAT, GRAPH_FORMAT, ROBOTS_FORMAT):
        raise PolicyError(f"{path} has format {mapping.get('format')!r}, this version reads {POLICY_FORMAT!r}.")
    try:
        robot = section_from_mapping(RobotConfig, mapping["robot"], where="robot.")
        # Policies of before the sensor was theirs to say name none.
        sensor = section_from_mapping(SensorConfig, mapping.get("sensor", {}), where="sensor.")
        return PolicySpec(
            robot=robot,
            sensor=sensor,
            frame_spacing_s=float(mapping["frame_spacing_s"]),
            **_graphs(mapping),
            training=mapping.get("training", {}),
        )
    except (ConfigError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise PolicyError(f"{path} cannot be used: {error}; export the policy again.") from error


def _graphs(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """What the graphs of a policy are given."""
    if mapping["format"] == FIRST_FORMAT:
        return {"inputs": FIRST_INPUTS}
    if mapping["format"] in (POLICY_FORMAT, ROBOTS_FORMAT):
        robot = mapping["format"] == ROBOTS_FORMAT
        return {"inputs": dataclasses.replace(_inputs(mapping["inputs"]), robot=robot)}
    graph = GraphSpec.from_mapping(mapping["graph"])
    frame_count = int(mapping.get("inputs", {}).get("frame_count", 1))
    return {"graph": graph, "inputs": PolicyInputs(frame_count=frame_count, images=graph.images)}


def _inputs(mapping: Mapping[str, Any]) -> PolicyInputs:
    return PolicyInputs(
        fusion=Fusion(mapping["fusion"]),
        latent_count=int(mapping["latent_count"]),
        motion=MotionInput(mapping["motion"]),
        # Policies of before it was theirs to say see three.
        frame_count=int(mapping.get("frame_count", FRAME_COUNT)),
        images=tuple(mapping.get("images", (RGB,))),
    )


def _toml_lines(mapping: Mapping[str, Any], path: str = "") -> list[str]:
    # TOML has no null: what is not given is left out.
    plain = {key: value for key, value in mapping.items() if value is not None and not isinstance(value, Mapping)}
    lines = [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in plain.items()]
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            table = f"{path}{_toml_key(key)}"
            lines += ["", f"[{table}]", *_toml_lines(value, f"{table}.")]
    return lines


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml_value(key)


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    text = str(value).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{text}"'
