"""NumPy archives without pickles."""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.errors import AvatarError


def read_npz(path: Path) -> dict[str, npt.NDArray[Any]]:
    """All plain arrays of an archive; entries that hold pickled objects are left out.

    Raises:
        AvatarError: If it is no NumPy archive.
    """
    arrays = {}
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            for key in archive.files:
                try:
                    arrays[key] = archive[key]
                except ValueError as error:
                    if "allow_pickle" not in str(error):
                        raise
    except (ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        line = " ".join(str(error).split())
        raise AvatarError(f"{path} is not a readable NumPy archive (.npz): {line}") from error
    return arrays
