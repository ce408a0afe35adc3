import math

import numpy as np
import pytest

from readygo.apps.drive.free_space import RANGE_MAX_M, RAYS, scan_of
from readygo.apps.drive.messages import ScanMessage
from readygo.common.camera import CameraConfig
from readygo.common.perception.grid import polar_grid


def scan(rays_m: object, camera: CameraConfig) -> ScanMessage:
    return scan_of(
        np.broadcast_to(np.asarray(rays_m, np.float64), len(polar_grid(camera).bearings_rad)),
        camera,
        stamp_ns=7,
        frame="base_link",
    )


def angles_of(made: ScanMessage) -> np.ndarray:
    return made.angle_min_rad + made.angle_increment_rad * np.arange(len(made.ranges_m))


def wall_m(camera: CameraConfig, wall_x_m: float) -> np.ndarray:
    """Free distances to a wall across the robot's x axis."""
    x_m, _, yaw_rad = camera.eye(0.0, 0.0, 0.0)
    return (wall_x_m - x_m) / np.cos(yaw_rad + polar_grid(camera).bearings_rad)


@pytest.mark.parametrize("yaw_deg", [0.0, 20.0, -90.0])
def test_angles_rise_from_right_to_left_about_the_direction_of_the_camera(yaw_deg: float) -> None:
    camera = CameraConfig(mount_yaw_deg=yaw_deg)
    bearings, made = polar_grid(camera).bearings_rad, scan(2.0, camera)
    assert (made.stamp_ns, made.frame, len(made.ranges_m)) == (7, "base_link", RAYS)
    assert made.angle_increment_rad > 0
    assert angles_of(made)[0] == pytest.approx(math.radians(yaw_deg) + bearings[-1])
    assert angles_of(made)[-1] == pytest.approx(math.radians(yaw_deg) + bearings[0])


def test_ranges_at_the_bearings_of_columns_are_their_free_distances() -> None:
    camera = CameraConfig()
    bearings = polar_grid(camera).bearings_rad
    rays_m = np.linspace(1.0, 4.0, len(bearings))
    made = scan(rays_m, camera)
    assert made.ranges_m[-1] == pytest.approx(1.0)
    assert made.ranges_m[0] == pytest.approx(4.0)
    # Columns fall from the left to the right, so the nearer half is on the left.
    between = np.interp(angles_of(made), bearings[::-1], rays_m[::-1])
    np.testing.assert_allclose(made.ranges_m, between, rtol=0.01)


@pytest.mark.parametrize(
    "camera",
    [
        CameraConfig(),
        CameraConfig(mount_yaw_deg=15.0),
        CameraConfig(mount_x_m=0.3, mount_y_m=-0.1),
        CameraConfig(distortion="fisheye", k1=0.05, mount_x_m=-0.2),
    ],
)
def test_wall_is_straight_from_the_robots_centre_wherever_the_camera_is(camera: CameraConfig) -> None:
    made = scan(wall_m(camera, 2.0), camera)
    ranges, angles = np.array(made.ranges_m), angles_of(made)
    seen = np.isfinite(ranges)
    assert seen.sum() > 0.75 * RAYS
    np.testing.assert_allclose(ranges[seen] * np.cos(angles[seen]), 2.0, atol=1e-6)


def test_nothing_within_range_is_infinite_and_what_the_camera_does_not_see_is_no_number() -> None:
    assert set(scan(RANGE_MAX_M + 0.5, CameraConfig()).ranges_m) == {math.inf}
    ranges = np.array(scan(2.0, CameraConfig(mount_x_m=0.5)).ranges_m)
    assert np.isnan(ranges[[0, -1]]).all()
    assert np.isfinite(ranges[RAYS // 2])
