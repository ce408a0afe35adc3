"""The plan of a sweep, read from a TOML file: which command runs with which options, point by point.

    command = "rl"
    scenes = ["embedded", "embedded:1"]
    seeds = [0, 1, 2]

    [options]                      # of every point, by the names of `readygo rl --help-all`
    decisions = 2_000_000

    [arms.exact]                   # options of one arm, over those above
    noise = "exact"

    [arms.perceived]
    noise = "perceived"

A point is one call of the command: an arm in a scene with a seed. In texts {arm}, {scene} and {seed} stand for its own.
"""

import hashlib
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from readygo.apps.cli import CliCommand, function_of, options_of, read_options
from readygo.apps.options import CommandOptions, Option, describe_options
from readygo.common.config import section_from_mapping
from readygo.common.documents import TOML_BYTES_MAX, parse_toml
from readygo.common.errors import ConfigError, ReadygoError
from readygo.common.files import check_folder_name, read_regular
from readygo.runs.sections import key_text, merge_tables

SWEPT = {
    name: CliCommand(f"readygo.apps.commands.{path}", "")
    for name, path in (
        ("generate", "generate:generate"),
        ("learn", "learn:learn"),
        ("train", "train:train"),
        ("rl", "rl:rl"),
        ("evaluate", "evaluate:evaluate"),
        ("benchmark run", "benchmark:benchmark_run"),
    )
}
"""Commands that a sweep can run: each writes into a folder `--out` and resumes there."""
RESERVED = ("out", "json", "watch", "on", "connect", "listen", "live")
"""Options that a point cannot have: the sweep sets them, or they belong to one run alone."""
SCENE_FIELDS = ("scene", "scenes")
ONLY_ARM = "base"
"""Name of the arm of a sweep that names none."""
POINTS_MAX = 10_000
_BEHIND_SCENE = re.compile(r"[^\w.+-]+")


@dataclass(frozen=True, kw_only=True)
class SweepFile:
    """The keys of a sweep's file."""

    command: str = ""
    """Name of the command, such as "learn" or "benchmark run"."""
    scenes: tuple[Any, ...] = ()
    """Scenes as on the command line; an inner array is one point that has several scenes, for `learn` and `rl`."""
    seeds: tuple[int, ...] = (0,)
    """Seeds, each of which is a point."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of all points, by name, and keys of the configuration in tables."""
    arms: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {ONLY_ARM: {}})
    """Options of each arm, by the arm's name."""

    def __post_init__(self) -> None:
        if not self.command:
            raise ValueError(f'name a command, such as command = "learn"; {_swept()}.')
        if self.command not in SWEPT:
            raise ValueError(f"{self.command!r} cannot be swept; {_swept()}.")
        if not self.arms or not self.seeds:
            raise ValueError("a sweep needs at least one arm and one seed.")
        for name in (*self.arms, *map(scene_name, self.scenes)):
            check_folder_name(name)
        for names, what in (([*map(scene_name, self.scenes)], "scenes"), ([*map(str, self.seeds)], "seeds")):
            if twice := {name for name in names if names.count(name) > 1}:
                raise ValueError(f"two {what} are named {min(twice)}, and would share a folder.")
        if (count := len(self.arms) * max(len(self.scenes), 1) * len(self.seeds)) > POINTS_MAX:
            raise ValueError(f"it has {count} points, more than {POINTS_MAX}.")


@dataclass(frozen=True, kw_only=True)
class SweepPoint:
    """One call of the command."""

    index: int
    """Its number in the plan, from 0."""
    arm: str
    scene: str
    """Name of its scene, as in folders; empty without one."""
    seed: int
    words: tuple[str, ...]
    """Arguments of the command, without --out."""

    @property
    def name(self) -> str:
        """Its folder below that of the sweep: ARM/SCENE/SEED."""
        return "/".join(part for part in (self.arm, self.scene, str(self.seed)) if part)


