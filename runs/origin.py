"""Origin of a policy's data, in `[training.data]` of its policy.toml: the defaults of evaluations."""

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.avatars import load_avatars
from readygo.common.avatars.cast import TEST, TEST_MIN, TRAIN, TRAIN_MIN, members, split_cast, with_cast
from readygo.common.avatars.file import avatar_hash
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.dataset import Dataset
from readygo.common.dataset.provenance import Provenance
from readygo.common.errors import ConfigError, PolicyError, RunError
from readygo.common.messages import RunSpec
from readygo.common.perception import PerceptionSpec
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.runs.config import RunConfig, merge_sections
from readygo.runs.folder import RunFolder
from readygo.services.renderer import RendererConfig

KEY = "data"
"""Key of the origin in `PolicySpec.training`."""
_RENDERED = ("detail", "contact_shadow", "feet_on_floor", "human_light", "human_look", "sub_frames", "depth")
"""Settings of the renderer that affect camera images; the policy's spec has the sensor."""
_HUMANS = ("episode", "human_planner")
"""Sections that a scenario mix replaces."""
_OF_DATA_ONLY = {"human_planner": ("absent", "absent_first")}
"""Settings by section that shape data, but not the tasks of an evaluation."""


@dataclass(frozen=True, kw_only=True)
class DataOrigin:
    """Origin of a policy's data, besides robot and sensor, which are in its spec."""

    scenes: Mapping[str, str] = field(default_factory=dict)
    """Name of each scene by its content hash."""
    avatars_path: str = ""
    """Folder or file of the avatars; empty for the embedded ones, or if unknown."""
    avatars: Mapping[str, str] = field(default_factory=dict)
    """Content hash by avatar name; empty for data without humans."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings by section that an evaluation shares with the data."""


def origin_of_runs(specs: Iterable[RunSpec]) -> DataOrigin:
    """The origin of some runs' data; settings are those that all share, the path of the avatars is the first run's."""
    runs = list(specs)
    return _origin([Provenance.of_run(spec) for spec in runs], runs[0].avatars_path)


def origin_of_data(folders: Iterable[Path]) -> DataOrigin:
    """The origin of recorded data; settings are those that all share, the path of the avatars is the first folder's.

    Raises:
        DatasetError: If the data cannot be read.
    """
    places = list(folders)
    try:
        avatars_path = RunFolder(places[0]).load()[0].avatars_path
    except RunError:
        # The folder has only shards, without the run's state.
        avatars_path = ""
    return _origin([Dataset(place).provenance for place in places], avatars_path)


def origin_of_policy(spec: PolicySpec) -> DataOrigin | None:
    """The origin of the data in a policy's spec; None if the spec has none.

    Raises:
        PolicyError: If the entry is invalid.
    """
    return _read_origin(spec.training, "the policy's policy.toml")


def origin_of_perception(spec: PerceptionSpec) -> DataOrigin | None:
    """The origin of the data in the spec of a network that perceives; None if the spec has none.

    Raises:
        PolicyError: If the entry is invalid.
    """
    return _read_origin(spec.training, "the network's perception.toml")


def with_origin(spec: PolicySpec, origin: DataOrigin) -> PolicySpec:
    """A policy's spec with the origin of its data."""
    return dataclasses.replace(spec, training={**spec.training, KEY: section_to_mapping(origin)})


def note_origin(folder: Path, origin: DataOrigin) -> None:
    """Write the origin of the data into a policy's folder.

    Raises:
        PolicyError: If there is no policy, or the file cannot be written.
    """
    save_spec(with_origin(load_spec(folder), origin), folder)


def robot_of_policy(spec: PolicySpec) -> RunConfig:
    """The settings of a run with the robot, camera and sensor of a policy's training."""
    return RunConfig(robot=spec.robot, renderer=RendererConfig(sensor=spec.sensor))


def settings_of_policy(spec: PolicySpec, *, humans: bool = True) -> RunConfig:
    """The settings of a policy's data, including robot and sensor; the defaults for missing ones.

    Args:
        spec: Spec of the policy.
        humans: False leaves out the settings of humans and episodes.

    Raises:
        PolicyError: If the settings are invalid.
    """
    origin = origin_of_policy(spec)
    if origin is None:
        return robot_of_policy(spec)
    sections = {name: keys for name, keys in origin.settings.items() if humans or name not in _HUMANS}
    try:
        return merge_sections(robot_of_policy(spec), sections)
    except ConfigError as error:
        raise PolicyError(f"The settings of the policy's data cannot be used: {error}") from error


