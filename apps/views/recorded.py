"""Sharpness of recorded images: warnings, thumbnails, and a map of blurred places."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.pictures.side_by_side import has_several, recorded_together, shown_images
from readygo.apps.views.pictures import (
    ALARM,
    COLUMNS,
    MAP_SIDE_PX,
    add_caption,
    sharpness_colour,
    sharpness_legend,
)
from readygo.common.arrays import Int64Array, UInt8Array
from readygo.common.dataset import Dataset, RecordedClarity, recorded_clarity
from readygo.common.drawing.plan_view import INK, draw_disc, draw_scale_bar, map_window
from readygo.common.drawing.sheet import sheet, stack_panels
from readygo.common.errors import ReadygoError
from readygo.common.images.clarity import COVERED_FROM, SHARP_FROM
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import RunSpec
from readygo.common.robot import RobotConfig
from readygo.common.scenes import load_scene
from readygo.services.renderer import Renderer, RendererConfig, look_around

THUMBNAILS = 24
MOMENTS, MOMENT_WIDTH_PX = 3, 1200
COVERAGE_LOOKS = 24
NAMED = 3
"""Number of blurred episodes that a warning names."""
MARGIN_M, MARGIN_SHARE = 1.0, 0.04


@dataclass(frozen=True, kw_only=True, eq=False)
class RunClarity:
    """Sharpness and coverage of a run's images."""

    recorded: RecordedClarity
    coverage: float | None
    """Median coverage of views from some of its poses, without humans; None if the scene is not available."""
    places: tuple[str, ...]
    """Blurred episodes with their places, at most `NAMED`."""

    def to_mapping(self) -> dict[str, Any]:
        """Plain values."""
        covered = None if self.coverage is None else round(self.coverage, 3)
        return {**self.recorded.to_mapping(), "coverage_median": covered}

    def warnings(self) -> list[str]:
        """Warnings about the recorded images, a line each."""
        found = []
        if self.recorded.blurred:
            found.append(
                f"{self.recorded}: fog, such as {', '.join(self.places)}. `readygo coverage` draws where, "
                f"[episode] sharpness_min = {SHARP_FROM:g} leaves such episodes out."
            )
        if self.coverage is not None and self.coverage < COVERED_FROM:
            found.append(
                f"Only {100 * self.coverage:.0f} % of the view is surface, the rest haze or nothing; "
                f"[episode] coverage_min = {COVERED_FROM:g} leaves out episodes that show no more."
            )
        return found


def run_clarity(spec: RunSpec, data: Path) -> RunClarity:
    """Measure some images of a finished run, and views of the scene from some of its poses.

    Raises:
        DatasetError: If an image cannot be read.
    """
    dataset = Dataset([data])
    clarity = recorded_clarity(dataset)
    return RunClarity(
        recorded=clarity, coverage=_coverage(spec, dataset, clarity), places=tuple(_blurred_places(dataset, clarity))
    )


def _coverage(spec: RunSpec, dataset: Dataset, clarity: RecordedClarity) -> float | None:
    poses = dataset.poses[_spread(clarity, COVERAGE_LOOKS)][:, [0, 1, 3]]
    try:
        scene = load_scene(Path(spec.scene_path))
        looks = look_around(Renderer(scene, {}, dataset.robot or RobotConfig(), RendererConfig()), poses)
        return float(np.median([look.coverage for look in looks]))
    except ReadygoError:
        return None


