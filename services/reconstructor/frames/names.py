"""Names of images: their order, and what no name of an image may hold."""

import re
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from readygo.common.arrays import Float64Array

_SIZE_FOLDER = re.compile(r"\d+x\d+/")
"""Folder of the photos of one size, see `photos`: photos of several sizes follow each other by their own names."""
_DIGITS = 20
"""Numbers of more digits are compared as text."""
_UNUSABLE = re.compile(r"\s|^#")
"""COLMAP splits lines of names at spaces, and takes those that begin with # for comments."""


def image_order(name: str) -> tuple[str, str]:
    """Key to sort names of images by: that of time in a video, and in photos that a camera numbers.

    Numbers in names count as numbers: 9.jpg comes before 10.jpg. Folders come before the names in them, but for those
    of photos of one size. Numbers of equally many digits have the same order as text.
    """
    own = _SIZE_FOLDER.sub("", name, count=1) if _SIZE_FOLDER.match(name) else name
    return re.sub(r"\d+", lambda digits: digits[0].zfill(_DIGITS), own), name


def usable_name(name: str) -> str:
    """The name of an image that is written: with _ for each space, and for # at the beginning."""
    return _UNUSABLE.sub("_", name)


def times_of_names(names: Sequence[str]) -> Float64Array:
    """When images were taken, by the frame numbers at the end of their names, in usual spacings, shape (F,).

    Names that differ in more than one number, or whose numbers do not grow, tell nothing: their images are evenly
    spaced.
    """
    even = np.arange(len(names), dtype=np.float64)
    parts = [re.fullmatch(r"(.*?)(\d{1,15})", PurePath(name).with_suffix("").as_posix()) for name in names]
    found = [part for part in parts if part is not None]
    if len(found) < len(names) or len({part[1] for part in found}) != 1:
        return even
    numbers = np.array([int(part[2]) for part in found], dtype=np.float64)
    spacing = np.diff(numbers)
    if len(numbers) < 2 or not (spacing > 0.0).all():
        return even
    times: Float64Array = (numbers - numbers[0]) / np.median(spacing)
    return times
