"""What a shard says about its run: a mapping of plain values, stored as one MCAP metadata record.

Readers use `config` (the resolved config; its tables `robot` and `episode` are `RobotConfig` and `EpisodeConfig`).
`scene` and `avatars` (hashes and licences), `numeric_class`, `version` and `commit` tell where the samples are from.
Every value is JSON, so that viewers show it and it comes back as it was.
"""

import json
from collections.abc import Mapping
from typing import Any

from readygo.common.camera import SensorConfig
from readygo.common.camera.recorded import with_whole_camera
from readygo.common.config import section_from_mapping
from readygo.common.errors import DatasetError
from readygo.common.robot.config import RobotConfig

RECORD_NAME = "readygo"
FORMAT = "readygo-shard/1"


def metadata_to_strings(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Metadata as MCAP's mapping of strings, keys in order.

    Raises:
        DatasetError: If a value cannot be written as JSON.
    """
    try:
        return {
            str(key): json.dumps(value, sort_keys=True, allow_nan=False)
            for key, value in sorted({**metadata, "format": FORMAT}.items())
        }
    except (TypeError, ValueError) as error:
        raise DatasetError(f"Shard metadata must be plain values: {error}.") from error


def metadata_from_strings(strings: Mapping[str, str]) -> dict[str, Any]:
    """The metadata that `metadata_to_strings` wrote.

    Raises:
        DatasetError: If it is of another format.
    """
    try:
        metadata = {key: json.loads(value) for key, value in strings.items()}
    except ValueError as error:
        raise DatasetError(f"the metadata cannot be read: {error}") from error
    if metadata.pop("format", None) != FORMAT:
        raise DatasetError(f"this is no {FORMAT} file")
    return metadata


def robot_of(metadata: Mapping[str, Any]) -> RobotConfig | None:
    """The robot in the metadata's config, None if it names none."""
    mapping = _config(metadata).get("robot")
    return None if mapping is None else section_from_mapping(RobotConfig, mapping)


def sensor_of(metadata: Mapping[str, Any]) -> SensorConfig:
    """What varied of the robot's camera from episode to episode; nothing if the metadata do not say."""
    renderer = _config(metadata).get("renderer", {})
    return section_from_mapping(SensorConfig, renderer.get("sensor", {}))


def _config(metadata: Mapping[str, Any]) -> dict[str, Any]:
    config = metadata.get("config")
    return with_whole_camera(config) if isinstance(config, Mapping) else {}
