from pathlib import Path

import pytest

from readygo.apps.coverage.summary import dataset_summary
from readygo.common.dataset import Dataset


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
