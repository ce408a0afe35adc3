"""The content of a coverage page, from a data folder: facts about its run, and all numbers as plain values."""

from collections import Counter
from pathlib import Path
from typing import Any

from readygo.apps.coverage.numbers import Coverage, visited_share
from readygo.apps.coverage.page import RunFacts
from readygo.apps.coverage.runs import failed_encounters, rejected, robot_map
from readygo.common.dataset import Dataset
from readygo.common.dataset.casts import Cast
from readygo.common.robot import RobotConfig


def gather(data: Path, dataset: Dataset, casts: list[Cast], measured: Coverage, scene: str) -> RunFacts:
    """Collect the facts about a data folder's run that its shards do not contain."""
    recorded = dataset.provenance
    occupancy = robot_map(data, scene, recorded.scene.hash)
    radius_m = (dataset.robot or RobotConfig()).planning_radius_m
    reasons = rejected(data)
    return RunFacts(
        name=data.resolve().name,
        scene=recorded.scene.name,
        occupancy=occupancy,
        visited_share=None if occupancy is None else visited_share(measured.visits, occupancy, radius_m),
        rejected=None if reasons is None else dict(sorted(Counter(reasons.values()).items())),
        failed=None if reasons is None else failed_encounters(data, reasons, casts),
        provenance={
            "data": dataset.content_hash,
            "scene": recorded.scene.hash or "unknown",
            **({"readygo_version": recorded.readygo_version} if recorded.readygo_version else {}),
            **({"commit": recorded.commit} if recorded.commit else {}),
        },
    )


def page_numbers(coverage: Coverage, facts: RunFacts, dataset: Dataset) -> dict[str, Any]:
    """All numbers of the page as plain values; unknown ones are None."""
    visits = coverage.visits
    return {
        "data": facts.name,
        "content_hash": dataset.content_hash,
        "scene": facts.scene,
        "episodes": coverage.episodes,
        "samples": coverage.samples,
        "hours": round(coverage.hours, 4),
        "distance_m": round(coverage.distance_m, 2),
        "visited_m2": round(float((visits.episodes > 0).sum()) * visits.frame.resolution_m**2, 2),
        "visited_share": None if facts.visited_share is None else round(facts.visited_share, 4),
        "human_visible_share": round(coverage.visible_total, 4),
        "encounters": {
            kind: {"episodes": episodes, "people": humans, "failed": _failed(facts, kind)}
            for kind, (episodes, humans) in coverage.encounters.items()
        },
        "avatars": dict(coverage.avatars),
        "rejected": facts.rejected,
        "closest_m": coverage.closest_m.to_mapping(),
        "time_to_collision_min_s": coverage.collision_s.to_mapping(),
        "duration_s": coverage.duration_s.to_mapping(),
        "human_visible_share_by_episode": coverage.visible_share.to_mapping(),
        "heading_rad": {
            "edges": [round(edge, 6) for edge in coverage.headings.edges.tolist()],
            "counts": coverage.headings.counts.tolist(),
        },
        "actions": {
            "v_edges_mps": [round(edge, 6) for edge in coverage.v_edges_mps.tolist()],
            "w_edges_radps": [round(edge, 6) for edge in coverage.w_edges_radps.tolist()],
            "counts": coverage.actions.tolist(),
        },
    }


def _failed(facts: RunFacts, kind: str) -> dict[str, int] | None:
    return None if facts.failed is None else dict(facts.failed.get(kind, {}))
