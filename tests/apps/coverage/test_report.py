import dataclasses
from pathlib import Path

import pytest

from readygo.apps.coverage import report
from readygo.apps.coverage.numbers import casts_of, measure
from readygo.apps.coverage.report import gather, page_numbers
from readygo.common.dataset import Dataset
from readygo.common.maps import OccupancyMap, save_ros_map


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
    monkeypatch.setattr(report, "rejected", lambda data: {3: "timeout", 5: "no way", 9: "timeout"})
    monkeypatch.setattr(
        report, "failed_encounters", lambda data, reasons, casts: {"crossing": {"timeout": len(reasons)}}
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