def avatars_of_policy(spec: PolicySpec) -> Path | None:
    """Path of the unchanged avatars of a policy's data; None for the embedded ones, also if the policy names none.

    If the data use a part of the avatars, the path names the part, as in `readygo.common.avatars.cast`.

    Raises:
        PolicyError: If the avatars have moved or changed.
    """
    origin = origin_of_policy(spec)
    if origin is None or not origin.avatars:
        return None
    place = Path(origin.avatars_path) if origin.avatars_path else None
    if place is not None and not place.exists():
        raise PolicyError(f"The avatars of the policy's data are not at {place} any more; name them with --avatars.")
    found = {name: avatar_hash(avatar) for name, avatar in load_avatars(place).items()}
    for cast in (TRAIN, TEST) if len(found) >= TRAIN_MIN + TEST_MIN else ():
        if members(found, cast) == origin.avatars:
            return with_cast(place, cast)
    different = sorted(name for name in {*found, *origin.avatars} if found.get(name) != origin.avatars.get(name))
    if different:
        raise PolicyError(
            f"The avatars of the policy's data are not those in {place or 'readygo'} any more "
            f"({different[0]!r} differs); name them with --avatars."
        )
    return place


def unseen_avatars(spec: PolicySpec) -> Path | None:
    """The test part of the avatars if a policy's data use the training part, else as `avatars_of_policy`."""
    place, cast = split_cast(avatars_of_policy(spec))
    return with_cast(place, TEST) if cast == TRAIN else place


def check_unseen(spec: PolicySpec, run: RunSpec, unseen: Collection[str]) -> None:
    """Check that an evaluation uses avatars or scenes that a policy's data do not contain.

    Args:
        spec: Spec of the policy.
        run: Spec of the evaluation.
        unseen: What must be new to the policy: "avatars", "scenes".

    Raises:
        PolicyError: If something is not new, the origin is unknown, or there are too few avatars.
    """
    if not unseen:
        return
    origin = origin_of_policy(spec)
    if origin is None:
        raise PolicyError("--unseen: the policy does not say what its data were made of; train it again.")
    if "scenes" in unseen and run.scene_hash in origin.scenes:
        raise PolicyError(f"--unseen scenes: the policy learned in this scene ({origin.scenes[run.scene_hash]}).")
    if "avatars" not in unseen:
        return
    known = sorted(name for name, sha256 in run.avatar_hashes.items() if sha256 in origin.avatars.values())
    if known:
        raise PolicyError(
            f"--unseen avatars: {known[0]!r} walked in the policy's data; record with --avatars embedded:train (or "
            "FOLDER:train), and name others here with --avatars."
        )
    if 0 < len(origin.avatars) < TRAIN_MIN or len(run.avatar_hashes) < TEST_MIN:
        raise PolicyError(
            f"--unseen avatars needs {TRAIN_MIN} or more avatars in the policy's data and {TEST_MIN} or more here; "
            f"there are {len(origin.avatars)} and {len(run.avatar_hashes)}."
        )


def _read_origin(training: Mapping[str, Any], where: str) -> DataOrigin | None:
    if KEY not in training:
        return None
    try:
        return section_from_mapping(DataOrigin, training[KEY])
    except (ConfigError, TypeError) as error:
        raise PolicyError(f"[training.{KEY}] of {where} cannot be used: {error}") from error


def _shared(configs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Settings by section that are the same in all runs: data of several scenario mixes have that of none of them."""
    first, *others = configs
    return {
        section: {
            key: value for key, value in keys.items() if all(_value(each, section, key) == value for each in others)
        }
        for section, keys in first.items()
        if isinstance(keys, Mapping)
    }


def _value(config: Mapping[str, Any], section: str, key: str) -> Any:
    return config.get(section, {}).get(key)


def _origin(runs: list[Provenance], avatars_path: str) -> DataOrigin:
    config = _shared([run.config or {} for run in runs])
    renderer = config.get("renderer", {})
    sections = {
        **{name: config[name] for name in (*_HUMANS, "animator") if name in config},
        "renderer": {name: renderer[name] for name in _RENDERED if name in renderer},
    }
    return DataOrigin(
        scenes={run.scene.hash: run.scene.name for run in runs},
        avatars_path=avatars_path,
        avatars=_avatars(runs),
        settings={
            name: {key: value for key, value in keys.items() if key not in _OF_DATA_ONLY.get(name, ())}
            for name, keys in sections.items()
        },
    )


def _avatars(runs: Sequence[Provenance]) -> dict[str, str]:
    """Content hash by avatar name; different avatars of one name have a part of the hash in their names."""
    found: dict[str, str] = {}
    for name, avatar in (pair for run in runs for pair in run.avatars.items()):
        unique = name if found.get(name, avatar.hash) == avatar.hash else f"{name} {avatar.hash[:12]}"
        found[unique] = avatar.hash
    return found
