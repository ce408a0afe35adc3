"""Suites of the benchmark: scenes by content hash, robot, people and cells of equal episodes, as versioned TOML.

    format = "readygo-suite/1"
    name = "lobby/1"
    episodes = 100
    paper_cell = "pedestrians"

    [scenes.lobby]
    scene = "../scenes/lobby"      # from this file; or "embedded:SEED"
    sha256 = "..."
    seed = 0

    [settings.robot]               # sections of settings as for `readygo generate`
    v_max_mps = 0.8

    [cells.pedestrians]
    task = "dynamic"
    words = "two people who ignore the robot"

    [cells.pedestrians.settings.episode]
    human_count_min = 2

A published suite never changes: other episodes are another version.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from readygo.common.avatars.cast import EMBEDDED
from readygo.common.config import section_from_mapping
from readygo.common.documents import TOML_BYTES_MAX, parse_toml
from readygo.common.errors import ConfigError, ReadygoError, SceneError
from readygo.common.files import check_folder_name, read_regular
from readygo.common.messages import Split
from readygo.runs.config import RunConfig, merge_sections
from readygo.runs.evaluation import evaluation_world, make_request
from readygo.runs.world import World
from readygo.services.evaluator import EvaluateRequest

SUITE_FORMAT = "readygo-suite/1"
PEDESTRIAN_NAV = "pedestrian-nav/1"
SUITES = {PEDESTRIAN_NAV: "pedestrian-nav-1.toml"}
"""Suites that come with readygo, by name."""


@dataclass(frozen=True, kw_only=True)
class SuiteScene:
    """One scene of a suite."""

    scene: str
    """"embedded", "embedded:SEED", or the folder of a bundle, from the suite's file."""
    sha256: str
    """Content hash of the scene."""
    seed: int
    """Seed of its episodes, which no other scene of the suite has."""


@dataclass(frozen=True, kw_only=True)
class SuiteCell:
    """Episodes of one difficulty, the same for every driver."""

    task: Literal["static", "dynamic", "reactive"]
    """Task of `readygo evaluate`."""
    words: str
    """Who stands and walks there."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Sections of settings that differ from those of the suite."""


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Which episodes drivers are measured in."""

    format: Literal["readygo-suite/1"]
    name: str
    """Name and version."""
    episodes: int
    """Episodes of a cell, spread evenly over the scenes."""
    scenes: Mapping[str, SuiteScene]
    cells: Mapping[str, SuiteCell]
    paper_cell: str
    """Cell in which the figures of the ReaDy-Go paper are comparable."""
    people: str = "embedded"
    """Avatars: "embedded", a file or folder, or the part train or test of them, as "embedded:test"."""
    people_sha256: Mapping[str, str] = field(default_factory=dict)
    """Content hash of every avatar, by name."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Sections of settings, of robot, camera and episodes."""

    def __post_init__(self) -> None:
        if not self.scenes or not self.cells or self.episodes < len(self.scenes):
            raise ValueError("a suite needs a scene, a cell, and at least one episode in each scene.")
        if self.paper_cell not in self.cells:
            raise ValueError(f"paper_cell {self.paper_cell!r} is none of its cells.")
        if len({scene.seed for scene in self.scenes.values()}) < len(self.scenes):
            raise ValueError("scenes of a suite need different seeds: episodes are told apart by them.")
        for name in (*self.scenes, *self.cells):
            check_folder_name(name)


