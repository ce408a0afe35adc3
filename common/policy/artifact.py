"""The policy artifact: a folder with `policy.toml`, `encoder.onnx`, `head.onnx` and `metrics.json`.

encoder.onnx: `image` uint8 (B, H, W, 3) RGB -> `latent` float32 (B, 20).
head.onnx: `features` float32 (B, 64) -> `action` float32 (B, 2), v [m/s] and w [rad/s] within the robot's limits.
The 64 features are the latents of t - 2 spacings, t - 1 spacing and t, then the previous action (v [m/s], w [rad/s])
and the goal in the robot's frame (dx, dy) [m]. Every normalisation lies inside of the two graphs.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.camera import SensorConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.files import write_whole
from readygo.common.policy.windows import FRAME_COUNT, spacing_steps_of
from readygo.common.robot import RobotConfig

POLICY_FORMAT = "readygo-policy/1"
LATENT_COUNT = 20
FEATURE_COUNT = FRAME_COUNT * LATENT_COUNT + 4
GOAL_SCALE_M = 10.0
"""Goals are divided by this and clipped to [-1, 1] [m]."""
ENCODER_FILE = "encoder.onnx"
HEAD_FILE = "head.onnx"
SPEC_FILE = "policy.toml"
METRICS_FILE = "metrics.json"


@dataclass(frozen=True, kw_only=True)
class PolicySpec:
    """What a policy was trained for."""

    robot: RobotConfig
    """With the camera whose images it saw."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """What varied of that camera from episode to episode."""
    frame_spacing_s: float = 0.5
    """Time between the three frames [s]; a multiple of the step of 0.05 s."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Where it comes from: data hashes, seed, versions."""

    def __post_init__(self) -> None:
        spacing_steps_of(self.frame_spacing_s)

    @property
    def frame_spacing_steps(self) -> int:
        """Simulation steps between the three frames."""
        return spacing_steps_of(self.frame_spacing_s)


def save_spec(spec: PolicySpec, folder: Path) -> None:
    """Write `policy.toml` in one piece."""
    mapping = {
        "format": POLICY_FORMAT,
        "frame_spacing_s": spec.frame_spacing_s,
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
        mapping = tomllib.loads(path.read_text())
    except OSError as error:
        raise PolicyError(
            f"{folder} holds no {SPEC_FILE}; give the folder that `readygo train --out` wrote."
        ) from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise PolicyError(f"{path} is no TOML file: {error}; export the policy again.") from error
    if mapping.get("format") != POLICY_FORMAT:
        raise PolicyError(f"{path} has format {mapping.get('format')!r}, this version reads {POLICY_FORMAT!r}.")
    try:
        robot = section_from_mapping(RobotConfig, mapping["robot"], where="robot.")
        # Policies of before the sensor was theirs to say name none.
        sensor = section_from_mapping(SensorConfig, mapping.get("sensor", {}), where="sensor.")
        return PolicySpec(
            robot=robot,
            sensor=sensor,
            frame_spacing_s=float(mapping["frame_spacing_s"]),
            training=mapping.get("training", {}),
        )
    except (ConfigError, KeyError, TypeError, ValueError) as error:
        raise PolicyError(f"{path} cannot be used: {error}; export the policy again.") from error


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
