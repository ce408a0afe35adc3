"""The folder of an evaluation: what survives, who may go on."""

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import RunError
from readygo.services.evaluator import (
    POLICY,
    STRAIGHT_LINE,
    EvaluateRequest,
    Task,
    handle_evaluate,
    is_of,
    open_results,
    read_results,
)
from tests.services.evaluator.conftest import GoalSeeker

SETTINGS = {"scene": "ab", "config": {"episode": {"time_limit_s": 50.0}}, "policy": ""}
REQUEST = EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY, STRAIGHT_LINE), episodes=3)


class StopError(Exception):
    pass


def stop_after(count):
    left = [count]

    def report(record) -> None:
        left[0] -= 1
        if not left[0]:
            raise StopError

    return report


def test_evaluation_that_is_stopped_goes_on_and_ends_as_one_that_was_not(make_evaluator, tmp_path):
    whole = handle_evaluate(make_evaluator(), REQUEST)
    with pytest.raises(StopError), open_results(tmp_path, SETTINGS) as results:
        handle_evaluate(make_evaluator(), REQUEST, report=stop_after(2), results=results)
    assert len((tmp_path / "episodes.jsonl").read_text().splitlines()) == 2
    driven = []
    with open_results(tmp_path, SETTINGS) as results:
        assert len(results.records) == 2
        keep, results.keep = results.keep, lambda record, run: (driven.append(record.key), keep(record, run))
        reply = handle_evaluate(make_evaluator(), REQUEST, results=results)
    assert len(driven) == 4
    assert reply.records == whole.records
    assert reply.summaries == whole.summaries


def test_what_is_kept_is_told_and_more_is_driven_when_more_is_asked_for(make_evaluator, tmp_path):
    told = []
    for episodes in (1, 3):
        request = EvaluateRequest(tasks=(Task.STATIC,), methods=(STRAIGHT_LINE,), episodes=episodes)
        with open_results(tmp_path, SETTINGS) as results:
            handle_evaluate(make_evaluator(), request, report=told.append, results=results)
    assert [record.episode.index for record in told] == [0, 0, 2, 4]
    assert len((tmp_path / "episodes.jsonl").read_text().splitlines()) == 3


def test_commands_are_kept_to_the_last_bit(make_evaluator, tmp_path):
    with open_results(tmp_path, SETTINGS) as results:
        reply = handle_evaluate(make_evaluator(policy=GoalSeeker()), REQUEST, results=results)
        keys = [record.key for record in reply.records]
        actions = results.actions(keys)
        assert set(actions) == set(keys)
        assert results.actions([]) == {}
    lines = [json.loads(line) for line in (tmp_path / "trajectories.jsonl").read_text().splitlines()]
    assert len(lines) == len(keys)
    record = reply.records[0]
    assert len(actions[record.key]) * 0.05 == pytest.approx(record.result.duration_s)
    assert len(lines[0]["xyyaw"]) == len(lines[0]["actions"])
    assert actions[record.key].dtype == np.float64


def test_half_a_line_is_cut_off_and_its_episode_driven_again(make_evaluator, tmp_path):
    with open_results(tmp_path, SETTINGS) as results:
        handle_evaluate(make_evaluator(), REQUEST, results=results)
    for name in ("episodes.jsonl", "trajectories.jsonl"):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[:-7])
    with open_results(tmp_path, SETTINGS) as results:
        assert len(results.records) == 5
        reply = handle_evaluate(make_evaluator(), REQUEST, results=results)
        assert len(results.actions([record.key for record in reply.records])) == 6
    assert (tmp_path / "trajectories.jsonl").read_bytes() == whole


def test_other_settings_are_refused_in_a_line_that_names_them(tmp_path):
    with open_results(tmp_path, SETTINGS):
        pass
    other = {**SETTINGS, "config": {"episode": {"time_limit_s": 40.0}}, "policy": "0123456789abcdef0123"}
    assert is_of(tmp_path, SETTINGS)
    assert not is_of(tmp_path, other)
    named = r"config\.episode\.time_limit_s 50\.0 \(now: 40\.0\), policy none"
    with pytest.raises(RunError, match=named) as caught, open_results(tmp_path, other):
        pass
    assert "\n" not in str(caught.value)


def test_methods_that_are_files_stay_what_they_were_and_others_join(tmp_path):
    hashes = {"a.py:A": "11", "gnm": "22"}
    with open_results(tmp_path, SETTINGS):
        pass
    for names in (["a.py:A"], ["gnm"], []):
        with open_results(tmp_path, {**SETTINGS, "methods": {name: hashes[name] for name in names}}):
            pass
    assert json.loads((tmp_path / "settings.json").read_text())["methods"] == hashes
    edited = {**SETTINGS, "methods": {"a.py:A": "33", "b.py:B": "44"}}
    assert not is_of(tmp_path, edited)
    with pytest.raises(RunError, match=r"methods\.a\.py:A 11 \(now: 33\)"), open_results(tmp_path, edited):
        pass
    assert json.loads((tmp_path / "settings.json").read_text())["methods"] == hashes


def test_folder_of_something_else_or_in_use_or_broken_is_refused(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "episodes.jsonl").write_text("")
    with pytest.raises(RunError, match="do not say how they came"), open_results(tmp_path / "old", SETTINGS):
        pass
    new = tmp_path / "new"
    with open_results(new, SETTINGS), pytest.raises(RunError, match="Another process"), open_results(new, SETTINGS):
        pass
    (tmp_path / "new" / "episodes.jsonl").write_text("no record\n")
    with pytest.raises(RunError, match="broken in line 1"), open_results(tmp_path / "new", SETTINGS):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="cannot be written"), open_results(tmp_path / "file", SETTINGS):
        pass


