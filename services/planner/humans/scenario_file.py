"""Scenario files: starts, goals and humans as TOML, written by hand or exported from episodes.

    format = "readygo-scenarios/1"

    [[scenarios]]
    start_m = [0.5, 1.0]
    goal_m = [4.0, 1.0]

    [[scenarios.humans]]
    waypoints_m = [[4.0, 2.0], [2.0, 1.0], [0.5, 2.0]]
    pauses_s = [0.0, 2.0, 0.0]
    speed_mps = 1.1

A human with `trajectory_m` (a position every 0.05 s) instead of waypoints walks exactly there.
"""

import dataclasses
import hashlib
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.config import section_from_mapping
from readygo.common.documents import TOML_BYTES_MAX, parse_toml
from readygo.common.errors import ConfigError
from readygo.common.files import read_regular, write_whole
from readygo.common.messages import HumanTrajectory, Scenario
from readygo.common.robot.kinematics import DT_S

FORMAT = "readygo-scenarios/1"
HUMANS_MAX = 8
SPEED_MAX_MPS = 3.5
STEP_MAX_MPS = 5.0
"""People who move faster between two rows of a trajectory cannot be animated [m/s]."""
SCRIPTED = "scripted"
"""Encounter of humans whose file names no other."""

Point = tuple[float, ...]
Section = TypeVar("Section")


@dataclass(frozen=True, kw_only=True)
class ScriptedHuman:
    """One human of a scenario file."""

    waypoints_m: tuple[tuple[float, ...], ...] = ()
    """Where they walk, around obstacles; a single one: they stand there. World x, y [m]."""
    pauses_s: tuple[float, ...] = ()
    """How long they stop at each waypoint [s]; the first delays the start, the last is meaningless."""
    speed_mps: float = 1.2
    avatar: str = ""
    """Name of the avatar; empty lets the run choose."""
    encounter: str = SCRIPTED
    trajectory_m: tuple[tuple[float, ...], ...] = ()
    """Instead of waypoints: the exact position every 0.05 s [m]."""

    def __post_init__(self) -> None:
        if bool(self.waypoints_m) == bool(self.trajectory_m):
            raise ValueError("give either waypoints_m or trajectory_m.")
        for name in ("waypoints_m", "trajectory_m"):
            for row, point in enumerate(getattr(self, name)):
                _check_point(f"{name}[{row}]", point)
        if self.pauses_s and len(self.pauses_s) != len(self.waypoints_m):
            raise ValueError(f"pauses_s needs one value per waypoint ({len(self.waypoints_m)}).")
        if not all(0 <= pause < 1000 for pause in self.pauses_s):
            raise ValueError(f"pauses_s must be 0..1000 s, got {list(self.pauses_s)}.")
        # A trajectory has its speed in its rows; there the number only describes it.
        least = 0.0 if self.trajectory_m else 0.05
        if not least <= self.speed_mps <= SPEED_MAX_MPS:
            raise ValueError(f"speed_mps must be {least:g}..{SPEED_MAX_MPS:g} m/s, got {self.speed_mps:g}.")
        self._check_steps()

    def _check_steps(self) -> None:
        for row, (a, b) in enumerate(zip(self.trajectory_m[:-1], self.trajectory_m[1:], strict=True)):
            speed = math.dist(a, b) / DT_S
            if speed > STEP_MAX_MPS:
                raise ValueError(
                    f"trajectory_m jumps at {speed:.1f} m/s after row {row}; rows are {DT_S:g} s apart, people move "
                    f"at most {STEP_MAX_MPS:g} m/s."
                )

    @property
    def xy_m(self) -> Float64Array:
        """The rows of `trajectory_m`, shape (T, 2)."""
        return np.array(self.trajectory_m, np.float64).reshape(-1, 2)


@dataclass(frozen=True, kw_only=True)
class ScriptedScenario:
    """One entry of a scenario file."""

    start_m: tuple[float, ...]
    goal_m: tuple[float, ...]
    yaw_rad: float | None = None
    """Where the robot looks at the start; without it, at the goal."""
    name: str = ""
    """Name in error messages; has no other use."""
    humans: tuple[ScriptedHuman, ...] = ()

    def __post_init__(self) -> None:
        _check_point("start_m", self.start_m)
        _check_point("goal_m", self.goal_m)
        if self.yaw_rad is not None and not math.isfinite(self.yaw_rad):
            raise ValueError(f"yaw_rad must be finite, got {self.yaw_rad}.")
        if len(self.humans) > HUMANS_MAX:
            raise ValueError(f"at most {HUMANS_MAX} humans, got {len(self.humans)}.")
        if self.start_m == self.goal_m:
            raise ValueError("start_m and goal_m must differ.")


@dataclass(frozen=True, kw_only=True)
class ScenarioFile:
    """The entries of a file. Episode k plays entry k modulo their number."""

    source: str
    """Name of the file, for error messages."""
    entries: tuple[ScriptedScenario, ...]

    def where(self, number: int) -> str:
        """How messages call an entry."""
        name = self.entries[number].name
        return f"{self.source}, scenarios[{number}]" + (f" {name!r}" if name else "")


