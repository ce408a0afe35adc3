import math

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.camera.view import FieldOfView, in_view, view_of

VIEW = FieldOfView(left_rad=math.radians(50), right_rad=math.radians(50), rise=1.0, fall=-1.0, height_m=0.5)


def shows_body(view: FieldOfView, distance_m: float) -> bool:
    """True if a human straight ahead is not above or below the image."""
    return in_view((0.0, 0.0, 0.0), distance_m, 0.0, view, math.inf, 0.1)


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
    assert all(shows_body(level, distance_m) for distance_m in (0.3, 1.0, 5.0, 10.0))
    assert shows_body(down, 1.0)
    assert not shows_body(down, 3.0)
    high = view_of(CameraConfig(mount_height_m=3.0))
    assert not shows_body(high, 1.0)
    assert shows_body(high, 3.0)


def test_camera_that_looks_steeply_up_sees_nobody_far_away() -> None:
    up = view_of(CameraConfig(mount_pitch_deg=-60.0))
    assert up.rise == math.inf
    assert not shows_body(up, 4.0)
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


@pytest.mark.parametrize("yaw_rad", [2.5, -9.3, 40.0])
def test_disc_is_in_view_if_one_of_its_points_is_between_the_borders(yaw_rad):
    """Unlike borders to the left and to the right, and a view that is bounded above and below."""
    view = FieldOfView(left_rad=0.93, right_rad=0.41, rise=0.31, fall=-0.57, height_m=0.62)
    rng, turn = np.random.default_rng(3), np.linspace(0.0, 2 * math.pi, 721)
    seen = []
    for x_m, y_m, radius_m in rng.uniform((-5.0, -5.0, 0.1), (5.0, 5.0, 0.6), (150, 3)).tolist():
        eye = (0.4, -0.7, yaw_rad)
        rim = np.exp(-1j * yaw_rad) * (complex(x_m - 0.4, y_m + 0.7) + radius_m * np.exp(1j * turn))
        away_m = math.hypot(x_m - 0.4, y_m + 0.7)
        bearings = np.angle(rim)
        across = ((bearings <= 0.93) & (bearings >= -0.41)).any()
        upright = 0.62 - 0.57 * away_m <= 1.9 and 0.62 + 0.31 * away_m >= 0.0
        expected = away_m <= 4.1 and (away_m <= radius_m or bool(across and upright))
        assert in_view(eye, x_m, y_m, view, 4.1, radius_m) is expected
        seen.append(expected)
    assert 20 < sum(seen) < 130


@pytest.mark.parametrize("yaw_deg", [-140.0, 35.0])
def test_borders_of_a_turned_and_tilted_camera_are_those_of_its_corner_rays(yaw_deg):
    """The mount's yaw is left to the eye; pitch moves the upper and lower borders."""
    camera = CameraConfig(
        fx_px=120.0, fy_px=118.0, cx_px=110.0, cy_px=60.5, mount_yaw_deg=yaw_deg, mount_pitch_deg=17.0
    )
    view, T = view_of(camera), camera.T_world_camera(0.0, 0.0, -math.radians(yaw_deg), 0.0)
    for v, slope in ((0.0, view.rise), (144.0, view.fall)):
        ray = T[:3, :3] @ [0.0, (v - 60.5) / 118.0, 1.0]
        assert slope == pytest.approx(ray[2] / ray[0])
    assert view.rise > view.fall
    for u, edge_rad in ((0.0, view.left_rad), (256.0, -view.right_rad)):
        rays = np.array([T[:3, :3] @ [(u - 110.0) / 120.0, (v - 60.5) / 118.0, 1.0] for v in np.linspace(0, 144, 289)])
        level = rays[np.argmin(np.abs(rays[:, 2]) / np.hypot(rays[:, 0], rays[:, 1]))]
        assert edge_rad == pytest.approx(math.atan2(level[1], level[0]))


@pytest.mark.parametrize(
    ("height_m", "fall", "rise", "shown"),
    [(0.5, 0.7, 1.0, True), (0.5, 0.71, 1.0, False), (1.0, -1.0, -0.5, True), (1.0, -1.0, -0.51, False)],
)
def test_body_is_shown_from_its_crown_to_its_soles(height_m, fall, rise, shown):
    """2 m ahead the lower border is at the crown of 1.9 m, or the upper one at the floor."""
    view = FieldOfView(left_rad=0.5, right_rad=0.5, rise=rise, fall=fall, height_m=height_m)
    assert shows_body(view, 2.0) is shown
