"""The page of a scene's quality, readable in a minute, and its maps."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from readygo.apps.report.health_numbers import Sightlines
from readygo.apps.report.page import (
    Block,
    PageTable,
    Paragraph,
    arrange_blocks,
    drawing,
    fact_table,
    page,
    percent,
    photograph,
    small_print,
)
from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.drawing.plan_view import INK, Rgb, draw_path, draw_scale_bar, put_mark, sample_grid, window_around
from readygo.common.drawing.sheet import area_swatch, line_swatch, sheet
from readygo.common.maps import OccupancyMap
from readygo.common.scenes.filmed import FILMED_MIN

SIDE_MAX_PX = 1200
TOP, ROBOT_MAP, VIEWS, CLARITY = "top.png", "map_robot.png", "views.png", "map_views.png"
SIGHT, FILMED, HELD_OUT = "map_sight.png", "map_filmed.png", "map_held_out.png"
"""Names of the report's pictures."""
_PHOTOGRAPHS = (TOP, VIEWS)
_MAP_NOTE = (
    "What blocks the robot: dark is occupied, grey is unknown or was not filmed, white too narrow, green the largest "
    "area that it can move in, orange areas cut off from that."
)
_FOG_NOTE = "How sharp the views are; a region in orange or brown is fog."
_SIGHT_NOTE = (
    "Directions in which nothing stands at the height of eyes: windows, open doors, holes in walls, or the open."
)
SIDE_PX = 900
OUT: Rgb = (213, 94, 0)
# Orange to blue, as maps of sharpness: distinguishable with every common colour vision.
_FILMED: tuple[tuple[float, Rgb, str], ...] = (
    (0.25, (150, 50, 10), "less than 25 % of what is seen was filmed"),
    (FILMED_MIN, (240, 140, 50), f"less than {100 * FILMED_MIN:.0f} %"),
    (0.75, (190, 215, 235), "less than 75 %"),
    (math.inf, (80, 150, 205), "more"),
)
_PSNR: tuple[tuple[float, Rgb, str], ...] = (
    (20.0, (150, 50, 10), "PSNR below 20 dB"),
    (24.0, (240, 140, 50), "below 24 dB"),
    (28.0, (130, 180, 220), "below 28 dB"),
    (math.inf, (40, 110, 170), "better"),
)


def health_page(numbers: Mapping[str, Any], pictures: Mapping[str, UInt8Array]) -> str:
    """The page as HTML text.

    Args:
        numbers: Result of `readygo.apps.report.health_numbers.health`.
        pictures: Pictures by name; missing ones are left out.
    """
    floaters = "Floaters and haze hide what is behind them; readygo scene clean removes them."
    sections: dict[str, Sequence[Block]] = {
        "What to look at": _findings(numbers["findings"]),
        "From above": _figures(pictures, {TOP: "Without its ceiling.", ROBOT_MAP: _MAP_NOTE}),
        "Scale and registration": [fact_table(_origin(numbers))],
        "Held-out images": _held_out(numbers["held_out"], pictures),
        "What was filmed": _coverage_section(numbers["filmed"], pictures),
        "What the robot sees": _figures(pictures, {VIEWS: "From places all over its ground.", CLARITY: _FOG_NOTE}),
        "Floor and walls": [fact_table(_floor(numbers)), *_figures(pictures, {SIGHT: _SIGHT_NOTE})],
        "Gaussians": [
            PageTable(("Kind", "Gaussians", "Share"), _defect_rows(numbers)),
            small_print(floaters),
        ],
    }
    return page(
        f"Health of {numbers['name']}",
        "What this scene holds, where its scale comes from, and what is wrong with it.",
        tiles=_tiles(numbers),
        sections=sections,
        facts={"scene": numbers["content_hash"], "license": numbers["license"] or "not given"},
    )


