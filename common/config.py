"""Configuration sections: frozen dataclasses that travel as plain mappings (TOML tables, message fields)."""

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from readygo.common.errors import ConfigError

Section = TypeVar("Section")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Range:
    """What numbers a field may hold: `Annotated[float, Range(low=0.0)]`; see `check_ranges`."""

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    """Exclusive lower bound: numbers must be greater."""

    def __contains__(self, number: float) -> bool:
        return math.isfinite(number) and self.low <= number <= self.high and number > self.above

    def __str__(self) -> str:
        lows = [f"at least {self.low:g}"] if math.isfinite(self.low) else []
        lows += [f"above {self.above:g}"] if math.isfinite(self.above) else []
        return " and ".join([*lows, *([f"at most {self.high:g}"] if math.isfinite(self.high) else [])]) or "finite"


def check_ranges(section: Any) -> None:
    """Check the numbers of a dataclass, and those in its tuples, against the ranges that its fields declare.

    Raises:
        ValueError: If one is out of its range or not finite; the message names field, range and number.
    """
    for name, hint in typing.get_type_hints(type(section), include_extras=True).items():
        value = getattr(section, name)
        numbers = value if isinstance(value, tuple) else (value,)
        for allowed in getattr(hint, "__metadata__", ()):
            wrong = [number for number in numbers if isinstance(allowed, Range) and number not in allowed]
            if wrong:
                raise ValueError(f"{name} must be {allowed}, got {wrong[0]:g}.")


def section_to_mapping(section: Any) -> dict[str, Any]:
    """A dataclass as a mapping of plain values; tuples become lists, as in TOML and MessagePack."""

    def plain(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        if isinstance(value, Mapping):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, (tuple, list)):
            return [plain(item) for item in value]
        return value

    mapping: dict[str, Any] = plain(section)
    return mapping


def section_from_mapping(cls: type[Section], mapping: Mapping[str, Any], *, where: str = "") -> Section:
    """A dataclass `cls` from a mapping; missing keys take their defaults.

    Args:
        cls: A dataclass whose fields are plain values, dataclasses, or tuples or mappings of them.
        mapping: Keys are field names.
        where: Path of the section, for error messages.

    Raises:
        ConfigError: If it is no mapping, a key is unknown or missing, or a value has the wrong type.
    """
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"{where.rstrip('.') or cls.__name__} must be a table, got {mapping!r}.")
    hints = typing.get_type_hints(cls)
    unknown = sorted(set(mapping) - set(hints))
    if unknown:
        raise ConfigError(f"Unknown key {where + unknown[0]!r}; known keys: {', '.join(sorted(hints))}.")
    if missing := [name for name in _required(cls) if name not in mapping]:
        of = f" of {where.rstrip('.')}" if where else ""
        raise ConfigError(f"Key{'s' * (len(missing) > 1)} {', '.join(missing)}{of} must be given.")
    values = {key: _convert(hints[key], value, f"{where}{key}") for key, value in mapping.items()}
    try:
        return cls(**values)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{where.rstrip('.') or cls.__name__}: {error}") from error


def _required(cls: Any) -> list[str]:
    """Names of the fields without a default."""
    unset = dataclasses.MISSING
    return [field.name for field in dataclasses.fields(cls) if field.default is field.default_factory is unset]


def section_differences(ours: Any, theirs: Any) -> list[tuple[str, Any, Any]]:
    """Fields in which two sections of one class differ: dotted name, our value, their value."""
    return _differences(section_to_mapping(ours), section_to_mapping(theirs), "")


def _differences(ours: Mapping[str, Any], theirs: Mapping[str, Any], where: str) -> list[tuple[str, Any, Any]]:
    found: list[tuple[str, Any, Any]] = []
    for name, our in ours.items():
        their = theirs.get(name)
        if isinstance(our, Mapping) and isinstance(their, Mapping):
            found += _differences(our, their, f"{where}{name}.")
        elif our != their:
            found.append((where + name, our, their))
    return found


def _convert(hint: Any, value: Any, where: str) -> Any:
    origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return section_from_mapping(hint, value, where=f"{where}.")
    if origin is tuple:
        if not isinstance(value, (tuple, list)):
            raise ConfigError(f"{where} must be an array, got {value!r}.")
        item_hint = typing.get_args(hint)[0]
        return tuple(_convert(item_hint, item, where) for item in value)
    if hint is Any:
        return value
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where} must be a table, got {value!r}.")
        item_hint = typing.get_args(hint)[1]
        return {key: _convert(item_hint, item, f"{where}.{key}") for key, item in value.items()}
    if origin is typing.Literal:
        if value not in typing.get_args(hint):
            raise ConfigError(f"{where} must be one of {list(typing.get_args(hint))}, got {value!r}.")
        return value
    if origin in (types.UnionType, typing.Union):
        if value is None:
            return None
        return _convert(next(arg for arg in typing.get_args(hint) if arg is not type(None)), value, where)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and (not isinstance(value, hint) or (hint is int and isinstance(value, bool))):
        raise ConfigError(f"{where} must be {hint.__name__}, got {value!r}.")
    return value
