"""Where things are kept on this machine."""

import os
from pathlib import Path


def cache_folder(name: str) -> Path:
    """A folder below the user's cache for files that can be made again."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "readygo" / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder
