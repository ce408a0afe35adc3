"""`readygo doctor`: checks whether this machine can run readygo."""

import json as json_module
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from readygo.apps.doctor import examine
from readygo.common.errors import ReadygoError

MARKS = {True: "ok  ", False: "FAIL", None: "    "}


@dataclass(frozen=True, kw_only=True)
class DoctorOptions:
    """Check this machine's software, hardware and disk for readygo; changes nothing."""

    data: Path = Path()
    """Folder for future recordings, whose disk is checked; this folder by default."""
    json: bool = False
    """Print everything as JSON."""


def doctor(options: DoctorOptions) -> None:
    """Check this machine's software, hardware and disk for readygo; changes nothing."""
    findings = examine(options.data)
    if options.json:
        sys.stdout.write(json_module.dumps([asdict(finding) for finding in findings], indent=2) + "\n")
    else:
        width = max(len(finding.name) for finding in findings)
        lines = (f"{MARKS[finding.good]} {finding.name:<{width}}  {finding.text}" for finding in findings)
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    if wrong := [finding.name for finding in findings if finding.good is False]:
        raise ReadygoError(f"mend first: {', '.join(wrong)}.")
