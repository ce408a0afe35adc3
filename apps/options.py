"""The options of a command, read from their dataclass: names, values, defaults and docstrings; and their help.

The options of a command are one frozen dataclass. Its own fields are what users change weekly, and stand in the short
help; fields that are dataclasses group further options below a heading, and `--help-all` shows these too.
"""

import ast
import dataclasses
import functools
import inspect
import itertools
import re
import shutil
import sys
import textwrap
import types
import typing
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from tyro.conf import Positional, UseAppendAction

from readygo.runs.sections import Sections, value_kind

SHORT_MAX = 12
"""Most options in the short help of a command."""
POSITIONAL = typing.get_args(Positional[int])[1]
REPEATED = typing.get_args(UseAppendAction[tuple[int, ...]])[1]
"""Marks of fields: an argument without a name, and an option that may be repeated to give several values."""
_COLUMN = 26
"""Column of the descriptions in the help."""


class Option(NamedTuple):
    """One option, positional argument or key of a command."""

    flag: str
    """The option as typed, such as --out, or the name of a positional argument, such as SCENE."""
    value: str
    """Name of its value in the help; empty for a switch and for a positional argument."""
    default: str
    """Default value; empty if there is none or if the description names it."""
    words: str
    required: bool = False
    field: str = ""
    """Name of its field; empty for a key."""

    @property
    def typed(self) -> str:
        """The option with the name of its value."""
        return f"{self.flag} {self.value}".strip()

    @property
    def usage(self) -> str:
        """The option with the name of its value; an optional argument stands in brackets."""
        return self.typed if self.required or self.flag.startswith("-") else f"[{self.flag}]"


class OptionGroup(NamedTuple):
    """Options below one heading."""

    kind: type
    """The dataclass that has them as fields."""
    title: str
    """Name of the field that holds the group, or of the section; empty for a command's own options."""
    heading: str
    """Name of the group where it stands without its command."""
    words: str
    options: tuple[Option, ...]


class CommandOptions(NamedTuple):
    """All that the help of a command says."""

    words: str
    own: OptionGroup
    groups: tuple[OptionGroup, ...]
    sections: Sections | None
    """Configuration whose keys can be given as options."""

    @property
    def options(self) -> tuple[Option, ...]:
        """All options but the keys of sections."""
        return tuple(option for group in (self.own, *self.groups) for option in group.options)

    @property
    def short(self) -> tuple[OptionGroup, ...]:
        """The groups of the short help: all of them if they are few options together."""
        return (self.own, *self.groups) if len(self.options) <= SHORT_MAX else (self.own,)


def describe_options(kind: type) -> CommandOptions:
    """Read the options of a command from their dataclass."""
    hints = typing.get_type_hints(kind, include_extras=True)
    groups = tuple(_group(hint, name) for name, hint in hints.items() if dataclasses.is_dataclass(hint))
    found = sections_field(kind)
    return CommandOptions(inspect.getdoc(kind) or "", _group(kind, ""), groups, found[1] if found else None)


def sections_field(kind: type) -> tuple[str, Sections] | None:
    """The field of a command's options that holds keys of its configuration, and which keys these may be."""
    for name, hint in typing.get_type_hints(kind, include_extras=True).items():
        for said in getattr(hint, "__metadata__", ()):
            if isinstance(said, Sections):
                return name, said
    return None


def given_options(options: Any, allowed: Collection[str]) -> dict[str, str]:
    """The options and keys whose value is not their default, such as {"--seed": "3", "--renderer.detail": "lod"}.

    Args:
        options: The options of a command.
        allowed: Names of fields, groups and sections to leave out.
    """
    about, found = describe_options(type(options)), dict[str, str]()
    for group in (about.own, *about.groups):
        values = getattr(options, group.title) if group.title else options
        defaults = {field.name: _default(field) for field in dataclasses.fields(group.kind)}
        for option in group.options if group.title not in allowed else ():
            value = getattr(values, option.field)
            if option.field not in allowed and value != defaults[option.field]:
                found[option.flag] = "" if isinstance(value, bool) else _text(value)
    if held := sections_field(type(options)):
        keys = {name: value for name, value in getattr(options, held[0]).items() if name not in allowed}
        found |= held[1].typed(keys)
    return found


def section_groups(sections: Sections, options: Sequence[Option]) -> Iterator[OptionGroup]:
    """The keys of a configuration by section, those that stand above all sections first.

    Args:
        sections: The configuration.
        options: The command's own options, which take precedence over keys of the same name.
    """
    own = {option.flag for option in options}
    for tree in sections.trees:
        keys = [key for key in _keys(tree, tree(), "--", deep=False) if key.flag not in own]
        if keys:
            yield OptionGroup(tree, "settings", _heading(tree), _first_line(tree), tuple(keys))
    for name, hint in sections.hints.items():
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            title = name.replace("_", "-")
            yield OptionGroup(
                hint, title, f"Section {title}", _first_line(hint), tuple(_keys(hint, hint(), f"--{title}."))
            )


