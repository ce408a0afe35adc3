"""Where numba keeps compiled kernels: one folder per state of the sources that are compiled.

Numba compares the file of a compiled function only, so an edited function that it calls in another file would leave
stale machine code behind, and with it other samples.
"""

import contextlib
import hashlib
import os
import re
import shutil
from pathlib import Path

from readygo.apps.paths import cache_folder

_WORDS = (b"njit", b"kernel", b"intrinsic")
_IMPORT = re.compile(rb"^from readygo\.((?:common|services)[.\w]*) import", re.MULTILINE)
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
    for name, source in sorted(_compiled_sources(root).items()):
        digest.update(name.encode() + source)
    return digest.hexdigest()[:16]


def _compiled_sources(root: Path) -> dict[str, bytes]:
    """Files with compiled functions, and all that these import: constants become part of the machine code."""
    paths = (path for top in ("common", "services") for path in (root / top).rglob("*.py"))
    sources = {path.relative_to(root).as_posix(): path.read_bytes() for path in paths}
    found: dict[str, bytes] = {}
    waiting = [name for name, source in sources.items() if any(word in source for word in _WORDS)]
    while waiting:
        name = waiting.pop()
        if name in found or name not in sources:
            continue
        found[name] = sources[name]
        for module in _IMPORT.findall(sources[name]):
            place = module.decode().replace(".", "/")
            waiting += [f"{place}.py", f"{place}/__init__.py"]
    return found


def _forget_old(folder: Path) -> None:
    # Another process may be doing the same.
    with contextlib.suppress(FileNotFoundError):
        states = sorted(folder.iterdir(), key=lambda state: state.stat().st_mtime, reverse=True)
        for state in states[_KEPT:]:
            shutil.rmtree(state, ignore_errors=True)
