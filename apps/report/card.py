"""A dataset in words: its summary in a few numbers, and its card, the README.md of its folder."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from readygo.apps.pictures.side_by_side import camera_name, has_several
from readygo.apps.report.coverage_numbers import Coverage
from readygo.apps.report.page import draw
from readygo.common.dataset import Dataset, recorded_clarity
from readygo.common.dataset.aside import read_set_aside
from readygo.common.images.names import DEPTH, RGB, cameras_of, kind_of
from readygo.common.robot import RobotConfig

CARD_FILE = "README.md"
FRAMES_FILE, CAMERAS_FILE, VISITS_FILE = "card/frames.jpg", "card/cameras.jpg", "card/visits.png"
_NOT_SHOWN = ("folder", "licenses", "content hash", "made by")
"""Lines of the summary that the card shows elsewhere."""


def dataset_summary(dataset: Dataset, data: Path) -> dict[str, Any]:
    """Summarise a dataset: sizes, outcomes and drivers, and provenance.

    Args:
        dataset: The dataset.
        data: Data folder of the dataset.
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
        "hours": round(len(dataset) / dataset.clock.rate_hz / 3600, 4),
        "shards": len(dataset.shards),
        "samples_per_shard_min": min(samples_per_shard.values()),
        "samples_per_shard_max": max(samples_per_shard.values()),
        "size_bytes": sum(shard.stat().st_size for shard in dataset.shards),
        "image_height_px": dataset.height_px,
        "image_width_px": dataset.width_px,
        "outputs": list(dataset.outputs),
        "depth": dataset.provenance.depth if any(kind_of(name) == DEPTH for name in dataset.outputs) else None,
        "cameras": _cameras(dataset),
        "labels": list(dataset.labels),
        "speed_mean_mps": round(float(dataset.actions[:, 0].mean()), 3),
        "human_visible_fraction": round(float(truth["human_visible"].mean()), 3),
        "human_distance_min_m": round(float(with_human.min()), 3) if len(with_human) else None,
        "clarity": recorded_clarity(dataset).to_mapping(),
        "set_aside": read_set_aside(data),
        "replans": int(truth["replanned"].sum()),
        "content_hash": dataset.content_hash,
        **dict(sorted(recorded.items())),
        "config": {name: config.get(name) for name in ("robot", "episode")},
    }


def summary_lines(summary: Mapping[str, Any]) -> dict[str, str]:
    """A summary as lines for one screen: text by name.

    Args:
        summary: Result of `dataset_summary`.
    """
    clarity, scene, avatars = summary["clarity"], summary["scene"], summary.get("avatars", {})
    blurred, nearest = clarity["episodes_blurred"], summary["human_distance_min_m"]
    labels = f"; labels: {', '.join(summary['labels'])}" if summary["labels"] else ""

    def name_output(output: str) -> str:
        return f"{output} ({summary['depth']})" if kind_of(output) == DEPTH else output

    lines = {
        "folder": f"{summary['folder']}, {summary['shards']} shards, {summary['size_bytes'] / 1e6:.1f} MB",
        "episodes": f"{summary['episodes']:,} ({', '.join(summary['splits'])})",
        "samples": f"{summary['samples']:,}, {60 * summary['hours']:.1f} min",
        "images": f"{_sizes(summary)}, {', '.join(map(name_output, summary['outputs']))}{labels}",
        "sharpness": f"median {clarity['sharpness_median']:.0f}, 5 % below {clarity['sharpness_5_percent']:.0f}; "
        f"{blurred} of {clarity['episodes_looked_at']} episodes blurred",
        "driving": f"{summary['speed_mean_mps']:.2f} m/s on average, {summary['replans']:,} replans",
        "humans": f"in view at {100 * summary['human_visible_fraction']:.0f} % of samples"
        + ("" if nearest is None else f", nearest {nearest:.2f} m"),
        "scene": f"{scene['name'] or 'unknown'} {scene['hash'][:16]}",
        "avatars": ", ".join(sorted(avatars)) or "none",
        "licenses": _licenses([scene, *avatars.values()]),
        "robot": _robot_line(summary["config"]["robot"] or {}),
        "made by": _made_by(summary),
        "content hash": summary["content_hash"],
    }
    if summary["set_aside"]:
        lines["set aside"] = f"episodes {', '.join(map(str, summary['set_aside']))}: see `readygo validate`"
    return lines | _others(summary)


