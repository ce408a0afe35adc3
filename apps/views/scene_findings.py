"""A map of a scene's likely defects, with sentences that describe them."""

import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from readygo.apps.pictures.scene_maps import OCCUPIED, REACHABLE, SEPARATE, TOO_NARROW, UNKNOWN
from readygo.apps.views.pictures import ALARM
from readygo.apps.views.views import SceneViews
from readygo.common.arrays import UInt8Array
from readygo.common.drawing.plan_view import (
    GOAL,
    HUMANS,
    INK,
    WHITE,
    Rgb,
    draw_scale_bar,
    put_mark,
    put_text,
    resize_view,
)
from readygo.common.drawing.sheet import area_swatch, ring_swatch, sheet
from readygo.common.maps import ScenePlan, clearance_m, free_components
from readygo.common.scenes.findings import BLURRED, ROUGH, UNFILMED, marks
from readygo.common.scenes.top_view import TopView

COLOURS: dict[str, Rgb] = {ROUGH: HUMANS[1], BLURRED: HUMANS[3], UNFILMED: HUMANS[0]}
SHARE = 0.7
"""Opacity of a mark, 0..1; the map shines through."""
HEIGHT_PX, WIDTH_MAX_PX = 900, 1600
LINE_PX, LETTER_PX = 20, 6.8


def findings_map(plan: ScenePlan, seen: SceneViews, sentences: Sequence[str], name: str, radius_m: float) -> UInt8Array:
    """The robot's map with marks at likely defects.

    Args:
        plan: Maps of the scene.
        seen: Sample views; blurred and bare places are numbered as in `views_sheet`.
        sentences: Descriptions of the defects, written below the map.
        name: Name of the scene.
        radius_m: Radius of the disc that the reachable ground is for [m].

    Returns:
        RGB image.
    """
    view = _map(plan, radius_m)
    picture = np.ascontiguousarray(view.rgb)
    dull = [(number, place) for number, place in enumerate(seen.places, start=1) if place.blurred or place.bare]
    for number, place in dull:
        put_mark(picture, view, place.typical.xyyaw[:2], str(number), ALARM)
    draw_scale_bar(picture, view)
    found = {kind: float(cells.sum()) * plan.robot.frame.resolution_m**2 for kind, cells in marks(plan).items()}
    legend = [(area_swatch(COLOURS[kind], SHARE), f"{kind}: {m2:.1f} m2") for kind, m2 in found.items() if m2 > 0]
    legend += [(area_swatch(REACHABLE, 1.0), "reachable"), (area_swatch(SEPARATE, 1.0), "cut off")]
    legend += [(area_swatch(UNKNOWN, 1.0), "no floor seen"), (area_swatch(OCCUPIED, 1.0), "blocked")]
    if dull:
        legend.append((ring_swatch(ALARM), "number: little to see from there, as `scene inspect` draws"))
    verdict = ("nothing to complain about", GOAL) if not sentences else (f"{len(sentences)} to look at", ALARM)
    rows = [[picture], *([[_text(sentences, max(picture.shape[1], 480))]] if sentences else [])]
    return sheet(rows, [(f"what was found in {name}", INK), verdict], legend)


def _map(plan: ScenePlan, radius_m: float) -> TopView:
    """The map in colours; row 0 is the largest y."""
    labels, _ = free_components(clearance_m(plan.robot) > radius_m)
    cells = np.full((*labels.shape, 3), TOO_NARROW, np.uint8)
    for part, colour in (
        (plan.robot.occupied, OCCUPIED),
        (plan.unknown, UNKNOWN),
        (labels > 1, SEPARATE),
        (labels == 1, REACHABLE),
    ):
        cells[part] = colour
    for kind, part in marks(plan).items():
        cells[part] = np.rint((1 - SHARE) * cells[part] + SHARE * np.array(COLOURS[kind])).astype(np.uint8)
    frame = plan.robot.frame
    factor = max(1, -(-HEIGHT_PX // len(cells)))
    large = cells[::-1].repeat(factor, axis=0).repeat(factor, axis=1)
    view = TopView(rgb=large, frame=replace(frame, resolution_m=frame.resolution_m / factor))
    return resize_view(view, min(HEIGHT_PX, round(WIDTH_MAX_PX * len(cells) / cells.shape[1])))


def _text(sentences: Sequence[str], width: int) -> UInt8Array:
    lines = [
        line
        for sentence in sentences
        for line in textwrap.wrap(f"- {sentence}", int(width / LETTER_PX), subsequent_indent="  ")
    ]
    block = np.full((LINE_PX * len(lines) + 6, width, 3), WHITE, np.uint8)
    for row, line in enumerate(lines, start=1):
        put_text(block, line, (4, LINE_PX * row - 4))
    return block
