"""Keys of a configuration on the command line: `--renderer.detail lod` is `detail = "lod"` of `[renderer]` in TOML."""

import difflib
import re
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_toml
from readygo.common.errors import ConfigError, cause

Config = TypeVar("Config")
Keys = Mapping[str, Any]
"""Given keys as nested tables, as in a TOML file."""
NO_KEYS: Keys = types.MappingProxyType({})
NONE = "none"
"""Text of an optional key's value None."""
_TRUTH = {"true": True, "false": False}
_KINDS: Mapping[Any, str] = {int: "a whole number", float: "a number"}


class Sections:
    """Annotation of the field of a command's options that holds keys of its configuration, by section.

    A key of a section is given as --SECTION.KEY VALUE, one that stands above all sections as --KEY VALUE.
    """

    def __init__(self, *trees: type, without: Sequence[str] = (), **sections: type) -> None:
        """Name the configurations.

        Args:
            trees: Dataclasses whose fields are sections and keys.
            without: Sections of these that have no effect in the command; their keys are refused.
            sections: Further sections by name.
        """
        self.trees, self.without = trees, without
        hints = {name: hint for tree in trees for name, hint in _hints(tree).items()} | sections
        self.hints: dict[str, Any] = {name: hint for name, hint in hints.items() if name not in without}

    def flags(self) -> list[str]:
        """The options of keys that stand above all sections."""
        return [_flag(name) for name, hint in self.hints.items() if not is_dataclass(hint)]

    def take(self, argv: Sequence[str], options: Sequence[str]) -> tuple[list[str], Keys]:
        """Split arguments into those of the command and the keys of its configuration.

        Args:
            argv: The arguments after the command's name.
            options: The command's own options, which take precedence over keys of the same name.

        Raises:
            ConfigError: If a key is unknown, or its value is missing or of the wrong kind.
        """
        rest: list[str] = []
        keys: dict[str, Any] = {}
        words = iter(argv)
        for word in words:
            flag, given, value = word.partition("=")
            if not (flag.startswith("--") and self._is_key(flag, options)):
                rest.append(word)
                continue
            path, hint = self._find(flag)
            if not given:
                value = next(words, "--")
                if value.startswith("--"):
                    raise ConfigError(f"{flag} needs a value: {flag} {value_kind(hint)}")
            table = keys
            for name in path[:-1]:
                table = table.setdefault(name, {})
            table[path[-1]] = read_value(hint, value, flag)
        return rest, keys

    def typed(self, keys: Keys) -> dict[str, str]:
        """Keys as options with their values, such as {"--renderer.detail": "lod"}: what `take` reads."""
        return dict(_typed(self, keys, "--"))

    def _is_key(self, flag: str, options: Sequence[str]) -> bool:
        return "." in flag or (flag.replace("_", "-") in self.flags() and flag not in options)

    def _find(self, flag: str) -> tuple[list[str], Any]:
        """Names from the section to the key, and the key's type."""
        path: list[str] = []
        hint: Any = self
        for word in flag.removeprefix("--").split("."):
            known = _members(hint)
            if known is None:
                raise ConfigError(f"{_flag(*path)} has no keys: it is {value_kind(hint)}")
            name = word if "*" in known else word.replace("-", "_")
            if hint is self and name in self.without:
                raise ConfigError(f"keys of {_flag(name)} have no effect in this command")
            if name not in known and "*" not in known:
                close = difflib.get_close_matches(name, known, n=1)
                meant = f" (did you mean {_flag(*path, close[0])}?)" if close else ""
                of = f"key {word!r} of {_flag(*path)}" if path else f"section --{word}"
                raise ConfigError(f"unknown {of}{meant}; known: {', '.join(map(_with_dashes, known))}")
            hint = known.get(name, known.get("*"))
            path.append(name)
        if known := _members(hint):
            raise ConfigError(
                f"{_flag(*path)} is a section; name one of its keys: {', '.join(map(_with_dashes, known))}"
            )
        return path, hint


def with_keys(config: Config, keys: Keys, where: str = "") -> Config:
    """A configuration with the keys of the command line.

    Args:
        config: A dataclass.
        keys: Given keys.
        where: Path of the configuration, such as "learn.", for errors.

    Raises:
        ConfigError: If a value is out of range, or values do not go together.
    """
    if not keys:
        return config
    try:
        return section_from_mapping(type(config), merge_tables(section_to_mapping(config), keys), where=where)
    except ConfigError as error:
        said = str(error).removeprefix(f"{type(config).__name__}: ")
        named = said.startswith((*keys, where.rstrip(".") or ":"))
        path, _, words = re.sub(r"^([\w.]+): (\w+) must", r"\1.\2 must", said).partition(" ")
        raise ConfigError(f"--{_with_dashes(path)} {words}" if named else str(error)) from error


