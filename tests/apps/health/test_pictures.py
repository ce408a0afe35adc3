import numpy as np

from readygo.apps.health.numbers import Sightlines
from readygo.apps.health.pictures import filmed_map, held_out_map, sightlines_map
from readygo.common.maps import OccupancyMap


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
