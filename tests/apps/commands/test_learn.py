import dataclasses
import sys
from pathlib import Path

import pytest

from readygo.__main__ import main
from readygo.apps.commands.learn import line_of
from readygo.apps.learn.choice import Measurement
from readygo.apps.learn.supervise import Now


def test_line_says_what_is_known() -> None:
    early = Now(fraction=0, minutes=0.1, samples=6004, images=1200, learned=0, policies=0, driven=None, latest=None)
    assert line_of(early) == "0.1 min, 6,004 samples recorded, 1,200 with an image, 0 learned from, 0 policies"
    latest = Measurement(fraction=0.1, policy="ab", episodes=8, static=0.5, dynamic=0.25)
    late = dataclasses.replace(early, images=30_000, learned=135_000, policies=4, driven=0.42, latest=latest)
    assert ", 135,000 learned from (4.5 times each), 4 policies, driving SR 42 %, val SR 50 / 25 %" in line_of(late)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["embedded", "--minutes", "0"], "--minutes and --samples must be above 0, got 0 and None."),
        (["embedded", "--samples", "-3"], "--minutes and --samples must be above 0, got 60 and -3."),
        (["embedded", "--episodes", "-1"], "--episodes must be at least 0, got -1."),
        (["nowhere"], "nowhere does not exist; make one with"),
    ],
)
def test_what_makes_no_sense_is_one_line_and_leaves_nothing(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(sys, "argv", ["readygo", "learn", *arguments, "--out", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as exit_info:
        main()
    assert exit_info.value.code == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "run").exists()
