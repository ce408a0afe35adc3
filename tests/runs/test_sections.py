from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest

from readygo.common.config import Range, check_ranges
from readygo.common.errors import ConfigError
from readygo.runs.sections import Keys, Sections, merge_tables, with_file, with_keys


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens."""

    height_px: Annotated[int, Range(low=1)] = 8

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera."""

    lens: Lens = field(default_factory=Lens)
    kind: Literal["fast", "slow"] = "fast"
    rate_hz: float | None = None
    names: tuple[str, ...] = ()
    on: bool = True
    others: Mapping[str, Lens] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Whole:
    """A configuration."""

    threads: int = 0
    camera: Camera = field(default_factory=Camera)


SECTIONS = Sections(Whole)


@pytest.mark.parametrize(
    ("argv", "keys"),
    [
        ("--camera.lens.height-px 9", {"camera": {"lens": {"height_px": 9}}}),
        ("--camera.lens.height_px=9", {"camera": {"lens": {"height_px": 9}}}),
        ("--camera.rate-hz -0.5 --camera.kind slow", {"camera": {"rate_hz": -0.5, "kind": "slow"}}),
        ("--camera.rate-hz none --camera.on false", {"camera": {"rate_hz": None, "on": False}}),
        ("--camera.names [a,b] --threads 2", {"camera": {"names": ["a", "b"]}, "threads": 2}),
        ("--camera.others.left_eye.height-px 3", {"camera": {"others": {"left_eye": {"height_px": 3}}}}),
        ("", {}),
    ],
)
def test_keys_are_read_as_tables_and_the_rest_is_left(argv: str, keys: Keys) -> None:
    assert SECTIONS.take(["place", *argv.split(), "--out", "o"], ["--out"]) == (["place", "--out", "o"], keys)


@pytest.mark.parametrize(
    "keys",
    [
        {"camera": {"lens": {"height_px": 9}, "rate_hz": None, "on": False}, "threads": 2},
        {"camera": {"rate_hz": -0.5, "kind": "slow", "names": ["a", "b"]}},
        {"camera": {"others": {"left_eye": {"height_px": 3}}, "names": []}},
        {},
    ],
)
def test_keys_as_options_are_read_as_the_same_keys(keys: Keys) -> None:
    argv = [word for option in SECTIONS.typed(keys).items() for word in option]
    assert SECTIONS.take(argv, []) == ([], keys)


def test_option_of_the_command_takes_precedence_over_a_key_of_its_name() -> None:
    assert SECTIONS.take(["--threads", "2"], ["--threads"]) == (["--threads", "2"], {})


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ("--camra.on true", "unknown section --camra (did you mean --camera?); known: threads, camera"),
        (
            "--camera.knd fast",
            "unknown key 'knd' of --camera (did you mean --camera.kind?); known: lens, kind, rate-hz",
        ),
        ("--camera.lens 3", "--camera.lens is a section; name one of its keys: height-px"),
        ("--threads.most 3", "--threads has no keys: it is INT"),
        ("--camera.on", "--camera.on needs a value: --camera.on {true,false}"),
        ("--camera.kind --out", "--camera.kind needs a value: --camera.kind {fast,slow}"),
        ("--camera.kind fats", "--camera.kind must be fast or slow, got 'fats' (did you mean fast?)"),
        ("--camera.rate-hz quick", "--camera.rate-hz must be a number, got 'quick'"),
    ],
)
def test_wrong_keys_are_named_in_a_line(argv: str, words: str) -> None:
    with pytest.raises(ConfigError) as error:
        SECTIONS.take(argv.split(), ["--out"])
    assert str(error.value).startswith(words)


def test_section_without_effect_is_not_offered_and_its_keys_are_refused() -> None:
    sections = Sections(Whole, without=("camera",))
    assert set(sections.hints) == {"threads"}
    with pytest.raises(ConfigError, match=r"^keys of --camera have no effect in this command$"):
        sections.take(["--camera.on", "true"], [])


def test_keys_win_over_the_configuration() -> None:
    config = Whole(camera=Camera(kind="slow", lens=Lens(height_px=5)))
    changed = with_keys(config, {"camera": {"rate_hz": 2.0}})
    assert changed == Whole(camera=Camera(kind="slow", lens=Lens(height_px=5), rate_hz=2.0))
    assert with_keys(config, {}) is config


def test_value_out_of_range_names_its_key() -> None:
    with pytest.raises(ConfigError, match=r"^--camera\.lens\.height-px must be at least 1, got 0"):
        with_keys(Whole(), {"camera": {"lens": {"height_px": 0}}})


def test_tables_are_merged_key_by_key() -> None:
    assert merge_tables({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 4}}) == {"a": {"b": 4, "c": 2}, "d": 3}


def test_file_changes_the_keys_that_it_holds(tmp_path: Path) -> None:
    config, file = Whole(threads=3, camera=Camera(kind="slow", lens=Lens(height_px=5))), tmp_path / "whole.toml"
    file.write_text("threads = 4\n[camera]\nrate_hz = 2\n[camera.lens]\n")
    assert with_file(config, file) == Whole(threads=4, camera=Camera(kind="slow", lens=Lens(height_px=5), rate_hz=2.0))
    assert with_file(config, None) is config


def test_table_of_a_file_is_read_alone(tmp_path: Path) -> None:
    config, file = Camera(kind="slow"), tmp_path / "whole.toml"
    file.write_text("threads = 4\n[camera]\nrate_hz = 2\n")
    assert with_file(config, file, table="camera") == Camera(kind="slow", rate_hz=2.0)
    assert with_file(config, file, table="other") == config
    with pytest.raises(ConfigError, match=r"whole\.toml: threads must be a table, got 4\.$"):
        with_file(config, file, table="threads")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("threads = ", " cannot be read: "),
        ("[learn]\nmix = 1\n", ": Unknown key 'learn'; known keys: camera, threads."),
        ("[camera.lens]\nheight_px = 0\n", ": camera.lens: height_px must be at least 1, got 0."),
        ("camera = 3\n", ": camera must be a table, got 3."),
    ],
)
def test_error_in_a_file_names_the_file(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "whole.toml").write_text(text)
    with pytest.raises(ConfigError) as error:
        with_file(Whole(), tmp_path / "whole.toml")
    assert str(error.value).startswith(f"Configuration {tmp_path / 'whole.toml'}{words}")
