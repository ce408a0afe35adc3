import json
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.monitor.link import RunAddress
from readygo.apps.monitor.subject import Subject, subject_at, subjects_of
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.dataset.places import note_folders
from readygo.common.errors import BusError, DatasetError, RunError
from readygo.runs.folder import RunFolder


def test_a_folder_without_its_run_shows_its_episodes(data: Path) -> None:
    (subject,) = subjects_of(data)
    subject.read_scene()
    assert (subject.name, subject.house, subject.link) == ("data", None, None)
    assert subject.recorded is not None
    track = subject.track(next(iter(subject.recorded.episodes())))
    assert track is not None
    assert subject.robot.radius_m > 0


def test_what_is_no_data_says_so(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="does not exist"):
        subjects_of(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match="no finished shards"):
        subjects_of(tmp_path)
    with pytest.raises(BusError, match="No router answers"):
        subject_at(RunAddress(free_endpoint(), "run-a", ""))


def test_scene_that_is_gone_is_noted_and_the_rest_is_shown(data: Path, spec) -> None:
    folder = RunFolder(data)
    folder.state.mkdir()
    folder.save(spec, 3)
    (subject,) = subjects_of(data)
    subject.read_scene()
    assert subject.house is None
    assert "/nowhere" in subject.note or "No fleet" in subject.note
    assert subject.recorded is not None
    note_folders(data, {"r1": data / "disk"})
    subject.recorded.episodes()
    assert subject.notes == f"{subject.note} {subject.recorded.absent}"


def test_a_run_that_learns_shows_its_curves(data: Path, tmp_path: Path, spec) -> None:
    run = tmp_path / "run"
    (run / "data").mkdir(parents=True)
    data.rename(run / "data" / "flat")
    (run / "learn.json").write_text("{}")
    (run / "policy").mkdir()
    history = [{"step": 1, "samples": 100, "train_loss": 2.0, "validation_loss": 3.0}]
    (run / "policy" / "progress.json").write_text(json.dumps({"history": history}))
    measurement = {"fraction": 0.5, "policy": "ab", "episodes": 4, "static": 0.5, "dynamic": 0.25}
    point = {"minutes": 2.0, "recorded": 10, "learned": 100, "policies": 1, "driven": 0.75, "measurement": measurement}
    (run / "curve.json").write_text(json.dumps({"points": [point]}))
    (subject,) = subjects_of(run)
    assert subject.name == "flat"
    assert [(curve.name, curve.y.tolist()) for curve in subject.losses()] == [
        ("training", [2.0]),
        ("held out", [3.0]),
    ]
    assert [(c.name, c.y.tolist()) for c in subject.success()] == [
        ("driving", [0.75]),
        ("static", [0.5]),
        ("dynamic", [0.25]),
    ]
    assert np.all(subject.success()[0].x == 2.0)


def test_a_run_that_is_only_heard_shows_what_was_heard() -> None:
    subject = Subject("run")
    subject.read_scene()
    assert "--scene" in subject.note, "nobody says where it is"
    assert subject.losses() == []
    assert subject.success() == []
    subject.watch.losses.add(10, (1.0, 2.0))
    subject.watch.driven.add(1, (0.5,))
    assert [curve.name for curve in subject.losses()] == ["training", "held out"]
    assert [curve.name for curve in subject.success()] == ["driving"]