def load_scenarios(path: Path) -> ScenarioFile:
    """Read a scenario file; whether its places are free only a map can tell, see `HumanPlanner`.

    Raises:
        ConfigError: If it cannot be read, or an entry is wrong.
    """
    return parse_scenarios(read_text(path), path.name)


def read_text(path: Path) -> str:
    """The text of a scenario file.

    Raises:
        ConfigError: If there is none.
    """
    try:
        # Ends of lines count nothing in the text's digest.
        return io.StringIO(read_regular(path, bytes_max=TOML_BYTES_MAX).decode(), newline=None).read()
    except UnicodeDecodeError as error:
        raise ConfigError(f"Scenario file {path} cannot be read: it is no text.") from error
    except OSError as error:
        raise ConfigError(f"Scenario file {path} cannot be read: {error.strerror}.") from error


def text_hash(text: str) -> str:
    """Digest of a scenario file's text, which runs are identified by."""
    return hashlib.sha256(text.encode()).hexdigest()


def parse_scenarios(text: str, source: str) -> ScenarioFile:
    """The entries of a scenario file's text.

    Args:
        text: TOML.
        source: Name of the file, for error messages.

    Raises:
        ConfigError: If an entry is wrong; the message names file and entry.
    """
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise ConfigError(f"Scenario file {source} is no TOML: {error}.") from error
    if data.get("format") != FORMAT:
        raise ConfigError(f"Scenario file {source} must begin with format = {FORMAT!r}, got {data.get('format')!r}.")
    unknown = sorted(set(data) - {"format", "scenarios"})
    if unknown:
        raise ConfigError(f"{source}: unknown key {unknown[0]!r}; known keys: format, scenarios.")
    rows = data.get("scenarios", [])
    if not isinstance(rows, list) or not rows:
        raise ConfigError(f"{source} has no [[scenarios]].")
    return ScenarioFile(source=source, entries=tuple(_parse_entry(row, source, k) for k, row in enumerate(rows)))


def _parse_entry(row: Any, source: str, number: int) -> ScriptedScenario:
    where = f"{source}, scenarios[{number}]"
    if not isinstance(row, Mapping):
        raise ConfigError(f"{where} must be a table.")
    humans = row.get("humans", [])
    if not isinstance(humans, list):
        raise ConfigError(f"{where}.humans must be an array of tables.")
    scripted = tuple(_section(ScriptedHuman, human, f"{where}.humans[{k}]") for k, human in enumerate(humans))
    entry = _section(ScriptedScenario, {key: value for key, value in row.items() if key != "humans"}, where)
    try:
        return dataclasses.replace(entry, humans=scripted)
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error


def _section(cls: type[Section], mapping: Any, where: str) -> Section:
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"{where} must be a table, got {mapping!r}.")
    missing = sorted(
        field.name
        for field in dataclasses.fields(cls)  # type: ignore[arg-type]
        if field.default is dataclasses.MISSING and field.name not in mapping
    )
    if missing:
        raise ConfigError(f"{where} lacks {missing[0]}.")
    return section_from_mapping(cls, mapping, where=f"{where}.")


def _check_point(name: str, point: Point) -> None:
    if len(point) != 2 or not all(math.isfinite(value) and abs(value) < 1e6 for value in point):
        raise ValueError(f"{name} must be two finite numbers [x, y] in metres, got {list(point)}.")


def save_scenarios(path: Path, scenarios: Sequence[Scenario]) -> None:
    """Write scenarios so that the file gives the same starts, goals and trajectories again, bit by bit.

    Args:
        path: Where to; is there whole or not at all.
        scenarios: Drawn or scripted ones.

    Raises:
        ConfigError: If there is no scenario, or the file cannot be written.
    """
    if not scenarios:
        raise ConfigError(f"There is no scenario to write into {path}.")
    text = "\n".join([f'format = "{FORMAT}"', "", *(_scenario_toml(scenario) for scenario in scenarios)])
    write_whole(path, text, raises=ConfigError)


def _scenario_toml(scenario: Scenario) -> str:
    x, y, yaw = scenario.start_xyyaw.tolist()
    lines = [
        "[[scenarios]]",
        f"name = {json.dumps(scenario.episode.episode_id)}",
        f"start_m = [{x!r}, {y!r}]",
        f"yaw_rad = {yaw!r}",
        f"goal_m = {scenario.goal_xy_m.tolist()!r}",
        "",
    ]
    for human in scenario.humans:
        lines += _human_toml(human)
    return "\n".join(lines)


def _human_toml(human: HumanTrajectory) -> list[str]:
    rows = ",\n".join(f"  {row!r}" for row in human.xy_m.tolist())
    return [
        "[[scenarios.humans]]",
        f"avatar = {json.dumps(human.avatar, ensure_ascii=False)}",
        f"encounter = {json.dumps(human.encounter, ensure_ascii=False)}",
        f"speed_mps = {float(human.speed_mps)!r}",
        f"trajectory_m = [\n{rows},\n]",
        "",
    ]
