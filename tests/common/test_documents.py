import os
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from readygo.common.documents import (
    DEPTH_MAX,
    JSON_BYTES_MAX,
    KEY_PARTS_MAX,
    TOML_BYTES_MAX,
    VALUES_MAX,
    YAML_BYTES_MAX,
    parse_json,
    parse_toml,
    read_json,
    read_tagged,
    read_toml,
    read_yaml,
    write_json,
    write_toml,
)
from readygo.common.errors import SceneError

READERS: list[Callable[[Path], Any]] = [read_toml, read_json, read_yaml]


def test_documents_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b'\xef\xbb\xbfa.b = [1, 2.5]\r\n[c]\nd = "\xc3\xa9"\n')
    assert read_toml(tmp_path / "a.toml") == {"a": {"b": [1, 2.5]}, "c": {"d": "é"}}
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": [1, NaN, null]}')
    assert str(read_json(tmp_path / "a.json")) == "{'a': [1, nan, None]}"
    assert parse_json("3") == 3


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000,
        "a = " + "[" * (DEPTH_MAX + 1) + "]" * (DEPTH_MAX + 1),
        "a = " + "{a=" * 5_000,
        "a" + ".a" * 300_000 + " = 1",
        "[a" + ' . "b c"' * 100_000 + "]",
        "'a'" + ".'a'" * KEY_PARTS_MAX + " = 1",
        "a = " + "9" * 5_000,
        "a = 0x" + "f" * 20_000,
        f"a = {2**63}",
        "a = 1\nb",
        "#" * TOML_BYTES_MAX + "\n",
    ],
    ids=lambda text: text[:12],
)
def test_toml_beyond_a_limit_is_refused_at_once(text: str) -> None:
    begin_s = time.process_time()
    with pytest.raises(ValueError, match=r"."):
        parse_toml(text)
    assert time.process_time() - begin_s < 2.0


@pytest.mark.parametrize(
    "text",
    [
        b"[" * 1_000_000,
        b'{"a":' * (DEPTH_MAX + 1) + b"1" + b"}" * (DEPTH_MAX + 1),
        b"9" * 5_000,
        b"[" + b"9" * 4_000 + b"]",
        str(2**63).encode(),
        b'"\xff"',
        b"{",
        b"",
        b"[" + b"[]," * VALUES_MAX + b"1]",
        b" " * JSON_BYTES_MAX + b"1",
    ],
    ids=lambda text: repr(text[:12]),
)
def test_json_beyond_a_limit_is_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_json(text)


def test_what_lies_within_the_limits_is_taken() -> None:
    assert parse_json("[" * DEPTH_MAX + "]" * DEPTH_MAX)
    assert parse_toml("a" + ".a" * (KEY_PARTS_MAX - 1) + " = 1")
    assert parse_toml(f"a = {2**63 - 1}\nb = {-(2**63)}\n")
    # A number has one point, a list of them many.
    assert len(parse_toml(f"a = [{'0.5, ' * 1000}]")["a"]) == 1000


@pytest.mark.parametrize("read", READERS)
def test_files_that_are_none_are_refused(tmp_path: Path, read: Callable[[Path], Any]) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path / "none", tmp_path, Path("/dev/zero")):
        with pytest.raises(OSError, match=r"."):
            read(path)
    (tmp_path / "latin").write_bytes(b'a = "\xe9"')
    with pytest.raises(ValueError, match="byte 5 is not UTF-8"):
        read(tmp_path / "latin")


@pytest.mark.parametrize(
    ("read", "size"), [(read_toml, TOML_BYTES_MAX), (read_json, JSON_BYTES_MAX), (read_yaml, YAML_BYTES_MAX)]
)
def test_files_beyond_the_limit_are_not_read(tmp_path: Path, read: Callable[[Path], Any], size: int) -> None:
    with (tmp_path / "a").open("wb") as file:
        file.truncate(size + 1)
    with pytest.raises(OSError, match="more than the"):
        read(tmp_path / "a")


def test_tables_read_back_as_they_were_written(tmp_path: Path) -> None:
    tables = {
        "text": 'quotes " back\\slash \n tab \t umlaut ü del \x7f',
        "number": 0.1,
        "whole": 3,
        "flag": True,
        "list": [1.5, 2.5],
        "a table": {"key with.dot": "x", "inner": {"size": 1, "name": "y"}},
    }
    write_toml(tmp_path / "a.toml", tables, raises=SceneError)
    assert tomllib.loads((tmp_path / "a.toml").read_text()) == tables
    write_toml(tmp_path / "a.toml", {"a": None, "b": {"c": None, "d": 1}}, raises=SceneError)
    assert tomllib.loads((tmp_path / "a.toml").read_text()) == {"b": {"d": 1}}
    with pytest.raises(SceneError, match=r"a\.toml"):
        write_toml(tmp_path / "a.toml" / "b.toml", tables, raises=SceneError)


def test_scalars_of_yaml_stay_text(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: 1e-3  # small\nb: [0, 'no']\nc:\n  - 2020-01-01\n")
    assert read_yaml(tmp_path / "a.yaml") == {"a": "1e-3", "b": ["0", "no"], "c": ["2020-01-01"]}


@pytest.mark.parametrize("text", ["a: [", "[" * 20_000, '"\\UFFFFFFFF"', "a: \x00", "- a\nb: c"])
def test_text_that_is_no_yaml_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(ValueError, match=r"no YAML|nest deeper") as caught:
        read_yaml(tmp_path / "a.yaml")
    assert "\n" not in str(caught.value)


def test_file_of_ours_is_read_if_it_has_the_format_of_this_version(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"

    def read(old: str = "") -> dict[str, Any]:
        return read_tagged(path, "ours/2", raises=SceneError, missing="make one", remedy="make it again", old=old)

    for text, words in (
        (None, rf"^{tmp_path} holds no a\.toml; make one\.$"),
        ("a", r"a\.toml is no TOML file: .*; make it again\.$"),
        ("a = 1", r"a\.toml has format None, this version reads 'ours/2'; make it again\.$"),
    ):
        if text is not None:
            path.write_text(text)
        with pytest.raises(SceneError, match=words):
            read()
    path.write_text('format = "ours/1"')
    with pytest.raises(SceneError, match=r"has format 'ours/1', this version reads 'ours/2'; use the old one\.$"):
        read(old="use the old one")
    path.write_text('format = "ours/2"\na = 1')
    assert read() == {"format": "ours/2", "a": 1}


def test_json_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"b": 1, "a": [None]}, raises=SceneError)
    assert (tmp_path / "a.json").read_text() == '{\n  "b": 1,\n  "a": [\n    null\n  ]\n}\n'
    with pytest.raises(SceneError):
        write_json(tmp_path / "a.json" / "b.json", {}, raises=SceneError)
