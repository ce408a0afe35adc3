"""State of a training run on disk: plain tensors and numbers, nothing pickled is ever loaded."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from readygo.common.errors import PolicyError, ReadygoError, cause
from readygo.common.files import read_regular, write_whole
from readygo.services.trainer.config import CHECKPOINT_FILE

CHECKPOINT_FORMAT = "readygo-training/2"


def save_checkpoint(state: dict[str, Any], folder: Path) -> None:
    """Write `checkpoint.pt` in one piece.

    Raises:
        PolicyError: If it cannot be written; the one before is left then.
    """
    write_state({"format": CHECKPOINT_FORMAT} | state, folder / CHECKPOINT_FILE)


def load_checkpoint(folder: Path, identity: dict[str, Any]) -> dict[str, Any] | None:
    """State to continue from; None where there is none.

    Args:
        folder: Folder of the run.
        identity: What must be the same as when the run began: data hashes and settings.

    Raises:
        PolicyError: If the file is damaged, or belongs to a run of another identity.
    """
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    state = read_state(path)
    theirs = state.get("identity")
    if state.get("format") != CHECKPOINT_FORMAT or not isinstance(theirs, dict):
        raise PolicyError(f"{path} is no checkpoint of this version; give another --out.")
    changed = sorted(key for key, value in identity.items() if theirs.get(key) != value)
    if changed:
        raise PolicyError(f"{path} belongs to a run with another {changed[0]}; give another --out.")
    return state


def write_state(state: dict[str, Any], path: Path, *, raises: type[ReadygoError] = PolicyError) -> None:
    """Write a training's state in one piece.

    Args:
        state: Plain tensors and numbers.
        path: The file.
        raises: What is raised if it cannot be written; the file before is left then.
    """
    # Into memory first: torch has its own words for a full disk.
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_whole(path, buffer.getvalue(), raises=raises)


def read_state(path: Path) -> dict[str, Any]:
    """Read what `write_state` wrote.

    Raises:
        PolicyError: If the file cannot be read or is damaged.
    """
    try:
        data = read_regular(path)
    except OSError as error:
        raise PolicyError(f"{path} cannot be read: {cause(error)}.") from error
    try:
        state = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many unrelated types for a damaged file
        raise PolicyError(_damaged(path)) from error
    if not isinstance(state, dict):
        raise PolicyError(_damaged(path))
    return state


@contextmanager
def refuse_damaged(path: Path) -> Iterator[None]:
    """Report a state whose content cannot be used: keys are missing, or tensors have other shapes.

    Args:
        path: File of the state that the block takes over.

    Raises:
        PolicyError: If the block raises what such a content leads to.
    """
    try:
        yield
    except (AttributeError, IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise PolicyError(_damaged(path)) from error


def _damaged(path: Path) -> str:
    return f"{path} is damaged, or of another version: restore it from a copy, or give another --out."
