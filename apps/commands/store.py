"""`readygo store`: copies finished shards to an object store."""

import sys
from pathlib import Path

from readygo.apps.run.store import hand_over


def store(data: Path, url: str, /, *, check: bool = False) -> None:
    """Copy the finished shards of a data folder to an object store, and verify size and SHA-256 by reading them back.

    Can run repeatedly, also while a fleet records: only new files are copied. The data folder stays unchanged; the
    command removes shards from the store whose episodes `readygo recover` has moved to other shards.

    Args:
        data: Data folder.
        url: Folder of the store in fsspec's notation: a path, or a URL such as s3://bucket/lobby if s3fs is installed.
        check: Also verify files that were copied before.
    """
    count = hand_over(data, url, every_byte=check, told=lambda name, done: sys.stdout.write(f"{name} {done}\n"))
    sys.stdout.write(f"{count} files copied to {url}; its shards.json lists what is there.\n")
