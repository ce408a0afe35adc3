"""State of a training run on disk: plain tensors and numbers, nothing pickled is ever loaded."""

import io
from pathlib import Path
from typing import Any

import torch

from readygo.common.errors import PolicyError
from readygo.common.files import write_whole

CHECKPOINT_FORMAT = "readygo-training/2"
CHECKPOINT_FILE = "checkpoint.pt"


def save_checkpoint(state: dict[str, Any], folder: Path) -> None:
    """Write `checkpoint.pt` in one piece.

    Raises:
        PolicyError: If it cannot be written; the one before is left then.
    """
    # Into memory first: torch has its own words for a full disk.
    buffer = io.BytesIO()
    torch.save({"format": CHECKPOINT_FORMAT} | state, buffer)
    write_whole(folder / CHECKPOINT_FILE, buffer.getvalue(), raises=PolicyError)


def load_checkpoint(folder: Path, identity: dict[str, Any]) -> dict[str, Any] | None:
    """State to continue from; None where there is none.

    Args:
        folder: Folder of the run.
        identity: What must be the same as when the run began: data hashes and settings.

    Raises:
        PolicyError: If the file is broken, or belongs to a run of another identity.
    """
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many unrelated types for a broken file
        reason = (str(error).splitlines() or ["broken file"])[0]
        raise PolicyError(f"{path} cannot be read: {reason}; delete it to start again.") from error
    if not isinstance(state, dict) or state.get("format") != CHECKPOINT_FORMAT:
        raise PolicyError(f"{path} is no checkpoint of this version; delete it to start again.")
    changed = sorted(key for key, value in identity.items() if state["identity"].get(key) != value)
    if changed:
        raise PolicyError(f"{path} belongs to a run with another {changed[0]}; give another --out, or delete it.")
    return state
