"""Facts about a data folder's run besides its shards: its scene, its rejected episodes and their encounters."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from readygo.apps.run.folder import RunFolder
from readygo.apps.run.scene_argument import open_maps
from readygo.apps.run.world import World
from readygo.common.dataset.casts import Cast
from readygo.common.errors import ReadygoError, RunError
from readygo.common.maps import OccupancyMap
from readygo.common.messages import EpisodeKey, HumanPlanRequest, Outcome, RunSpec
from readygo.common.scenes import load_scene
from readygo.services import coordinator as coordination
from readygo.services.planner import HumanPlanner, handle_human_plan

CHECKED = 3
"""Number of recorded episodes that are drawn again, to check that the run's scenarios are reproducible here."""


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


def rejected(data: Path) -> Mapping[int, str] | None:
    """Reason of every index that the run rejected; None if its ledger is missing or not accessible."""
    folder = RunFolder(data)
    if not os.access(folder.ledger, os.R_OK | os.W_OK):
        return None
    ledger = coordination.Ledger(folder.ledger)
    try:
        return ledger.census.rejected()
    finally:
        ledger.close()


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
