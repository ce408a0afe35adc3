"""Folders of what was trained: other commands must not write into them."""

from pathlib import Path

from readygo.common.errors import RunError
from readygo.common.perception import artifact as perception
from readygo.common.policy import artifact as policy
from readygo.common.state_policy.state_policy import STATE_POLICY_FILE
from readygo.runs.folder import RunFolder
from readygo.services.trainer import CHECKPOINT_FILE

_TRAINED = {
    policy.SPEC_FILE: "a policy",
    STATE_POLICY_FILE: "a policy on states",
    perception.SPEC_FILE: "a network of perception",
}
"""What the files that describe trained artifacts belong to."""


def check_out(folder: Path, *, resumes: bool = False) -> None:
    """Check that a command may write its results into a folder; changes nothing.

    Args:
        folder: It need not be there.
        resumes: True for a training, which resumes from a checkpoint beside the artifact.

    Raises:
        RunError: If it is a file, or holds recorded data or a trained artifact.
    """
    RunFolder(folder).check_other()
    if resumes and (folder / CHECKPOINT_FILE).exists():
        return
    for name, what in _TRAINED.items():
        if (folder / name).exists():
            lacks = f" without {CHECKPOINT_FILE}: copy that too to resume, or" if resumes else ";"
            raise RunError(f"--out {folder} holds {what} ({name}){lacks} choose a new folder.")
