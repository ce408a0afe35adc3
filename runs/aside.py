"""Episodes that a run has set aside: files by which a user can find out what went wrong."""

from collections.abc import Mapping

from readygo.common.dataset.aside import SET_ASIDE
from readygo.common.documents import write_json
from readygo.common.errors import ReadygoError, RunError
from readygo.common.files import write_whole
from readygo.common.messages import HumanPlanReply, decode
from readygo.common.messages.stages import HUMAN_PLAN
from readygo.runs.folder import RunFolder
from readygo.services.planner import save_scenarios


def note_set_aside(folder: RunFolder, given_up: Mapping[int, str]) -> None:
    """Write the list of the episodes that the run has set aside, which `read_set_aside` reads.

    Args:
        folder: Folder of the run.
        given_up: Reasons by index, from the ledger.

    Raises:
        RunError: If the folder cannot be written.
    """
    file = folder.path / SET_ASIDE
    if given_up:
        reasons = {str(index): reason for index, reason in given_up.items()}
        write_json(file, reasons, raises=RunError)
    else:
        file.unlink(missing_ok=True)


def keep_scenario(folder: RunFolder, index: int, reason: str, results: Mapping[str, bytes]) -> str:
    """Save the reason why an episode was set aside, and its scenario as a file for `readygo generate --scenarios`.

    Args:
        folder: Folder of the run.
        index: Index of the episode.
        reason: Reason for setting it aside.
        results: Results of its stages, by their names.

    Returns:
        Text with the path of the scenario; empty if there is none.
    """
    place = folder.aside / f"episode-{index:06d}"
    try:
        write_whole(place.with_suffix(".txt"), f"{reason}\n")
        scenario = decode(HumanPlanReply, results.get(HUMAN_PLAN.name, b"")).scenario
        if scenario is None:
            return ""
        save_scenarios(place.with_suffix(".toml"), [scenario])
    except ReadygoError:
        # The episode may have no scenario, or one that cannot be decoded.
        return ""
    return f" (its scenario: {place.with_suffix('.toml')})"
