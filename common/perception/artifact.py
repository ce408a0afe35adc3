"""The perception artifact: a folder with `perception.toml`, `perception.onnx`, `weights.safetensors`, `metrics.json`.

The graph is given the newest image and those before it as bytes (`frames`, uint8 (3, H, W, 3), the oldest first) and
the robot's own motion (`motion`, float32 (1, 8), `readygo.common.policy.motion.own_motion`). It answers the map of
people (`people`, float32 (9, D, C), `readygo.common.perception.people`) and free distances with the deviation of their
logarithms (`rays`, float32 (2, C)). These inputs are all of its state. The weights are for networks that begin with it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_tagged, write_toml
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.robot import RobotConfig

PERCEPTION_FORMAT = "readygo-perception/1"
SPEC_FILE, GRAPH_FILE, WEIGHTS_FILE = "perception.toml", "perception.onnx", "weights.safetensors"
FRAMES = 3
"""Images that are seen together."""


@dataclass(frozen=True, kw_only=True)
class PerceptionSpec:
    """What a network was trained to perceive with."""

    robot: RobotConfig
    """The robot, with the camera whose images it saw."""
    spacing_s: float = 0.2
    """Time between the images that it sees together [s]."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Origin: hashes of the data, scenes, people, settings."""

    def __post_init__(self) -> None:
        self.robot.clock.spacing_steps(self.spacing_s)


def save_perception_spec(spec: PerceptionSpec, folder: Path) -> None:
    """Write `perception.toml` in one piece."""
    mapping = {
        "format": PERCEPTION_FORMAT,
        "spacing_s": spec.spacing_s,
        "robot": section_to_mapping(spec.robot),
        "training": dict(spec.training),
    }
    write_toml(folder / SPEC_FILE, mapping, raises=PolicyError)


def load_perception_spec(folder: Path) -> PerceptionSpec:
    """Read `perception.toml`.

    Raises:
        PolicyError: If the file is missing, broken, or of another format.
    """
    path = folder / SPEC_FILE
    mapping = read_tagged(
        path,
        PERCEPTION_FORMAT,
        raises=PolicyError,
        missing="give the folder that `readygo train --recipe perception --out` wrote",
        remedy="train it again",
    )
    try:
        return PerceptionSpec(
            robot=section_from_mapping(RobotConfig, mapping["robot"], where="robot."),
            spacing_s=float(mapping["spacing_s"]),
            training=mapping.get("training", {}),
        )
    except (ConfigError, KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise PolicyError(f"{path} cannot be used: {error}; train it again.") from error
