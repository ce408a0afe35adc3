"""The card of a dataset: the README.md of its folder, which the Hugging Face Hub shows as well."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from readygo.apps.coverage.numbers import Coverage
from readygo.apps.coverage.summary import summary_lines
from readygo.apps.pictures.side_by_side import has_several
from readygo.common.dataset import Dataset
from readygo.common.images.names import RGB

CARD_FILE = "README.md"
FRAMES_FILE, CAMERAS_FILE, VISITS_FILE = "card/frames.jpg", "card/cameras.jpg", "card/visits.png"
_NOT_SHOWN = ("folder", "licenses", "content hash", "made by")
"""Lines of the summary that the card shows elsewhere."""


def card_text(name: str, dataset: Dataset, summary: Mapping[str, Any], measured: Coverage) -> str:
    """The card in Markdown.

    Args:
        name: Name of the dataset.
        dataset: The dataset.
        summary: Result of `dataset_summary`.
        measured: Coverage of the dataset.
    """
    facts = [(key, value) for key, value in summary_lines(summary).items() if key not in _NOT_SHOWN]
    parts = [
        ["---", "task_categories:", "- robotics", "tags:", "- navigation", "- readygo", "---"],
        [f"# {name}", "", _first_sentence(dataset, measured), "", f"![Recorded pictures]({FRAMES_FILE})"],
        ["## What it holds", "", *_table(("", ""), facts), *_cameras(dataset)],
        ["## Balance", "", *_balance(dataset, measured), "", f"![Episodes by place]({VISITS_FILE})"],
        ["## Licenses", "", *_licenses(summary)],
        ["## How it was made", "", *_origin(summary)],
        ["## How to read it", "", *_reading(dataset)],
    ]
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def _reading(dataset: Dataset) -> list[str]:
    further = next((name for name in reversed(dataset.outputs) if name != RGB), None)
    return [
        "The shards are MCAP files: open one in Foxglove or Rerun, or all of them in Python:",
        "",
        "```python",
        "from readygo import Dataset",
        "",
        'data = Dataset(".")',
        "data.actions, data.goals_xy_m, data.decode(0)",
        *([f'data.decode_output(0, "{further}")  # one of data.outputs'] if further else []),
        "```",
        "",
        "`readygo export . --to lerobot --out FOLDER` writes them for other programs.",
    ]


def _cameras(dataset: Dataset) -> list[str]:
    """The section with all images of sample moments; empty for a dataset with one image per moment."""
    return ["", f"![All cameras at some moments]({CAMERAS_FILE})"] if has_several(dataset) else []


def _first_sentence(dataset: Dataset, measured: Coverage) -> str:
    return (
        f"{measured.episodes:,} episodes of a robot that drives to goals among people: {measured.samples:,} samples "
        f"at {dataset.clock.rate_hz} Hz, {measured.hours:.2f} h, {measured.distance_m / 1000:.2f} km."
    )


def _balance(dataset: Dataset, measured: Coverage) -> list[str]:
    """Shares of episodes by outcome, driver and kind of encounter."""
    counts = {
        "outcome": Counter(entry.outcome.value for entry in dataset.episodes),
        "driver": Counter(entry.driver.value for entry in dataset.episodes),
        "split": Counter(entry.episode.split.value for entry in dataset.episodes),
        "encounter": Counter({kind: count for kind, (count, _) in measured.encounters.items()}),
        "avatar": Counter(measured.avatars),
    }
    rows = [
        (what, value, f"{count:,}", f"{100 * count / measured.episodes:.0f} %")
        for what, found in counts.items()
        for value, count in found.most_common()
    ]
    return _table(("", "", "episodes", "share"), rows)


def _licenses(summary: Mapping[str, Any]) -> list[str]:
    scene, avatars = summary["scene"], summary.get("avatars", {})
    rows = [("scene", scene["name"] or "unknown", scene["license"] or "not given")]
    by_license: dict[str, list[str]] = {}
    for name, avatar in sorted(avatars.items()):
        by_license.setdefault(avatar["license"] or "not given", []).append(name)
    rows += [("avatars", ", ".join(names), license) for license, names in by_license.items()]
    return _table(("", "", "license"), rows)


def _origin(summary: Mapping[str, Any]) -> list[str]:
    """Versions, seed and hashes."""
    named = ("readygo_version", "commit", "numeric_class", "seed", "content_hash")
    rows = [(name.replace("_", " "), f"`{summary[name]}`") for name in named if summary.get(name) not in (None, "")]
    rows += [("scene", f"`{summary['scene']['hash']}`")] if summary["scene"].get("hash") else []
    return _table(("", ""), rows)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    names = list(head)
    lines = [f"| {' | '.join(names)} |", f"|{'---|' * len(names)}"]
    return lines + [f"| {' | '.join(str(cell).replace('|', '/') for cell in row)} |" for row in rows]
