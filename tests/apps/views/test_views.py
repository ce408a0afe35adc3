import dataclasses

import numpy as np
import pytest

from readygo.apps.views.views import scene_views, warnings
from readygo.common.errors import SceneError
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.runs.scene_argument import open_scene
from tests.apps.views.looks import place, views


def test_a_place_is_judged_by_its_second_sharpest_view() -> None:
    assert place(0.0, 0.0, (20.0, 700.0, 500.0, 10.0)).typical.sharpness == 500.0
    assert not place(0.0, 0.0, (20.0, 700.0, 500.0, 10.0)).blurred
    assert place(0.0, 0.0, (20.0, 700.0, 50.0, 10.0)).blurred


def test_a_few_dull_places_are_no_reason_to_warn() -> None:
    assert warnings(views(blurred=1, bare=1, clear=8)) == []
    fog, haze = warnings(views(blurred=2, bare=3, clear=5))
    assert "2 of 10 places are blurred" in fog
    assert "sharpness_min = 150" in fog
    assert "From 3 of 10 places" in haze
    assert "coverage_min = 0.45" in haze


def test_numbers_are_plain() -> None:
    mapping = views(blurred=1, bare=2, clear=2).to_mapping()
    assert (mapping["blurred_places"], mapping["bare_places"], mapping["coverage_median"]) == (1, 2, 0.9)
    assert mapping["places"][1] == {"xyyaw": [0.5, 1.0, 3.0], "sharpness": 500.0, "coverage": 0.1}


def test_the_embedded_flat_is_clear_at_every_size() -> None:
    robots = [RobotConfig(camera=CameraConfig(height_px=h, width_px=w)) for h, w in ((72, 128), (144, 256))]
    small, large = (scene_views(open_scene("embedded"), robot, places=6) for robot in robots)
    assert warnings(small) == warnings(large) == []
    assert np.isclose(small.sharpness, large.sharpness, rtol=0.15)


def test_a_disc_that_fits_nowhere_is_said() -> None:
    scene = dataclasses.replace(open_scene("embedded"))
    with pytest.raises(SceneError, match="room for a disc of radius 9 m"):
        scene_views(scene, RobotConfig(), radius_m=9.0)
