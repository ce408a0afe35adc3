"""`readygo doctor`: what this machine has, lacks and can do."""

import json as json_module
import sys
from dataclasses import asdict
from pathlib import Path

from readygo.apps.doctor import examine
from readygo.common.errors import ReadygoError

MARKS = {True: "ok  ", False: "FAIL", None: "    "}


def doctor(*, data: Path = Path(), json: bool = False) -> None:
    """Say what this machine has, lacks and can do; changes nothing.

    Args:
        data: Folder that data shall be recorded into, to look at its disk; this folder by default.
        json: Print everything as JSON.

    Raises:
        ReadygoError: If something is missing without which nothing works.
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
