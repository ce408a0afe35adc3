import dataclasses

import cv2
import numpy as np
import pytest

from readygo.apps.drive.calibration import (
    Rectifier,
    camera_from_file,
    camera_from_info,
    info_of,
    inside_of,
    mount_differences,
)
from readygo.apps.robot_logs.reader import LogCamera
from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.errors import ConfigError

POLICY = CameraConfig(height_px=72, width_px=128, horizontal_fov_deg=90.0)
WIDE = CameraConfig(height_px=480, width_px=640, horizontal_fov_deg=100.0, distortion="brown_conrady", k1=-0.05)
YAML = """image_width: 640
image_height: 480
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [300.0, 0.0, 319.5, 0.0, 301.0, 239.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.05, 0.01, 0.001, 0.002, 0.0]
"""


def seen_by(camera, pitch_deg=0.0):
    """What a camera shows of a world whose colours are smooth functions of the direction."""
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px] + 0.5
    xy = make_lens(camera).rays(np.stack([u.ravel(), v.ravel()], axis=1))
    down = np.arctan(xy[:, 1]) + np.radians(pitch_deg)
    colours = np.stack([128 + 100 * np.sin(2 * xy[:, 0]), 128 + 100 * np.sin(3 * down), 128 + 0 * down], axis=1)
    return np.nan_to_num(colours).reshape(camera.height_px, camera.width_px, 3).astype(np.uint8)


def test_another_lens_and_size_give_what_the_policys_camera_would_have_shown():
    found = Rectifier(WIDE, POLICY)(seen_by(WIDE))
    expected = seen_by(POLICY)[..., ::-1]
    assert found.shape == (72, 128, 3)
    assert np.abs(found.astype(int) - expected).max() <= 3


def test_a_camera_that_looks_down_is_turned_back_up():
    # Along the middle column the angle below the horizon is that of the pixel and the camera's pitch.
    down = dataclasses.replace(WIDE, mount_pitch_deg=5.0)
    found = Rectifier(down, POLICY)(seen_by(down, pitch_deg=5.0))
    assert np.abs(found[:, 64].astype(int) - seen_by(POLICY)[:, 64, ::-1]).max() <= 4


def test_the_policys_own_camera_passes_untouched():
    rectifier, image = Rectifier(POLICY, POLICY), seen_by(POLICY)
    assert rectifier.identity
    assert np.array_equal(rectifier(image), image[..., ::-1])


def test_a_camera_that_sees_too_little_is_refused_and_a_little_less_is_black():
    narrow = CameraConfig(height_px=480, width_px=640, horizontal_fov_deg=60.0)
    with pytest.raises(ConfigError, match=r"does not show \d+ % of what the policy's shows \(at most 10 %\)"):
        Rectifier(narrow, POLICY)
    almost = CameraConfig(height_px=480, width_px=640, horizontal_fov_deg=87.0)
    rectifier = Rectifier(almost, POLICY)
    assert 0.0 < rectifier.unseen < 0.1
    assert not rectifier(np.full((480, 640, 3), 200, np.uint8))[:, 0].any()


def test_images_of_another_size_than_the_calibrations_are_said():
    with pytest.raises(ValueError, match="240x320 px, and its calibration is of 480x640"):
        Rectifier(WIDE, POLICY)(np.zeros((240, 320, 3), np.uint8))


def test_mounts_that_differ_are_named():
    assert mount_differences(WIDE, POLICY) == []
    high = dataclasses.replace(WIDE, mount_height_m=1.0)
    assert mount_differences(high, POLICY) == ["mount_height_m 0.5 (the robot's: 1)"]


def test_files_of_ros_and_of_readygo_are_read(tmp_path):
    (tmp_path / "front.yaml").write_text(YAML)
    camera = camera_from_file(POLICY, tmp_path / "front.yaml")
    assert (camera.width_px, camera.fx_px, camera.cx_px, camera.k1, camera.p2) == (640, 300.0, 320.0, -0.05, 0.002)
    (tmp_path / "robot.toml").write_text("[camera]\nheight_px = 100\nwidth_px = 200\nmount_pitch_deg = 3.0\n")
    assert camera_from_file(POLICY, tmp_path / "robot.toml").mount_pitch_deg == 3.0


