"""`readygo store`: copies finished shards to an object store."""

import sys
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.run.store import hand_over


@dataclass(frozen=True, kw_only=True)
class StoreOptions:
    """Copy the finished shards of a data folder to an object store, and verify size and SHA-256 by reading them back.

    Can run repeatedly, also while a fleet records: only new files are copied. The data folder stays unchanged; the
    command removes shards from the store whose episodes `readygo recover` has moved to other shards.
    """

    data: Positional[Path]
    """Data folder."""
    url: Positional[str]
    """Folder of the store in fsspec's notation: a path, or a URL such as s3://bucket/lobby if s3fs is installed."""
    check: bool = False
    """Also verify files that were copied before."""


def store(options: StoreOptions) -> None:
    """Copy the finished shards of a data folder to an object store, and verify size and SHA-256."""
    count = hand_over(
        options.data,
        options.url,
        every_byte=options.check,
        told=lambda name, done: sys.stdout.write(f"{name} {done}\n"),
    )
    sys.stdout.write(f"{count} files copied to {options.url}; its shards.json lists what is there.\n")
