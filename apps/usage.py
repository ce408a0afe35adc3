"""One-line errors for a command's arguments, instead of tyro's boxes of many lines.

This module alone uses tyro's error hook, which is not part of its public interface: with a version without it, or for
an unknown kind of error, tyro's text is printed.
"""

import contextlib
import difflib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from readygo.apps.options import Option, section_groups
from readygo.common.errors import ReadygoError
from readygo.runs.sections import Sections

_KINDS = {"INT": "a whole number", "FLOAT": "a number"}
"""Kind of value in words, by the value's name in the help."""
_WRONG = (
    re.compile(r"invalid literal for (?P<kind>int)\(\) with base 10: (?P<got>.*)", re.DOTALL),
    re.compile(r"could not convert string to (?P<kind>float): (?P<got>.*)", re.DOTALL),
    re.compile(r"no type matching (?P<kind>.+?) could be instantiated from \[(?P<got>.*?)\]\.?\s.*", re.DOTALL),
)
"""Patterns of the messages of Python and tyro for a value of a wrong type."""
_ALIKE_MIN = 0.75


@contextlib.contextmanager
def errors_in_one_line(options: Sequence[Option], sections: Sections | None = None) -> Iterator[None]:
    """Make tyro raise a one-line ReadygoError instead of printing a box and exiting.

    Args:
        options: All options of the command.
        sections: Configuration whose keys can be given as options.
    """
    try:
        from tyro import _errors as errors
    except ImportError:
        yield
        return
    with errors.on_parse_error(partial(_raise, {option.field: option for option in options}, sections)):
        yield


def _raise(fields: Mapping[str, Option], sections: Sections | None, event: Any) -> None:
    words = _words(fields, sections, event)
    if words:
        raise ReadygoError(f"{' '.join(words.split())}; see `{event.prog} --help`.")


def _words(fields: Mapping[str, Option], sections: Sections | None, event: Any) -> str:
    """The error in words; empty for an unknown event."""
    match type(event).__name__:
        case "UnrecognizedArgs":
            return _unknown(list(fields.values()), sections, event.tokens)
        case "MissingArgs":
            # The missing argument may be there under a misspelt name.
            if any(token.startswith("-") for token in event.unrecognized_tokens):
                return _unknown(list(fields.values()), sections, event.unrecognized_tokens)
            missing = [_option(fields, each.arg).typed for each in event.missing_arguments]
            return f"{_list(missing, 'and')} must be given"
        case "InvalidChoice":
            # tyro lists the choices of an optional value in any order.
            choices = sorted(set(event.choices) - {"None"}) if "None" in event.choices else list(event.choices)
            close = _closest(event.value, choices)
            option = _option(fields, event.argument)
            name = option.flag if option.flag.startswith("--") else option.field.upper()
            return f"{name} must be {_list(choices, 'or')}, got {event.value!r}{close}"
        case "BadValue" if event.offending_value is not None:
            return f"{_option(fields, event.argument).flag} takes no value, got {event.offending_value!r}"
        case "BadValue":
            return f"{_option(fields, event.argument).flag} needs a value: {_option(fields, event.argument).typed}"
        case "InstantiationFailure" if event.argument is None:
            return str(event.message).rstrip(".")
        case "InstantiationFailure":
            return f"{_option(fields, event.argument).flag} {_wrong_value(event.message)}"
    return ""


def _unknown(options: Sequence[Option], sections: Sections | None, tokens: list[str]) -> str:
    given = next((token.partition("=")[0] for token in tokens if token.startswith("-")), None)
    if given is None:
        return f"unexpected argument {tokens[0]!r}"
    name = given.replace("_", "-")
    groups = section_groups(sections, options) if sections else ()
    if keys := [key.typed for group in groups for key in group.options if key.flag.endswith(f".{name.lstrip('-')}")]:
        return f"{given} is a key of the configuration: {_list(keys, 'or')}"
    flags = [option.flag.partition(" ")[0] for option in options]
    return f"unknown option {given!r}{_closest(name, [*flags, *(sections.flags() if sections else ())])}"


def _closest(got: str, known: Collection[str]) -> str:
    plain = {name.lstrip("-"): name for name in known}
    found = difflib.get_close_matches(got.lstrip("-"), plain, n=1, cutoff=_ALIKE_MIN)
    return f" (did you mean {plain[found[0]]}?)" if found else ""


def _wrong_value(message: str) -> str:
    for pattern in _WRONG:
        if found := pattern.fullmatch(message):
            kind = found["kind"].replace("{None}|", "").strip("{}").upper()
            return f"must be {_KINDS.get(kind, kind)}, got {found['got'].replace(',', '')}"
    return f"cannot be used: {message.rstrip('.')}"


def _option(fields: Mapping[str, Option], argument: Any) -> Option:
    return fields[argument.field.intern_name.rpartition(".")[2]]


def _list(words: list[str], last: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
