"""What a policy's data were made of: its policy.toml says so in `[training.data]`, and evaluations take it up."""

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.apps.run.config import RENDERED_BEFORE, RunConfig, merged
from readygo.apps.run.folder import RunFolder
from readygo.common.avatars import load_avatars
from readygo.common.avatars.cast import TEST, TEST_MIN, TRAIN, TRAIN_MIN, members, split_cast, with_cast
from readygo.common.avatars.file import avatar_hash
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.dataset import Dataset
from readygo.common.dataset.provenance import Provenance
from readygo.common.errors import ConfigError, PolicyError, RunError
from readygo.common.messages import RunSpec
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.services.renderer import RendererConfig

KEY = "data"
"""Of `PolicySpec.training`."""
_RENDERED = ("detail", "contact_shadow", "feet_on_floor", "human_light", "human_look", "sub_frames", "depth")
"""Settings of the renderer that change what a robot sees; the sensor is the policy's own to say."""
_HUMANS = ("episode", "human_planner")
"""Sections that a recipe of humans takes the place of."""
_OF_DATA_ONLY = {"human_planner": ("absent", "absent_first")}
"""Settings of a section that shape data, but not the tasks that a policy is tried in."""


@dataclass(frozen=True, kw_only=True)
class DataOrigin:
    """Where a policy's data come from, beside the robot and the sensor that it names itself."""

    scenes: Mapping[str, str] = field(default_factory=dict)
    """Name of each scene by its content hash."""
    avatars_path: str = ""
    """Folder or file of the avatars; empty for the embedded ones, or where it is not known."""
    avatars: Mapping[str, str] = field(default_factory=dict)
    """Content hash by avatar name; empty where nobody walked."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings by section that an evaluation shares with the data."""


def origin_of_runs(specs: Iterable[RunSpec]) -> DataOrigin:
    """The origin of what some runs record; settings and the place of the avatars are the first one's."""
    runs = list(specs)
    return _origin([Provenance.of_run(spec) for spec in runs], runs[0].avatars_path)


def origin_of_data(folders: Iterable[Path]) -> DataOrigin:
    """The origin of recorded data; settings and the place of the avatars are those of the first folder.

    Raises:
        DatasetError: If the data cannot be read.
    """
    places = list(folders)
    try:
        avatars_path = RunFolder(places[0]).load()[0].avatars_path
    except RunError:
        # Shards alone, without the run's own files.
        avatars_path = ""
    return _origin([Dataset(place).provenance for place in places], avatars_path)


def origin_of_policy(spec: PolicySpec) -> DataOrigin | None:
    """What a policy says of its data; None where it says nothing.

    Raises:
        PolicyError: If that is not understood.
    """
    if KEY not in spec.training:
        return None
    try:
        return section_from_mapping(DataOrigin, spec.training[KEY])
    except (ConfigError, TypeError) as error:
        raise PolicyError(f"[training.{KEY}] of the policy's policy.toml cannot be used: {error}") from error


def with_origin(spec: PolicySpec, origin: DataOrigin) -> PolicySpec:
    """A policy that says what its data were made of."""
    return dataclasses.replace(spec, training={**spec.training, KEY: section_to_mapping(origin)})


def note_origin(folder: Path, origin: DataOrigin) -> None:
    """Write into a policy's folder what its data were made of.

    Raises:
        PolicyError: If there is no policy, or it cannot be written.
    """
    save_spec(with_origin(load_spec(folder), origin), folder)


def robot_of_policy(spec: PolicySpec) -> RunConfig:
    """The settings of a run whose robot, camera and sensor are those that a policy was trained with."""
    return RunConfig(robot=spec.robot, renderer=RendererConfig(sensor=spec.sensor))


def settings_of_policy(spec: PolicySpec, *, humans: bool = True) -> RunConfig:
    """The settings of a policy's data, robot and sensor included; the defaults where it does not name them.

    Args:
        spec: What the policy says of itself.
        humans: False leaves out who comes and how they meet the robot.

    Raises:
        PolicyError: If they are not understood.
    """
    origin = origin_of_policy(spec)
    if origin is None:
        return robot_of_policy(spec)
    sections = {name: keys for name, keys in origin.settings.items() if humans or name not in _HUMANS}
    sections["renderer"] = {**RENDERED_BEFORE, **sections.get("renderer", {})}
    try:
        return merged(robot_of_policy(spec), sections)
    except ConfigError as error:
        raise PolicyError(f"The settings of the policy's data cannot be used: {error}") from error


def avatars_of_policy(spec: PolicySpec) -> Path | None:
    """Where the avatars of a policy's data are, unchanged; None for the embedded ones, also where it names none.

    Where they are a cast of those that are there, the cast is named: see `readygo.common.avatars.cast`.

    Raises:
        PolicyError: If they have moved or changed.
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
    """The cast of tests where a policy's data have that of training, else what `avatars_of_policy` answers."""
    place, cast = split_cast(avatars_of_policy(spec))
    return with_cast(place, TEST) if cast == TRAIN else place


def check_unseen(spec: PolicySpec, run: RunSpec, unseen: Collection[str]) -> None:
    """See whether a policy is tried among what its data do not have.

    Args:
        spec: What the policy says of itself.
        run: Where it is tried.
        unseen: Of "avatars" and "scenes", what must be new to it.

    Raises:
        PolicyError: If something is not, it cannot be told, or there are too few avatars for it to say anything.
    """
    if not unseen:
        return
    origin = origin_of_policy(spec)
    if origin is None:
        raise PolicyError("--unseen: the policy does not say what its data were made of; train it anew.")
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


def _origin(runs: list[Provenance], avatars_path: str) -> DataOrigin:
    config = runs[0].config or {}
    renderer = config.get("renderer", {})
    sections = {
        **{name: config[name] for name in (*_HUMANS, "animator") if name in config},
        "renderer": {name: renderer[name] for name in _RENDERED if name in renderer},
    }
    return DataOrigin(
        scenes={run.scene.hash: run.scene.name for run in runs},
        avatars_path=avatars_path,
        avatars={name: avatar.hash for run in runs for name, avatar in run.avatars.items()},
        settings={
            name: {key: value for key, value in keys.items() if key not in _OF_DATA_ONLY.get(name, ())}
            for name, keys in sections.items()
        },
    )
