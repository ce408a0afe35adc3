"""A person is filmed where there is room to walk, and free sight from the camera."""

import numpy as np
import pytest

from readygo.apps.avatar.place import place_in
from readygo.common.errors import AvatarError
from readygo.common.maps import clearance_m
from readygo.runs.scene_argument import open_scene

MIDDLE_M, EYE_M = np.array([3.0, 0.95]), np.array([3.0, -2.05])


def test_walk_has_room_and_the_line_of_sight_is_free() -> None:
    scene = open_scene("embedded")
    T = place_in(scene, 1.0, MIDDLE_M, EYE_M)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert T[2, 2] == 1.0
    human = scene.maps.human
    clear = clearance_m(human)
    x, y, z, _ = T @ [*MIDDLE_M, 0.0, 1.0]
    assert clear[human.frame.cell(x, y)] >= 1.0
    assert z == pytest.approx(scene.maps.floor.at(x, y))
    for share in np.linspace(0.0, 0.98, 60):
        place = T @ [*(MIDDLE_M + share * (EYE_M - MIDDLE_M)), 0.0, 1.0]
        assert clear[human.frame.cell(place[0], place[1])] > 0.05


def test_scene_without_room_is_refused() -> None:
    with pytest.raises(AvatarError, match=r"no free floor with a radius of 9\.00 m that is seen from 3\.0 m away"):
        place_in(open_scene("embedded"), 9.0, MIDDLE_M, EYE_M)