@dataclass(frozen=True, kw_only=True)
class OpenSuite:
    """A suite that was read from its file."""

    suite: Suite
    text: bytes
    folder: Path
    """Folder that the paths of its scenes and avatars start from."""

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.text).hexdigest()

    @property
    def scene_hashes(self) -> dict[str, str]:
        """Content hash of each scene, by name."""
        return {name: scene.sha256 for name, scene in self.suite.scenes.items()}

    @property
    def places(self) -> list[tuple[str, str]]:
        """All pairs of a cell and a scene, by name."""
        return [(cell, scene) for cell in self.suite.cells for scene in self.suite.scenes]

    def episodes_of(self, scene: str, episodes: int | None = None) -> int:
        """Episodes of a cell in a scene; the first scenes have one more where the number is not even.

        Args:
            scene: Name of the scene.
            episodes: Episodes of the cell; all of them if None.
        """
        total, count = self.suite.episodes if episodes is None else episodes, len(self.suite.scenes)
        return total // count + (list(self.suite.scenes).index(scene) < total % count)

    def world(self, cell: str, scene: str) -> World:
        """Scene, people and settings of a cell.

        Raises:
            ReadygoError: If a scene or an avatar is missing or has another hash than the suite says, or a setting is
                wrong.
        """
        place, people = self.suite.scenes[scene], self._path(self.suite.people)
        avatars, config = None if people == EMBEDDED else Path(people), self.config(cell)
        world = evaluation_world(self._path(place.scene), config, avatars=avatars, seed=place.seed, split=Split.TEST)
        found, wanted = world.spec.avatar_hashes, self.suite.people_sha256
        if world.spec.scene_hash != place.sha256:
            raise SceneError(
                f"Scene {scene} of the suite {self.suite.name} has the hash {place.sha256[:12]}..., but "
                f"{place.scene} has {world.spec.scene_hash[:12]}...: get the scene that the suite was made with."
            )
        if wanted and found != wanted:
            name = min(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))
            raise ConfigError(f"The people of the suite {self.suite.name} are others here: avatar {name!r} differs.")
        return world

    def config(self, cell: str) -> RunConfig:
        """The settings of a cell.

        Raises:
            ConfigError: If a section or key is unknown, or a value wrong.
        """
        try:
            return merge_sections(merge_sections(RunConfig(), self.suite.settings), self.suite.cells[cell].settings)
        except ConfigError as error:
            raise ConfigError(f"Suite {self.suite.name}, cell {cell}: {error}") from error

    def request(self, cell: str, scene: str, drivers: tuple[str, ...], episodes: int | None = None) -> EvaluateRequest:
        """The evaluation of some drivers in a cell; without `episodes`, in all of its episodes.

        Raises:
            RunError: If a driver is named twice.
        """
        count, seed = self.episodes_of(scene, episodes), self.suite.scenes[scene].seed
        return make_request(count, (self.suite.cells[cell].task,), drivers, Split.TEST, seed)

    def _path(self, place: str) -> str:
        """A scene or avatars of the suite, as a command would name it here."""
        return place if place.partition(":")[0] == EMBEDDED else str(self.folder / place)


def open_suite(suite: str) -> OpenSuite:
    """Read a suite by its name, such as "pedestrian-nav/1", or by the path of its file.

    Raises:
        ConfigError: If there is none, or the file describes none.
    """
    if suite in SUITES:
        text, folder = resources.files(__package__).joinpath("suites", SUITES[suite]).read_bytes(), Path()
    elif suite.endswith(".toml"):
        try:
            text, folder = read_regular(suite, bytes_max=TOML_BYTES_MAX), Path(suite).resolve().parent
        except OSError as error:
            raise ConfigError(f"Suite {suite} cannot be read: {error.strerror or error}.") from error
    else:
        raise ConfigError(f"There is no suite {suite!r}; there are {', '.join(SUITES)}, and yours as a .toml file.")
    return parse_suite(text, suite, folder)


def parse_suite(text: bytes, name: str, folder: Path) -> OpenSuite:
    """The suite of a file's content.

    Args:
        text: Content of the file.
        name: Name of the suite, for messages.
        folder: Folder that its paths start from.

    Raises:
        ConfigError: If it describes no suite, or a cell has an unknown or wrong setting.
    """
    try:
        suite = OpenSuite(
            suite=section_from_mapping(Suite, parse_toml(text.decode("utf-8-sig"))), text=text, folder=folder
        )
    except (ValueError, ReadygoError) as error:
        raise ConfigError(f"Suite {name}: {error}") from error
    for cell in suite.suite.cells:
        suite.config(cell)
    return suite
