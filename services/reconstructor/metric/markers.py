"""ArUco and AprilTag markers in images."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.errors import ConfigError
from readygo.common.images.encoded import read_pixels
from readygo.common.images.light import LIGHT_ONE, light_of_byte

DEFAULT_DICTIONARY = "4X4_50"
_PREFIX = "DICT_"
_LIGHT = np.rint(255.0 * light_of_byte() / LIGHT_ONE).astype(np.uint8)
"""Light of the grey values of an image as cameras encode it."""
_AGREE_MIN = 3
"""Images that have to show a marker of another dictionary: one alone may be a mistake."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkerSighting:
    """A marker in one image."""

    image: str
    marker: int
    """Id of the marker."""
    corners_px: Float64Array
    """Upper left, upper right, lower right, lower left as printed; pixel centres at +0.5; shape (4, 2)."""


def dictionaries() -> list[str]:
    """Names of the dictionaries that OpenCV knows, such as 4X4_50, ARUCO_ORIGINAL and APRILTAG_36h11."""
    return sorted(name.removeprefix(_PREFIX) for name in dir(cv2.aruco) if name.startswith(_PREFIX))


def open_dictionary(name: str) -> Any:
    """OpenCV's dictionary of a name, which may begin with DICT_ and be in small letters.

    Raises:
        ConfigError: If there is none of that name.
    """
    known = {each.upper(): each for each in dictionaries()}
    wanted = name.upper().removeprefix(_PREFIX)
    if wanted not in known:
        raise ConfigError(f"There is no marker dictionary {name!r}; there are: {', '.join(dictionaries())}.")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _PREFIX + known[wanted]))


def find_markers(grey: UInt8Array, dictionary: str) -> Iterator[tuple[int, Float64Array]]:
    """Ids and corners, shape (4, 2) [px], of the markers in an image (H, W).

    AprilTag's refinement is the one without a bias: others see markers 0.2-4 % too small, and it alone has the centres
    of pixels at +0.5 already. It is slow, so it sees the surroundings of what the plain detector finds, and it sees
    light: pixels on an edge are means of light. In encoded values they are too bright, and drawn markers with sides of
    30 to 60 px come out 1.3 to 0.7 % too small; in light, 0.3 to 0.06 % too large.
    """
    plain = _detector(dictionary, cv2.aruco.CORNER_REFINE_NONE)
    exact = _detector(dictionary, cv2.aruco.CORNER_REFINE_APRILTAG)
    for marker, rough_px in _detect(plain, grey):
        margin = 0.25 * np.ptp(rough_px, axis=0).max() + 4.0
        left, top = np.maximum(rough_px.min(axis=0) - margin, 0.0).astype(int)
        right, bottom = (rough_px.max(axis=0) + margin).astype(int)
        for again, corners_px in _detect(exact, _LIGHT[grey[top:bottom, left:right]]):
            corners_px = corners_px + np.array([left, top])
            if again == marker and np.abs(corners_px - rough_px).max() < margin:
                yield marker, corners_px


def _detector(dictionary: str, refinement: int) -> Any:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    return cv2.aruco.ArucoDetector(open_dictionary(dictionary), parameters)


def _detect(detector: Any, grey: UInt8Array) -> Iterator[tuple[int, Float64Array]]:
    corners, ids, _ = detector.detectMarkers(np.ascontiguousarray(grey))
    for corners_px, marker in zip(corners, [] if ids is None else ids.ravel(), strict=True):
        yield int(marker), np.asarray(corners_px, dtype=np.float64).reshape(4, 2)


def sightings_in(folder: Path, names: Iterable[str], dictionary: str) -> list[MarkerSighting]:
    """Every marker of a dictionary in the images of a folder."""
    found = []
    for name in names:
        # Poses are of the pixels as they lie in the file: EXIF does not turn them.
        grey = read_pixels(folder / name, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        if grey is None:
            continue
        seen = list(find_markers(np.asarray(grey, dtype=np.uint8), dictionary))
        # An id that one image shows twice says nothing about which is which.
        ids = [marker for marker, _ in seen]
        found += [MarkerSighting(image=name, marker=m, corners_px=px) for m, px in seen if ids.count(m) == 1]
    return found


def other_dictionaries(folder: Path, names: Iterable[str], tried: str) -> list[str]:
    """What markers of other dictionaries the images show, in words; only those that several images agree on."""
    names = list(names)
    words = []
    # Of dictionaries with the same cells the largest holds the others' markers.
    for dictionary in ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL", "ARUCO_MIP_36h12",
                       "APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"):  # fmt: skip
        if dictionary.split("_")[0] == tried.split("_")[0] and dictionary[0].isdigit():
            continue
        counts: dict[int, int] = {}
        for sighting in sightings_in(folder, names, dictionary):
            counts[sighting.marker] = counts.get(sighting.marker, 0) + 1
        words += [f"{dictionary} id {m} in {n} images" for m, n in sorted(counts.items()) if n >= _AGREE_MIN]
    return words
