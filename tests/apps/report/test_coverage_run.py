import contextlib
import dataclasses
import sqlite3
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.commands.coverage import CoverageOptions, coverage
from readygo.apps.report.coverage_numbers import casts_of, measure
from readygo.apps.report.coverage_run import failed_encounters, gather, page_numbers, rejection_reasons, robot_map
from readygo.common.dataset import Dataset, ShardWriter, encode_episode, shard_name
from readygo.common.dataset.casts import Cast
from readygo.common.errors import RunError
from readygo.common.maps import OccupancyMap, save_ros_map
from readygo.common.messages import HumanPlanRequest, Split
from readygo.common.scenes import save_scene
from readygo.runs.folder import RunFolder
from readygo.services.planner import handle_human_plan
from tests.apps.report.drives import drive
from tests.common.dataset.episodes import PROVENANCE
from tests.common.maps.room import sheet
from tests.common.messages.run_specs import SPEC
from tests.common.scenes.small_room import small_room
from tests.services.planner.worlds import key, make_human_planner


def test_other_scene_than_the_datas_is_refused(data, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(
        "readygo.apps.report.coverage_run.open_maps", lambda scene: (None, type("S", (), {"content_hash": "x"})())
    )
    folder = tmp_path / "hashed"
    folder.mkdir()
    with ShardWriter(folder / shard_name("r0", 0), PROVENANCE, fsync=False) as writer:
        header, samples = drive(0, yaw_rad=0.0, gaps_m=[1.0])
        writer.append(encode_episode(header, 1, samples))
    with pytest.raises(RunError, match="recorded in another scene"):
        coverage(CoverageOptions(data=folder, out=tmp_path / "out", scene="elsewhere"))


def test_failures_are_told_by_the_scenarios_of_rejected_indices(data, monkeypatch) -> None:
    planner = make_human_planner()
    drawn = [handle_human_plan(planner, HumanPlanRequest(episode=key(k))).scenario for k in range(6)]
    kinds = {k: tuple(human.encounter for human in scenario.humans) for k, scenario in enumerate(drawn) if scenario}
    recorded, failed, *_ = sorted(kinds)
    spec = SimpleNamespace(seed=1, split=Split.TEST, static=False)
    monkeypatch.setattr("readygo.apps.report.coverage_run.load_spec", lambda data: spec)
    monkeypatch.setattr(
        "readygo.apps.report.coverage_run.World", lambda spec: SimpleNamespace(human_planner=lambda: planner)
    )
    cast = Cast(episode=key(recorded), avatars=(), encounters=kinds[recorded])
    reasons = {failed: "timeout", 99: "no room for a human"}
    assert failed_encounters(data, reasons, [cast]) == {kind: {"timeout": 1} for kind in sorted(set(kinds[failed]))}
    other = dataclasses.replace(cast, encounters=("teleport",))
    assert failed_encounters(data, reasons, [other]) is None


def test_folder_without_a_run_knows_no_failures(data) -> None:
    assert rejection_reasons(data) is None
    assert failed_encounters(data, {}, []) is None


def test_ledger_that_is_damaged_or_of_another_layout_tells_no_failures(tmp_path) -> None:
    folder = RunFolder(tmp_path)
    with folder.lock():
        folder.ledger.write_bytes(b"no ledger at all " * 500)
        assert rejection_reasons(tmp_path) is None
        folder.ledger.unlink()
        with contextlib.closing(sqlite3.connect(folder.ledger)) as other:
            other.executescript("CREATE TABLE episode (idx); PRAGMA user_version = 99")
        assert rejection_reasons(tmp_path) is None


def test_map_is_that_of_the_runs_scene_unless_another_one_lies_there_now(tmp_path) -> None:
    sky = sheet((-50, -50, -5), (100, 0, 0), (0, 100, 0), spacing_m=10)
    scene = save_scene(small_room(), sky, tmp_path / "room", license="CC0")
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
        folder.save(dataclasses.replace(SPEC, scene_path=str(scene.path)), 3)
    found = robot_map(folder.path, "", scene.content_hash)
    assert found is not None
    assert np.array_equal(found.occupied, scene.maps.robot.occupied)
    assert robot_map(folder.path, "", "ab" * 32) is None
    assert robot_map(tmp_path / "nowhere", "", scene.content_hash) is None


def test_shards_alone_know_neither_map_nor_failures(data: Path) -> None:
    dataset = Dataset([data])
    casts = casts_of(dataset)
    facts = gather(data, dataset, casts, measure(dataset, casts), "")
    assert (facts.name, facts.scene) == ("data", "plaza")
    assert facts.occupancy is facts.visited_share is facts.rejected is facts.failed is None
    assert facts.provenance == {
        "data": dataset.content_hash,
        "scene": "ab" * 32,
        "readygo_version": "0.1.0",
        "commit": "0" * 40,
    }


def test_run_and_map_add_shares_and_reasons(
    data: Path, room: OccupancyMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_ros_map(room, tmp_path / "room.yaml")
    monkeypatch.setattr(
        "readygo.apps.report.coverage_run.rejection_reasons", lambda data: {3: "timeout", 5: "no way", 9: "timeout"}
    )
    monkeypatch.setattr(
        "readygo.apps.report.coverage_run.failed_encounters",
        lambda data, reasons, casts: {"crossing": {"timeout": len(reasons)}},
    )
    dataset = Dataset([data])
    casts = casts_of(dataset)
    facts = gather(data, dataset, casts, measure(dataset, casts), str(tmp_path / "room.yaml"))
    assert facts.rejected == {"no way": 1, "timeout": 2}
    assert facts.failed == {"crossing": {"timeout": 3}}
    assert 0.0 < facts.visited_share < 0.2


def test_numbers_tell_what_is_known_and_leave_the_rest_open(data: Path) -> None:
    dataset = Dataset([data])
    casts = casts_of(dataset)
    coverage = measure(dataset, casts)
    facts = gather(data, dataset, casts, coverage, "")
    numbers = page_numbers(coverage, facts, dataset)
    assert (numbers["episodes"], numbers["samples"], numbers["distance_m"]) == (3, 60, 3.0)
    assert numbers["encounters"]["crossing"] == {"episodes": 2, "people": 2, "failed": None}
    assert sum(numbers["heading_rad"]["counts"]) == 60
    known = dataclasses.replace(facts, failed={"crossing": {"timeout": 1}})
    encounters = page_numbers(coverage, known, dataset)["encounters"]
    assert encounters["crossing"]["failed"] == {"timeout": 1}
    assert encounters["parallel"]["failed"] == {}
