import math

import numpy as np
import pytest

from readygo.apps.capture.compare import pose_errors
from readygo.apps.capture.truth import Truth
from readygo.apps.capture.walk import camera_pose
from readygo.common.errors import SceneError


def capture(count: int = 12) -> tuple[Truth, dict[str, np.ndarray]]:
    angles = np.linspace(0.0, 5.0, count)
    poses = [camera_pose(np.array([2 * math.cos(a), math.sin(a), 1.5]), a, -0.2, 0.0) for a in angles]
    frames = [{"image": number, "T_world_camera": T.tolist()} for number, T in enumerate(poses)]
    return Truth(content={"frames": frames, "marker": None}), {f"{k:06d}.jpg": T for k, T in enumerate(poses)}


def moved(T: np.ndarray, scale: float = 1.0, yaw: float = 0.7, roll: float = 0.0) -> np.ndarray:
    c, s, cr, sr = math.cos(yaw), math.sin(yaw), math.cos(roll), math.sin(roll)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    out = T.copy()
    out[:3, :3] = R @ T[:3, :3]
    out[:3, 3] = scale * R @ T[:3, 3] + (3.0, -1.0, 0.0)
    return out


def test_the_same_map_elsewhere_is_without_error() -> None:
    truth, poses = capture()
    errors = pose_errors(truth, {name: moved(T) for name, T in poses.items()})
    assert errors.images == errors.of == 12
    for value in (errors.scale_percent, errors.camera_rmse_m, errors.shape_rmse_m, errors.height_m):
        assert value == pytest.approx(0.0, abs=1e-9)
    assert max(errors.rotation_deg, errors.up_deg) < 1e-5


def test_scale_and_tilt_are_told_apart_from_shape() -> None:
    truth, poses = capture()
    errors = pose_errors(truth, {name: moved(T, scale=1.02, roll=0.01) for name, T in poses.items()})
    assert errors.scale_percent == pytest.approx(2.0, abs=1e-6)
    assert errors.shape_rmse_m < 1e-9
    assert errors.camera_rmse_m > 0.01
    assert errors.up_deg == pytest.approx(math.degrees(0.01), rel=1e-3)


def test_images_without_a_pose_are_counted_and_others_refused() -> None:
    truth, poses = capture()
    some = dict(list(poses.items())[:7])
    assert (pose_errors(truth, some).images, pose_errors(truth, some).of) == (7, 12)
    with pytest.raises(SceneError, match="Only 0 of 12 images"):
        pose_errors(truth, {f"other{name}": T for name, T in poses.items()})
