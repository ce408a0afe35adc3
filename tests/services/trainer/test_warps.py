import dataclasses
import math

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.camera.depth import depth_bytes, in_range
from readygo.common.camera.lens import make_lens
from readygo.common.robot import RobotConfig
from readygo.services.trainer.light import draw_light
from readygo.services.trainer.pooling import pool
from readygo.services.trainer.views import BatchViews, plain_view
from readygo.services.trainer.warps import RobotWarp, in_mirror, mirror_twins, show_frames
from tests import crooked


def view_of(yaws_rad=(0.0,), shift_px=(0, 0), mirrored=False):
    count = len(yaws_rad)
    return BatchViews(
        yaws_rad=np.array(yaws_rad),
        shifts_px=np.tile(np.array(shift_px), (count, 1)),
        mirrored=np.full(count, mirrored),
        light=draw_light(count, 0.0, np.random.default_rng(0)),
    )


def turn(camera, frames, yaws_rad, pooling=1):
    warps = dict.fromkeys(range(len(frames)), warp_of(camera, pooling))
    return show_frames(frames, np.arange(len(frames)), view_of(yaws_rad), warps)


def warp_of(camera, pooling=1):
    return RobotWarp(RobotConfig(camera=camera), ("rgb",), pooling)


SMALL = CameraConfig(height_px=48, width_px=96)
LENSES = {
    "pinhole": {},
    "pitched": {"mount_pitch_deg": 15.0},
    "barrel": {"distortion": "brown_conrady", "k1": -0.05, "p1": 0.002},
    "fisheye": {"distortion": "fisheye", "k1": 0.02, "mount_pitch_deg": -10.0},
    "calibrated": {"fx_px": 42.0, "fy_px": 40.0, "cx_px": 50.0, "cy_px": 22.0, "horizontal_fov_deg": None},
}


def rays_of(camera, yaw_rad):
    """Directions of a camera's pixels in the world, shape (H, W, 3)."""
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    xy = make_lens(camera).rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) @ camera.T_world_camera(0, 0, yaw_rad, 0)[:3, :3].T
    return rays.reshape(*rows.shape, 3)


def brightness_of(rays):
    """Brightness of a world by direction alone."""
    heading_rad, rise = np.arctan2(rays[..., 1], rays[..., 0]), rays[..., 2] / np.linalg.norm(rays, axis=-1)
    return np.rint(128 + 60 * np.sin(5 * heading_rad) + 60 * np.sin(4 * rise))


def panorama(camera, yaw_rad):
    """What a camera sees of the world of `brightness_of`."""
    return np.repeat(brightness_of(rays_of(camera, yaw_rad)).astype(np.uint8)[:, :, None], 3, axis=2)


@pytest.mark.parametrize("lens", LENSES)
def test_turned_frame_is_what_the_turned_camera_sees(lens):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    frames = np.stack([panorama(camera, 0.3)] * 3)
    turned = turn(camera, frames, [0.2, -0.2, 0.2])
    left = np.abs(turned[0].astype(int) - panorama(camera, 0.5))[10:-10, 25:]
    right = np.abs(turned[1].astype(int) - panorama(camera, 0.1))[10:-10, :-25]
    assert left.max() <= 3
    assert right.max() <= 3
    assert np.array_equal(turned[0], turned[2])


def test_lens_matters_to_the_turn():
    camera = dataclasses.replace(SMALL, distortion="brown_conrady", k1=-0.05)
    turned = turn(SMALL, panorama(camera, 0.3)[None], [0.2])[0]
    assert np.abs(turned.astype(int) - panorama(camera, 0.5))[10:-10, 25:].max() > 3


def seen_before(camera, column, row, yaw_rad):
    """Where a robot that is turned to the left saw what it sees at a pixel, by the angles of a level pinhole."""
    K = camera.K_px
    right, down = (column - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1]
    angle_rad = math.atan(right) - yaw_rad
    # The ray keeps its length along the floor, and its drop over it.
    drop = down / math.hypot(1.0, right)
    return K[0, 0] * math.tan(angle_rad) + K[0, 2], K[1, 1] * drop / math.cos(angle_rad) + K[1, 2]


@pytest.mark.parametrize("yaw_rad", [0.3, -0.4])
@pytest.mark.parametrize("pooling", [1, 2])
@pytest.mark.parametrize("axis", [0, 1])
def test_turn_of_a_pinhole_is_exact_to_a_part_of_a_pixel(yaw_rad, pooling, axis):
    camera = dataclasses.replace(SMALL, **LENSES["calibrated"])
    height, width = 48 // pooling, 96 // pooling
    slope = (2.5, 5.0)[axis] * pooling
    ramp = np.rint(slope * (np.arange((width, height)[axis]) + 0.5)).astype(np.uint8)
    ramp = ramp[None, :, None] if axis == 0 else ramp[:, None, None]
    frame = np.ascontiguousarray(np.broadcast_to(ramp, (height, width, 3)))
    turned = turn(camera, frame[None], [yaw_rad], pooling=pooling)[0]
    checked = 0
    for row in range(height):
        for column in range(width):
            x, y = seen_before(camera, pooling * (column + 0.5), pooling * (row + 0.5), yaw_rad)
            if 2 * pooling < x < 96 - 2 * pooling and 2 * pooling < y < 48 - 2 * pooling:
                expected = slope * (x, y)[axis] / pooling
                assert abs(float(turned[row, column, 0]) - expected) < 1.1, (row, column)
                checked += 1
    assert checked > height * width / 3


