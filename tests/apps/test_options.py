from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest
from tyro.conf import Fixed, Positional, UseAppendAction

from readygo.apps.options import SHORT_MAX, describe_options, given_options, help_text, section_groups
from readygo.runs.sections import Keys, Sections


@dataclass(frozen=True, kw_only=True)
class Wheels:
    """The wheels."""

    radius_m: float = 0.1
    """Radius [m]."""
    driven: bool = True


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine."""

    seed: int = 0
    threads: int = 0
    """Threads."""
    wheels: Wheels = field(default_factory=Wheels)


@dataclass(frozen=True, kw_only=True)
class TrialsOfTest:
    """How it is tried."""

    task: tuple[str, ...] = ("static", "dynamic")
    """Tasks."""
    image: UseAppendAction[tuple[str, ...]] = ()
    """Topics."""


@dataclass(frozen=True, kw_only=True)
class BuildOptions:
    """Build it.

    In one go.
    """

    name: Positional[str]
    """Its name,
    in one word."""
    out: str
    """Where."""
    speed: Literal["slow", "fast"] | None = None
    """How fast."""
    seed: int = 3
    """Of it."""
    trials: TrialsOfTest = field(default_factory=TrialsOfTest)
    keys: Annotated[Keys, Sections(Machine), Fixed] = field(default_factory=dict)


def test_options_have_name_value_default_and_words() -> None:
    about = describe_options(BuildOptions)
    assert about.words == "Build it.\n\nIn one go."
    assert [(each.typed, each.default, each.words, each.required) for each in about.options] == [
        ("NAME", "", "Its name, in one word.", True),
        ("--out OUT", "", "Where.", True),
        ("--speed {slow,fast}", "", "How fast.", False),
        ("--seed INT", "3", "Of it.", False),
        ("--task TASK [TASK ...]", "static dynamic", "Tasks.", False),
        ("--image IMAGE", "", "Topics.", False),
    ]


def test_given_options_are_those_beside_the_defaults() -> None:
    options = BuildOptions(
        name="cart", out="o", seed=4, trials=TrialsOfTest(task=("a",), image=("b",)), keys={"wheels": {"radius_m": 1.0}}
    )
    assert given_options(options, ("out",)) == {
        "NAME": "cart", "--seed": "4", "--task": "a", "--image": "b", "--wheels.radius-m": "1.0"
    }  # fmt: skip
    assert given_options(options, ("name", "out", "trials", "wheels")) == {"--seed": "4"}
    assert given_options(BuildOptions(name="cart", out="o"), ("name", "out")) == {}


def test_keys_are_listed_by_section_without_those_that_are_options() -> None:
    about = describe_options(BuildOptions)
    assert about.sections is not None
    above, wheels = section_groups(about.sections, about.options)
    assert [option.flag for option in above.options] == ["--threads"]
    assert (wheels.title, wheels.words) == ("wheels", "The wheels.")
    assert [(each.typed, each.default, each.words) for each in wheels.options] == [
        ("--wheels.radius-m FLOAT", "0.1", "Radius [m]."),
        ("--wheels.driven {true,false}", "true", ""),
    ]


def test_short_help_names_where_the_keys_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown, everything = (
        help_text("readygo build", BuildOptions),
        help_text("readygo build", BuildOptions, everything=True),
    )
    assert shown.startswith("usage: readygo build NAME --out OUT [OPTIONS]\n\nBuild it.\n\nIn one go.\n\noptions:\n")
    assert "trials: How it is tried.\n  --task TASK" in shown
    assert shown.endswith("\n\nAll options: readygo build --help-all")
    assert "--wheels.radius-m FLOAT\n                          Radius [m]. (default: 0.1)" in everything
    assert "--help-all" not in everything


def test_groups_of_many_options_are_in_the_long_help_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.apps.options.SHORT_MAX", 5)
    assert [group.title for group in describe_options(BuildOptions).short] == [""]
    assert SHORT_MAX == 12
