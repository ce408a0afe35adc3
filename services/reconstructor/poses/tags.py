"""Markers as features: points of their squares that are the same in every image, where there is little texture."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.services.reconstructor.metric.markers import MarkerSighting

GRID = 4
"""Points of a marker along each side. Four corners of a few markers would be fewer matches than mappers ask for."""
_UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], dtype=np.float32)


def tag_features(sightings: Sequence[MarkerSighting]) -> dict[str, tuple[Int64Array, Float64Array]]:
    """Points of markers that each image shows: numbers that all images share, and positions.

    Points between the corners come from the homography of the square; a lens bends it by less than a pixel.

    Returns:
        By image: numbers (N,), pixels (N, 2).
    """
    steps = np.linspace(0.0, 1.0, GRID, dtype=np.float32)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2)
    found: dict[str, tuple[list[int], list[Float64Array]]] = {}
    for sighting in sightings:
        H = cv2.getPerspectiveTransform(_UNIT_SQUARE, sighting.corners_px.astype(np.float32))
        numbers, pixels = found.setdefault(sighting.image, ([], []))
        numbers += range(sighting.marker * GRID**2, (sighting.marker + 1) * GRID**2)
        pixels.append(cv2.perspectiveTransform(grid, H).reshape(-1, 2).astype(np.float64))
    return {image: (np.array(numbers), np.concatenate(pixels)) for image, (numbers, pixels) in found.items()}


def tag_matches(first: Int64Array, second: Int64Array) -> Int64Array:
    """Rows of two images' tag features that are the same point, shape (M, 2)."""
    _, rows, columns = np.intersect1d(first, second, return_indices=True)
    return np.column_stack([rows, columns])


def focal_of_tags(sightings: Sequence[MarkerSighting], size_of: Mapping[str, tuple[int, int]]) -> float | None:
    """Focal length [px] that makes the markers square, for square pixels and a centre in the middle of the image.

    Args:
        sightings: Of squares, seen at a slant.
        size_of: Width and height of the images [px].

    Returns:
        None where the squares were seen too straight on, or too small, to tell.

    Source: Zhang, A flexible new technique for camera calibration, PAMI 2000, equations 3 and 4, one unknown.
    """
    left, right = [], []
    for sighting in sightings:
        width, height = size_of[sighting.image]
        centred = (sighting.corners_px - np.array([width, height]) / 2.0) / max(width, height)
        H = cv2.getPerspectiveTransform(_UNIT_SQUARE, centred.astype(np.float32))
        a, b = H[:, 0], H[:, 1]
        size = float(np.linalg.norm(a[:2]) * np.linalg.norm(b[:2]))
        left += [float(a[:2] @ b[:2]) / size, float(a[:2] @ a[:2] - b[:2] @ b[:2]) / size]
        right += [-float(a[2] * b[2]) / size, -float(a[2] ** 2 - b[2] ** 2) / size]
    x, y = np.array(left), np.array(right)
    if len(x) < 8:
        return None
    inverse = float((x @ y) / (x @ x))
    spread = float(np.sqrt(((y - inverse * x) ** 2).mean() / (x @ x)))
    if inverse <= 4.0 * spread:
        return None
    longer = {max(size) for size in size_of.values()}
    return float(max(longer) / np.sqrt(inverse))
