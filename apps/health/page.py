"""The web page of a scene's quality, readable in a minute."""

from collections.abc import Mapping
from html import escape
from typing import Any

import cv2
import numpy as np

from readygo.apps.pages.page import Column, figure, jpeg_source, page, percent, png_source, table
from readygo.common.drawing.files import Picture

SIDE_MAX_PX = 1200
TOP, ROBOT_MAP, HUMAN_MAP, VIEWS, CLARITY = "top.png", "map_robot.png", "map_human.png", "views.png", "map_views.png"
SIGHT, FILMED, HELD_OUT = "map_sight.png", "map_filmed.png", "map_held_out.png"
"""Names of the report's pictures."""
_PHOTOGRAPHS = (TOP, VIEWS)


def health_page(numbers: Mapping[str, Any], pictures: Mapping[str, Picture]) -> str:
    """The page as HTML text.

    Args:
        numbers: Result of `readygo.apps.health.numbers.health`.
        pictures: Pictures by name; missing ones are left out.
    """
    return page(
        f"Health of {numbers['name']}",
        "What this scene holds, where its scale comes from, and what is wrong with it.",
        tiles=_tiles(numbers),
        sections=[
            ("What to look at", _findings(numbers)),
            ("From above", _pair(pictures, {TOP: "Without its ceiling.", ROBOT_MAP: _MAP_NOTE})),
            ("Scale and registration", _origin(numbers)),
            ("Held-out images", _held_out(numbers, pictures)),
            ("What was filmed", _filmed(numbers, pictures)),
            ("What the robot sees", _pair(pictures, {VIEWS: "From places all over its ground.", CLARITY: _FOG_NOTE})),
            ("Floor and walls", _floor_and_walls(numbers, pictures)),
            ("Gaussians", _gaussians(numbers)),
        ],
        facts={"scene": numbers["content_hash"], "license": numbers["license"] or "not given"},
    )


_MAP_NOTE = (
    "What blocks the robot: dark is occupied, grey is unknown or was not filmed, white too narrow, green the largest "
    "area that it can move in, orange areas cut off from that."
)
_FOG_NOTE = "How sharp the views are; a region in orange or brown is fog."


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


def _findings(numbers: Mapping[str, Any]) -> str:
    if not numbers["findings"]:
        return "<p>Nothing looks wrong.</p>"
    return table((Column("Look here", "wide"),), [[escape(sentence)] for sentence in numbers["findings"]])


def _origin(numbers: Mapping[str, Any]) -> str:
    scale, verdict = numbers["scale"], numbers["registered"]
    interval = scale.get("interval_percent")
    known = "not known" if interval is None else f"+-{interval:.2f} % (95 %)"
    rows = [
        ["scale", f"{scale['metres_per_unit']:.5g} m per unit, {escape(str(scale['source']))}"],
        ["its interval", known],
        ["cameras", f"{numbers['cameras']:,}" if numbers["cameras"] else "not known"],
    ]
    if verdict:
        rows += [
            ["images with a pose", f"{verdict['registered']} of {verdict['images']}"],
            ["reprojection error", f"{verdict['reprojection_px']:.2f} px"],
            ["pieces", " + ".join(map(str, verdict["components"]))],
            ["drift", escape(str(verdict.get("drift", "not known")))],
        ]
    return table((Column("What"), Column("Value", "wide")), rows)


def _held_out(numbers: Mapping[str, Any], pictures: Mapping[str, Picture]) -> str:
    held_out = numbers["held_out"]
    if not held_out:
        return ""
    rows = [
        [str(number), escape(row["image"]), f"{row['psnr_db']:.2f} dB", f"{row['ssim']:.3f}"]
        for number, row in enumerate(held_out["images"], start=1)
    ]
    columns = (Column("Number", "n"), Column("Image", "wide"), Column("PSNR", "n"), Column("SSIM", "n"))
    where = {HELD_OUT: "Where they were taken, in the colours of their PSNR; training has not seen them."}
    return _pair(pictures, where) + table(columns, rows)


def _filmed(numbers: Mapping[str, Any], pictures: Mapping[str, Picture]) -> str:
    filmed = numbers["filmed"]
    if not filmed:
        return ""
    limit = percent(filmed["share_min"])
    closed = "the robot stays where it is more" if filmed["closed"] else "the robot may go everywhere"
    words = f"How much of what is seen from each place cameras saw from about the same side: {closed} than {limit}."
    if not filmed["closed"]:
        words = "How much of what is seen from each place cameras saw from about the same side; nothing is closed."
    return _pair(pictures, {FILMED: words})


def _floor_and_walls(numbers: Mapping[str, Any], pictures: Mapping[str, Picture]) -> str:
    floor, holes = numbers["floor"], numbers["floor_holes"]
    rows = [
        ["height of the floor", f"{floor['low_m']:.2f} to {floor['high_m']:.2f} m"],
        ["tilt", f"{floor['tilt_deg']:.2f} deg"],
        ["flatness (rms about its plane)", f"{1000 * floor['roughness_m']:.0f} mm"],
        ["holes", f"{holes['count']}, {holes['total_m2']:.2f} m2; the largest {holes['largest_m2']:.2f} m2"],
        ["directions without a wall", percent(numbers["open_share"])],
    ]
    note = "Directions in which nothing stands at the height of eyes: windows, open doors, holes in walls, or the open."
    return table((Column("What"), Column("Value", "wide")), rows) + _pair(pictures, {SIGHT: note})


def _gaussians(numbers: Mapping[str, Any]) -> str:
    rows = [
        [kind, f"{entry['count']:,}", f"{100 * entry['share']:.2f} %"] for kind, entry in numbers["unwanted"].items()
    ]
    rows.append(["fainter than 0.1", "", f"{100 * numbers['opacity_below_0p1_share']:.1f} %"])
    note = '<p class="note">Floaters and haze veil what is behind them; readygo scene clean removes them.</p>'
    return table((Column("Kind"), Column("Gaussians", "n"), Column("Share", "n")), rows) + note


def _pair(pictures: Mapping[str, Picture], captions: Mapping[str, str]) -> str:
    """HTML of the existing pictures with captions, side by side if there is room."""
    figures = [
        figure(_source(name, pictures[name]), caption, alt=caption)
        for name, caption in captions.items()
        if name in pictures
    ]
    return f'<div class="pair">{"".join(figures)}</div>' if figures else ""


def _source(name: str, picture: Picture) -> str:
    share = SIDE_MAX_PX / max(picture.shape[:2])
    if share < 1.0:
        size = (round(picture.shape[1] * share), round(picture.shape[0] * share))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return jpeg_source(picture) if name in _PHOTOGRAPHS else png_source(picture)
