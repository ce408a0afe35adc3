"""Statistics of features in LeRobot's format: per episode, and overall."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array
from readygo.common.errors import DatasetError
from readygo.common.images.encoded import decode_image

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
IMAGES_MAX = 8
"""Largest number of images per episode for the statistics, spread over it."""
_PIXEL_STEP = 2
"""Step between the pixels that count, in both directions."""

Statistics = dict[str, dict[str, Any]]
"""For each feature min, max, mean, std, count, q01, ... as nested lists, for JSON and Parquet."""


def of_rows(column: npt.NDArray[np.generic]) -> dict[str, Any]:
    """Statistics of a column, shape (T,) or (T, n); each has shape (1,) or (n,)."""
    values = column.reshape(len(column), -1).astype(np.float64)
    return _describe_values(values, (values.shape[1],), len(column))


def of_images(images: Sequence[bytes]) -> dict[str, Any]:
    """Statistics of the colours of some of an episode's images, 0..1; each has shape (3, 1, 1).

    Raises:
        DatasetError: If an image cannot be decoded.
    """
    chosen = sorted(set(np.linspace(0, len(images) - 1, IMAGES_MAX).astype(int).tolist()))
    pictures = [decode_image(images[row]) for row in chosen]
    if any(picture is None for picture in pictures):
        raise DatasetError("An image is damaged; `readygo validate` names it.")
    seen = [picture[::_PIXEL_STEP, ::_PIXEL_STEP].reshape(-1, 3) for picture in pictures if picture is not None]
    return _describe_values(np.concatenate(seen) / 255.0, (3, 1, 1), len(chosen))


def merge_statistics(parts: Sequence[Statistics]) -> Statistics:
    """Overall statistics; quantiles are the means of the parts' quantiles, as in LeRobot."""
    return {name: _merged_feature([part[name] for part in parts]) for name in parts[0]}


def _describe_values(values: Float64Array, shape: tuple[int, ...], count: int) -> dict[str, Any]:
    found = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
    }
    quantiles = np.quantile(values, QUANTILES, axis=0)
    found |= {f"q{round(100 * share):02d}": row for share, row in zip(QUANTILES, quantiles, strict=True)}
    return {**{name: value.reshape(shape).tolist() for name, value in found.items()}, "count": [count]}


def _merged_feature(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    counts = np.array([part["count"][0] for part in parts], dtype=np.float64)

    def weigh(values: Float64Array) -> Float64Array:
        return np.asarray(np.tensordot(counts / counts.sum(), values, axes=1))

    stacked = {name: np.array([part[name] for part in parts]) for name in parts[0] if name != "count"}
    mean = weigh(stacked["mean"])
    found = {name: weigh(values) for name, values in stacked.items()}
    found["min"], found["max"] = stacked["min"].min(axis=0), stacked["max"].max(axis=0)
    found["std"] = np.sqrt(weigh(stacked["std"] ** 2 + (stacked["mean"] - mean) ** 2))
    return {**{name: value.tolist() for name, value in found.items()}, "count": [int(counts.sum())]}
