"""The state of a training on disk: arrays and numbers, nothing pickled."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import AnyArray
from readygo.common.documents import parse_json
from readygo.common.errors import RunError
from readygo.common.files import write_then_rename

FORMAT = "readygo-gaussians/1"
CHECKPOINT_FILE = "checkpoint.npz"
Arrays = dict[str, AnyArray]


def save_checkpoint(folder: Path, identity: str, numbers: dict[str, Any], arrays: Arrays) -> None:
    """Write the state in one piece.

    Raises:
        RunError: If it cannot be written; the one before is left then.
    """
    meta = json.dumps({"format": FORMAT, "identity": identity, **numbers})
    with write_then_rename(folder / CHECKPOINT_FILE, raises=RunError) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, **{"meta": np.array(meta), **arrays})


def load_checkpoint(folder: Path, identity: str) -> tuple[dict[str, Any], Arrays] | None:
    """State to resume from; None if there is none.

    Args:
        folder: Folder of the training.
        identity: Identity of settings and images, which must be the same as when it began.

    Raises:
        RunError: If the file is broken, or of another training.
    """
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    # Nothing in it is compressed.
    remedy, size = "delete it to start the training again", path.stat().st_size
    arrays = load_npz(path, None, bytes_max=size, raises=RunError, remedy=remedy)
    try:
        numbers = dict(parse_json(str(arrays.pop("meta"))))
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path} cannot be read ({error}); {remedy}.") from error
    if numbers.get("format") != FORMAT or numbers.get("identity") != identity:
        raise RunError(
            f"{path} is of a training with other settings or images, or of another version of readygo; give another "
            "--out, or delete it."
        )
    return numbers, arrays
