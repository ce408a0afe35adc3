"""The page of a dataset's coverage, readable in a minute, and its heat map."""

import math

import numpy as np

from readygo.apps.report.coverage_numbers import Coverage, Histogram, Visits
from readygo.apps.report.coverage_run import RunFacts
from readygo.apps.report.page import (
    Block,
    MediaFigure,
    Meter,
    PageTable,
    arrange_blocks,
    drawing,
    page,
    percent,
    rejections,
    small_print,
)
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.drawing.charts import bar_chart, grid_chart, rose_chart
from readygo.common.drawing.plan_view import (
    INK,
    WHITE,
    draw_scale_bar,
    map_window,
    put_text,
    sample_grid,
    text_width_px,
)
from readygo.common.maps import OccupancyMap

MARGIN_M, ASPECT_MIN = 0.5, 0.5
MAP_SIDE_MIN_PX, MAP_SIDE_MAX_PX = 500, 1400
CELL_MIN_PX = 4
"""Smallest width of a cell in the picture [px]: a path through a large map stays visible."""
_SHARPNESS_NOTE = (
    "Where some of the images were taken, and how sharp they are: the variance of the Laplacian. A wall close by "
    "is dull for a moment; a region in orange or brown is fog."
)
# Pale yellow to dark red: told apart from the grey of walls in print and with every common colour vision.
_HEAT = np.array([(255, 237, 160), (254, 178, 76), (240, 59, 32), (128, 0, 38)], dtype=np.float64)


def heat_map(visits: Visits, occupancy: OccupancyMap | None) -> UInt8Array:
    """Heat map of the number of episodes that visited each cell, on the map if there is one, with a scale.

    Cells that would be too small to see are merged.
    """
    frame, (rows, columns) = visits.frame, visits.episodes.shape
    low_m = np.array([frame.origin_x_m, frame.origin_y_m])
    high_m = low_m + np.array([columns, rows]) * frame.resolution_m
    ground = occupancy
    if ground is None:
        ground = OccupancyMap(frame=frame, occupied=np.zeros((rows, columns), np.bool_))
    elif not _is_vast(ground, float((high_m - low_m).max())):
        free = np.argwhere(~ground.occupied)
        corner = np.array([ground.frame.origin_x_m, ground.frame.origin_y_m])
        low_m = np.minimum(low_m, corner + free.min(axis=0)[::-1] * ground.frame.resolution_m)
        high_m = np.maximum(high_m, corner + (free.max(axis=0)[::-1] + 1) * ground.frame.resolution_m)
    side_m = float((high_m - low_m).max()) + 2 * MARGIN_M
    # A long corridor keeps room for the scale below it.
    spare_m = np.maximum(MARGIN_M, (ASPECT_MIN * side_m - (high_m - low_m)) / 2)
    low_m, high_m = low_m - spare_m, high_m + spare_m
    side_px = min(max(MAP_SIDE_MIN_PX, 60 * side_m), MAP_SIDE_MAX_PX)
    view = map_window(ground, low_m, high_m, pixel_m=side_m / side_px)
    picture = view.rgb.copy()
    shown = visits.coarser(math.ceil(CELL_MIN_PX * view.frame.resolution_m / frame.resolution_m - 1e-6))
    counts = sample_grid(view, shown.episodes, shown.frame)
    picture[counts > 0] = _heat_colours(counts[counts > 0] / max(int(shown.episodes.max()), 1))
    draw_scale_bar(picture, view)
    return np.concatenate([picture, _heat_scale(picture.shape[1], shown)])


def _is_vast(occupancy: OccupancyMap, visited_m: float) -> bool:
    """True if the visited part would be lost in a picture of the whole map."""
    return float(max(occupancy.occupied.shape)) * occupancy.frame.resolution_m > max(4 * visited_m, 60.0)


def _heat_colours(shares: Float64Array) -> UInt8Array:
    """Colours of shares in 0..1, shape (N, 3); a square-root scale emphasises rarely visited cells."""
    place = np.sqrt(shares) * (len(_HEAT) - 1)
    channels = [np.interp(place, np.arange(len(_HEAT)), _HEAT[:, channel]) for channel in range(3)]
    return np.asarray(np.rint(np.stack(channels, axis=-1)), dtype=np.uint8)


def _heat_scale(width: int, visits: Visits) -> UInt8Array:
    highest = int(visits.episodes.max())
    strip = np.full((30, width, 3), WHITE, np.uint8)
    bar = np.linspace(1 / max(highest, 1), 1.0, 160)
    strip[8:22, 30:190] = _heat_colours(bar)[None]
    put_text(strip, "1", (16, 20), colour=INK)
    put_text(strip, f"{highest} episodes", (198, 20), colour=INK)
    note = f"cells of {visits.frame.resolution_m:.3g} m; colour: square root of the count"
    if 320 + text_width_px(note) < width:
        put_text(strip, note, (320, 20), colour=(93, 104, 116))
    return strip


