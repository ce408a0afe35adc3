"""The formats that data can be exported to."""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.export import gnm, lerobot, parquet, webdataset
from readygo.apps.export.source import ExportPart, ExportSource
from readygo.common.errors import ConfigError
from readygo.common.extras import install_command

MB = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Format:
    """One format: functions that write a part of an export, and the files that describe all parts."""

    write: Callable[[ExportSource, ExportPart, Path], Mapping[str, Any]]
    """Writes a part's files below the folder; what it returns, plain values, goes to `finish`."""
    finish: Callable[[ExportSource, Path, Sequence[Any]], None]
    """Writes the files that describe all parts."""
    part_bytes: int
    """Approximate size of a part's images [bytes]."""
    rate_hz: int | None = None
    """Default number of rows per second [Hz]; None for one row per image."""
    package: str = ""
    """Required package, from the extra `export`; empty if none."""

    def check(self) -> None:
        """Check that the format's package is installed.

        Raises:
            ConfigError: If a package is missing.
        """
        if self.package and importlib.util.find_spec(self.package) is None:
            raise ConfigError(f"This format needs {self.package}, which is not installed: {install_command('export')}")


FORMATS: Mapping[str, Format] = {
    "lerobot": Format(write=lerobot.write, finish=lerobot.finish, part_bytes=100 * MB, package="pyarrow"),
    "gnm": Format(write=gnm.write, finish=gnm.finish, part_bytes=20 * MB, rate_hz=4),
    "huggingface-parquet": Format(write=parquet.write, finish=parquet.finish, part_bytes=300 * MB, package="pyarrow"),
    "webdataset": Format(write=webdataset.write, finish=webdataset.finish, part_bytes=300 * MB),
}
