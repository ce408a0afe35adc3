"""The policy artifact: a folder with `policy.toml`, `policy.onnx`, `weights.safetensors` and `metrics.json`.

`policy.onnx` is the whole policy, from images to a command, with every normalisation inside; `policy.toml` says which
robot it drives and what its graph is given (`readygo.common.policy.graph`). Policies run from these two files.
`weights.safetensors` holds the weights of the trained network, by their names in PyTorch, for training by other means.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.camera import SensorConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_tagged, write_toml
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.policy.sight import check_cameras
from readygo.common.robot import RobotConfig

POLICY_FORMAT = "readygo-policy/5"
SPEC_FILE = "policy.toml"
WEIGHTS_FILE = "weights.safetensors"
METRICS_FILE = "metrics.json"
POLICY_FILES = (GRAPH_FILE, SPEC_FILE)
"""Names of all that a policy is loaded from."""


@dataclass(frozen=True, kw_only=True)
class PolicySpec:
    """What a policy was trained for."""

    robot: RobotConfig
    """The robot, with the camera whose images the policy saw."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """What varied of that camera from episode to episode."""
    frame_spacing_s: float = 0.5
    """Time between the frames [s]; a multiple of the time between two images of the robot's camera."""
    graph: GraphSpec = field(default_factory=GraphSpec)
    """What its graph takes and gives."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Origin of the policy: data hashes, seed, versions."""

    def __post_init__(self) -> None:
        self.robot.clock.spacing_steps(self.frame_spacing_s)
        check_cameras(self.images, self.robot)

    @property
    def images(self) -> tuple[str, ...]:
        """What each frame is of, side by side in this order: see `readygo.common.policy.sight`."""
        return self.graph.images

    @property
    def wants_goal_image(self) -> bool:
        """True if it is given an image of the goal."""
        return not {Given.GOAL_IMAGE, Given.GOAL_FRAME}.isdisjoint(self.graph.inputs.values())

    @property
    def frame_spacing_steps(self) -> int:
        """Simulation steps between the frames."""
        return self.robot.clock.spacing_steps(self.frame_spacing_s)


def save_spec(spec: PolicySpec, folder: Path) -> None:
    """Write `policy.toml` in one piece."""
    mapping = {
        "format": POLICY_FORMAT,
        "frame_spacing_s": spec.frame_spacing_s,
        "graph": spec.graph.to_mapping(),
        "robot": section_to_mapping(spec.robot),
        "sensor": section_to_mapping(spec.sensor),
        "training": dict(spec.training),
    }
    write_toml(folder / SPEC_FILE, mapping, raises=PolicyError)


def load_spec(folder: Path) -> PolicySpec:
    """Read `policy.toml`.

    Raises:
        PolicyError: If the file is missing, broken, or of another format.
    """
    path = folder / SPEC_FILE
    mapping = read_tagged(
        path,
        POLICY_FORMAT,
        raises=PolicyError,
        missing="give the folder that `readygo train --out` wrote",
        remedy="export the policy again",
        old="run the `readygo train` command that wrote it again, which exports it from its checkpoint, or train it "
        "again. For a graph of your own, write policy.toml as `readygo.common.policy.graph` shows",
    )
    try:
        return PolicySpec(
            robot=section_from_mapping(RobotConfig, mapping["robot"], where="robot."),
            sensor=section_from_mapping(SensorConfig, mapping.get("sensor", {}), where="sensor."),
            frame_spacing_s=float(mapping["frame_spacing_s"]),
            graph=GraphSpec.from_mapping(mapping["graph"]),
            training=mapping.get("training", {}),
        )
    except (ConfigError, KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise PolicyError(f"{path} cannot be used: {error}; export the policy again.") from error