def _blurred_places(dataset: Dataset, clarity: RecordedClarity) -> list[str]:
    named = []
    for number in np.flatnonzero(clarity.of_episode < SHARP_FROM)[:NAMED].tolist():
        first = clarity.samples.reshape(len(clarity.of_episode), -1)[number]
        x_m, y_m = dataset.poses[first[len(first) // 2], :2].tolist()
        name = dataset.episodes[int(dataset.episode_of_sample[first[0]])].episode.episode_id
        named.append(f"{name} near ({x_m:.1f}, {y_m:.1f})")
    return named


def thumbnails(dataset: Dataset, name: str) -> UInt8Array:
    """Recorded images, spread over the episodes, with place and sharpness below them.

    Args:
        dataset: Recorded episodes.
        name: Name of the dataset.

    Returns:
        RGB image of the sheet.

    Raises:
        DatasetError: If an image is damaged.
    """
    clarity = recorded_clarity(dataset)
    shown = _spread(clarity, THUMBNAILS)
    sharp = dict(zip(clarity.samples.tolist(), clarity.sharpness.tolist(), strict=True))
    tiles = [_thumbnail(dataset, index, sharp[index]) for index in shown.tolist()]
    rows = [tiles[k : k + COLUMNS] for k in range(0, len(tiles), COLUMNS)]
    colour = ALARM if clarity.blurred else INK
    return sheet(rows, [(f"recorded in {name}", INK), (str(clarity), colour)], [])


def camera_moments(dataset: Dataset) -> UInt8Array | None:
    """All cameras' images at some moments, depths included; None for a dataset with one image per moment.

    Args:
        dataset: Recorded episodes.

    Returns:
        RGB image of the sheet.

    Raises:
        DatasetError: If an image is damaged.
    """
    if not has_several(dataset):
        return None
    robot = dataset.robot or RobotConfig()
    rows = shown_images(dataset.outputs, robot)
    looked_at = recorded_clarity(dataset).samples
    with_somebody = looked_at[dataset.truth["human_visible"][looked_at]]
    chosen = with_somebody if len(with_somebody) else looked_at
    shown = dict.fromkeys(chosen[(2 * np.arange(MOMENTS) + 1) * len(chosen) // (2 * MOMENTS)].tolist())
    return stack_panels([recorded_together(dataset, sample, rows, robot, width_px=MOMENT_WIDTH_PX) for sample in shown])


def recorded_map(dataset: Dataset, clarity: RecordedClarity, occupancy: OccupancyMap | None) -> UInt8Array:
    """Map of the places of the measured images, in the colours of their sharpness.

    Args:
        dataset: Recorded episodes.
        clarity: Sharpness of its images.
        occupancy: Map of the cells that block the robot; None leaves it out.

    Returns:
        RGB image of the map.
    """
    xy_m = dataset.poses[clarity.samples, :2]
    margin_m = max(MARGIN_M, MARGIN_SHARE * float(np.ptp(xy_m, axis=0).max()))
    low_m, high_m = xy_m.min(axis=0) - margin_m, xy_m.max(axis=0) + margin_m
    if occupancy is None:
        side = 1 + int(np.ceil((high_m - low_m).max()))
        frame = GridFrame(origin_x_m=float(low_m[0]), origin_y_m=float(low_m[1]), resolution_m=1.0)
        occupancy = OccupancyMap(frame=frame, occupied=np.zeros((side, side), np.bool_))
    pixel_m = float((high_m - low_m).max()) / MAP_SIDE_PX
    view = map_window(occupancy, low_m, high_m, pixel_m=pixel_m)
    picture = view.rgb.copy()
    # The most blurred ones are drawn last, on top.
    for place in np.argsort(-clarity.sharpness, kind="stable").tolist():
        draw_disc(picture, view, xy_m[place], 7 * pixel_m, sharpness_colour(float(clarity.sharpness[place])))
    draw_scale_bar(picture, view)
    return sheet([[picture]], [("sharpness of recorded pictures", INK)], sharpness_legend())


def _spread(clarity: RecordedClarity, count: int) -> Int64Array:
    """Some of the measured samples, spread evenly."""
    total = len(clarity.samples)
    return clarity.samples[np.arange(min(count, total)) * total // min(count, total)]


def _thumbnail(dataset: Dataset, index: int, sharp: float) -> UInt8Array:
    entry = dataset.episodes[int(dataset.episode_of_sample[index])]
    x_m, y_m = dataset.poses[index, :2].tolist()
    time_s = int(dataset.time_ns[index]) / 1e9
    text = f"{entry.episode.episode_id}  {time_s:.1f} s  ({x_m:.1f}, {y_m:.1f})  sharp {sharp:.0f}"
    return add_caption(dataset.decode(index), text, ALARM if sharp < SHARP_FROM else INK)