@dataclass(frozen=True, kw_only=True)
class PointNeeds:
    """What a scheduler reserves for each point."""

    cpus: int = 1
    """Cores."""
    gpus: int = 0


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A sweep that was read from its file."""

    file: SweepFile
    text: bytes

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.text).hexdigest()

    @cached_property
    def kind(self) -> type:
        """Dataclass of the command's options."""
        return options_of(function_of(SWEPT[self.file.command]))

    @cached_property
    def points(self) -> tuple[SweepPoint, ...]:
        """All points: arms, then scenes, then seeds."""
        about = describe_options(self.kind)
        places = itertools.product(self.file.arms, self.file.scenes or ("",), self.file.seeds)
        return tuple(
            SweepPoint(
                index=index,
                arm=arm,
                scene=scene_name(scene),
                seed=seed,
                words=tuple(self._words(about, arm, scene, seed)),
            )
            for index, (arm, scene, seed) in enumerate(places)
        )

    def read(self, point: SweepPoint) -> Any:
        """The options of a point, as the command reads them.

        Raises:
            ConfigError: If an option is unknown or has a wrong value.
        """
        try:
            return read_options(self.kind, [*point.words, "--out", "out"], prog=f"readygo {self.file.command}")
        except ReadygoError as error:
            raise ConfigError(f"arm {point.arm}: {error}") from error

    def arguments(self, point: SweepPoint, out: Path) -> list[str]:
        """Arguments of `readygo` that run a point into a folder."""
        told = ["--json"] if any(option.field == "json" for option in describe_options(self.kind).options) else []
        return [*self.file.command.split(), *point.words, "--out", str(out), *told]

    def _words(self, about: CommandOptions, arm: str, scene: Any, seed: int) -> Iterator[str]:
        known = {_key(option): option for option in about.options}
        given = merge_tables(_with_underscores(self.file.options), _with_underscores(self.file.arms[arm]))
        for name in RESERVED:
            if name in given:
                raise ConfigError(f"arm {arm}: the option {name} is none of a sweep's points; leave it out.")
        place = next((name for name in SCENE_FIELDS if name in known and not known[name].flag.startswith("-")), None)
        own = {"seed": seed} if "seed" in known else {}
        if place and place not in given:
            if not scene:
                raise ConfigError(f'{self.file.command} needs a scene: give scenes = ["embedded"].')
            own[place] = scene
        filled = _fill({**own, **given}, {"{arm}": arm, "{scene}": scene_name(scene), "{seed}": str(seed)})
        positional = [name for name, option in known.items() if not option.flag.startswith("-")]
        for name in positional:
            yield from map(key_text, _items(filled.get(name, ())))
        for name, value in filled.items():
            if name not in positional:
                yield from _typed_option(known.get(name), name, value)


def open_sweep(path: Path) -> Sweep:
    """Read a sweep from its file, and check the options of its arms.

    Raises:
        ConfigError: If the file cannot be read, or describes no sweep.
    """
    try:
        text = read_regular(path, bytes_max=TOML_BYTES_MAX)
        sweep = Sweep(file=section_from_mapping(SweepFile, parse_toml(text.decode())), text=text)
        _check(sweep)
    except OSError as error:
        raise ConfigError(f"Sweep {path} cannot be read: {error.strerror or error}.") from error
    except (ValueError, ReadygoError) as error:
        raise ConfigError(f"Sweep {path}: {str(error).removeprefix('SweepFile: ')}") from error
    return sweep


def scene_name(scene: Any) -> str:
    """Name of a scene's folder: "embedded:1" becomes "embedded-1", several scenes are joined by "+"."""
    names = (Path(str(each)).name if "/" in str(each) else str(each) for each in _items(scene))
    return "+".join(_BEHIND_SCENE.sub("-", name) for name in names)


def _check(sweep: Sweep) -> None:
    """Raise ConfigError if the options of an arm are wrong, or two points are the same call."""
    calls: dict[tuple[str, ...], SweepPoint] = {}
    for point in sweep.points:
        if (same := calls.setdefault(point.words, point)) is not point:
            raise ConfigError(
                f"{same.name} and {point.name} are the same call: name what differs by {{arm}}, {{scene}} or {{seed}} "
                "in an option."
            )
    for point in {point.arm: point for point in sweep.points}.values():
        sweep.read(point)


def _key(option: Option) -> str:
    """The key of an option in the file."""
    return option.flag[2:].replace("-", "_") if option.flag.startswith("--") else option.field


def _typed_option(option: Option | None, name: str, value: Any) -> Iterator[str]:
    """An option, or a key of the configuration, as words of the command line."""
    # A name may be both, as --robot FILE and [robot]: a table has keys.
    if option is None or isinstance(value, Mapping):
        yield from _typed_keys(f"--{name.replace('_', '-')}", value)
    elif option.value:
        yield from (option.flag, *map(key_text, _items(value)))
    elif value is True:
        yield option.flag
    elif value is not False:
        raise ConfigError(f"{name} must be true or false, got {value!r}.")


def _typed_keys(flag: str, value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _typed_keys(f"{flag}.{name}", inner)
    else:
        yield from (flag, key_text(value))


def _fill(value: Any, own: Mapping[str, str]) -> Any:
    """A value whose texts have a point's names instead of {arm}, {scene} and {seed}."""
    if isinstance(value, Mapping):
        return {name: _fill(inner, own) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_fill(inner, own) for inner in value]
    if isinstance(value, str):
        for mark, text in own.items():
            value = value.replace(mark, text)
    return value


def _with_underscores(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name.replace("-", "_"): value for name, value in options.items()}


def _items(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) else (value,)


def _swept() -> str:
    return f"a sweep runs {', '.join(SWEPT)}"
