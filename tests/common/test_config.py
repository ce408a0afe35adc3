import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
class _Given:
    first: int
    second: int
    third: int = 0


@dataclass(frozen=True, kw_only=True)
class _Holder:
    given: _Given


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({}, "Key given must be given."),
        ({"given": {}}, "Keys first, second of given must be given."),
        ({"given": {"second": 1}}, "Key first of given must be given."),
    ],
)
def test_missing_keys_are_named(mapping: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=f"^{message}$"):
        section_from_mapping(_Holder, mapping)


@dataclass(frozen=True, kw_only=True)
class _Table:
    a: int = 0


@pytest.mark.parametrize("mapping", [3, [1], "text", None])
def test_what_is_no_table_is_refused(mapping: object) -> None:
    with pytest.raises(ConfigError, match="must be a table"):
        section_from_mapping(_Table, mapping)


@pytest.mark.parametrize(
    ("allowed", "inside", "outside", "words"),
    [
        (Range(), (-1e300, 0.0), (math.inf, -math.inf, math.nan), "finite"),
        (Range(low=-2.0), (-2.0, 5.0), (-2.0000001, math.inf), "at least -2"),
        (Range(high=3.0), (3.0, -9.0), (3.0000001, -math.inf), "at most 3"),
        (Range(above=0.5), (0.5000001, 9.0), (0.5, 0.0), "above 0.5"),
        (Range(above=0.0, high=1.0), (1e-9, 1.0), (0.0, 1.1), "above 0 and at most 1"),
        (Range(low=1.0, above=0.0, high=4.0), (1.0, 4.0), (0.9, 4.1), "at least 1 and above 0 and at most 4"),
    ],
)
def test_range_holds_its_ends_and_says_so(allowed: Range, inside, outside, words: str) -> None:
    assert [number in allowed for number in (*inside, *outside)] == [True] * len(inside) + [False] * len(outside)
    assert str(allowed) == words


@dataclass(frozen=True)
class Everything:
    parts: tuple[Part, ...] = ()
    named: Mapping[str, Part] = field(default_factory=dict)
    free: Any = None
    nothing: float | None = None
    pair: tuple[int, int] = (3, -4)
    flag: bool = False
    text: str = "a"


PARTS = st.builds(Part, size_m=st.floats(allow_nan=False), count=st.integers(0, 9))


@settings(max_examples=40, deadline=None)
@given(
    st.builds(
        Everything,
        parts=st.lists(PARTS, max_size=3).map(tuple),
        named=st.dictionaries(st.text(max_size=3), PARTS, max_size=3),
        nothing=st.none() | st.floats(allow_nan=False),
        pair=st.tuples(st.integers(), st.integers()),
        flag=st.booleans(),
        text=st.text(max_size=3),
    )
)
def test_nested_sections_survive_as_plain_values(whole: Everything) -> None:
    mapping = section_to_mapping(whole)
    assert mapping["pair"] == list(whole.pair)
    assert section_from_mapping(Everything, mapping) == whole
    assert section_differences(whole, section_from_mapping(Everything, mapping)) == []


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"parts": [{"count": 1}, {"coun": 1}]}, "Unknown key 'parts.coun'; known keys: count, size_m"),
        ({"parts": {"count": 1}}, "parts must be an array"),
        ({"named": [1]}, r"named must be a table, got \[1\]"),
        ({"named": {"a": {"count": -1}}}, "named.a: count must not be negative, got -1"),
        ({"named": {"a": 3}}, "named.a must be a table, got 3"),
        ({"flag": 1}, "flag must be bool, got 1"),
        ({"text": 1}, "text must be str, got 1"),
        ({"nothing": True}, "nothing must be float, got True"),
        ({"pair": [1, 2.0]}, "pair must be int, got 2.0"),
        ({"b": 1, "a": 2}, "Unknown key 'a'"),
    ],
)
def test_wrong_values_deep_inside_are_refused_by_their_path(mapping: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=f"^{message}"):
        section_from_mapping(Everything, mapping)


def test_section_that_is_wrong_as_a_whole_is_named_by_its_class_or_path() -> None:
    with pytest.raises(ConfigError, match=r"^Part: count must not be negative"):
        section_from_mapping(Part, {"count": -1})
    with pytest.raises(ConfigError, match=r"^deep: count must not be negative"):
        section_from_mapping(Part, {"count": -1}, where="deep.")
    free = {"a": [1, {"b": 2}]}
    assert section_from_mapping(Everything, {"free": free}).free is free
    assert section_differences(Everything(named={"a": Part()}), Everything(named={"a": Part(count=5)})) == [
        ("named.a.count", 2, 5)
    ]
    assert section_differences(Everything(pair=(1, 2)), Everything()) == [("pair", [1, 2], [3, -4])]