def card_text(name: str, dataset: Dataset, summary: Mapping[str, Any], measured: Coverage) -> str:
    """The card of a dataset in Markdown, which the Hugging Face Hub shows as well.

    Args:
        name: Name of the dataset.
        dataset: The dataset.
        summary: Result of `dataset_summary`.
        measured: Coverage of the dataset.
    """
    return draw(
        "card.md",
        "card",
        name=name,
        about=f"{measured.episodes:,} episodes of a robot that drives to goals among people: {measured.samples:,} "
        f"samples at {dataset.clock.rate_hz} Hz, {measured.hours:.2f} h, {measured.distance_m / 1000:.2f} km.",
        facts={key: words for key, words in summary_lines(summary).items() if key not in _NOT_SHOWN},
        balance=_balance(dataset, measured),
        licenses=_license_rows(summary),
        origin=_origin_rows(summary),
        frames=FRAMES_FILE,
        cameras=CAMERAS_FILE if has_several(dataset) else "",
        visits=VISITS_FILE,
        output=next((output for output in reversed(dataset.outputs) if output != RGB), ""),
    )


def _licenses(parts: Iterable[Mapping[str, Any]]) -> str:
    """All licenses without duplicates, as text."""
    return "; ".join(dict.fromkeys(str(part["license"]) or "not given" for part in parts))


def _cameras(dataset: Dataset) -> dict[str, list[int]]:
    """Height and width of the images of each camera [px], the first one first."""
    robot = dataset.robot or RobotConfig()
    seen = ((camera, dataset.calibration(0, camera)) for camera in cameras_of(dataset.outputs))
    return {camera_name(camera, robot): [of.height_px, of.width_px] for camera, of in seen}


def _sizes(summary: Mapping[str, Any]) -> str:
    cameras = {name: f"{height}x{width}" for name, (height, width) in summary["cameras"].items()}
    if len(cameras) == 1:
        return "".join(cameras.values())
    return ", ".join(f"{name} {size}" for name, size in cameras.items())


def _robot_line(robot: Mapping[str, Any]) -> str:
    words = [f"{name} = {robot[name]:g}" for name in ("radius_m", "v_max_mps", "w_max_radps") if name in robot]
    cameras = {robot.get("camera_name", ""): robot.get("camera", {}), **robot.get("cameras", {})}
    for name, camera in cameras.items():
        if "mount_height_m" in camera:
            words.append(_camera_words(camera, f"camera {name}" if len(cameras) > 1 else "camera"))
    return ", ".join(words) or "not named"


def _camera_words(camera: Mapping[str, Any], name: str) -> str:
    span_deg, yaw_deg = camera.get("horizontal_fov_deg"), camera.get("mount_yaw_deg", 0.0)
    lens = f"{span_deg:g} deg" if span_deg else "custom intrinsics"
    turned = f" that looks {abs(yaw_deg):g} deg to the {'left' if yaw_deg > 0 else 'right'}" if yaw_deg else ""
    return f"{name} at {camera['mount_height_m']:g} m with {lens}{turned}"


def _made_by(summary: Mapping[str, Any]) -> str:
    words = [f"readygo {summary['readygo_version']}"] if summary.get("readygo_version") else []
    words += [f"commit {summary['commit'][:12]}"] if summary.get("commit") else []
    words += [f"seed {summary['seed']}"] if summary.get("seed") is not None else []
    return ", ".join(words) or "unknown"


def _others(summary: Mapping[str, Any]) -> dict[str, str]:
    """Lines for content that only few datasets have."""
    named = {"scenarios": "sha256", "policy": "sha256"}
    found = {name: summary[name] for name in named if summary.get(name)}
    return {name: f"{value.get('name', '')} {str(value[named[name]])[:16]}".strip() for name, value in found.items()}


def _balance(dataset: Dataset, measured: Coverage) -> list[tuple[str, ...]]:
    """Shares of episodes by outcome, driver and kind of encounter."""
    counts = {
        "outcome": Counter(entry.outcome.value for entry in dataset.episodes),
        "driver": Counter(entry.driver.value for entry in dataset.episodes),
        "split": Counter(entry.episode.split.value for entry in dataset.episodes),
        "encounter": Counter({kind: count for kind, (count, _) in measured.encounters.items()}),
        "avatar": Counter(measured.avatars),
    }
    return [
        (what, value, f"{count:,}", f"{100 * count / measured.episodes:.0f} %")
        for what, found in counts.items()
        for value, count in found.most_common()
    ]


def _license_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    scene = summary["scene"]
    by_license: dict[str, list[str]] = {}
    for name, avatar in sorted(summary.get("avatars", {}).items()):
        by_license.setdefault(avatar["license"] or "not given", []).append(name)
    avatars = [("avatars", ", ".join(names), license) for license, names in by_license.items()]
    return [("scene", scene["name"] or "unknown", scene["license"] or "not given"), *avatars]


def _origin_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Versions, seed and hashes."""
    named = ("readygo_version", "commit", "numeric_class", "seed", "content_hash")
    rows = [(name.replace("_", " "), f"`{summary[name]}`") for name in named if summary.get(name) not in (None, "")]
    return rows + [("scene", f"`{summary['scene']['hash']}`")] * bool(summary["scene"].get("hash"))
