"""Where samples are from: what every shard says about its run, stored as one MCAP metadata record.

Every value is JSON, so that viewers show it and it comes back as it was.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from readygo.common.camera import SensorConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import parse_json
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.messages.coordination import RunSpec
from readygo.common.robot.config import RobotConfig

RECORD_NAME = "readygo"
FORMAT = "readygo-shard/1"

Part = TypeVar("Part")


@dataclass(frozen=True, kw_only=True)
class SceneOrigin:
    """The scene that samples were recorded in."""

    name: str = ""
    hash: str = ""
    """Content hash of the bundle."""
    license: str = ""


@dataclass(frozen=True, kw_only=True)
class AvatarOrigin:
    """An avatar that humans of the run wear."""

    hash: str = ""
    license: str = ""


@dataclass(frozen=True, kw_only=True)
class ScenarioOrigin:
    """The file of the scenarios that were played instead of drawn."""

    name: str = ""
    sha256: str = ""


@dataclass(frozen=True, kw_only=True)
class PolicyOrigin:
    """The policy that drove in a share of the episodes."""

    sha256: str = ""
    """SHA-256 over the files that the policy is loaded from."""
    mix: float = 0.0
    """Share of the episodes that it was to drive."""


@dataclass(frozen=True, kw_only=True)
class TeacherOrigin:
    """Who labelled the samples, and drove the episodes that are the expert's without it."""

    sha256: str = ""
    """SHA-256 over the files that a state policy is loaded from; empty for others."""
    kind: str = "state-policy"
    """The value of a `TeacherKind`."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Versions, hashes, licenses and settings of the run that recorded a shard; empty where it does not say."""

    readygo_version: str = ""
    commit: str = ""
    """Commit of the sources; empty for an installed package."""
    numeric_class: str = ""
    """What the samples' bits depend on besides their key: backend, package versions, architecture."""
    scene: SceneOrigin = field(default_factory=SceneOrigin)
    avatars: Mapping[str, AvatarOrigin] = field(default_factory=dict)
    """Origin of each avatar, by its name."""
    scenarios: ScenarioOrigin | None = None
    """File of the scenarios that were played; None where scenarios were drawn."""
    policy: PolicyOrigin | None = None
    """The policy that drove; None where the expert alone drove."""
    teacher: TeacherOrigin | None = None
    """The teacher in the expert's place; None where the expert labelled."""
    seed: int | None = None
    config: Mapping[str, Any] | None = None
    """The run's resolved settings by section, as plain values."""

    @classmethod
    def of_run(cls, spec: RunSpec) -> "Provenance":
        """The provenance of everything that a run records."""
        return cls.from_mapping({**spec.metadata, "config": spec.config, "seed": spec.seed})

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> "Provenance":
        """The provenance of `to_mapping`'s result: unknown keys are left out, missing ones are empty.

        Raises:
            DatasetError: If a value is of another kind than this version's.
        """
        try:
            scenarios, policy, teacher = (mapping.get(name) for name in ("scenarios", "policy", "teacher"))
            parts = {
                "scene": _part(SceneOrigin, mapping.get("scene", {})),
                "avatars": {name: _part(AvatarOrigin, entry) for name, entry in mapping.get("avatars", {}).items()},
                "scenarios": None if scenarios is None else _part(ScenarioOrigin, scenarios),
                "policy": None if policy is None else _part(PolicyOrigin, policy),
                "teacher": None if teacher is None else _part(TeacherOrigin, teacher),
            }
        except (TypeError, AttributeError) as error:
            raise DatasetError(f"the metadata cannot be read: {error}") from error
        return _part(cls, {**mapping, **parts})

    def to_mapping(self) -> dict[str, Any]:
        """Plain values; what is None is left out."""
        return {name: value for name, value in section_to_mapping(self).items() if value is not None}

    @property
    def robot(self) -> RobotConfig | None:
        """The robot that the samples were recorded with, None if the settings name none.

        Raises:
            ConfigError: If its settings are not those of a robot.
        """
        mapping = self._sections.get("robot")
        return None if mapping is None else self._read_section(RobotConfig, mapping)

    @property
    def sensor(self) -> SensorConfig:
        """What varied of the robot's camera from episode to episode; nothing if the settings do not say.

        Raises:
            ConfigError: If its settings are not those of a sensor.
        """
        renderer = self._sections.get("renderer", {})
        return self._read_section(SensorConfig, renderer.get("sensor", {}))

    def _read_section(self, cls: type[Part], mapping: Mapping[str, Any]) -> Part:
        try:
            return section_from_mapping(cls, mapping)
        except ConfigError as error:
            raise ConfigError(
                f"The settings that readygo {self.readygo_version or '(unknown)'} recorded with the data are none of "
                f"this version: {error} Record the data again, or read them with that version."
            ) from error

    @property
    def _sections(self) -> dict[str, Any]:
        try:
            sections = dict(self.config or {})
            if not isinstance(sections.get("renderer", {}), Mapping):
                raise TypeError("renderer")
            return sections
        except (AttributeError, LookupError, TypeError) as error:
            raise ConfigError(f"The recorded settings are none ({error!r}).") from error

    @property
    def depth(self) -> str:
        """What images of depth hold: "median" (the default) or "mean"; see `RendererConfig.depth`."""
        return str(self._sections.get("renderer", {}).get("depth", "median"))


def _part(cls: type[Part], mapping: Mapping[str, Any]) -> Part:
    """A dataclass of the entries of a mapping that it has fields for."""
    if not isinstance(mapping, Mapping):
        raise TypeError(f"{cls.__name__} is {mapping!r}")
    names = [entry.name for entry in dataclasses.fields(cls)]  # type: ignore[arg-type]
    return cls(**{name: mapping[name] for name in names if name in mapping})


def provenance_to_strings(provenance: Provenance) -> dict[str, str]:
    """A provenance as MCAP's mapping of strings, keys in order.

    Raises:
        DatasetError: If a value cannot be written as JSON.
    """
    try:
        return {
            key: json.dumps(value, sort_keys=True, allow_nan=False)
            for key, value in sorted({**provenance.to_mapping(), "format": FORMAT}.items())
        }
    except (TypeError, ValueError) as error:
        raise DatasetError(f"Shard metadata must be plain values: {error}.") from error


def provenance_from_strings(strings: Mapping[str, str]) -> Provenance:
    """The provenance that `provenance_to_strings` wrote.

    Raises:
        DatasetError: If it is of another format.
    """
    try:
        mapping = {key: parse_json(value) for key, value in strings.items()}
    except ValueError as error:
        raise DatasetError(f"the metadata cannot be read: {error}") from error
    if mapping.get("format") != FORMAT:
        raise DatasetError(f"this is no {FORMAT} file")
    return Provenance.from_mapping(mapping)
