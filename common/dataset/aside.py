"""Episodes that a dataset lacks because its run gave them up: a file in the data folder, beside the shards."""

import json
from pathlib import Path

from readygo.common.errors import DatasetError

SET_ASIDE = "set_aside.json"


def read_set_aside(folder: Path) -> dict[int, str]:
    """Why each episode that the run gave up was, by index; empty where it gave up none.

    Raises:
        DatasetError: If the file is damaged.
    """
    file = folder / SET_ASIDE
    try:
        reasons = json.loads(file.read_text())
        return {int(index): str(reason) for index, reason in sorted(reasons.items(), key=lambda item: int(item[0]))}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise DatasetError(f"{file} is damaged: {error}; `readygo generate` writes it again.") from error


def set_aside_lines(folder: Path) -> list[str]:
    """A line for each episode that the run gave up."""
    return [
        f"Episode {index} was set aside, the next index took its place: {reason}"
        for index, reason in read_set_aside(folder).items()
    ]
