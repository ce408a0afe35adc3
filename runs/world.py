"""Builds the services' objects from a run's spec."""

import dataclasses
import os
import shutil
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path

from readygo.common.avatars import Avatar, load_avatars
from readygo.common.avatars.file import avatar_hash, avatar_paths
from readygo.common.bus import Bus
from readygo.common.dataset.provenance import Provenance
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import RunError, SceneError
from readygo.common.files import cache_folder
from readygo.common.fleet.blobs import fetch_file, is_whole
from readygo.common.messages import FileRef, PolicyRef, RunSpec, TeacherKind, TeacherRef, files_digest
from readygo.common.policy import Policy, load_policy
from readygo.common.scenes import Scene, load_scene
from readygo.common.state_policy.state_policy import StatePolicy, load_state_policy
from readygo.runs.config import config_of
from readygo.runs.policy import file_ref
from readygo.services.animator import Animator
from readygo.services.planner import HumanPlanner, RobotPlanner, ScenarioFile, parse_scenarios
from readygo.services.renderer import Renderer

POLICIES_MAX = 2
"""Number of policies in memory: drivers take the newest one, and never return to an older one."""
POLICIES_CACHED = 8
"""Number of fetched policies in this machine's cache, for all its runs."""

_SHARED: dict[str, Avatar] = {}
"""The embedded avatars, in a process whose forked children share them."""


def share_embedded_avatars() -> None:
    """Load the embedded avatars once for all processes that will be forked from this one."""
    _SHARED.update(load_avatars())


class World:
    """Scene, avatars and configuration of a run, loaded when they are first needed."""

    def __init__(self, spec: RunSpec, bus: Bus | None = None) -> None:
        self.spec = spec
        self.config = config_of(spec)
        self._bus = bus
        self._policies: dict[PolicyRef, Policy] = {}

    @cached_property
    def scene(self) -> Scene:
        """The scene of the spec: at its path if it is there, else fetched from the run.

        Raises:
            RunError: If the scene at the path is not the run's, or a fetched file does not match its hash.
        """
        path = Path(self.spec.scene_path)
        if self._bus is not None and not _is_scene(path, self.spec.scene_hash):
            # On another machine the path may hold a different scene.
            path = _fetch_files(self._bus, self.spec.scene_files, "scenes", self.spec.scene_hash)
        scene = load_scene(path)
        if scene.content_hash != self.spec.scene_hash:
            raise RunError(f"Scene {scene.path} has changed since the run began; import it under another name.")
        return scene

    @cached_property
    def avatars(self) -> dict[str, Avatar]:
        """The avatars of the run, by name: at their path if they are there, else fetched from the run.

        Raises:
            RunError: If they cannot be fetched, or differ from the run's.
        """
        place, files = Path(self.spec.avatars_path) if self.spec.avatars_path else None, self.spec.avatar_files
        if self._bus is not None and place is not None and files and not _are_whole(files, _avatar_files(place)):
            place = _fetch_files(self._bus, files, "avatars", files_digest(files))
        avatars = load_avatars(place) if place or not _SHARED else _SHARED
        missing = sorted(set(self.spec.avatar_hashes) - set(avatars))
        if missing:
            raise RunError(
                f"Avatar {missing[0]!r} of the run is not in {self.spec.avatars_path or 'the embedded ones'}."
            )
        for name, expected in self.spec.avatar_hashes.items():
            if avatar_hash(avatars[name]) != expected:
                raise RunError(f"Avatar {name!r} has changed since the run began.")
        return {name: avatars[name] for name in self.spec.avatar_hashes}

    def forget_avatars(self) -> None:
        """Release the avatars, 14 MB each, once their users hold them; they are loaded again on demand."""
        self.__dict__.pop("avatars", None)

    def human_planner(self, *, react: bool = True) -> HumanPlanner:
        """The human planner; an expert drives in it only if the humans react to one.

        Args:
            react: False plans only the humans' intended paths, for callers in which they react to another driver.
        """
        config = self.config
        humans = config.human_planner if react else dataclasses.replace(config.human_planner, reactive=False)
        return HumanPlanner(
            self.scene.maps,
            sorted(self.spec.avatar_hashes),
            config.robot,
            config.episode,
            humans,
            scenarios=self._scenarios(),
            make_expert=self.robot_planner.expert if humans.reactive else None,
        )

    @cached_property
    def robot_planner(self) -> RobotPlanner:
        """The robot expert."""
        config = self.config
        avatars = self.avatars if config.expert.needs_avatars else {}
        return RobotPlanner(self.scene.maps, avatars, config.robot, config.episode, config.expert)

    def _scenarios(self) -> ScenarioFile | None:
        """The scenarios that the run plays, if it does not draw them."""
        recorded = Provenance.of_run(self.spec).scenarios
        name = recorded.name if recorded else "the run's scenarios"
        return parse_scenarios(self.spec.scenarios, name) if self.spec.scenarios else None

    def animator(self) -> Animator:
        """The animator."""
        maps, config = self.scene.maps, self.config
        rate_hz = config.robot.clock.rate_hz
        return Animator(self.avatars, maps.floor, config.animator, obstacles=maps.human, rate_hz=rate_hz)

    def policy(self, ref: PolicyRef) -> Policy:
        """A policy that drives in the run: at its path if it is there, else fetched from the run.

        The last `POLICIES_MAX` policies stay in memory.

        Raises:
            RunError: If the policy at the path is not the run's.
            PolicyError: If it cannot be used.
        """
        if ref not in self._policies:
            while len(self._policies) >= POLICIES_MAX:
                self._policies.pop(next(iter(self._policies)))
            self._policies[ref] = self._load_policy(ref)
        return self._policies[ref]

    def _load_policy(self, ref: PolicyRef) -> Policy:
        folder = self._policy_folder(ref, "policies")
        policy = load_policy(folder)
        _check_unchanged("Policy", folder, ref.files)
        return policy

    @cached_property
    def teacher(self) -> StatePolicy | None:
        """The state policy that teaches: at its path if it is there, else fetched from the run; None if none does.

        Raises:
            RunError: If the policy at the path is not the run's.
            PolicyError: If it cannot be used.
        """
        ref = self.spec.teacher
        if ref is None or ref.kind is not TeacherKind.STATE_POLICY:
            return None
        folder = self._policy_folder(ref, "teachers")
        teacher = load_state_policy(folder)
        _check_unchanged("Teacher", folder, ref.files)
        return teacher

    def _policy_folder(self, ref: PolicyRef | TeacherRef, kind: str) -> Path:
        """The folder with the files of a policy: its path, or one in this machine's cache for files of a kind."""
        folder = Path(ref.path)
        here = ref.path and _are_whole(ref.files, {file.path: folder / file.path for file in ref.files})
        if not here and self._bus is not None:
            folder = _fetch_files(self._bus, ref.files, kind, ref.sha256)
            _keep_latest(folder)
        return folder

    def stage(self) -> Scenery:
        """The surroundings that viewers show with the run's samples; without the map if the scene is not here."""
        here = Path(self.spec.scene_path).is_dir()
        return Scenery(robot=self.config.robot, maps=self.scene.maps if here else None)

    def renderer(self) -> Renderer:
        """The renderer."""
        config = self.config
        return Renderer(scene=self.scene, avatars=self.avatars, robot=config.robot, config=config.renderer)


