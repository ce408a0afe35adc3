import json

import numpy as np
import pytest

from readygo.apps.report.health_numbers import health, reachable_ground, sightlines
from readygo.common.errors import SceneError
from readygo.common.scenes import Scene
from readygo.runs.scene_argument import open_scene
from tests.apps.views.looks import views

RADIUS_M = 0.3


def test_reconstruction_is_told_and_everything_is_plain(filmed_room: Scene) -> None:
    lines = sightlines(filmed_room, reachable_ground(filmed_room, RADIUS_M))
    numbers = health(filmed_room, RADIUS_M, lines, views(blurred=0, bare=0, clear=4))
    assert json.loads(json.dumps(numbers)) == numbers
    assert numbers["scale"]["interval_percent"] == 0.22
    assert numbers["registered"]["registered"] == 38
    assert numbers["cameras"] == 32
    placed = [row["xyyaw"] for row in numbers["held_out"]["images"]]
    assert placed[0] == [0.7, 0.7, 0.0]
    assert placed[2] is None
    assert numbers["filmed"]["closed"]
    assert numbers["filmed"]["share_median"] > 0.5
    assert "check: the floor <leans>" in numbers["findings"]


def test_closed_room_has_no_way_to_look_out_and_one_without_a_wall_has(filmed_room: Scene) -> None:
    assert sightlines(filmed_room, reachable_ground(filmed_room, RADIUS_M)).open_share == 0.0
    flat = open_scene("embedded")
    lines = sightlines(flat, reachable_ground(flat, RADIUS_M))
    assert 0.02 < lines.open_share < 0.3, "its windows"
    assert lines.open.shape == (len(lines.places_m), len(lines.bearings_rad))


def test_scene_that_came_as_gaussians_is_not_said_to_be_reconstructed() -> None:
    flat = open_scene("embedded")
    lines = sightlines(flat, reachable_ground(flat, RADIUS_M))
    numbers = health(flat, RADIUS_M, lines, views(blurred=3, bare=0, clear=3))
    assert numbers["registered"] is numbers["held_out"] is numbers["filmed"] is None
    assert numbers["scale"] == {"metres_per_unit": 1.0, "source": "made in metres", "interval_percent": None}
    assert numbers["floor_holes"]["count"] == 1
    assert any("3 of 6 places are blurred" in line for line in numbers["findings"])
    assert np.isclose(numbers["floor"]["tilt_deg"], 0.0, atol=0.2)


def test_disc_that_fits_nowhere_is_said(filmed_room: Scene) -> None:
    with pytest.raises(SceneError, match="room for a disc of radius 4 m"):
        reachable_ground(filmed_room, 4.0)
