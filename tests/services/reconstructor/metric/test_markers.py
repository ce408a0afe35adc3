from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import ConfigError
from readygo.services.reconstructor.metric.markers import (
    find_markers,
    open_dictionary,
    other_dictionaries,
    sightings_in,
)
from tests.services.reconstructor.frames.test_exif import exif

CORNERS_PX = np.array([[120.3, 80.7], [201.2, 90.1], [195.6, 170.4], [115.8, 160.2]])


def drawn(dictionary: str = "4X4_50", marker: int = 7) -> np.ndarray:
    """A photo of a marker on white whose corners are at CORNERS_PX, pixel centres at +0.5."""
    square = cv2.aruco.generateImageMarker(open_dictionary(dictionary), marker, 600)
    begin = np.array([[0, 0], [600, 0], [600, 600], [0, 600]], dtype=np.float32) - 0.5
    big = cv2.getPerspectiveTransform(begin, (8 * CORNERS_PX - 0.5).astype(np.float32))
    image = cv2.warpPerspective(square, big, (8 * 320, 8 * 240), borderValue=255, flags=cv2.INTER_LINEAR)
    light = cv2.resize(image.astype(np.float32) / 255, (320, 240), interpolation=cv2.INTER_AREA)
    return np.rint(255 * light ** (1 / 2.2)).astype(np.uint8)


def test_corners_of_a_drawn_marker_are_found_without_an_offset() -> None:
    ((marker, corners_px),) = find_markers(drawn(), "4X4_50")
    assert marker == 7
    np.testing.assert_allclose(corners_px, CORNERS_PX, atol=0.15)
    sides = [np.linalg.norm(c - np.roll(c, -1, axis=0), axis=1).mean() for c in (corners_px, CORNERS_PX)]
    np.testing.assert_allclose(sides[0], sides[1], rtol=0.003)


def test_marker_of_another_dictionary_is_named(tmp_path: Path) -> None:
    names = [f"{number}.png" for number in range(3)]
    for name in names:
        cv2.imwrite(str(tmp_path / name), drawn("APRILTAG_36h11", 5))
    assert sightings_in(tmp_path, names, "4X4_50") == []
    assert "APRILTAG_36h11 id 5 in 3 images" in other_dictionaries(tmp_path, names, "4X4_50")


def test_id_that_an_image_shows_twice_is_ignored(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.concatenate([drawn(), drawn()], axis=1))
    assert sightings_in(tmp_path, ["a.png"], "4X4_50") == []


def test_unknown_dictionary_is_refused() -> None:
    assert open_dictionary("dict_4x4_50") is not None
    with pytest.raises(ConfigError, match=r"no marker dictionary '9X9'.*4X4_50"):
        open_dictionary("9X9")


@pytest.mark.parametrize("orientation", [3, 6])
def test_markers_are_where_the_pixels_lie_in_the_file_and_exif_does_not_turn_them(
    tmp_path: Path, orientation: int
) -> None:
    data = cv2.imencode(".jpg", drawn(), [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
    (tmp_path / "a.jpg").write_bytes(exif("<", orientation, 26) + data[2:])
    (found,) = sightings_in(tmp_path, ["a.jpg"], "4X4_50")
    np.testing.assert_allclose(found.corners_px, CORNERS_PX, atol=0.3)
