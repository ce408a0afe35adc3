import os
import time
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import ReadygoError
from tests.fuzz import mutate
from tests.fuzz.__main__ import all_targets
from tests.fuzz.run import Counts, Seed, Target, as_mapping, fuzz, input_of, total

for needed in ("torch", "onnx", "rosbags"):
    pytest.importorskip(needed, reason=f"{needed} is not installed")
TARGETS = all_targets()
INPUTS = 20


@pytest.mark.parametrize("target", TARGETS, ids=[target.name for target in TARGETS])
def test_reader_accepts_or_refuses_what_it_is_documented_to(target: Target) -> None:
    counts = fuzz(target, 0, INPUTS, key=0)
    assert counts.ok, counts.findings
    assert counts.inputs == counts.accepted + counts.refused == INPUTS
    assert counts.accepted > 0


def _read(data: bytes, about: object, folder: Path) -> None:
    match data[:1]:
        case b"a":
            raise ReadygoError("a documented refusal")
        case b"b":
            raise KeyError("b")
        case b"c":
            os.abort()
        case b"d":
            np.ones(150_000_000).sum()
        case b"e":
            while True:
                pass
        case b"f":
            raise ReadygoError("no memory") from MemoryError()


def _of(letters: str) -> Target:
    def mutated(data: bytes, dice: mutate.Dice) -> bytes:
        return letters[dice.below(len(letters))].encode()

    return Target(name="toy", seeds=lambda folder: [Seed(b"-")], read=_read, mutate=mutated)


def test_what_comes_of_an_input_is_counted_by_kind(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert fuzz(_of("d"), 1, 2, key=1).above_memory == 2
    monkeypatch.setattr("tests.fuzz.run.CPU_MAX_S", 0.05)
    counts = {letter: fuzz(_of(letter), 1, 3, key=1, keep=tmp_path) for letter in "-abcef"}
    assert all(each.inputs == 3 for each in counts.values())
    assert [counts[letter].accepted for letter in "-a"] == [3, 0]
    assert (counts["a"].refused, counts["f"].refused, counts["f"].failed_allocations) == (3, 3, 3)
    assert (counts["b"].tracebacks, counts["c"].crashes, counts["e"].above_time) == (3, 3, 3)
    assert (tmp_path / "toy-1.bin").exists()
    assert "KeyError" in (tmp_path / "toy.txt").read_text()


def test_input_that_waits_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.fuzz.run.SILENT_MAX_S", 0.0)
    monkeypatch.setattr("tests.fuzz.run.LOOK_EVERY_S", 0.05)
    waiting = Target(
        name="waiting",
        seeds=lambda folder: [Seed(b"-")],
        read=lambda data, about, folder: time.sleep(60) if data == b"w" else None,
        mutate=lambda data, dice: b"w",
    )
    assert fuzz(waiting, 1, 1, key=0).above_time == 1


def test_inputs_follow_from_their_number(tmp_path: Path) -> None:
    (target,) = (each for each in TARGETS if each.name == "robot.toml")
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    seeds, again = target.seeds(tmp_path / "a"), target.seeds(tmp_path / "b")
    some = [input_of(target, seeds, number, 0) for number in range(60)]
    assert some == [input_of(target, again, number, 0) for number in range(60)]
    assert some[len(seeds) :] != [input_of(target, seeds, number, 1) for number in range(60)][len(seeds) :]
    assert len({data for data, _ in some}) > 50


def test_reader_that_refuses_a_valid_input_is_a_mistake_of_the_target() -> None:
    target = Target(name="toy", seeds=lambda folder: [Seed(b"a")], read=_read, mutate=mutate.binary)
    with pytest.raises(RuntimeError, match="toy refuses a valid input"):
        fuzz(target, 0, 1, key=0)


def test_counts_of_targets_and_rounds_are_added() -> None:
    first, second = Counts(inputs=2, crashes=1, peak_mb=3.0, findings={"x": 1}), Counts(inputs=3, findings={"x": 2})
    assert total({"a": first, "b": second})["inputs"] == 5
    first.add(second)
    assert (first.inputs, first.crashes, first.findings, first.peak_mb) == (5, 1, {"x": 3}, 3.0)
    assert not first.ok
    assert as_mapping({"a": first})["a"]["inputs"] == 5