def help_text(prog: str, kind: type, *, everything: bool = False) -> str:
    """The help of a command.

    Args:
        prog: The command, such as "readygo generate".
        kind: Dataclass of its options.
        everything: True for all groups and the keys of the configuration, False for the short help.
    """
    about = describe_options(kind)
    named = [option.usage for option in about.options if option.required or not option.flag.startswith("-")]
    lines = [" ".join(["usage:", prog, *named, "[OPTIONS]"]), "", about.words]
    groups = [about.own, *about.groups] if everything else list(about.short)
    more = about.sections is not None or len(groups) <= len(about.groups)
    if everything and about.sections:
        groups += section_groups(about.sections, about.options)
    width = min(shutil.get_terminal_size().columns, 120)
    for group in groups:
        if group.options:
            lines += ["", f"{group.title or 'options'}:{f' {group.words}' if group.title else ''}"]
            lines += [line for option in group.options for line in _help_lines(option, width)]
    if more and not everything:
        lines += ["", f"All options: {prog} --help-all"]
    return "\n".join(lines)


def option_name(field: str) -> str:
    """The option of a field; `from_` becomes --from, because `from` is a keyword of Python."""
    return f"--{field.rstrip('_').replace('_', '-')}"


def value_name(hint: Any, name: str, positional: bool) -> str | None:
    """Name of a value in the help, such as PATH; None if the type has none."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return value_name(arguments[0], name, positional)
    if origin in (types.UnionType, typing.Union):
        kinds = [kind for kind in arguments if kind is not type(None)]
        return value_name(kinds[0], name, positional) if len(kinds) == 1 else None
    if origin is Literal:
        return f"{{{','.join(map(str, arguments))}}}"
    if origin is tuple and arguments[1:] == (...,):
        item = value_name(arguments[0], name, positional)
        return item and f"{item} [{item} ...]"
    if origin is tuple:
        items = [value_name(argument, name, positional) for argument in arguments]
        return " ".join(item for item in items if item) if all(items) else None
    if hint is str or (positional and hint is Path):
        return name.upper()
    return {Path: "PATH", int: "INT", float: "FLOAT"}.get(hint)


def _group(kind: Any, title: str) -> OptionGroup:
    hints, words = typing.get_type_hints(kind, include_extras=True), _docstrings(kind)
    fields = [field for field in dataclasses.fields(kind) if _is_option(hints[field.name])]
    options = tuple(_option(field, hints[field.name], words.get(field.name, "")) for field in fields)
    return OptionGroup(kind, title, _heading(kind), _first_line(kind), options)


def _default(field: "dataclasses.Field[Any]") -> Any:
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def _is_option(hint: Any) -> bool:
    marks = getattr(hint, "__metadata__", ())
    return not dataclasses.is_dataclass(hint) and not any(isinstance(mark, Sections) for mark in marks)


def _option(field: "dataclasses.Field[Any]", hint: Any, words: str) -> Option:
    marks = getattr(hint, "__metadata__", ())
    positional = POSITIONAL in marks
    required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    plain = field.name if positional else field.name.rstrip("_").rsplit("_", 1)[-1]
    bare = typing.get_args(hint)[0] if marks else hint
    repeated = REPEATED in marks
    value = "" if bare is bool else value_name(typing.get_args(bare)[0] if repeated else bare, plain, positional)
    value = plain.upper() if value is None else value
    unsaid = required or bare is bool or field.default in (None, "", (), dataclasses.MISSING)
    default = "" if unsaid else _text(field.default)
    if positional:
        return Option(value, "", default, words, required, field.name)
    return Option(option_name(field.name), value, default, words, required, field.name)


def _keys(kind: type, values: Any, prefix: str, *, deep: bool = True) -> Iterator[Option]:
    """The keys of a section, with those of the sections in it."""
    words = _docstrings(kind)
    for name, hint in typing.get_type_hints(kind, include_extras=True).items():
        flag, value = f"{prefix}{name.replace('_', '-')}", getattr(values, name)
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            yield from _keys(hint, value, f"{flag}.") if deep else ()
        elif isinstance(value, Mapping):
            yield Option(f"{flag}.NAME", "VALUE", "", words.get(name, ""))
        else:
            yield Option(flag, value_kind(hint), "" if value in (None, "", ()) else _text(value), words.get(name, ""))


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def _docstrings(kind: type) -> dict[str, str]:
    """The docstring below each field of a dataclass, as one line."""
    words: dict[str, str] = {}
    for each in reversed(kind.__mro__[:-1]):
        words |= _documented_fields(each.__module__).get(each.__name__, {})
    return words


@functools.cache
def _documented_fields(module: str) -> dict[str, dict[str, str]]:
    """The docstrings of fields in a module, by class and field; empty if there is no source."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    found: dict[str, dict[str, str]] = {}
    for kind in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        for field, said in itertools.pairwise(kind.body):
            match field, said:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(value=str(text))):
                    found.setdefault(kind.name, {})[name] = " ".join(text.split())
    return found


def _heading(kind: type) -> str:
    """The name of a class as words, such as "Fleet options"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind.__name__).capitalize()


def _first_line(kind: Any) -> str:
    return (inspect.getdoc(kind) or "").partition("\n\n")[0].replace("\n", " ")


def _help_lines(option: Option, width: int) -> list[str]:
    said = "required" if option.required else f"default: {option.default}" if option.default else ""
    words = f"{option.words} ({said})" if said else option.words
    lines = textwrap.wrap(words, max(width - _COLUMN, 30)) or [""]
    head = f"  {option.typed}"
    first = [f"{head:<{_COLUMN}}{lines[0]}"] if len(head) < _COLUMN - 1 else [head, f"{'':{_COLUMN}}{lines[0]}"]
    return [*(line.rstrip() for line in first), *(f"{'':{_COLUMN}}{line}" for line in lines[1:])]