def sightlines_map(lines: Sightlines, occupancy: OccupancyMap) -> UInt8Array:
    """The map with the lines of sight that leave the scene."""
    view = window_around(occupancy, ~occupancy.occupied, side_px=SIDE_PX)
    picture = view.rgb.copy()
    reach_m = 0.5 * float(max(view.rgb.shape[:2])) * view.frame.resolution_m
    for place, row in zip(lines.places_m, lines.open, strict=True):
        for bearing in lines.bearings_rad[row]:
            end = place + reach_m * np.array([math.cos(bearing), math.sin(bearing)])
            draw_path(picture, view, np.stack([place, end]), OUT, width_px=1)
    for number, place in enumerate(lines.places_m, start=1):
        put_mark(picture, view, place, str(number), INK)
    draw_scale_bar(picture, view)
    words = f"nothing stands in {100 * lines.open_share:.0f} % of the directions"
    return sheet([[picture]], [(words, INK)], [(line_swatch(OUT), "looks out of the scene at the height of eyes")])


def filmed_map(share: Float32Array, occupancy: OccupancyMap) -> UInt8Array:
    """The map with the ground coloured by the share of the view from there that was filmed."""
    view = window_around(OccupancyMap(frame=occupancy.frame, occupied=share <= 0.0), share > 0.0, side_px=SIDE_PX)
    picture = view.rgb.copy()
    values = sample_grid(view, share, occupancy.frame)
    for limit, colour, _ in reversed(_FILMED):
        picture[(values > 0.0) & (values < limit)] = colour
    draw_scale_bar(picture, view)
    return sheet(
        [[picture]], [("what was filmed", INK)], [(area_swatch(colour, 1.0), text) for _, colour, text in _FILMED]
    )


def held_out_map(images: Sequence[dict[str, Any]], occupancy: OccupancyMap) -> UInt8Array | None:
    """The map with the places and the quality of held-out images; None if their places are unknown."""
    placed = [row for row in images if row["xyyaw"] is not None]
    if not placed:
        return None
    view = window_around(occupancy, ~occupancy.occupied, side_px=SIDE_PX)
    picture = view.rgb.copy()
    for number, row in enumerate(images, start=1):
        if row["xyyaw"] is None:
            continue
        x, y, yaw = row["xyyaw"]
        colour = next(colour for limit, colour, _ in _PSNR if row["psnr_db"] < limit)
        way = np.array([[x, y], [x + 0.4 * math.cos(yaw), y + 0.4 * math.sin(yaw)]])
        draw_path(picture, view, way, colour, width_px=3)
        put_mark(picture, view, (x, y), str(number), colour)
    draw_scale_bar(picture, view)
    return sheet(
        [[picture]], [("held-out images", INK)], [(area_swatch(colour, 1.0), text) for _, colour, text in _PSNR]
    )


def _tiles(numbers: Mapping[str, Any]) -> list[tuple[str, str]]:
    robot, held_out, filmed = numbers["robot"], numbers["held_out"], numbers["filmed"]
    interval = numbers["scale"].get("interval_percent")
    tiles = [
        (f"{robot['reachable_m2']:.0f} m2", "for the robot to move in"),
        ("unknown" if interval is None else f"+-{interval:.2f} %", "interval of its scale (95 %)"),
        (f"{numbers['gaussians']:,}", "Gaussians"),
        (percent(numbers["views"]["coverage_median"]), "of a view is surface"),
    ]
    if numbers["registered"]:
        tiles.append((percent(numbers["registered"]["registered_share"]), "of the images have a pose"))
    if held_out and held_out["psnr_db"] is not None:
        tiles.append((f"{held_out['psnr_db']:.1f} dB", "PSNR of held-out images"))
    if filmed:
        tiles.append((percent(filmed["share_median"]), "of what is seen was filmed"))
    return tiles


def _findings(findings: Sequence[str]) -> list[Block]:
    if not findings:
        return [Paragraph(text="Nothing looks wrong.")]
    return [PageTable(("Look here",), [[sentence] for sentence in findings])]


