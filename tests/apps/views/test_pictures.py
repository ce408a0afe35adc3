from collections.abc import Callable

import numpy as np
import pytest

from readygo.apps.views.pictures import ALARM, add_caption, clarity_map, sharpness_colour, views_sheet
from readygo.apps.views.views import SceneViews, ViewPlace
from readygo.common.drawing.plan_view import INK
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.services.renderer import Look
from tests.apps.views.looks import views


def has(picture, colour) -> bool:
    return bool((picture == np.array(colour, np.uint8)).all(axis=-1).any())


def test_the_sheet_shows_every_place_and_sets_off_what_is_dull() -> None:
    clear, dull = views_sheet(views(0, 0, 8), "flat"), views_sheet(views(1, 0, 7), "flat")
    assert clear.shape == dull.shape
    # The typical view of a clear place is its third, of one grey.
    assert has(clear, (80, 80, 80))
    caption = clear.shape[0] - 60
    assert (dull[:caption] != clear[:caption]).any()


def test_the_map_has_the_colours_of_the_nearest_places() -> None:
    frame = GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.1)
    occupancy = OccupancyMap(frame=frame, occupied=np.zeros((40, 60), np.bool_))
    picture = clarity_map(views(2, 0, 6), occupancy, 0.2)
    middle = len(picture) // 2
    assert has(picture[middle], sharpness_colour(12.0))
    assert has(picture[middle], sharpness_colour(500.0))
    left, right = picture[middle, 150], picture[middle, -150]
    assert tuple(left) == sharpness_colour(12.0)
    assert tuple(right) == sharpness_colour(500.0)


def test_colours_tell_fog_from_what_is_clear() -> None:
    assert len({sharpness_colour(value) for value in (5.0, 149.0, 151.0, 301.0)}) == 4
    assert sharpness_colour(0.0) == sharpness_colour(29.0)


def test_captions_stay_within_their_picture() -> None:
    picture = np.zeros((30, 40, 3), np.uint8)
    for text in ("short", "train-0-000123  12.3 s  (-123.4, -123.4)  sharp 1234"):
        tile = add_caption(picture, text, ALARM)
        assert tile.shape == add_caption(picture, "", INK).shape
        assert (tile[-20:, -2:] == 255).all()


def test_map_and_sheet_look_as_they_did(
    golden_image: Callable[[str, np.ndarray], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    looks = [
        Look(xyyaw=(x, y, 2.5), rgb=rng.integers(0, 255, (4, 7, 3)).astype(np.uint8), sharpness=sharp, coverage=share)
        for x, y, sharp, share in ((-0.4, 0.3, 12.0, 0.9), (1.7, 0.1, 240.0, 0.97), (3.9, 1.6, 470.0, 0.2))
    ]
    found = SceneViews(places=tuple(ViewPlace(looks=(look, look)) for look in looks))
    occupied = np.zeros((31, 62), np.bool_)
    occupied[:, 30], occupied[12:20, 30] = True, False
    occupied[25:, :20] = True
    occupancy = OccupancyMap(frame=GridFrame(origin_x_m=-1.1, origin_y_m=-0.6, resolution_m=0.1), occupied=occupied)
    monkeypatch.setattr("readygo.apps.views.pictures.MAP_SIDE_PX", 300)
    golden_image("clarity_map", clarity_map(found, occupancy, 0.2))
    monkeypatch.setattr("readygo.apps.views.pictures.COLUMNS", 2)
    monkeypatch.setattr("readygo.apps.views.pictures.TILE_WIDTH_PX", 200)
    golden_image("views_sheet", views_sheet(found, "hall"))