def with_file(config: Config, path: Path | None, *, table: str = "") -> Config:
    """A configuration with the keys of a TOML file; keys that the file lacks stay.

    Args:
        config: A dataclass.
        path: The file; None changes nothing.
        table: Table of the file that holds the keys, such as "learn"; the whole file by default.

    Raises:
        ConfigError: If the file cannot be read, or holds an unknown key or a wrong value.
    """
    if path is None:
        return config
    keys = read_sections(path)
    if table:
        keys = keys.get(table, {})
    whole = merge_tables(section_to_mapping(config), keys) if isinstance(keys, Mapping) else keys
    try:
        return section_from_mapping(type(config), whole, where=f"{table}." if table else "")
    except ConfigError as error:
        raise ConfigError(f"Configuration {path}: {error}") from error


def read_sections(path: Path) -> dict[str, Any]:
    """All sections of a configuration file.

    Raises:
        ConfigError: If it cannot be read.
    """
    try:
        return read_toml(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"Configuration {path} cannot be read: {cause(error)}.") from error


def merge_tables(tables: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables with the keys of others."""
    nested = {
        name: merge_tables(tables[name], keys)
        for name, keys in over.items()
        if isinstance(keys, Mapping) and isinstance(tables.get(name), Mapping)
    }
    return {**tables, **over, **nested}


def _typed(hint: Any, keys: Keys, prefix: str) -> Iterator[tuple[str, str]]:
    known = _members(hint) or {}
    for name, value in keys.items():
        flag = f"{prefix}{name if '*' in known else _with_dashes(name)}"
        if isinstance(value, Mapping):
            yield from _typed(known.get(name, known.get("*")), value, f"{flag}.")
        else:
            yield flag, key_text(value)


def key_text(value: Any) -> str:
    """The value of a key as text of the command line, which `read_value` reads."""
    if value is None:
        return NONE
    if isinstance(value, (list, tuple)):
        return ",".join(map(key_text, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def value_kind(hint: Any) -> str:
    """The kind of a key's value for the help, such as FLOAT."""
    plain = _plain(hint)
    origin, arguments = typing.get_origin(plain), typing.get_args(plain)
    if origin is Literal:
        return f"{{{','.join(map(str, arguments))}}}"
    if origin is tuple:
        return f"{value_kind(arguments[0])},..."
    if plain is bool:
        return "{true,false}"
    return {int: "INT", float: "FLOAT"}.get(plain, "TEXT")


def read_value(hint: Any, text: str, flag: str) -> Any:
    """The value of a key, from its text on the command line.

    Raises:
        ConfigError: If the text is no value of that type.
    """
    plain = _plain(hint)
    origin, arguments = typing.get_origin(plain), typing.get_args(plain)
    if plain is not _bare(hint) and text == NONE:
        return None
    if origin is tuple:
        items = [item.strip() for item in text.strip("[]").split(",") if item.strip()]
        return [read_value(arguments[0], item, flag) for item in items]
    choices = {str(choice): choice for choice in arguments} if origin is Literal else _TRUTH if plain is bool else {}
    if choices and text not in choices:
        close = difflib.get_close_matches(text, choices, n=1)
        meant = f" (did you mean {close[0]}?)" if close else ""
        raise ConfigError(f"{flag} must be {' or '.join(choices)}, got {text!r}{meant}")
    if choices:
        return choices[text]
    try:
        return plain(text) if plain in _KINDS else text
    except ValueError:
        raise ConfigError(f"{flag} must be {_KINDS[plain]}, got {text!r}") from None


def _members(hint: Any) -> dict[str, Any] | None:
    """The keys of a section or table by name; "*" stands for any name; None if it is a key."""
    if isinstance(hint, Sections):
        return hint.hints
    plain = _bare(hint)
    if is_dataclass(plain):
        return _hints(plain)
    if typing.get_origin(plain) in (dict, Mapping):
        return {"*": typing.get_args(plain)[1]}
    return None


def _hints(tree: Any) -> dict[str, Any]:
    return typing.get_type_hints(tree, include_extras=True)


def _bare(hint: Any) -> Any:
    return typing.get_args(hint)[0] if typing.get_origin(hint) is typing.Annotated else hint


def _plain(hint: Any) -> Any:
    """A type without its annotations and without None."""
    bare = _bare(hint)
    if typing.get_origin(bare) in (types.UnionType, typing.Union):
        return _bare(next(kind for kind in typing.get_args(bare) if kind is not type(None)))
    return bare


def _flag(*path: str) -> str:
    return f"--{'.'.join(map(_with_dashes, path))}"


def _with_dashes(name: str) -> str:
    return name.replace("_", "-")
