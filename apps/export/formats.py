"""The formats that data can be exported to."""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.export import gnm, lerobot, npz, parquet, rlds, webdataset
from readygo.apps.export.source import Part, Source
from readygo.common.errors import ConfigError
from readygo.common.extras import install_command

MB = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Format:
    """One format: how a part of an export is written, and what is written when all parts are there."""

    write: Callable[[Source, Part, Path], Mapping[str, Any]]
    """Writes a part's files below the folder; what it returns, plain values, goes to `finish`."""
    finish: Callable[[Source, Path, Sequence[Any]], None]
    """Writes what describes all parts."""
    part_bytes: int
    """Images of a part, about."""
    rate_hz: int | None = None
    """Rows per second unless asked otherwise; None is one row for every image."""
    package: str = ""
    """What must be installed for it, of the extra `export`."""

    def check(self) -> None:
        """See whether it can be written here.

        Raises:
            ConfigError: If a package is missing.
        """
        if self.package and importlib.util.find_spec(self.package) is None:
            raise ConfigError(f"This format needs {self.package}, which is not installed: {install_command('export')}")


FORMATS: Mapping[str, Format] = {
    "lerobot": Format(write=lerobot.write, finish=lerobot.finish, part_bytes=100 * MB, package="pyarrow"),
    "gnm": Format(write=gnm.write, finish=gnm.finish, part_bytes=20 * MB, rate_hz=4),
    "rlds": Format(write=rlds.write, finish=rlds.finish, part_bytes=150 * MB),
    "huggingface-parquet": Format(write=parquet.write, finish=parquet.finish, part_bytes=300 * MB, package="pyarrow"),
    "webdataset": Format(write=webdataset.write, finish=webdataset.finish, part_bytes=300 * MB),
    "npz": Format(write=npz.write, finish=npz.finish, part_bytes=20 * MB),
}
