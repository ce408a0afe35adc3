"""Shared parts of several formats: the task in words, JSON files, names of images."""

import json
from pathlib import Path
from typing import Any

from readygo.common.errors import DatasetError
from readygo.common.files import write_whole

TASK = "Drive to the goal without touching anything or anybody."
"""The task of every episode, for formats that name it."""
_JPEG = b"\xff\xd8"


def write_json(path: Path, value: Any) -> None:
    """Write plain values.

    Raises:
        DatasetError: If the file cannot be written.
    """
    write_whole(path, json.dumps(value, indent=2) + "\n", raises=DatasetError)


def suffix(image: bytes) -> str:
    """File extension of an encoded image."""
    return "jpg" if image.startswith(_JPEG) else "png"
