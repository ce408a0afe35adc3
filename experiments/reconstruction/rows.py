"""How the benchmarks of reconstructions print what they measured."""

import json
import sys
from collections.abc import Callable
from typing import Any

from readygo.common.errors import ReadygoError


def print_row(measure: Callable[[], dict[str, Any]], *, as_json: bool) -> int:
    """Measure and print, as one JSON object or a line for each value; returns the exit code."""
    try:
        row = measure()
    except ReadygoError as error:
        sys.stderr.write(f"Error: {error}\n")
        return 2
    if as_json:
        print(json.dumps(row))
        return 0
    for name, value in row.items():
        print(f"{name:>18}  {value}")
    return 0
