import base64
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from readygo.apps.report.health import (
    CLARITY,
    FILMED,
    HELD_OUT,
    SIGHT,
    TOP,
    VIEWS,
    filmed_map,
    health_page,
    held_out_map,
    sightlines_map,
)
from readygo.apps.report.health_numbers import Sightlines
from readygo.common.maps import OccupancyMap
from tests.apps.report.browser import CHROMIUM, NO_CHROMIUM, assert_readable, browser
from tests.apps.report.scenes import MADE

PICTURES = {name: np.full((600, 2000, 3), 90, np.uint8) for name in (TOP, VIEWS, CLARITY, SIGHT, FILMED, HELD_OUT)}


def numbers(**changes: Any) -> dict[str, Any]:
    held_out = {**MADE["training"], "images": MADE["training"]["held_out"]}
    return {
        "name": "<lobby>",
        "content_hash": "ab" * 32,
        "license": "",
        "scale": MADE["scale"],
        "registered": MADE["verdict"],
        "cameras": 38,
        "held_out": held_out,
        "filmed": {"share_median": 0.8, "filmed_m2": 12.0, "share_min": 0.5, "closed": True},
        "unwanted": {"floaters": {"count": 12, "share": 0.01}},
        "floor_holes": {"count": 2, "total_m2": 0.5, "largest_m2": 0.3},
        "floor": {"low_m": -0.01, "high_m": 0.02, "tilt_deg": 0.7, "roughness_m": 0.012},
        "open_share": 0.12,
        "opacity_below_0p1_share": 0.2,
        "gaussians": 150_000,
        "robot": {"reachable_m2": 14.0},
        "views": {"coverage_median": 0.9},
        "findings": ["its floor <leans>."],
        **changes,
    }


def test_page_tells_where_the_scale_comes_from_and_how_exact_it_is() -> None:
    html = health_page(numbers(), PICTURES)
    assert "Health of &lt;lobby&gt;" in html
    assert "+-0.22 %" in html
    assert "marker 0 of 0.2 m" in html
    assert "38 of 40" in html
    assert "25.5 dB" in html
    assert "its floor &lt;leans&gt;." in html
    assert "12 mm" in html


def test_what_is_not_known_is_left_out() -> None:
    plain = {"metres_per_unit": 1.0, "source": "as in the file", "interval_percent": None}
    html = health_page(numbers(scale=plain, registered=None, held_out=None, filmed=None, findings=[]), {})
    assert "Held-out" not in html
    assert "What was filmed" not in html
    assert "Nothing looks wrong" in html
    assert "unknown" in html


def test_ground_that_is_not_closed_is_said() -> None:
    filmed = {"share_median": 0.8, "filmed_m2": 12.0, "share_min": 0.5, "closed": False}
    assert "nothing is closed" in health_page(numbers(filmed=filmed), PICTURES)


def test_page_looks_as_it_did(golden_page: Callable[[str, str], None]) -> None:
    golden_page("health", health_page(numbers(), PICTURES))
    plain = {"metres_per_unit": 0.0123456, "source": "as <in> the file", "interval_percent": None}
    unwanted = {"floaters": {"count": 1234, "share": 0.01234}, "haze": {"count": 5, "share": 0.2}}
    unknown = numbers(
        scale=plain, registered=None, held_out=None, filmed=None, findings=[], cameras=0, license="CC <0>",
        unwanted=unwanted, floor_holes={"count": 7, "total_m2": 1.257, "largest_m2": 0.996},
    )  # fmt: skip
    golden_page("health_unknown", health_page(unknown, {TOP: np.zeros((4, 6, 3), np.uint8)}))
    undrifted = {**MADE["verdict"], "components": [30, 8], "reprojection_px": 0.456, "drift": "1 <cm>"}
    open_ground = {"share_median": 0.26, "filmed_m2": 12.0, "share_min": 0.35, "closed": False}
    held_out = {"psnr_db": None, "ssim": None, "images": MADE["training"]["held_out"][:1]}
    other = numbers(registered=undrifted, filmed=open_ground, held_out=held_out)
    golden_page("health_open", health_page(other, {FILMED: PICTURES[FILMED]}))


@pytest.mark.parametrize(("height", "width", "shown"), [(600, 2001, (360, 1200)), (30, 1200, (30, 1200))])
def test_pictures_are_1200_pixels_wide_at_most_and_photographs_are_jpegs(
    height: int, width: int, shown: tuple[int, int]
) -> None:
    html = health_page(numbers(), {name: np.zeros((height, width, 3), np.uint8) for name in (TOP, CLARITY)})
    found = dict(re.findall(r'src="data:image/(\w+);base64,([^"]+)"', html))
    assert set(found) == {"png", "jpeg"}
    for data in found.values():
        picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape[:2] == shown


@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_page_reads_well_on_telephones(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(health_page(numbers(), PICTURES))
    with browser(tmp_path / "profile") as chromium:
        for width_px in (400, 1280):
            chromium.open(tmp_path / "page.html", width_px)
            assert_readable(chromium, width_px)
    assert chromium.complaints == []


def pixels_of(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - colour).max(axis=2) < 12).sum())


def test_directions_without_a_wall_are_drawn(room: OccupancyMap) -> None:
    places, bearings = np.array([[0.5, 0.5]]), np.array([0.0, 1.5])
    closed, opened = (
        sightlines_map(Sightlines(places_m=places, bearings_rad=bearings, open=np.full((1, 2), out)), room)
        for out in (False, True)
    )
    drawn = (opened != closed).any(axis=2)
    drawn[:100] = False
    assert drawn.sum() > 500


def test_filmed_ground_is_blue_and_the_rest_orange(room: OccupancyMap) -> None:
    share = np.where(room.occupied, 0.0, 0.9).astype(np.float32)
    share[:, 30:] = np.where(room.occupied[:, 30:], 0.0, 0.3)
    picture = filmed_map(share, room)
    assert pixels_of(picture, (80, 150, 205)) > 50_000
    assert pixels_of(picture, (240, 140, 50)) > 50_000


def test_held_out_images_without_a_place_are_left_out(room: OccupancyMap) -> None:
    rows = [{"psnr_db": 19.0, "xyyaw": [0.5, 0.5, 0.0]}, {"psnr_db": 30.0, "xyyaw": None}]
    picture = held_out_map(rows, room)
    assert picture is not None
    assert pixels_of(picture, (150, 50, 10)) > pixels_of(
        held_out_map([{"psnr_db": 30.0, "xyyaw": [0, 0, 0]}], room), (150, 50, 10)
    )
    assert held_out_map(rows[1:], room) is None
