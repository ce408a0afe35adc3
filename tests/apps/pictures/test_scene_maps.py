import numpy as np
import pytest

from readygo.apps.pictures.scene_maps import REACHABLE, SEPARATE, map_picture, top_pixel_m
from readygo.common.maps import GridFrame, OccupancyMap


def test_map_picture_tints_the_largest_area_and_the_cut_off_one():
    occupied = np.zeros((40, 60), np.bool_)
    occupied[:, 40] = True
    frame = GridFrame(origin_x_m=0, origin_y_m=0, resolution_m=0.05)
    picture = map_picture(OccupancyMap(frame=frame, occupied=occupied), np.zeros_like(occupied), 0.2)
    factor = picture.shape[0] // 40
    assert tuple(picture[20 * factor, 20 * factor]) == REACHABLE
    assert tuple(picture[20 * factor, 50 * factor]) == SEPARATE


@pytest.mark.parametrize(("side_m", "side_px"), [(2.0, 1000), (50.0, 2500), (488.0, 4000)])
def test_small_scenes_fill_their_picture_and_large_ones_fit(side_m, side_px):
    assert side_m / top_pixel_m(side_m, cell_m=0.05) == pytest.approx(side_px)


def test_map_picture_looks_as_it_did(golden_image, monkeypatch):
    occupied = np.zeros((31, 57), np.bool_)
    occupied[:, 40] = occupied[22:26, 5:9] = occupied[4, :30] = True
    unknown = np.zeros_like(occupied)
    unknown[22:24, 5:9] = unknown[10:14, 40] = True
    frame = GridFrame(origin_x_m=-1.3, origin_y_m=0.7, resolution_m=0.05)
    monkeypatch.setattr("readygo.apps.pictures.scene_maps.MAP_PICTURE_MIN_PX", 200)
    golden_image("map_picture", map_picture(OccupancyMap(frame=frame, occupied=occupied), unknown, 0.17))
