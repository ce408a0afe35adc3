"""Where numba keeps compiled kernels: one folder per state of the sources that are compiled.

Numba compares the file of a compiled function only, so an edited function that it calls in another file would leave
stale machine code behind, and with it other samples.
"""

import hashlib
import os
import shutil
from pathlib import Path

from apps.paths import cache_folder

_KEPT = 4
"""States whose kernels are kept, the latest ones."""


def use_own_kernels() -> None:
    """Let numba keep kernels in the folder of this state of the sources; call it before numba is imported."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        folder = cache_folder("kernels") / _sources_digest()
        folder.mkdir(exist_ok=True)
        os.utime(folder)
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
        _forget_old(folder.parent)


def _sources_digest() -> str:
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for path in sorted(p for top in ("common", "services") for p in (root / top).rglob("*.py")):
        source = path.read_bytes()
        if b"njit" in source or b"kernel" in source or b"intrinsic" in source:
            digest.update(path.relative_to(root).as_posix().encode() + source)
    return digest.hexdigest()[:16]


def _forget_old(folder: Path) -> None:
    states = sorted(folder.iterdir(), key=lambda state: state.stat().st_mtime, reverse=True)
    for state in states[_KEPT:]:
        shutil.rmtree(state, ignore_errors=True)