def coverage_page(coverage: Coverage, facts: RunFacts, heat: UInt8Array, sharp: UInt8Array) -> str:
    """The page as HTML text.

    Args:
        coverage: Coverage of the dataset.
        facts: Facts about its run.
        heat: Heat map of the visited cells.
        sharp: Map of the images' sharpness.
    """
    rejected = [] if facts.rejected is None else [rejections(facts.rejected, coverage.episodes)]
    return page(
        f"Coverage of {facts.name}",
        f"What {coverage.episodes:,} recorded episodes in scene {facts.scene or 'unknown'} show, and what they do not.",
        tiles=_tiles(coverage, facts),
        sections={
            "Where robots went": _places(coverage, facts, heat),
            "How sharp images are": [drawing(sharp, _SHARPNESS_NOTE, alt="How sharp images are")],
            "Whom they met": _encounters(coverage, facts),
            "How they drove": _driving(coverage),
            "What is not recorded": rejected,
        },
        facts=facts.provenance,
    )


def _tiles(coverage: Coverage, facts: RunFacts) -> list[tuple[str, str]]:
    tiles = [
        (f"{coverage.episodes:,}", "episodes"),
        (f"{coverage.samples:,}", "samples"),
        (f"{60 * coverage.hours:.0f} min", "driven"),
        (f"{coverage.distance_m:,.0f} m", "of path"),
        (percent(coverage.visible_total), "of samples show a pedestrian"),
    ]
    if facts.visited_share is not None:
        tiles.append((percent(facts.visited_share), "of the reachable ground"))
    return tiles


def _places(coverage: Coverage, facts: RunFacts, heat: UInt8Array) -> list[Block]:
    note = "How many episodes came by, at the busiest place of each cell"
    note += (
        "; grey blocks the robot." if facts.occupancy else ". The scene's map is not available: name it with --scene."
    )
    rose = MediaFigure(
        chart=rose_chart(coverage.headings.counts, name="Samples by heading"),
        caption="Where the robot looked, in the world; areas are samples.",
    )
    return arrange_blocks("pair", [drawing(heat, note, alt="Where robots went"), rose])


def _encounters(coverage: Coverage, facts: RunFacts) -> list[Block]:
    failed = facts.failed or {}
    outcomes = sorted({outcome for counts in failed.values() for outcome in counts})
    columns = ["Encounter", "Episodes", "Pedestrians", "Share"]
    note = "Recorded episodes. Whom the rejected ones would have met is not known here."
    if facts.failed is not None:
        columns += [*(outcome.replace("_", " ") for outcome in outcomes), "Expert succeeds"]
        note = "Recorded episodes; those in which the expert failed are not in the data and counted at the right."
    rows: list[list[str | Block]] = []
    for kind in dict.fromkeys([*coverage.encounters, *failed]):
        episodes, humans = coverage.encounters.get(kind, (0, 0))
        row: list[str | Block] = [
            kind.replace("_", " "), f"{episodes:,}", f"{humans:,}", Meter(episodes / coverage.episodes)
        ]  # fmt: skip
        if facts.failed is not None:
            counts = failed.get(kind, {})
            row += [f"{counts.get(outcome, 0):,}" for outcome in outcomes]
            row.append(percent(episodes / max(episodes + sum(counts.values()), 1)))
        rows.append(row)
    charts = [
        _histogram(
            coverage.closest_m,
            "closest approach, centre to centre [m]",
            "How near pedestrians came, once per episode. Discs touch at 0.5 m by default.",
            "never met",
        ),
        _histogram(
            coverage.collision_s,
            "least time to collision [s]",
            "How soon robot and pedestrian would have touched at constant velocities, at worst in each episode.",
            "never",
        ),
    ]
    return [PageTable(columns, rows), small_print(note), *arrange_blocks("pair", charts)]


def _driving(coverage: Coverage) -> list[Block]:
    commands = grid_chart(
        coverage.w_edges_radps,
        coverage.v_edges_mps,
        coverage.actions,
        x_axis="turn rate w [rad/s], left is positive",
        y_axis="speed v [m/s]",
        count_name="Samples",
    )
    figures = [
        MediaFigure(chart=commands, caption="Commands; density is the logarithm of the number of samples."),
        _histogram(coverage.duration_s, "length of the episode [s]", "How long episodes take."),
        _histogram(
            coverage.visible_share,
            "share of the episode with a pedestrian in view",
            "How much of an episode shows a pedestrian.",
        ),
    ]
    return arrange_blocks("pair", figures)


def _histogram(histogram: Histogram, axis: str, caption: str, none_name: str = "") -> MediaFigure:
    rest = [(f"over {histogram.edges[-1]:.3g}", histogram.beyond), (none_name, histogram.none)]
    chart = bar_chart(histogram.edges, histogram.counts, axis=axis, count_name="Episodes", rest=rest)
    return MediaFigure(chart=chart, caption=caption)
