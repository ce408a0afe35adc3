"""How well people and free space are perceived."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.perception.grid import peaks
from readygo.common.perception.people import ACROSS, ALONG, BEARING, DISTANCE, PRESENCE, THRESHOLD

MATCH_M = 0.5
"""A human is found if it is told this near to where it is, for the average precision [m]."""
PAIR_RAD, PAIR_RATIO = math.radians(12.0), 0.5
"""A told human is paired with one this near in bearing, and in the logarithm of distance, for errors and misses."""
NEAR_M = 6.0
"""Misses are counted up to this distance [m]."""


@dataclass(frozen=True, kw_only=True)
class PerceptionMetrics:
    """Errors over a set of images."""

    images: int
    people: int
    """Visible humans in all images."""
    average_precision: float
    """Area below precision over recall, found within `MATCH_M`."""
    bearing_deg: float
    """Median error of the bearing [deg]."""
    distance: float
    """Median relative error of the distance."""
    missed: float
    """Share of the visible humans within `NEAR_M` that were not told."""
    false_per_image: float
    """Detections without a human, per image; detections of hidden humans in view do not count."""
    along_r2: float
    """R2 of the velocity along the line of sight."""
    across_r2: float
    """R2 of the velocity across the line of sight."""
    along_mae_mps: float
    across_mae_mps: float
    rays: float
    """Median relative error of free distances."""


def measure_perception(
    maps: Sequence[Float64Array], free_m: Float64Array, people: Float32Array, visible: BoolArray, rays_m: Float32Array
) -> PerceptionMetrics:
    """Compare what was perceived with labels, see `PerceptionLabels`.

    Args:
        maps: Map of people of each image, as the exported network answers it, shape (9, D, C).
        free_m: Free distances [m], shape (N, C).
        people: True humans, shape (N, M, 4).
        visible: Which of them are visible, shape (N, M).
        rays_m: True free distances [m], shape (N, C).
    """
    scored: list[tuple[float, bool]] = []
    pairs: list[tuple[Float64Array, Float64Array]] = []
    near = missed = false = 0
    for image, answers in enumerate(maps):
        told = _told(answers, 0.05)
        there = people[image][np.isfinite(people[image, :, 0])].astype(np.float64)
        shown = visible[image, : len(there)]
        scored += _scored(told, there, shown)
        told = told[told[:, PRESENCE] >= THRESHOLD]
        matched = _paired(told, there)
        pairs += [(told[a], there[b]) for a, b in matched if shown[b]]
        found = {b for _, b in matched}
        close = [k for k in range(len(there)) if shown[k] and there[k, 1] <= NEAR_M]
        near, missed = near + len(close), missed + sum(k not in found for k in close)
        false += len(told) - len(matched)
    ours = np.array([a for a, _ in pairs]).reshape(-1, 9)
    true = np.array([b for _, b in pairs]).reshape(-1, 4)
    return PerceptionMetrics(
        images=len(maps),
        people=int(visible.sum()),
        average_precision=_average_precision(scored, int(visible.sum())),
        bearing_deg=_median(np.degrees(np.abs(ours[:, BEARING] - true[:, 0]))),
        distance=_median(np.abs(ours[:, DISTANCE] / true[:, 1] - 1.0)),
        missed=missed / max(near, 1),
        false_per_image=false / max(len(maps), 1),
        along_r2=r2(ours[:, ALONG], true[:, 2]),
        across_r2=r2(ours[:, ACROSS], true[:, 3]),
        along_mae_mps=_mean(np.abs(ours[:, ALONG] - true[:, 2])),
        across_mae_mps=_mean(np.abs(ours[:, ACROSS] - true[:, 3])),
        rays=_median(np.abs(free_m / np.maximum(rays_m, 0.05) - 1.0)),
    )


def _told(answers: Float64Array, threshold: float) -> Float64Array:
    cells = peaks(answers[PRESENCE], threshold)
    told: Float64Array = answers[:, cells[:, 0], cells[:, 1]].T
    return told


def _scored(told: Float64Array, there: Float64Array, shown: BoolArray) -> list[tuple[float, bool]]:
    """Probability of each told human, and whether it is a visible one not told before; hidden ones do not count."""
    taken: set[int] = set()
    scored = []
    xy, true = _places(told[:, BEARING], told[:, DISTANCE]), _places(there[:, 0], there[:, 1])
    for row in range(len(told)):
        away = np.hypot(*(true - xy[row]).T) if len(true) else np.empty(0)
        best = int(np.argmin(away)) if len(away) else -1
        right = best >= 0 and away[best] <= MATCH_M
        if right and not shown[best]:
            continue
        scored.append((float(told[row, PRESENCE]), bool(right and best not in taken)))
        if right:
            taken.add(best)
    return scored


def _paired(told: Float64Array, there: Float64Array) -> list[tuple[int, int]]:
    """Told and true humans that belong together, the likeliest first."""
    free, pairs = set(range(len(there))), []
    for row in range(len(told)):
        best, least = -1, 1.0
        for k in free:
            off = abs(told[row, BEARING] - there[k, 0]) / PAIR_RAD
            off = max(off, abs(math.log(told[row, DISTANCE] / max(there[k, 1], 0.05))) / PAIR_RATIO)
            if off < least:
                best, least = k, off
        if best >= 0:
            free.discard(best)
            pairs.append((row, best))
    return pairs


def _places(bearing: Float64Array, distance_m: Float64Array) -> Float64Array:
    places: Float64Array = np.stack([distance_m * np.cos(bearing), distance_m * np.sin(bearing)], axis=1)
    return places


def _average_precision(scored: list[tuple[float, bool]], count: int) -> float:
    if not scored or count == 0:
        return 0.0
    ranked = sorted(scored, key=lambda row: -row[0])
    right = np.cumsum([hit for _, hit in ranked])
    precision, recall = right / np.arange(1, len(ranked) + 1), right / count
    # Precision never rises with recall: what a higher threshold gives is at hand.
    best = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * best))


def _median(values: Float64Array) -> float:
    return float(np.median(values)) if values.size else math.nan


def _mean(values: Float64Array) -> float:
    return float(np.mean(values)) if values.size else math.nan


def r2(told: Float64Array, true: Float64Array) -> float:
    """Share of the variance of `true` that `told` explains, shapes (N,); NaN where there is none."""
    if len(true) < 2 or np.var(true) == 0:
        return math.nan
    return float(1.0 - np.mean((told - true) ** 2) / np.var(true))