def test_damaged_line_is_named_where_it_is_read(make_evaluator, tmp_path):
    with open_results(tmp_path, SETTINGS) as results:
        kept = handle_evaluate(make_evaluator(), REQUEST, results=results).records
    trajectories = tmp_path / "trajectories.jsonl"
    trajectories.write_text(trajectories.read_text().replace('"actions": [', '"actions": ["fast", ', 1))
    with (
        read_results(tmp_path) as results,
        pytest.raises(RunError, match=r"trajectories\.jsonl holds no trajectory in"),
    ):
        results.actions([record.key for record in kept])
    records = tmp_path / "episodes.jsonl"
    first, *others = records.read_text().splitlines(keepends=True)
    records.write_text("".join([first, json.dumps({**json.loads(others[0]), "duration_s": "abc"}) + "\n"]))
    with (
        pytest.raises(RunError, match="holds no record in line 2: duration_s must be a finite"),
        read_results(tmp_path),
    ):
        pass


@contextlib.contextmanager
def small_disk():
    """No file may grow beyond 12 kB: not a fixture, for pytest's own report may be such a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def test_full_disk_ends_in_a_line_and_what_was_kept_stays(make_evaluator, tmp_path):
    with open_results(tmp_path, SETTINGS) as results:
        with (
            small_disk(),
            pytest.raises(RunError, match=r"cannot be written: .*; \d episodes are kept, the same command resumes"),
        ):
            handle_evaluate(make_evaluator(lockstep=1), REQUEST, results=results)
        kept = set(results.records)
    assert 0 < len(kept) < 6
    with open_results(tmp_path, SETTINGS) as results:
        assert set(results.records) == kept
        assert set(results.actions(kept)) == kept


def test_line_that_a_full_disk_cut_short_leaves_nothing_before_the_next_one(make_evaluator, tmp_path):
    driven = []
    with open_results(tmp_path / "first", SETTINGS) as results:
        results.keep = lambda record, run: driven.append((record, run))
        handle_evaluate(make_evaluator(lockstep=1), REQUEST, results=results)
    with open_results(tmp_path, SETTINGS) as results:
        (tmp_path / "trajectories.jsonl").write_bytes(b"{}" + b" " * 11_900 + b"\n")
        with small_disk(), pytest.raises(RunError, match="cannot be written"):
            results.keep(*driven[0])
        results.keep(*driven[1])
    with open_results(tmp_path, SETTINGS) as results:
        assert set(results.records) == {driven[1][0].key}
    assert len((tmp_path / "trajectories.jsonl").read_text().splitlines()) == 2


KILLED = """
import os, signal, sys
from pathlib import Path
from readygo.services.evaluator import open_results
from readygo.services.evaluator.records import record_of_mapping
mapping = {"seed": 0, "split": "test", "index": 3, "task": "static", "method": "policy", "outcome": "success",
           "duration_s": 1.0, "path_length_m": 1.0, "shortest_m": 1.0, "human_distance_min_m": None}
with open_results(Path(sys.argv[1]), {}) as results:
    results.keep(record_of_mapping(mapping), None)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_episode_that_was_kept_survives_a_kill(tmp_path):
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], env={**os.environ, "PYTHONPATH": str(root)}, check=False
    )
    assert done.returncode == -signal.SIGKILL
    with open_results(tmp_path, {}) as results:
        assert [episode.index for _, _, episode in results.records] == [3]


@pytest.mark.parametrize("text", ["3", '{"methods": 3}', "[" * 100_000, '{"seed": ' + "9" * 5000 + "}"])
def test_settings_of_another_shape_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "settings.json").write_text(text)
    with pytest.raises(RunError, match=r"settings\.json cannot be read"), open_results(tmp_path, {"seed": 1}):
        pass


def test_results_are_read_while_they_are_written_and_stay_as_they_are(make_evaluator, tmp_path):
    with open_results(tmp_path, SETTINGS) as results:
        handle_evaluate(make_evaluator(), REQUEST, results=results)
        results.finish({"sees": ["rgb", "depth"]})
        with (tmp_path / "episodes.jsonl").open("a") as file:
            file.write('{"torn')
        before = (tmp_path / "episodes.jsonl").read_bytes()
        with read_results(tmp_path) as read:
            assert read.records == results.records
            assert read.settings() == SETTINGS
            assert read.sees() == ("rgb", "depth")
            key = next(iter(read.records))
            assert np.array_equal(read.actions([key])[key], results.actions([key])[key])
        assert (tmp_path / "episodes.jsonl").read_bytes() == before


@pytest.mark.parametrize("summary", [None, "[]", '{"sees": 3}', "{", '{"policy": ""}'])
def test_summary_that_says_nothing_of_images_names_none(tmp_path, summary):
    with open_results(tmp_path, SETTINGS):
        pass
    if summary is not None:
        (tmp_path / "summary.json").write_text(summary)
    with read_results(tmp_path) as read:
        assert read.sees() == ()


def test_folder_without_results_or_settings_is_refused(tmp_path):
    with pytest.raises(RunError, match="holds no results"), read_results(tmp_path):
        pass
    with open_results(tmp_path, SETTINGS):
        pass
    (tmp_path / "settings.json").write_text("{")
    with read_results(tmp_path) as read, pytest.raises(RunError, match=r"settings\.json cannot be read"):
        read.settings()
