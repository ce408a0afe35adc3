"""What a dataset holds, in a few numbers."""

from collections import Counter
from pathlib import Path
from typing import Any

from readygo.common.dataset import Dataset
from readygo.common.robot.kinematics import RATE_HZ


def dataset_summary(dataset: Dataset, data: Path) -> dict[str, Any]:
    """What a dataset holds: sizes, how robots drove, and what it was made of.

    Args:
        dataset: The dataset.
        data: Its folder.
    """
    truth = dataset.truth
    with_human = truth["human_distance_m"][truth["human_distance_m"] < float("inf")]
    samples_per_shard = Counter(entry.shard for entry in dataset.episodes for _ in range(entry.sample_count))
    recorded = dataset.provenance.to_mapping()
    config = recorded.pop("config", {})
    return {
        "folder": str(data),
        "episodes": len(dataset.episodes),
        "splits": sorted({entry.episode.split.value for entry in dataset.episodes}),
        "samples": len(dataset),
        "hours": round(len(dataset) / RATE_HZ / 3600, 4),
        "shards": len(dataset.shards),
        "samples_per_shard_min": min(samples_per_shard.values()),
        "samples_per_shard_max": max(samples_per_shard.values()),
        "size_bytes": sum(shard.stat().st_size for shard in dataset.shards),
        "image_height_px": dataset.height_px,
        "image_width_px": dataset.width_px,
        "outputs": list(dataset.outputs),
        "labels": list(dataset.labels),
        "speed_mean_mps": round(float(dataset.actions[:, 0].mean()), 3),
        "human_visible_fraction": round(float(truth["human_visible"].mean()), 3),
        "human_distance_min_m": round(float(with_human.min()), 3) if len(with_human) else None,
        "replans": int(truth["replanned"].sum()),
        "content_hash": dataset.content_hash,
        **dict(sorted(recorded.items())),
        "config": {name: config.get(name) for name in ("robot", "episode")},
    }
