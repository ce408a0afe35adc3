"""Episodes that a run has given up: what is kept of them, so that somebody can look at what went wrong."""

import json
from collections.abc import Mapping

from readygo.apps.run.folder import RunFolder
from readygo.common.dataset.aside import SET_ASIDE
from readygo.common.errors import ReadygoError, RunError
from readygo.common.files import write_whole
from readygo.common.messages import HumanPlanReply, decode
from readygo.common.messages.stages import HUMAN_PLAN
from readygo.services.planner.humans.scenario_file import save_scenarios


def note_set_aside(folder: RunFolder, given_up: Mapping[int, str]) -> None:
    """Write which episodes a dataset lacks because the run gave them up, see `read_set_aside`.

    Args:
        folder: Of the run.
        given_up: Reasons by index, as the ledger has them.

    Raises:
        RunError: If the folder cannot be written.
    """
    file = folder.path / SET_ASIDE
    if given_up:
        reasons = {str(index): reason for index, reason in given_up.items()}
        write_whole(file, json.dumps(reasons, indent=2) + "\n", raises=RunError)
    else:
        file.unlink(missing_ok=True)


def keep_scenario(folder: RunFolder, index: int, reason: str, results: Mapping[str, bytes]) -> str:
    """Keep why an episode was given up, and its scenario as a file for `readygo generate --scenarios`.

    Args:
        folder: Of the run.
        index: Of the episode.
        reason: Why it was given up.
        results: What its stages have made of it, by their names.

    Returns:
        Words on where the scenario is; empty if it has none.
    """
    place = folder.aside / f"episode-{index:06d}"
    try:
        write_whole(place.with_suffix(".txt"), f"{reason}\n")
        scenario = decode(HumanPlanReply, results.get(HUMAN_PLAN.name, b"")).scenario
        if scenario is None:
            return ""
        save_scenarios(place.with_suffix(".toml"), [scenario])
    except ReadygoError:
        # It may have none, or the very one that cannot be read.
        return ""
    return f" (its scenario: {place.with_suffix('.toml')})"
