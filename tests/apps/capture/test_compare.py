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


def test_errors_of_a_crooked_capture_are_those_of_a_similarity_by_hand() -> None:
    truth, poses = capture()
    rng = np.random.default_rng(6)
    found = {}
    for name, T in poses.items():
        found[name] = moved(T, scale=0.97, roll=0.02)
        found[name][:3, 3] += rng.normal(0.0, 0.01, 3)
        found[name][:3, :3] = found[name][:3, :3] @ camera_pose(np.zeros(3), 0.01 * rng.normal(), 0.02, 0.0)[:3, :3]
    errors = pose_errors(truth, found)
    p_true, p_found = (np.array([T[:3, 3] for T in side.values()]) for side in (poses, found))
    a, b = p_found - p_found.mean(axis=0), p_true - p_true.mean(axis=0)
    U, sigma, Vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    R = U @ sign @ Vt
    scale = float(sigma @ np.diag(sign)) / float((a * a).sum())
    rigid, similar = (np.linalg.norm(factor * a @ R.T - b, axis=1) for factor in (1.0, scale))
    turned = [poses[name][:3, :3].T @ R @ found[name][:3, :3] for name in poses]
    angles = [math.degrees(math.acos((np.trace(turn) - 1) / 2)) for turn in turned]
    assert errors.scale_percent == pytest.approx(100 * (1 / scale - 1))
    assert errors.camera_rmse_m == pytest.approx(math.sqrt(float((rigid**2).mean())))
    assert errors.camera_max_m == pytest.approx(rigid.max())
    assert errors.shape_rmse_m == pytest.approx(math.sqrt(float((similar**2).mean())))
    assert errors.rotation_deg == pytest.approx(np.median(angles))
    assert errors.up_deg == pytest.approx(math.degrees(math.acos(R[2, 2])))
    assert errors.height_m == pytest.approx(p_found[:, 2].mean() - p_true[:, 2].mean())
    rounded = errors.to_mapping()
    assert (rounded["images"], rounded["scale_percent"]) == (12, round(errors.scale_percent, 5))


def test_three_images_are_enough() -> None:
    truth, poses = capture()
    names = list(poses)
    assert pose_errors(truth, {name: poses[name] for name in names[:3]}).images == 3
    with pytest.raises(SceneError, match="Only 2 of 2"):
        pose_errors(truth, {name: poses[name] for name in names[:2]})
