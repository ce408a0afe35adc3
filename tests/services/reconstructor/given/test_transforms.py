import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.given.depth import DepthFile
from readygo.services.reconstructor.given.transforms import read_transforms
from tests.services.reconstructor.given.known import (
    CX,
    CY,
    FX,
    FY,
    HEIGHT_PX,
    POINT_M,
    WIDTH_PX,
    opengl,
    pixel,
    seen_by,
    write_images,
)

pytest.importorskip("pycolmap", reason="pycolmap is not installed")

LENS = {"fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY, "w": WIDTH_PX, "h": HEIGHT_PX}
FRAMES = [{"file_path": f"images/{row}.png", "transform_matrix": opengl(row).tolist()} for row in range(4)]


def written(folder: Path, table: dict[str, Any]) -> Path:
    path = folder / "transforms.json"
    path.write_text(json.dumps(table))
    return path


def test_camera_sees_a_point_at_its_pixel(tmp_path: Path) -> None:
    capture = read_transforms(written(tmp_path, {**LENS, "frames": FRAMES}))
    for row in range(4):
        np.testing.assert_allclose(seen_by(capture, row, POINT_M), pixel(row), atol=1e-9)
    assert (capture.metric, capture.rough, capture.up) == (False, False, None)
    assert capture.images[2] == tmp_path / "images" / "2.png"


def test_lens_of_a_frame_goes_before_the_shared_one(tmp_path: Path) -> None:
    frames = [{**frame, **LENS} if row else frame for row, frame in enumerate(FRAMES)]
    capture = read_transforms(written(tmp_path, {**LENS, "fl_x": 99.0, "frames": frames}))
    assert capture.lenses[0].params[0] == 99.0
    np.testing.assert_allclose(seen_by(capture, 1, POINT_M), pixel(1), atol=1e-9)


@pytest.mark.parametrize(("model", "kind"), [("OPENCV", "OPENCV"), ("OPENCV_FISHEYE", "OPENCV_FISHEYE")])
def test_distortion_is_that_of_opencv(tmp_path: Path, model: str, kind: str) -> None:
    import cv2

    k = {"k1": 0.11, "k2": -0.05, "k3": 0.0, "k4": 0.0, "p1": 0.002, "p2": -0.003}
    table = {**LENS, **k, "camera_model": model, "frames": FRAMES}
    capture = read_transforms(written(tmp_path, table))
    assert capture.lenses[0].model == kind
    T = capture.T_world_camera[0]
    local = T[:3, :3].T @ (POINT_M - T[:3, 3])
    K, zero = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1.0]]), np.zeros(3)
    if model == "OPENCV":
        there, _ = cv2.projectPoints(local[None], zero, zero, K, np.array([0.11, -0.05, 0.002, -0.003]))
    else:
        there, _ = cv2.fisheye.projectPoints(local[None, None], zero, zero, K, np.array([0.11, -0.05, 0.0, 0.0]))
    np.testing.assert_allclose(seen_by(capture, 0, POINT_M), there.reshape(2), atol=1e-9)


def test_what_nerfstudio_did_to_the_frame_is_undone(tmp_path: Path) -> None:
    applied = np.array([[1.0, 0, 0, 0.5], [0, 0, 1, -1], [0, -1, 0, 2]])
    whole = np.vstack([applied, [0, 0, 0, 1]])
    frames = []
    for row in range(4):
        T = whole @ opengl(row)
        T[:3, 3] *= 0.25
        frames.append({"file_path": f"images/{row}", "transform_matrix": T.tolist()})
    table = {**LENS, "applied_transform": applied.tolist(), "applied_scale": 0.25, "frames": frames}
    capture = read_transforms(written(tmp_path, table))
    np.testing.assert_allclose(seen_by(capture, 3, POINT_M), pixel(3), atol=1e-9)
    np.testing.assert_allclose(capture.T_world_camera[3, :3, 3], opengl(3)[:3, 3], atol=1e-12)


def test_field_of_view_gives_the_focal_length_where_that_is_all(tmp_path: Path) -> None:
    write_images(tmp_path / "train", [f"r_{row}.png" for row in range(4)])
    frames = [{**frame, "file_path": f"./train/r_{row}"} for row, frame in enumerate(FRAMES)]
    capture = read_transforms(written(tmp_path, {"camera_angle_x": 2 * math.atan(40 / 70), "frames": frames}))
    assert capture.images[1].is_file()
    assert capture.lenses[1].size_px == (80, 60)
    np.testing.assert_allclose(capture.lenses[1].params[:4], [70.0, 70.0, 40.0, 30.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frames": None}, "no frames"),
        ({"frames": [{"file_path": "a"}]}, "no 'transform_matrix'"),
        ({"frames": [{"transform_matrix": np.eye(4).tolist()}]}, "no 'file_path'"),
        (
            {"frames": [{"file_path": "a", "transform_matrix": (2 * np.eye(4)).tolist()}]},
            "pose of frame 0 is no rotation",
        ),
        ({"frames": [{"file_path": "a", "transform_matrix": [[1, 2]]}]}, r"shape \(1, 2\)"),
        ({"frames": [{"file_path": "a", "transform_matrix": "far"}]}, "could not convert"),
        ({"camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR is not known"),
        ({"applied_transform": np.zeros((3, 4)).tolist()}, "no inverse"),
        ({"applied_scale": -1}, "applied_scale must be positive"),
        ({"fl_x": -5.0}, "focal lengths must be positive"),
        ({"fl_x": None}, "cannot be read as a transforms.json"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words) as error:
        read_transforms(written(tmp_path, {**LENS, "frames": FRAMES, **change}))
    assert "\n" not in str(error.value)
    assert "transforms.json" in str(error.value)


def test_lens_without_a_focal_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="fl_x or camera_angle_x"):
        read_transforms(written(tmp_path, {"w": 80, "h": 60, "frames": FRAMES}))


def test_fisheye_of_instant_ngp_names_no_model(tmp_path: Path) -> None:
    k = {"k1": 0.11, "k2": -0.05, "k3": 0.01, "k4": 0.002}
    capture = read_transforms(written(tmp_path, {**LENS, **k, "is_fisheye": True, "frames": FRAMES}))
    assert capture.lenses[0].model == "OPENCV_FISHEYE"
    assert capture.lenses[0].params == (FX, FY, CX, CY, *k.values())
    capture = read_transforms(written(tmp_path, {**LENS, **k, "is_fisheye": False, "frames": FRAMES}))
    assert capture.lenses[0].model == "FULL_OPENCV"


def test_depth_images_are_those_that_frames_name(tmp_path: Path) -> None:
    write_images(tmp_path / "depths", ["1.png"])
    frames = [{**frame, "depth_file_path": f"depths/{row}.png"} for row, frame in enumerate(FRAMES[:3])]
    capture = read_transforms(written(tmp_path, {**LENS, "frames": [*frames, FRAMES[3]]}))
    assert capture.depth == (None, DepthFile(path=tmp_path / "depths" / "1.png"), None, None)