@pytest.mark.parametrize("optics", [{}, {"distortion": "fisheye", "horizontal_fov_deg": 150.0}])
def test_beyond_the_frame_its_edge_is_repeated(optics):
    camera = dataclasses.replace(SMALL, **optics)
    frame = np.zeros((48, 96, 3), np.uint8)
    frame[:, 0] = 200
    turned = turn(camera, frame[None], [0.25])[0]
    assert (turned[24, :6] == 200).all()
    assert (turned[24, 40:] == 0).all()


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_pooled_frame_turns_as_the_camera_does(lens):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    pooled = pool(panorama(camera, 0.3), 2)
    turned = turn(camera, pooled[None], [0.2], pooling=2)[0]
    assert np.abs(turned.astype(int) - pool(panorama(camera, 0.5), 2))[5:-5, 14:].max() <= 3


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_turned_frame_is_shifted_and_mirrored_as_a_plain_one(lens):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    frames, groups, warp = panorama(camera, 0.3)[None], np.zeros(1, np.int64), {0: warp_of(camera)}
    turned = show_frames(frames, groups, view_of([0.1]), warp)
    expected = show_frames(turned, groups, view_of([0.0], (2, -3), mirrored=True), warp)
    both = show_frames(frames, groups, view_of([0.1], (2, -3), mirrored=True), warp)
    assert np.abs(both.astype(int) - expected)[0, 8:-8, 12:-12].max() <= 3


def scale_of_turn(camera, yaw_rad, level):
    """What a turned camera shows of depths that were all alike before, shape (H, W)."""
    frame = np.full((camera.height_px, camera.width_px, 4), level, np.uint8)
    warp = RobotWarp(RobotConfig(camera=camera), ("rgb", "depth"))
    return show_frames(frame[None], np.zeros(1, np.int64), view_of([yaw_rad]), {0: warp})[0, ..., 3]


def depths_of_wall(camera, yaw_rad):
    """What a camera has of a wall that is 4 m ahead at yaw 0, in bytes of depth, shape (H, W)."""
    ahead = rays_of(camera, yaw_rad)[..., 0]
    with np.errstate(divide="ignore"):
        depth_m = np.where(ahead > 0, 4.0 / ahead, np.inf).astype(np.float32)
    return depth_bytes(in_range(depth_m, camera), camera)


@pytest.mark.parametrize("yaw_rad", [0.2, -0.25])
@pytest.mark.parametrize("lens", LENSES)
def test_turned_depths_of_a_flat_wall_are_those_of_the_turned_camera(lens, yaw_rad):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    before, after = depths_of_wall(camera, 0.0), depths_of_wall(camera, yaw_rad)
    frame = np.concatenate([panorama(camera, 0.0), before[..., None]], axis=2)
    groups, warp = np.zeros(1, np.int64), {0: RobotWarp(RobotConfig(camera=camera), ("rgb", "depth"))}
    shown = show_frames(frame[None], groups, view_of([yaw_rad]), warp)[0, ..., 3]
    inside = np.s_[10:-10, 25:] if yaw_rad > 0 else np.s_[10:-10, :-25]
    assert np.abs(shown.astype(int) - after)[inside].max() <= 3
    assert np.abs(before.astype(int) - after)[inside].max() > 12
    moved = show_frames(frame[None], groups, view_of([yaw_rad], (2, -3), mirrored=True), warp)[0, ..., 3]
    expected = after[:-2, 3:][8:-10, 25:-25][:, ::-1]
    assert np.abs(moved[2:, 3:][8:-10, 25:-25].astype(int) - expected).max() <= 3


def test_depths_that_were_not_measured_or_are_out_of_range_after_a_turn_are_unknown():
    assert (scale_of_turn(SMALL, 0.3, 0) == 0).all()
    # The end of the range: farther along the new axis to one side, nearer to the other.
    ends = scale_of_turn(SMALL, 0.3, 1)
    assert (ends[:, :20] == 0).all()
    assert (ends[:, -20:] > 20).all()