def _origin(numbers: Mapping[str, Any]) -> list[tuple[str, str]]:
    scale, verdict = numbers["scale"], numbers["registered"]
    interval = scale.get("interval_percent")
    rows = [
        ("scale", f"{scale['metres_per_unit']:.5g} m per unit, {scale['source']}"),
        ("its interval", "not known" if interval is None else f"+-{interval:.2f} % (95 %)"),
        ("cameras", f"{numbers['cameras']:,}" if numbers["cameras"] else "not known"),
    ]
    if verdict:
        rows += [
            ("images with a pose", f"{verdict['registered']} of {verdict['images']}"),
            ("reprojection error", f"{verdict['reprojection_px']:.2f} px"),
            ("pieces", " + ".join(map(str, verdict["components"]))),
            ("drift", str(verdict.get("drift", "not known"))),
        ]
    return rows


def _held_out(held_out: Mapping[str, Any] | None, pictures: Mapping[str, UInt8Array]) -> list[Block]:
    if not held_out:
        return []
    rows = [
        [
            str(number),
            row["image"],
            f"{row['psnr_db']:.2f} dB",
            _decibels(row.get("psnr_fitted_db")),
            f"{row['ssim']:.3f}",
        ]
        for number, row in enumerate(held_out["images"], start=1)
    ]
    where = {HELD_OUT: "Where they were taken, in the colours of their PSNR; training has not seen them."}
    return [
        *_figures(pictures, where),
        PageTable(("Number", "Image", "PSNR", "Colours fitted", "SSIM"), rows, text_columns=2),
    ]


def _decibels(psnr_db: float | None) -> str:
    """A PSNR in words; scenes of older versions do not tell that of fitted colours."""
    return "not known" if psnr_db is None else f"{psnr_db:.2f} dB"


def _coverage_section(filmed: Mapping[str, Any] | None, pictures: Mapping[str, UInt8Array]) -> list[Block]:
    if not filmed:
        return []
    limit = percent(filmed["share_min"])
    end = f": the robot stays where it is more than {limit}." if filmed["closed"] else "; nothing is closed."
    words = f"How much of what is seen from each place cameras saw from about the same side{end}"
    return _figures(pictures, {FILMED: words})


def _floor(numbers: Mapping[str, Any]) -> list[tuple[str, str]]:
    floor, holes = numbers["floor"], numbers["floor_holes"]
    return [
        ("height of the floor", f"{floor['low_m']:.2f} to {floor['high_m']:.2f} m"),
        ("tilt", f"{floor['tilt_deg']:.2f} deg"),
        ("flatness (rms about its plane)", f"{1000 * floor['roughness_m']:.0f} mm"),
        ("holes", f"{holes['count']}, {holes['total_m2']:.2f} m2; the largest {holes['largest_m2']:.2f} m2"),
        ("directions without a wall", percent(numbers["open_share"])),
    ]


def _defect_rows(numbers: Mapping[str, Any]) -> list[list[str]]:
    rows = [
        [kind, f"{entry['count']:,}", f"{100 * entry['share']:.2f} %"] for kind, entry in numbers["unwanted"].items()
    ]
    return [*rows, ["fainter than 0.1", "", f"{100 * numbers['opacity_below_0p1_share']:.1f} %"]]


def _figures(pictures: Mapping[str, UInt8Array], captions: Mapping[str, str]) -> list[Block]:
    """The existing pictures with captions, side by side if there is room."""
    given = {name: caption for name, caption in captions.items() if name in pictures}
    return arrange_blocks(
        "pair",
        [
            (photograph if name in _PHOTOGRAPHS else drawing)(_shrunk(pictures[name]), caption)
            for name, caption in given.items()
        ],
    )


def _shrunk(picture: UInt8Array) -> UInt8Array:
    """A picture at most `SIDE_MAX_PX` wide and high."""
    share = SIDE_MAX_PX / max(picture.shape[:2])
    if share >= 1.0:
        return picture
    size = (round(picture.shape[1] * share), round(picture.shape[0] * share))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
