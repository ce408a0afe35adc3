import math

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.camera.view import View, in_view, view_of

VIEW = View(left_rad=math.radians(50), right_rad=math.radians(50), rise=1.0, fall=-1.0, height_m=0.5)


def test_level_camera_spans_its_field_of_view_with_every_lens() -> None:
    for optics in ({}, {"distortion": "brown_conrady", "k1": -0.05, "p2": 0.001}, {"distortion": "fisheye"}):
        view = view_of(CameraConfig(horizontal_fov_deg=80.0, **optics))
        assert view.left_rad == view.right_rad == math.radians(80.0) / 2
        assert view.height_m == 0.5


def test_given_intrinsics_are_seen_through_the_lens() -> None:
    focal = {"fx_px": 120.0, "fy_px": 118.0, "cx_px": 110.0, "cy_px": 70.5}
    plain = view_of(CameraConfig(**focal))
    assert math.tan(plain.left_rad) == pytest.approx(110 / 120, rel=1e-3)
    assert math.tan(plain.right_rad) == pytest.approx(146 / 120, rel=1e-3)
    assert (plain.rise, plain.fall) == (pytest.approx(70.5 / 118), pytest.approx(-73.5 / 118))
    barrel = view_of(CameraConfig(**focal, distortion="brown_conrady", k1=-0.05))
    assert barrel.left_rad > plain.left_rad + 0.01
    assert barrel.right_rad > plain.right_rad + 0.01


def test_borders_are_where_the_image_ends() -> None:
    camera = CameraConfig(distortion="fisheye", k1=0.02, mount_pitch_deg=20.0)
    view, T = view_of(camera), camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    for bearing_rad, inside in ((view.left_rad - 0.02, True), (view.left_rad + 0.02, False)):
        ray = T[:3, :3].T @ (math.cos(bearing_rad), math.sin(bearing_rad), 0.0)
        u, _ = make_lens(camera).pixels(ray[None, :2] / ray[2])[0]
        assert bool(u > 0.0) is inside
    assert view.left_rad == pytest.approx(view.right_rad)


def test_who_is_above_or_below_the_image_is_not_shown() -> None:
    level, down = view_of(CameraConfig()), view_of(CameraConfig(mount_pitch_deg=50.0))
    assert all(level.shows_body(distance_m) for distance_m in (0.3, 1.0, 5.0, 10.0))
    assert down.shows_body(1.0)
    assert not down.shows_body(3.0)
    high = view_of(CameraConfig(mount_height_m=3.0))
    assert not high.shows_body(1.0)
    assert high.shows_body(3.0)


def test_camera_that_looks_steeply_up_sees_nobody_far_away() -> None:
    up = view_of(CameraConfig(mount_pitch_deg=-60.0))
    assert up.rise == math.inf
    assert not up.shows_body(4.0)
    assert np.isfinite(up.fall)


@pytest.mark.parametrize(
    ("bearing_deg", "seen"), [(0, True), (49, True), (-49, True), (53, True), (60, False), (-60, False), (180, False)]
)
def test_a_human_is_seen_if_any_part_of_its_disc_is_in_view(bearing_deg, seen):
    angle = math.radians(bearing_deg)
    assert in_view((1.0, 1.0, 0.0), 1 + 3 * math.cos(angle), 1 + 3 * math.sin(angle), VIEW, 10.0, 0.25) is seen


def test_view_turns_with_the_robot_and_ends_at_its_range():
    assert in_view((0.0, 0.0, 7 * math.pi), -3.0, 0.0, VIEW, 10.0, 0.25)
    assert not in_view((0.0, 0.0, 0.0), 10.1, 0.0, VIEW, 10.0, 0.25)
