"""`readygo doctor`: checks whether this machine can run readygo."""

import json as json_module
import sys
from dataclasses import asdict
from pathlib import Path

from readygo.apps.doctor import examine
from readygo.common.errors import ReadygoError

MARKS = {True: "ok  ", False: "FAIL", None: "    "}


def doctor(*, data: Path = Path(), json: bool = False) -> None:
    """Check this machine's software, hardware and disk for readygo; changes nothing.

    Args:
        data: Folder for future recordings, whose disk is checked; this folder by default.
        json: Print everything as JSON.

    Raises:
        ReadygoError: If something essential is missing.
    """
    findings = examine(data)
    if json:
        sys.stdout.write(json_module.dumps([asdict(finding) for finding in findings], indent=2) + "\n")
    else:
        width = max(len(finding.name) for finding in findings)
        lines = (f"{MARKS[finding.good]} {finding.name:<{width}}  {finding.text}" for finding in findings)
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    if wrong := [finding.name for finding in findings if finding.good is False]:
        raise ReadygoError(f"mend first: {', '.join(wrong)}.")