def _check_unchanged(what: str, folder: Path, files: tuple[FileRef, ...]) -> None:
    """Raise RunError unless the files of a policy are those that the run began with."""
    if tuple(file_ref(folder, file.path) for file in files) != files:
        raise RunError(f"{what} {folder} has changed since the run began; record into a new folder with --out.")


def _keep_latest(folder: Path) -> None:
    """Mark a policy of the cache as used now, and remove the least recently used ones."""
    os.utime(folder)
    for other in sorted(folder.parent.iterdir(), key=_used_s)[:-POLICIES_CACHED]:
        shutil.rmtree(other, ignore_errors=True)


def _used_s(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except FileNotFoundError:
        # Another process has removed it.
        return 0.0


def _is_scene(path: Path, content_hash: str) -> bool:
    """True if the path holds a scene bundle with this content hash."""
    try:
        return load_scene(path).content_hash == content_hash
    except SceneError:
        return False


def _avatar_files(place: Path) -> dict[str, Path]:
    """The avatar files at a path, by name; empty if there are none."""
    return {path.name: path for path in avatar_paths(place)} if place.exists() else {}


def _are_whole(files: Iterable[FileRef], paths: Mapping[str, Path]) -> bool:
    """True if each file at its path matches its hash."""
    return all(file.path in paths and is_whole(paths[file.path], file) for file in files)


def _fetch_files(bus: Bus, files: Iterable[FileRef], kind: str, name: str) -> Path:
    """A folder in this machine's cache with the files, each checked by its hash."""
    cache = cache_folder(kind).resolve()
    folder = (cache / name).resolve()
    for file in files:
        path = (folder / file.path).resolve()
        # Messages were validated before; check the paths again where files are written.
        if folder.parent != cache or folder not in path.parents:
            raise RunError(f"The run names a file outside of its bundle: {file.path!r} of {name!r}.")
        fetch_file(bus, file, path)
    return folder
