import json

import numpy as np
import pytest

from readygo.common.maps import FloorMap, GridFrame, OccupancyMap, largest_free_area
from readygo.common.scenes.report import scene_report
from tests.common.scenes.small_room import small_room


def test_report_names_the_reachable_area(scene):
    report = json.loads((scene.path / "report.json").read_text())
    _, area_m2 = largest_free_area(scene.maps.robot, 0.3)
    assert report["robot"]["reachable_m2"] == pytest.approx(area_m2, abs=0.01)
    assert report["gaussians"] == len(small_room())
    assert report["floor"]["tilt_deg"] < 0.1


FRAME = GridFrame(origin_x_m=-2.0, origin_y_m=1.0, resolution_m=0.1)


def occupancy(*blocked):
    """4 x 3 m with walls around and blocks of cells (slices) in it."""
    occupied = np.zeros((30, 40), np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    for block in blocked:
        occupied[block] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def test_wall_across_makes_two_areas_of_which_the_larger_counts(make_cloud):
    wall = occupancy(np.s_[:, 15:17])
    floor = FloorMap(frame=FRAME, height_m=np.zeros((30, 40), np.float32))
    report = scene_report(make_cloud(50), None, wall, occupancy(), floor, 0.3)
    assert report["robot"]["free_m2"] == pytest.approx((28 * 38 - 2 * 28) * 0.01)
    assert report["robot"]["separate_areas_over_1_m2"] == 2
    # The larger part is 2.2 m wide and 2.8 m deep; a disc of 0.3 m has its centre 0.3 m from the walls.
    assert report["robot"]["reachable_m2"] == pytest.approx(1.6 * 2.2, rel=0.1)
    assert report["human"]["separate_areas_over_1_m2"] == 1
    assert report["human"]["radius_m"] == 0.25


def test_floor_is_told_by_its_tilt_and_what_is_left_of_it(make_cloud):
    x = FRAME.origin_x_m + (np.arange(40) + 0.5) * 0.1
    bumps = np.where(np.arange(30)[:, None] % 2, 0.004, -0.004)
    height_m = (np.tan(np.radians(2.0)) * x[None] + bumps).astype(np.float32)
    floor = FloorMap(frame=FRAME, height_m=height_m)
    figures = scene_report(make_cloud(50), None, occupancy(), occupancy(), floor, 0.3)["floor"]
    assert figures["tilt_deg"] == pytest.approx(2.0, abs=0.01)
    assert figures["roughness_m"] == pytest.approx(0.004, abs=0.001)
    assert figures["high_m"] - figures["low_m"] == pytest.approx(3.8 * np.tan(np.radians(2.0)), abs=0.02)


def test_scene_without_free_floor_has_figures_all_the_same(make_cloud):
    full = OccupancyMap(frame=FRAME, occupied=np.ones((30, 40), np.bool_))
    floor = FloorMap(frame=FRAME, height_m=np.zeros((30, 40), np.float32))
    report = scene_report(make_cloud(50, coefficients=4), make_cloud(7), full, full, floor, 0.3)
    assert (report["gaussians"], report["sky_gaussians"], report["sh_degree"]) == (50, 7, 1)
    assert report["robot"]["reachable_m2"] == 0.0
    assert report["floor"]["tilt_deg"] == 0.0
    json.dumps(report)
