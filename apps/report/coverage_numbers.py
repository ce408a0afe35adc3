"""Coverage of a dataset as counts: places, headings, encounters, distances, commands."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray, Float64Array, Int32Array, Int64Array
from readygo.common.dataset import Dataset
from readygo.common.dataset.casts import Cast, read_casts
from readygo.common.maps import GridFrame, OccupancyMap, clearance_m, free_components
from readygo.common.robot import Clock, RobotConfig

VISIT_CELL_M = 0.1
AREA_CELL_M = 0.25
"""Cells in which the visited share of the reachable ground is counted [m]."""
HEADING_BINS = 24
W_BINS = 13
"""Number of turn-rate bins: odd, so that driving straight has a separate bin."""
V_STEP_MPS = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """Counts of values in bins [edge, next edge)."""

    edges: Float64Array
    counts: Int64Array
    beyond: int
    """Number of finite values at or above the last edge."""
    none: int
    """Number of infinite values: samples without a measurable value."""
    median: float | None
    """Median of the finite values; None without any."""

    @classmethod
    def of(cls, values: Float64Array, edges: Float64Array) -> "Histogram":
        """Count values; those below the first edge go to the first bin."""
        finite = values[np.isfinite(values)]
        bins = np.searchsorted(edges, finite, side="right") - 1
        inside = np.clip(bins[finite < edges[-1]], 0, len(edges) - 2)
        return cls(
            edges=edges,
            counts=np.bincount(inside, minlength=len(edges) - 1).astype(np.int64),
            beyond=int(np.count_nonzero(finite >= edges[-1])),
            none=len(values) - len(finite),
            median=float(np.median(finite)) if len(finite) else None,
        )

    def to_mapping(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "edges": [round(edge, 6) for edge in self.edges.tolist()],
            "counts": self.counts.tolist(),
            "beyond": self.beyond,
            "none": self.none,
            "median": None if self.median is None else round(self.median, 3),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Visits:
    """Number of episodes that visited each cell of a grid."""

    frame: GridFrame
    episodes: Int64Array
    """Episodes per cell, shape (H, W); row 0 is the smallest y."""

    def coarser(self, factor: int) -> "Visits":
        """Cells `factor` times as wide, each with the count of its busiest one."""
        rows, columns = (-(-side // factor) for side in self.episodes.shape)
        spare = [(0, count * factor - side) for count, side in zip((rows, columns), self.episodes.shape, strict=True)]
        blocks = np.pad(self.episodes, spare).reshape(rows, factor, columns, factor)
        frame = replace(self.frame, resolution_m=self.frame.resolution_m * factor)
        return Visits(frame=frame, episodes=blocks.max(axis=(1, 3)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Coverage:
    """Coverage of a dataset."""

    episodes: int
    samples: int
    distance_m: float
    visits: Visits
    headings: Histogram
    """Headings of the robot at each sample in the world [rad]."""
    actions: Int64Array
    """Samples by v (rows) and w (columns)."""
    v_edges_mps: Float64Array
    w_edges_radps: Float64Array
    duration_s: Histogram
    closest_m: Histogram
    """Smallest distance of the centres of robot and humans in each episode [m]."""
    collision_s: Histogram
    """Smallest time to collision in each episode [s]."""
    visible_share: Histogram
    """Share of each episode in which a human is in view."""
    visible_total: float
    """Share of all samples in which a human is in view."""
    encounters: Mapping[str, tuple[int, int]]
    """Kind of encounter -> episodes with it, humans in it."""
    avatars: Mapping[str, int]
    """Avatar -> episodes."""
    clock: Clock
    """Clock of the samples."""

    @property
    def hours(self) -> float:
        """Recorded time [h]."""
        return self.samples / self.clock.rate_hz / 3600


def casts_of(dataset: Dataset) -> list[Cast]:
    """The humans of the dataset's episodes, in its order.

    Raises:
        DatasetError: If a shard is damaged.
    """
    casts = {(shard, cast.episode): cast for shard in dataset.shards for cast in read_casts(shard)}
    return [casts[entry.shard, entry.episode] for entry in dataset.episodes]


def measure(dataset: Dataset, casts: Sequence[Cast]) -> Coverage:
    """Count what a dataset covers; no image is read.

    Args:
        dataset: Recorded episodes.
        casts: The humans of each episode, from `casts_of`.
    """
    robot = dataset.robot or RobotConfig()
    starts = np.array([entry.first_sample for entry in dataset.episodes])
    counts = np.array([entry.sample_count for entry in dataset.episodes])
    actions, truth = dataset.actions.astype(np.float64), dataset.truth
    v_edges, w_edges = _action_edges(actions, robot)
    visible = np.add.reduceat(truth["human_visible"].astype(np.int64), starts) / counts
    return Coverage(
        episodes=len(counts),
        samples=len(dataset),
        distance_m=math.fsum(np.abs(actions[:, 0]).tolist()) * dataset.clock.dt_s,
        visits=_visits(dataset.poses[:, :2], dataset.episode_of_sample),
        headings=_headings(dataset.poses[:, 3]),
        actions=_joint_counts(actions, v_edges, w_edges),
        v_edges_mps=v_edges,
        w_edges_radps=w_edges,
        duration_s=Histogram.of(counts * dataset.clock.dt_s, np.arange(0.0, 51.0, 2.5)),
        closest_m=Histogram.of(_least(truth["human_distance_m"], starts), np.arange(0.0, 5.01, 0.25)),
        collision_s=Histogram.of(_least(truth["time_to_collision_s"], starts), np.arange(0.0, 5.01, 0.25)),
        visible_share=Histogram.of(visible, np.append(np.arange(10) / 10, 1.0 + 1e-9)),
        visible_total=float(truth["human_visible"].mean()),
        encounters=count_encounters(casts),
        avatars=_sorted_counts([name for cast in casts for name in dict.fromkeys(cast.avatars)]),
        clock=dataset.clock,
    )


def count_encounters(casts: Sequence[Cast]) -> dict[str, tuple[int, int]]:
    """Kind of encounter -> episodes with it, humans in it; episodes without humans have a separate kind."""
    episodes = _sorted_counts([kind for cast in casts for kind in dict.fromkeys(cast.encounters or ("nobody",))])
    humans = _sorted_counts([kind for cast in casts for kind in cast.encounters])
    return {kind: (count, humans.get(kind, 0)) for kind, count in episodes.items()}


def visited_share(visits: Visits, occupancy: OccupancyMap, radius_m: float) -> float:
    """Share of the reachable ground that robots have visited, in cells of 0.25 m.

    Args:
        visits: Cells that robots visited.
        occupancy: Map of the cells that block the robot.
        radius_m: Radius of the robot's disc [m]; its largest connected free area counts as reachable.
    """
    labels, _ = free_components(clearance_m(occupancy) > radius_m)
    reachable = _coarse(np.argwhere(labels == 1), occupancy.frame)
    visited = _coarse(np.argwhere(visits.episodes > 0), visits.frame)
    return len(reachable & visited) / max(len(reachable), 1)


def _coarse(cells: Int64Array, frame: GridFrame) -> set[tuple[int, int]]:
    centres = (cells + 0.5) * frame.resolution_m + np.array([frame.origin_y_m, frame.origin_x_m])
    coarse = np.unique(np.floor(centres / AREA_CELL_M).astype(np.int64), axis=0)
    return set(map(tuple, coarse.tolist()))


def _visits(xy_m: Float64Array, episode: Int32Array) -> Visits:
    cells = np.floor(xy_m[:, ::-1] / VISIT_CELL_M).astype(np.int64)
    low, high = cells.min(axis=0), cells.max(axis=0)
    once = np.unique(np.column_stack([episode.astype(np.int64), cells - low]), axis=0)
    counts = np.zeros(high - low + 1, np.int64)
    np.add.at(counts, (once[:, 1], once[:, 2]), 1)
    origin_y_m, origin_x_m = (low * VISIT_CELL_M).tolist()
    frame = GridFrame(origin_x_m=origin_x_m, origin_y_m=origin_y_m, resolution_m=VISIT_CELL_M)
    return Visits(frame=frame, episodes=counts)


def _headings(yaw_rad: Float64Array) -> Histogram:
    """Histogram of headings, with bins centred on the axes: driving along +x does not fall on an edge."""
    width = math.tau / HEADING_BINS
    turned = np.mod(yaw_rad + width / 2, math.tau)
    counted = Histogram.of(np.minimum(turned, math.tau * (1 - 1e-12)), np.linspace(0.0, math.tau, HEADING_BINS + 1))
    return Histogram(edges=counted.edges - width / 2, counts=counted.counts, beyond=0, none=0, median=None)


def _action_edges(actions: Float64Array, robot: RobotConfig) -> tuple[Float64Array, Float64Array]:
    first = math.floor(min(0.0, float(actions[:, 0].min())) / V_STEP_MPS + 1e-6)
    last = math.ceil(robot.v_max_mps / V_STEP_MPS - 1e-6)
    v_edges: Float64Array = np.array([V_STEP_MPS * k for k in range(first, last + 1)])
    return v_edges, np.linspace(-robot.w_max_radps, robot.w_max_radps, W_BINS + 1)


def _joint_counts(actions: Float64Array, v_edges: Float64Array, w_edges: Float64Array) -> Int64Array:
    """Samples by speed and turn rate; the last bins hold their upper edges, which are the robot's limits."""
    # Commands are stored in single precision: 0.7 must not fall below the edge at 0.7.
    i = np.clip(np.searchsorted(v_edges - 1e-6, actions[:, 0], side="right") - 1, 0, len(v_edges) - 2)
    j = np.clip(np.searchsorted(w_edges - 1e-6, actions[:, 1], side="right") - 1, 0, len(w_edges) - 2)
    counts = np.zeros((len(v_edges) - 1, len(w_edges) - 1), np.int64)
    np.add.at(counts, (i, j), 1)
    return counts


def _least(values: AnyArray, starts: Int64Array) -> Float64Array:
    """Smallest value of each episode."""
    least: Float64Array = np.minimum.reduceat(values.astype(np.float64), starts)
    return least


def _sorted_counts(names: Sequence[str]) -> dict[str, int]:
    """Counts, most frequent first, then by name."""
    found = {name: names.count(name) for name in sorted(set(names))}
    return dict(sorted(found.items(), key=lambda item: -item[1]))
