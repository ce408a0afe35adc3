import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from readygo.apps.report.card import card_text, dataset_summary, summary_lines
from readygo.common.dataset import Dataset
from tests.apps.report.drives import measured
from tests.common.dataset.episodes import PROVENANCE, write_shard


def test_card_says_counts_balance_licenses_and_origin(data: Path) -> None:
    dataset = Dataset([data])
    text = card_text("plaza", dataset, dataset_summary(dataset, data), measured(data))
    assert text.startswith("---\ntask_categories:\n- robotics\n")
    assert "# plaza\n" in text
    assert "3 episodes of a robot that drives to goals among people: 60 samples" in text
    assert "| outcome | success | 3 | 100 % |" in text
    assert "| encounter | crossing | 2 | 67 % |" in text
    assert "| scene | plaza | CC0 |" in text
    assert f"`{dataset.content_hash}`" in text
    assert str(data) not in text


def test_card_and_summary_look_as_they_did(data: Path, golden_page: Callable[[str, str], None]) -> None:
    dataset = Dataset([data])
    summary = {**dataset_summary(dataset, data), "folder": "data", "size_bytes": 4_560_000, "content_hash": "abc"}
    golden_page("card", card_text("plaza", dataset, summary, measured(data)))
    camera = {"mount_height_m": 0.7, "horizontal_fov_deg": 95.0}
    crooked = {
        **summary,
        "episodes": 12345, "samples": 2_345_678, "hours": 32.5791, "labels": ["boxes", "joints"],
        "cameras": {"front": [72, 128], "left": [36, 64]}, "human_distance_min_m": None, "seed": 7,
        "readygo_version": "1.2", "commit": "0123456789abcdef", "human_visible_fraction": 0.126,
        "config": {"robot": {
            "radius_m": 0.31, "v_max_mps": 1.5, "camera_name": "front", "camera": camera,
            "cameras": {
                "left": {"mount_height_m": 0.4, "mount_yaw_deg": 75.0}, "right": {**camera, "mount_yaw_deg": -60.5},
            },
        }},
        "scene": {"name": "", "hash": "0123456789abcdef01234567", "license": ""},
        "avatars": {"bob": {"license": "CC0"}, "ann": {"license": ""}, "cyd": {"license": "CC0"}},
        "scenarios": {"name": "", "sha256": "f" * 64}, "policy": {"name": "best", "sha256": "e" * 64},
        "clarity": {
            "episodes_blurred": 3, "episodes_looked_at": 40, "sharpness_median": 321.6, "sharpness_5_percent": 98.4,
        },
    }  # fmt: skip
    lines = [f"{name}: {words}" for name, words in summary_lines(crooked).items()]
    golden_page("card_crooked", card_text("hall", dataset, crooked, measured(data)) + "\n".join(lines) + "\n")


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


@pytest.mark.parametrize(("renderer", "depth"), [({"depth": "mean"}, "mean"), ({}, "median")])
def test_summary_says_which_depth_was_recorded(tmp_path: Path, renderer: dict[str, str], depth: str) -> None:
    provenance = dataclasses.replace(PROVENANCE, config={**PROVENANCE.config, "renderer": renderer})
    write_shard(tmp_path, [0], outputs=("depth", "mask"), provenance=provenance)
    summary = dataset_summary(Dataset([tmp_path]), tmp_path)
    assert summary["depth"] == depth
    assert f", rgb, depth ({depth}), mask" in summary_lines(summary)["images"]
