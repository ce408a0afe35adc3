"""What a coverage page says of a data folder: all numbers, and facts about its run that its shards do not contain."""

import contextlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.apps.report.coverage_numbers import Coverage, visited_share
from readygo.common.dataset import Dataset
from readygo.common.dataset.casts import Cast
from readygo.common.errors import ReadygoError, RunError
from readygo.common.maps import OccupancyMap
from readygo.common.messages import EpisodeKey, HumanPlanRequest, Outcome, RunSpec
from readygo.common.robot import RobotConfig
from readygo.common.scenes import load_scene
from readygo.runs.folder import RunFolder
from readygo.runs.scene_argument import open_maps
from readygo.runs.world import World
from readygo.services import coordinator as coordination
from readygo.services.planner import HumanPlanner, handle_human_plan

CHECKED = 3
"""Number of recorded episodes that are drawn again, to check that the run's scenarios are reproducible here."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RunFacts:
    """Facts about the run that its samples do not contain."""

    name: str
    """Name of the dataset."""
    scene: str
    occupancy: OccupancyMap | None
    """The map that the robots drove on."""
    visited_share: float | None
    """Share of the reachable ground that robots have visited; None without a map."""
    rejected: Mapping[str, int] | None
    """Episodes that were not recorded, by reason; None if that is not known."""
    failed: Mapping[str, Mapping[str, int]] | None
    """Kind of encounter -> outcome -> episodes that the expert failed in; None if that is not known."""
    provenance: Mapping[str, str] = field(default_factory=dict)


def gather(data: Path, dataset: Dataset, casts: list[Cast], measured: Coverage, scene: str) -> RunFacts:
    """Collect the facts about a data folder's run that its shards do not contain."""
    recorded = dataset.provenance
    occupancy = robot_map(data, scene, recorded.scene.hash)
    radius_m = (dataset.robot or RobotConfig()).planning_radius_m
    reasons = rejection_reasons(data)
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
            kind: {"episodes": episodes, "people": humans, "failed": _failure_counts(facts, kind)}
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


def load_spec(data: Path) -> RunSpec | None:
    """The run of a data folder; None for shards without one."""
    try:
        return RunFolder(data).load()[0]
    except RunError:
        return None


def robot_map(data: Path, scene: str, scene_hash: str) -> OccupancyMap | None:
    """The map that the robots drove on; None if it is not available.

    Args:
        data: Data folder.
        scene: Scene that the user names; empty for the run's.
        scene_hash: Hash in the shards' metadata; empty if they name none.

    Raises:
        SceneError: If the named scene cannot be read.
        RunError: If the named scene is not the one that was recorded.
    """
    if scene:
        maps, bundle = open_maps(scene)
        if bundle is not None and scene_hash and bundle.content_hash != scene_hash:
            raise RunError(f"{data} was recorded in another scene than {scene}.")
        return maps.robot
    spec = load_spec(data)
    if spec is None:
        return None
    try:
        found = load_scene(Path(spec.scene_path))
        return found.maps.robot if found.content_hash == scene_hash else None
    except ReadygoError:
        return None


def rejection_reasons(data: Path) -> Mapping[int, str] | None:
    """Reason of every index that the run rejected; None if its ledger is missing, damaged or not accessible."""
    folder = RunFolder(data)
    if not os.access(folder.ledger, os.R_OK | os.W_OK):
        return None
    try:
        with contextlib.closing(coordination.Ledger(folder.ledger)) as ledger:
            return ledger.census.rejection_reasons()
    except RunError:
        return None


def failed_encounters(
    data: Path, reasons: Mapping[int, str], recorded: Sequence[Cast]
) -> dict[str, dict[str, int]] | None:
    """Kind of encounter -> outcome -> episodes that the expert failed in, from scenarios that are drawn again.

    Args:
        data: Data folder.
        reasons: Reason of every rejected index.
        recorded: Humans of recorded episodes.

    Returns:
        The counts; None if scene, humans or program differ from those of the run.
    """
    spec = load_spec(data)
    failed = {index: reason for index, reason in reasons.items() if reason in {outcome.value for outcome in Outcome}}
    if spec is None:
        return None
    try:
        planner = World(spec).human_planner()
        for cast in recorded[:CHECKED]:
            if _encounters(planner, cast.episode, static=spec.static) != cast.encounters:
                return None
        counts: dict[str, Counter[str]] = {}
        for index, outcome in failed.items():
            episode = EpisodeKey(seed=spec.seed, split=spec.split, index=index)
            for kind in dict.fromkeys(_encounters(planner, episode, static=spec.static) or ("nobody",)):
                counts.setdefault(kind, Counter())[outcome] += 1
    except ReadygoError:
        return None
    return {kind: dict(sorted(count.items())) for kind, count in sorted(counts.items())}


def _encounters(planner: HumanPlanner, episode: EpisodeKey, *, static: bool) -> tuple[str, ...] | None:
    scenario = handle_human_plan(planner, HumanPlanRequest(episode=episode, static=static)).scenario
    return None if scenario is None else tuple(human.encounter for human in scenario.humans)


def _failure_counts(facts: RunFacts, kind: str) -> dict[str, int] | None:
    return None if facts.failed is None else dict(facts.failed.get(kind, {}))
