"""TOML, JSON and YAML that was written elsewhere, parsed within limits of size, depth and numbers; TOML of ours."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import tomli_w

from readygo.common.errors import ReadygoError
from readygo.common.files import read_regular, write_whole

TOML_BYTES_MAX = 2**20
JSON_BYTES_MAX = 16 * 2**20
YAML_BYTES_MAX = 2**16
VALUES_MAX = 2_000_000
"""Values of a JSON document: in a few bytes each takes a hundred of memory."""
DEPTH_MAX = 32
"""Tables and arrays within each other."""
KEY_PARTS_MAX = 16
"""Parts of a dotted key in TOML; `tomllib` takes the square of their number in time and memory."""
_INT_MIN, _INT_MAX = -(2**63), 2**63 - 1
_KEY = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_KEY}){{{KEY_PARTS_MAX}}}")


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        ValueError: If it is no TOML, or beyond a limit of depth or numbers; the message does not name the file.
        OSError: If it cannot be read, is no regular file, or larger than `TOML_BYTES_MAX`.
    """
    return parse_toml(_text(read_regular(path, bytes_max=TOML_BYTES_MAX)))


def read_json(path: str | Path, *, bytes_max: int = JSON_BYTES_MAX) -> Any:
    """The value of a JSON file.

    Args:
        path: The file.
        bytes_max: A larger file is refused [bytes].

    Raises:
        ValueError: If it is no JSON, or beyond a limit of depth or numbers; the message does not name the file.
        OSError: If it cannot be read, is no regular file, or larger.
    """
    return parse_json(read_regular(path, bytes_max=bytes_max), bytes_max=bytes_max)


def write_toml(path: Path, tables: Mapping[str, Any], *, raises: type[ReadygoError]) -> None:
    """Write plain values, lists and tables as a TOML file, whole or not at all; keys without a value are left out.

    Raises:
        ReadygoError: `raises`, if the file cannot be written.
    """
    write_whole(path, tomli_w.dumps(_given(tables)), raises=raises)


def read_tagged(
    path: Path, tag: str, *, raises: type[ReadygoError], missing: str, remedy: str, old: str = ""
) -> dict[str, Any]:
    """The tables of a TOML file that says by `format` what it holds.

    Args:
        path: The file.
        tag: The format that this version reads.
        raises: Exception for a file that cannot be used.
        missing: What to do if the folder has no such file.
        remedy: What to do if it is no TOML, or has another format.
        old: What to do if it has another format, if that is not the same.

    Raises:
        ReadygoError: `raises`, if the file is missing, no TOML, or of another format.
    """
    try:
        tables = read_toml(path)
    except OSError as error:
        raise raises(f"{path.parent} holds no {path.name}; {missing}.") from error
    except ValueError as error:
        raise raises(f"{path} is no TOML file: {error}; {remedy}.") from error
    if tables.get("format") != tag:
        raise raises(f"{path} has format {tables.get('format')!r}, this version reads {tag!r}; {old or remedy}.")
    return tables


def write_json(path: Path, value: Any, *, raises: type[ReadygoError]) -> None:
    """Write plain values as an indented JSON file, whole or not at all.

    Raises:
        ReadygoError: `raises`, if the file cannot be written.
    """
    write_whole(path, json.dumps(value, indent=2) + "\n", raises=raises)


def _given(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The keys that have a value: TOML has no null."""
    return {
        key: _given(value) if isinstance(value, Mapping) else value
        for key, value in tables.items()
        if value is not None
    }


def read_yaml(path: str | Path) -> Any:
    """The value of a YAML file; numbers and other scalars stay text.

    Raises:
        ValueError: If it is no YAML, or nests too deep; the message does not name the file.
        OSError: If it cannot be read, is no regular file, or larger than `YAML_BYTES_MAX`.
    """
    # Imported here: few programs read YAML.
    import yaml

    text = _text(read_regular(path, bytes_max=YAML_BYTES_MAX))
    try:
        return yaml.load(text, Loader=yaml.BaseLoader)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ValueError(f"it is no YAML: {' '.join(str(error).split())}") from error


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: If it is no TOML, or beyond a limit of size, depth or numbers.
    """
    if len(text) > TOML_BYTES_MAX:
        raise ValueError(f"it is larger than {TOML_BYTES_MAX >> 20} MiB")
    if _LONG_KEY.search(text):
        raise ValueError(f"a key has more than {KEY_PARTS_MAX} parts")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check(tables)
    return tables


def parse_json(data: bytes | str, *, bytes_max: int = JSON_BYTES_MAX) -> Any:
    """The value of a JSON text, UTF-8 where it comes as bytes.

    Raises:
        ValueError: If it is no JSON, or beyond a limit of size, depth or numbers.
    """
    if len(data) > bytes_max:
        raise ValueError(f"it is larger than {bytes_max >> 20} MiB")
    text = _text(data) if isinstance(data, bytes) else data
    if sum(map(text.count, ",[{")) > VALUES_MAX:
        raise ValueError(f"it holds more than {VALUES_MAX:,} values")
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check(value)
    return value


_TOO_DEEP = f"its tables and arrays nest deeper than {DEPTH_MAX} levels"


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start} is not UTF-8") from error


def _check(value: Any) -> None:
    """Raise ValueError at what neither can be worded in a message nor become a number of ours."""
    level = [value]
    for _ in range(DEPTH_MAX):
        below = []
        for item in _items(level):
            if type(item) is int:
                if not _INT_MIN <= item <= _INT_MAX:
                    raise ValueError("it holds a whole number of more than 64 bits")
            elif type(item) is dict or type(item) is list:
                below.append(item)
        if not below:
            return
        level = below
    raise ValueError(_TOO_DEEP)


def _items(level: list[Any]) -> Iterator[Any]:
    for each in level:
        yield from each.values() if type(each) is dict else each if type(each) is list else (each,)
