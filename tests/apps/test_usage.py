import sys
from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest
import tyro
from tyro.conf import Fixed, Positional

from readygo.apps.cli import CliCommand, run_command
from readygo.runs.sections import Keys, Sections


@dataclass(frozen=True, kw_only=True)
class TryOptions:
    """Trying."""

    dry_run: bool = False
    """Only say it."""


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor."""

    max_current: float = 1.0
    """Most current [A]."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine."""

    motor: Motor = field(default_factory=Motor)
    brake: Motor = field(default_factory=Motor)


@dataclass(frozen=True, kw_only=True)
class MoveOptions:
    """Move something."""

    where: Positional[str]
    """Place."""
    out: str
    """Folder."""
    steps: int = 1
    """How many."""
    share: float | None = None
    """Of them."""
    speed: Literal["slow", "fast"] = "slow"
    """How fast."""
    gait: Literal["walk", "run"] | None = None
    """How."""
    goal: tuple[float, float] | None = None
    """Where it ends."""
    trying: TryOptions = field(default_factory=TryOptions)
    keys: Annotated[Keys, Sections(Machine), Fixed] = field(default_factory=dict)


def move(options: MoveOptions) -> None:
    """Move something."""


@dataclass(frozen=True, kw_only=True)
class TurnOptions:
    """Turn something."""

    side: Positional[Literal["left", "right"]]
    """Side."""
    from_: Annotated[int, tyro.conf.arg(name="from")] = 0
    """Start [deg]."""


def turn(options: TurnOptions) -> None:
    """Turn something."""


TURN = {"turn": CliCommand(f"{__name__}:turn", "turns")}
MOVE = {"move": CliCommand(f"{__name__}:move", "moves")}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("a --out o --frobnicate 3", "unknown option '--frobnicate'"),
        ("a --out o --step 3", "unknown option '--step' (did you mean --steps?)"),
        ("a --out o --dry_runs", "unknown option '--dry_runs' (did you mean --dry-run?)"),
        ("a --ot=o", "unknown option '--ot' (did you mean --out?)"),
        (
            "a --out o --max_current=2",
            "--max_current is a key of the configuration: --motor.max-current FLOAT or --brake.max-current FLOAT",
        ),
        ("a b c --out o", "unexpected argument 'b'"),
        ("a", "--out OUT must be given"),
        ("", "WHERE and --out OUT must be given"),
        ("a --out", "--out needs a value: --out OUT"),
        ("a --out o --steps two", "--steps must be a whole number, got 'two'"),
        ("a --out o --share=much", "--share must be a number, got 'much'"),
        ("a --out o --speed fats", "--speed must be slow or fast, got 'fats' (did you mean fast?)"),
        ("a --out o --speed \x1b[2J", "--speed must be slow or fast, got '\\x1b[2J'"),
        ("a --out o --gait hop", "--gait must be run or walk, got 'hop'"),
        ("a --out o --goal 1", "--goal must be FLOAT FLOAT, got '1'"),
        ("a --out o --goal 1 z", "--goal must be FLOAT FLOAT, got '1' 'z'"),
    ],
)
def test_wrong_arguments_are_one_line_that_names_the_option(
    arguments: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(MOVE, ["move", *arguments.split()])
    assert stopped.value.code == 2
    assert capsys.readouterr() == ("", f"readygo: {said}; see `readygo move --help`.\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("", "{left,right} must be given"),
        ("lefd", "SIDE must be left or right, got 'lefd' (did you mean left?)"),
        ("left --from x", "--from must be a whole number, got 'x'"),
    ],
)
def test_argument_with_choices_and_renamed_option_are_named(
    arguments: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        run_command(TURN, ["turn", *arguments.split()])
    assert capsys.readouterr() == ("", f"readygo: {said}; see `readygo turn --help`.\n")


def test_right_arguments_pass_and_help_is_as_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    run_command(MOVE, ["move", "a", "--out", "o", "--share", "0.5", "--dry-run"])
    run_command(MOVE, ["move", "--help"])
    assert "--steps INT" in capsys.readouterr().out


def test_parser_without_the_hook_speaks_for_itself(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import tyro

    monkeypatch.delattr(tyro, "_errors")
    monkeypatch.setitem(sys.modules, "tyro._errors", None)
    with pytest.raises(SystemExit) as stopped:
        run_command(MOVE, ["move", "a", "--out", "o", "--frobnicate"])
    assert stopped.value.code == 2
    assert "Unrecognized options: --frobnicate" in capsys.readouterr().err
