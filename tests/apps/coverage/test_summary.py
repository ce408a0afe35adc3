import dataclasses
from pathlib import Path

import pytest

from readygo.apps.coverage.summary import dataset_summary, summary_lines
from readygo.common.dataset import Dataset
from tests.common.dataset.episodes import PROVENANCE, write_shard


def test_summary_counts_what_the_shards_hold(data: Path) -> None:
    summary = dataset_summary(Dataset([data]), data)
    assert (summary["episodes"], summary["samples"], summary["shards"]) == (3, 60, 1)
    assert (summary["samples_per_shard_min"], summary["samples_per_shard_max"]) == (60, 60)
    assert summary["hours"] == pytest.approx(60 / 20 / 3600, abs=1e-4)
    assert summary["size_bytes"] == sum(path.stat().st_size for path in data.glob("*.mcap"))
    assert summary["speed_mean_mps"] == 1.0
    assert summary["human_visible_fraction"] == 0.5
    assert summary["human_distance_min_m"] == pytest.approx(0.6)
    assert summary["splits"] == ["train"]


def test_summary_says_what_it_was_made_of(data: Path) -> None:
    dataset = Dataset([data])
    summary = dataset_summary(dataset, data)
    assert summary["folder"] == str(data)
    assert summary["content_hash"] == dataset.content_hash
    assert summary["scene"]["name"] == "plaza"
    assert set(summary["config"]) == {"robot", "episode"}
    assert summary["config"]["episode"] == {"time_limit_s": 50.0}


@pytest.mark.parametrize(("renderer", "depth"), [({}, "mean"), ({"depth": "median"}, "median")])
def test_summary_says_which_depth_was_recorded(tmp_path: Path, renderer: dict[str, str], depth: str) -> None:
    provenance = dataclasses.replace(PROVENANCE, config={**PROVENANCE.config, "renderer": renderer})
    write_shard(tmp_path, [0], outputs=("depth", "mask"), provenance=provenance)
    summary = dataset_summary(Dataset([tmp_path]), tmp_path)
    assert summary["depth"] == depth
    assert f", rgb, depth ({depth}), mask" in summary_lines(summary)["images"]