@pytest.mark.parametrize(
    ("text", "words"),
    [("a: 1\n", "lacks image_width"), ("[", "is no YAML"), (YAML.replace("plumb_bob", "odd"), "lens model 'odd'")],
)
def test_files_without_a_camera_are_refused(tmp_path, text, words):
    (tmp_path / "x.yaml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        camera_from_file(POLICY, tmp_path / "x.yaml")
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        camera_from_file(POLICY, tmp_path / "none.yaml")


def test_a_camera_that_nobody_calibrated_is_refused():
    info = LogCamera(height_px=480, width_px=640, K_px=(0.0,) * 9, model="", distortion=())
    with pytest.raises(ConfigError, match="is not calibrated"):
        camera_from_info(POLICY, info)


def test_a_camera_goes_through_its_camera_info_unchanged():
    back = camera_from_info(WIDE, info_of(WIDE))
    assert np.allclose(back.K_px, WIDE.K_px)
    assert (back.distortion, back.k1) == ("brown_conrady", -0.05)


def test_opencv_agrees_about_the_lens():
    K = WIDE.K_px - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    target = POLICY.K_px - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    image = seen_by(WIDE)
    distortion = np.array([WIDE.k1, 0, 0, 0, 0])
    maps = cv2.initUndistortRectifyMap(K, distortion, np.eye(3), target, (128, 72), cv2.CV_32FC1)
    expected = cv2.remap(image, *maps, cv2.INTER_LINEAR)[..., ::-1]
    assert np.abs(Rectifier(WIDE, POLICY)(image).astype(int) - expected).max() <= 4


def test_depths_follow_the_policys_camera_to_where_it_looks():
    robot = dataclasses.replace(WIDE, mount_pitch_deg=20.0)
    policy = dataclasses.replace(POLICY, horizontal_fov_deg=40.0, mount_pitch_deg=10.0)
    rectify = Rectifier(robot, policy)
    # A wall that stands 3 m before the policy's camera, at right angles to its axis.
    v, u = np.mgrid[0 : robot.height_px, 0 : robot.width_px] + 0.5
    xy = make_lens(robot).rays(np.stack([u.ravel(), v.ravel()], axis=1))
    turn_rad = np.radians(10.0)
    along = np.cos(turn_rad) - np.sin(turn_rad) * xy[:, 1]
    wall_m = (3.0 / along).reshape(480, 640).astype(np.float32)
    assert np.abs(rectify.depth(wall_m) - 3.0).max() < 0.03


def test_depths_and_colours_in_each_others_place_and_depths_of_another_size_are_refused():
    rectify = Rectifier(POLICY, POLICY)
    depth_m = np.ones((72, 128), np.float32)
    assert rectify.depth(depth_m) is depth_m
    with pytest.raises(ValueError, match="depths where colours are due"):
        rectify(depth_m)
    with pytest.raises(ValueError, match="colours where depths are due"):
        rectify.depth(np.zeros((72, 128, 3), np.uint8))
    with pytest.raises(ValueError, match=r"depths of 36x64 px, and images of 72x128: have its driver align"):
        rectify.depth(depth_m[::2, ::2])


@pytest.mark.parametrize("line", ["camera_matrix: 3", "camera_matrix:\n  data: {a: 1}", "camera_matrix: [1, 2]"])
def test_matrix_of_another_shape_is_refused(tmp_path, line):
    (tmp_path / "c.yaml").write_text(f"image_width: 10\nimage_height: 8\n{line}\ndistortion_model: plumb_bob\n")
    with pytest.raises(ConfigError, match="Calibration"):
        camera_from_file(CameraConfig(), tmp_path / "c.yaml")


def test_mounts_differ_from_more_than_five_centimetres_on_and_lenses_never():
    robot = dataclasses.replace(WIDE, mount_x_m=0.2, mount_y_m=-0.1, mount_height_m=0.7, mount_pitch_deg=9.0)
    near = dataclasses.replace(robot, mount_x_m=0.249, mount_y_m=-0.149, mount_height_m=0.651, mount_pitch_deg=0.0)
    assert mount_differences(robot, near) == []
    far = dataclasses.replace(robot, mount_x_m=0.251, mount_y_m=-0.151, mount_height_m=0.649)
    assert mount_differences(robot, far) == [
        "mount_x_m 0.251 (the robot's: 0.2)",
        "mount_y_m -0.151 (the robot's: -0.1)",
        "mount_height_m 0.649 (the robot's: 0.7)",
    ]


def test_camera_info_counts_pixels_from_their_centres_and_names_the_lens():
    crooked = CameraConfig(
        height_px=48, width_px=64, fx_px=31.0, fy_px=33.0, cx_px=30.2, cy_px=25.7, distortion="brown_conrady",
        k1=-0.05, k2=0.01, p1=0.002, p2=-0.003,
    )  # fmt: skip
    info = info_of(crooked)
    assert info.K_px == pytest.approx((31.0, 0.0, 29.7, 0.0, 33.0, 25.2, 0.0, 0.0, 1.0))
    assert (info.height_px, info.width_px, info.model) == (48, 64, "plumb_bob")
    assert info.distortion[:4] == (-0.05, 0.01, 0.002, -0.003)
    assert info_of(CameraConfig(distortion="fisheye")).model == "equidistant"


@pytest.mark.parametrize(("K_px", "count"), [((0.0,) * 9, 9), ((3.0, 0, 0, 0, 0.0, 0, 0, 0, 1), 9), ((3.0,) * 8, 8)])
def test_intrinsics_without_focal_lengths_are_none(K_px, count):
    assert len(K_px) == count
    with pytest.raises(ConfigError, match="not calibrated"):
        camera_from_info(POLICY, LogCamera(height_px=4, width_px=6, K_px=K_px, model="", distortion=()))


def test_places_of_an_image_end_at_its_edges():
    camera = CameraConfig(height_px=72, width_px=128)
    uv = [(0.0, 0.0), (128.0, 72.0), (-0.01, 5.0), (5.0, -0.01), (128.01, 5.0), (5.0, 72.01), (np.nan, 5.0)]
    assert inside_of(np.array(uv), camera).tolist() == [True, True, False, False, False, False, False]


def test_image_that_lacks_too_much_is_refused_and_less_is_black():
    narrower = dataclasses.replace(POLICY, horizontal_fov_deg=86.0)
    share = 1.0 - (np.tan(np.radians(43.0)) / np.tan(np.radians(45.0))) ** 2
    with pytest.raises(ConfigError, match=f"does not show {100 * share:.0f} % of what the policy's shows"):
        Rectifier(narrower, POLICY)
    little = Rectifier(dataclasses.replace(POLICY, horizontal_fov_deg=88.0), POLICY)
    assert 0.04 < little.unseen < 0.1
    white = little(np.full((72, 128, 3), 255, np.uint8))
    assert (white[0] == 0).all()
    assert (white[10:-10, 10:-10] == 255).all()
    depth_m = little.depth(np.full((72, 128), 2.5, np.float32))
    assert np.isinf(depth_m[0]).all()
    assert (depth_m[10:-10, 10:-10] == 2.5).all()


def test_camera_that_looks_to_the_side_is_turned_back_ahead():
    robot = CameraConfig(height_px=480, width_px=640, horizontal_fov_deg=120.0, mount_yaw_deg=8.0, mount_pitch_deg=3.0)
    policy = dataclasses.replace(POLICY, mount_yaw_deg=-2.0)
    rectifier = Rectifier(robot, policy)
    assert not rectifier.identity
    # Colours are functions of where the rays point in the robot's frame.
    shown, expected = (128 + 100 * np.sin(3 * directions(camera)) for camera in (robot, policy))
    found = rectifier(shown.astype(np.uint8))
    assert np.abs(found.astype(int) - expected[..., ::-1]).max() <= 4


def directions(camera):
    """Unit vectors along the rays of a camera's pixels in the robot's frame: forward, left, up."""
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px] + 0.5
    xy = make_lens(camera).rays(np.stack([u.ravel(), v.ravel()], axis=1))
    yaw, pitch = np.radians((camera.mount_yaw_deg, camera.mount_pitch_deg))
    ahead = np.cos(pitch) - xy[:, 1] * np.sin(pitch)
    up = -np.sin(pitch) - xy[:, 1] * np.cos(pitch)
    way = np.stack(
        [np.cos(yaw) * ahead + np.sin(yaw) * xy[:, 0], np.sin(yaw) * ahead - np.cos(yaw) * xy[:, 0], up], axis=1
    )
    return (way / np.linalg.norm(way, axis=1, keepdims=True)).reshape(camera.height_px, camera.width_px, 3)


def test_camera_that_looks_far_to_the_side_is_refused():
    with pytest.raises(ConfigError, match=r"does not show \d+ % of what the policy's shows"):
        Rectifier(dataclasses.replace(POLICY, mount_yaw_deg=40.0), POLICY)


def test_rectified_images_have_the_projection_of_their_file_and_no_lens(tmp_path):
    projection = (
        "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [280.0, 0, 315.5, 0, 0, 281.0, 235.5, 0, 0, 0, 1.0, 0]\n"
    )
    (tmp_path / "front.yaml").write_text(YAML + projection)
    camera = camera_from_file(POLICY, tmp_path / "front.yaml", image="/camera/image_rect_color/compressed")
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (280.0, 281.0, 316.0, 236.0)
    assert (camera.distortion, camera.k1) == ("none", 0.0)
    raw = camera_from_file(POLICY, tmp_path / "front.yaml", image="/camera/image_raw")
    assert (raw.fx_px, raw.k1) == (300.0, -0.05)
