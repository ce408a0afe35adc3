"""`readygo store`: finished shards in an object store."""

import sys
from pathlib import Path

from readygo.apps.run.store import hand_over


def store(data: Path, url: str, /, *, check: bool = False) -> None:
    """Copy the finished shards of a data folder to an object store, and read them back: size and SHA-256 must match.

    Run it again, also while a fleet records: only what is new is copied. Nothing is removed here; shards leave the
    store whose episodes `readygo recover` has left in others.

    Args:
        data: Data folder.
        url: Folder of the store as fsspec knows it: a path, or such as s3://bucket/lobby where s3fs is installed.
        check: Read again also what was copied before.
    """
    count = hand_over(data, url, every_byte=check, told=lambda name, done: sys.stdout.write(f"{name} {done}\n"))
    sys.stdout.write(f"{count} files copied to {url}; its shards.json lists what is there.\n")
