from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.given.depth import DepthFile
from readygo.services.reconstructor.given.find import prepare_capture, read_capture
from readygo.services.reconstructor.given.stray import find_stray, read_stray
from tests.services.reconstructor.given.known import (
    ARKIT_POINT_M,
    CX,
    CY,
    FX,
    FY,
    HEIGHT_PX,
    WIDTH_PX,
    arkit,
    pixel,
    seen_by,
)
from tests.services.reconstructor.given.test_depth import png, slope_mm

FRAMES = (0, 2, 3, 5)


def export(folder: Path, frames: int = 6) -> Path:
    """A video whose frames become lighter, with poses of four of them."""
    folder.mkdir(exist_ok=True)
    writer = cv2.VideoWriter(str(folder / "rgb.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30, (WIDTH_PX, HEIGHT_PX))
    for number in range(frames):
        writer.write(np.full((HEIGHT_PX, WIDTH_PX, 3), 40 * number + 20, np.uint8))
    writer.release()
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for row, number in enumerate(FRAMES):
        T = arkit(row) @ np.diag([1.0, -1.0, -1.0, 1.0])
        numbers = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()]
        lines.append(f"{number / 30}, {number:06d}, {', '.join(map(repr, map(float, numbers)))}")
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")
    (folder / "camera_matrix.csv").write_text(f"{FX}, 0.0, {CX}\n0.0, {FY}, {CY}\n0.0, 0.0, 1.0\n")
    return folder


def test_camera_sees_a_point_at_its_pixel(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    capture = read_stray(export(tmp_path))
    for row in range(4):
        np.testing.assert_allclose(seen_by(capture, row, ARKIT_POINT_M), pixel(row), atol=1e-9)
    assert (capture.metric, capture.rough, capture.up) == (True, True, (0.0, 1.0, 0.0))
    assert capture.video == tmp_path / "rgb.mp4"


def test_images_are_the_frames_of_the_video_that_have_a_pose(tmp_path: Path) -> None:
    folder = export(tmp_path / "s")
    png(folder / "depth" / "000003.png", slope_mm())
    png(folder / "confidence" / "000003.png", np.ones((6, 8), np.uint8))
    given = read_capture(folder)
    assert given is not None
    third = folder / "depth" / "000003.png", folder / "confidence" / "000003.png"
    assert given.depth == (None, None, DepthFile(path=third[0], confidence=third[1], far_m=5.0), None)
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert sorted(found["lens"]) == [f"{number:06d}.jpg" for number in FRAMES]
    for number in FRAMES:
        shown = cv2.imread(str(tmp_path / "out" / f"{number:06d}.jpg"))
        assert abs(float(shown.mean()) - (40 * number + 20)) < 6
    assert (found["what"], found["depths"], found["size_px"]) == ("Stray Scanner", 1, [WIDTH_PX, HEIGHT_PX])
    np.testing.assert_allclose(found["pose"]["000003.jpg"], given.T_world_camera[2])


def test_frames_after_the_end_of_the_video_are_told(tmp_path: Path) -> None:
    given = read_capture(export(tmp_path / "s", frames=5))
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert (found["kept"], found["unused"]) == (3, ["000005.jpg"])


def test_other_folders_are_no_recording(tmp_path: Path) -> None:
    export(tmp_path)
    (tmp_path / "camera_matrix.csv").unlink()
    assert find_stray(tmp_path) is None
    assert read_capture(tmp_path) is None


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("odometry.csv", "frame", "number", "no 'frame'"),
        ("odometry.csv", "000002", "000000", "not numbered in order"),
        ("odometry.csv", ", qw", ", w", "no 'qw'"),
        ("odometry.csv", "000002, ", "000002, nan", "could not convert|length 1"),
        ("camera_matrix.csv", "0.0, 0.0, 1.0", "", "cannot reshape"),
        ("camera_matrix.csv", f"{FX}", "-1", "focal lengths"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path: Path, name: str, old: str, new: str, words: str) -> None:
    path = export(tmp_path) / name
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(SceneError, match=words) as error:
        read_stray(tmp_path)
    assert "\n" not in str(error.value)