def test_depths_are_taken_from_one_pixel_and_colours_from_between():
    camera = SMALL
    rng = np.random.default_rng(4)
    frame = np.concatenate(
        [panorama(camera, 0.3), rng.choice(np.uint8([10, 200]), (camera.height_px, camera.width_px, 1))], axis=2
    )
    warp = RobotWarp(RobotConfig(camera=camera), ("rgb", "depth"))
    shown = show_frames(frame[None], np.zeros(1, np.int64), view_of([0.17]), {0: warp})[0]
    near, far = (scale_of_turn(camera, 0.17, level) for level in (200, 10))
    assert ((shown[..., 3] == near) | (shown[..., 3] == far)).all()
    alone = turn(camera, np.ascontiguousarray(frame[None, ..., :3]), [0.17])[0]
    assert np.array_equal(shown[..., :3], alone)


def test_plain_view_changes_nothing():
    frames = panorama(SMALL, 0.3)[None]
    assert show_frames(frames, np.zeros(1, np.int64), plain_view(), {0: warp_of(SMALL)}) is frames


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("shift_px", [(0, 0), (2, 3), (-2, 1), (1, -3), (-1, -1)])
def test_shift_moves_the_image_repeats_its_edge_and_is_mirrored_then(shift_px, mirrored):
    frame = np.random.default_rng(0).integers(0, 256, (48, 96, 3), np.uint8)
    shown = show_frames(frame[None], np.zeros(1, np.int64), view_of([0.0], shift_px, mirrored), {0: warp_of(SMALL)})[0]
    rows = np.clip(np.arange(48) - shift_px[0], 0, 47)
    columns = np.clip(np.arange(96) - shift_px[1], 0, 95)
    expected = frame[rows][:, columns]
    assert np.array_equal(shown, expected[:, ::-1] if mirrored else expected)


def test_camera_that_is_not_its_own_mirror_image_is_known():
    def is_symmetric(camera):
        return in_mirror(camera) == camera

    assert is_symmetric(CameraConfig(mount_pitch_deg=10.0, mount_x_m=0.2))
    assert is_symmetric(CameraConfig(mount_yaw_deg=180.0))
    assert not is_symmetric(CameraConfig(mount_y_m=0.1))
    assert not is_symmetric(CameraConfig(mount_yaw_deg=30.0))
    assert not is_symmetric(CameraConfig(distortion="brown_conrady", p2=0.001))
    focal = {"fx_px": 100.0, "fy_px": 100.0, "cy_px": 72.0, "horizontal_fov_deg": None}
    assert is_symmetric(CameraConfig(cx_px=128.0, **focal))
    assert not is_symmetric(CameraConfig(cx_px=120.0, **focal))


def test_mirrored_mirror_is_the_camera_itself():
    for camera in (crooked.CAMERA, crooked.LEFT, dataclasses.replace(SMALL, **LENSES["barrel"], p2=0.003)):
        assert in_mirror(in_mirror(camera)) == camera
        assert in_mirror(camera) != camera
    seen = in_mirror(crooked.CAMERA)
    assert (seen.cx_px, seen.cy_px) == (34 - 15.2, 12.4)
    assert (seen.mount_x_m, seen.mount_y_m, seen.mount_yaw_deg, seen.mount_pitch_deg) == (0.13, 0.07, 11.0, 7.0)


def test_mirrored_image_is_that_of_the_camera_in_the_mirror():
    # The world of the panorama is mirrored by mirroring headings: left of the robot becomes right.
    camera = dataclasses.replace(SMALL, **LENSES["calibrated"], mount_yaw_deg=20.0)
    twin = in_mirror(camera)
    image = np.asarray(panorama(camera, 0.3))[:, ::-1]
    seen = brightness_of(rays_of(twin, -0.3) * (1.0, -1.0, 1.0))
    assert np.abs(seen - image[..., 0]).max() <= 1


def three_cameras():
    sides = {
        name: dataclasses.replace(SMALL, mount_y_m=0.1 * side, mount_yaw_deg=60.0 * side)
        for name, side in (("left", 1), ("right", -1))
    }
    return RobotConfig(camera=SMALL, cameras=sides)


def test_cameras_of_both_sides_are_twins_and_one_alone_has_none():
    assert mirror_twins(three_cameras(), ("", "left", "right")) == {"": "", "left": "right", "right": "left"}
    assert mirror_twins(three_cameras(), ("", "left")) is None


def test_mirrored_robot_sees_to_its_left_what_it_saw_to_its_right():
    images = ("rgb", "left.rgb", "right.rgb")
    warp = RobotWarp(three_cameras(), images)
    frames = np.random.default_rng(0).integers(0, 256, (2, SMALL.height_px, SMALL.width_px, 9), np.uint8)
    view = dataclasses.replace(view_of([0.0, 0.0]), mirrored=np.array([False, True]))
    shown = show_frames(frames, np.arange(2), view, {0: warp, 1: warp})
    assert np.array_equal(shown[0], frames[0])
    assert np.array_equal(shown[1, ..., 3:6], frames[1, :, ::-1, 6:9])
    assert np.array_equal(shown[1, ..., :3], frames[1, :, ::-1, :3])
