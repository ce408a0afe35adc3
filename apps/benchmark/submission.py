"""Packs a folder of results into one file that others verify."""

import zipfile
from pathlib import Path

from readygo.common.errors import RunError
from readygo.common.files import read_regular, write_then_rename
from readygo.runs.benchmark.folder import MANIFEST_FILE, SUITE_FILE, check_suite, check_unchanged, read_manifest
from readygo.runs.benchmark.suite import OpenSuite

_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of all files in a ZIP: the same results make the same bytes."""


def pack_results(folder: Path, suite: OpenSuite, out: Path) -> int:
    """Pack what others need to verify results: manifest, suite, records. Weights and policies are not in it.

    Args:
        folder: Folder of the results.
        suite: Their suite.
        out: ZIP file to write.

    Returns:
        Number of packed files.

    Raises:
        ReadygoError: If the results are not complete, were edited, or cannot be read or written.
    """
    manifest = read_manifest(folder)
    check_suite(manifest, suite, folder)
    if not manifest.complete:
        raise RunError(
            f"{folder} has {manifest.episodes} of {suite.suite.episodes} episodes per cell and driver: run the rest."
        )
    check_unchanged(folder, suite, manifest)
    names = sorted([MANIFEST_FILE, SUITE_FILE, *manifest.files])
    with write_then_rename(out, raises=RunError) as part, zipfile.ZipFile(part, "w") as archive:
        for name in names:
            info = zipfile.ZipInfo(name, _EPOCH)
            archive.writestr(info, read_regular(folder / name), zipfile.ZIP_DEFLATED)
    return len(names)
