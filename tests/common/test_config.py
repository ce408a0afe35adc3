import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import pytest

from readygo.common.config import (
    Range,
    check_ranges,
    section_differences,
    section_from_mapping,
    section_to_mapping,
)
from readygo.common.errors import ConfigError


@dataclass(frozen=True)
class Section:
    share: Annotated[float, Range(low=0.0, high=1.0)] = 0.5
    speeds: Annotated[tuple[float, ...], Range(above=0.0)] = (1.0,)
    free: float = math.nan


@pytest.mark.parametrize("values", [{}, {"share": 0.0}, {"share": 1}, {"speeds": ()}, {"speeds": (0.1, 3.0)}])
def test_numbers_in_their_ranges_pass_and_fields_without_one_hold_anything(values):
    check_ranges(Section(**values))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"share": -0.1}, "share must be at least 0 and at most 1, got -0.1"),
        ({"share": 1.5}, "share must be at least 0 and at most 1, got 1.5"),
        ({"share": math.nan}, "share must be .* got nan"),
        ({"speeds": (1.0, 0.0)}, "speeds must be above 0, got 0"),
        ({"speeds": (math.inf,)}, "speeds must be above 0, got inf"),
    ],
)
def test_numbers_out_of_range_are_refused_by_field_range_and_value(values, message):
    with pytest.raises(ValueError, match=message):
        check_ranges(Section(**values))


@dataclass(frozen=True)
class Part:
    size_m: float = 1.0
    count: int = 2

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ValueError(f"count must not be negative, got {self.count}.")


@dataclass(frozen=True)
class Whole:
    part: Part = field(default_factory=Part)
    kind: Literal["a", "b"] = "a"
    times_s: tuple[float, ...] = ()
    limit: int | None = None


def test_section_survives_as_plain_values_and_missing_keys_take_their_defaults():
    whole = Whole(part=Part(size_m=0.5), kind="b", times_s=(1.0, 2.0), limit=3)
    mapping = section_to_mapping(whole)
    assert mapping == {"part": {"size_m": 0.5, "count": 2}, "kind": "b", "times_s": [1.0, 2.0], "limit": 3}
    assert section_from_mapping(Whole, mapping) == whole
    assert section_from_mapping(Whole, {"limit": None, "part": {"count": 7}}) == Whole(part=Part(count=7))


def test_whole_numbers_become_floats_where_floats_are_wanted():
    size_m = section_from_mapping(Part, {"size_m": 3}).size_m
    assert (size_m, type(size_m)) == (3.0, float)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"part": {"sise_m": 1.0}}, "Unknown key 'part.sise_m'; known keys: count, size_m"),
        ({"part": 3}, "part must be a table, got 3"),
        ({"part": {"count": 1.5}}, "part.count must be int, got 1.5"),
        ({"part": {"count": True}}, "part.count must be int, got True"),
        ({"part": {"count": -1}}, "part: count must not be negative"),
        ({"kind": "c"}, r"kind must be one of \['a', 'b'\], got 'c'"),
        ({"times_s": 1.0}, "times_s must be an array, got 1.0"),
        ({"times_s": [1.0, "x"]}, "times_s must be float, got 'x'"),
        ({"limit": "x"}, "limit must be int, got 'x'"),
    ],
)
def test_unknown_keys_and_wrong_values_are_refused_by_their_path(mapping: dict[str, Any], message: str):
    with pytest.raises(ConfigError, match=message):
        section_from_mapping(Whole, mapping)


def test_differences_are_named_with_both_values():
    assert section_differences(Whole(limit=1), Whole(part=Part(count=5), limit=1)) == [("part.count", 2, 5)]
    assert section_differences(Whole(), Whole()) == []


@dataclass(frozen=True, kw_only=True)
class _Table:
    a: int = 0


@pytest.mark.parametrize("mapping", [3, [1], "text", None])
def test_what_is_no_table_is_refused(mapping: object) -> None:
    with pytest.raises(ConfigError, match="must be a table"):
        section_from_mapping(_Table, mapping)
