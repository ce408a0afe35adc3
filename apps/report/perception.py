"""The page of a run that learned to perceive: how it drives, what it sees, commands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.report.page import Block, CommandLine, PageLink, Paragraph, fact_table, page, percent
from readygo.apps.report.tables import DriverScore, people_note, success_rates
from readygo.common.files import write_whole

_DECIDES = {
    "perceive-and-plan": "The expert plans among them.",
    "perceive-and-act": "A policy that learned by reinforcement decides.",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PerceptionContent:
    """Everything in a report."""

    title: str
    method: str
    """The chosen driver."""
    val: Mapping[str, float]
    """Success rates of the drivers that it was chosen from; empty without a choice."""
    scores: Sequence[DriverScore]
    """Scores of all drivers, without a test none."""
    metrics: Mapping[str, Any]
    """What `metrics.json` of the network holds."""
    minutes: float
    """Wall time of recording and training [min]."""
    unseen: bool
    """True if the people of the test do not walk in the data."""
    pages: Sequence[PageLink]
    """Pages of the test episodes."""
    commands: Sequence[CommandLine]


def perception_html(content: PerceptionContent) -> str:
    """The page as HTML text."""
    metrics = content.metrics
    tiles = [(f"{content.minutes:.0f} min", "recorded and trained"), (f"{metrics['images']:,}", "images")]
    dynamic = [score for score in content.scores if score.driver == content.method and score.task != "static"]
    tiles += [(percent(score.summary.success_rate), f"success {score.task}") for score in dynamic]
    driving: list[Block] = success_rates(content.scores, watched=content.method) if content.scores else []
    if content.pages:
        driving.append(Paragraph(text=people_note(unseen=content.unseen)))
        driving.append(Paragraph(text="All test episodes, with the failures:", links=content.pages))
    return page(
        content.title,
        "The robot knows the map of the place. A network tells people and free space from three images, and a tracker "
        f"follows the people. {_DECIDES.get(content.method, '')}",
        tiles=tiles,
        sections={
            "Driving": driving,
            "Why this driver": [Paragraph(text=reason(content))],
            "Perception": [fact_table(perception_facts(metrics))],
            "Commands": list(content.commands),
        },
        facts={"network": f"{metrics['parameters']:,} parameters"},
    )


def reason(content: PerceptionContent) -> str:
    """Why the driver was chosen, in a sentence."""
    if not content.val:
        return "There was no choice: it takes test episodes, and a policy on states, which is trained on a second core."
    rates = ", ".join(f"{percent(rate)} by {name}" for name, rate in content.val.items())
    return f"Success among pedestrians on the split val: {rates}. A policy without a map: --form paper."


def perception_facts(metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values of what `metrics.json` says of held-out images."""
    told = metrics.get("held_out")
    learned = ("images learned from, repeats counted", f"{metrics['samples_seen']:,}")
    if told is None:
        return [learned]
    return [
        learned,
        ("held-out images; visible people in them", f"{told['images']:,}; {told['people']:,}"),
        ("average precision, found within 0.5 m", f"{told['average_precision']:.2f}"),
        ("bearing, median error", f"{told['bearing_deg']:.1f} deg"),
        ("distance, median error", percent(told["distance"])),
        ("missed, of visible people within 6 m", percent(told["missed"])),
        ("detections without a human, per image", f"{told['false_per_image']:.3f}"),
        ("velocity along and across the view, R2", f"{told['along_r2']:.2f} and {told['across_r2']:.2f}"),
        ("free distance, median error", percent(told["rays"])),
    ]


def write_perception_report(path: Path, content: PerceptionContent) -> None:
    """Write the page in one piece."""
    write_whole(path, perception_html(content))
