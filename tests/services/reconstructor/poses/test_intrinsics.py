import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import ConfigError
from readygo.services.reconstructor.poses.intrinsics import (
    Intrinsics,
    fisheye_lens,
    fit_to_images,
    lens,
    lens_of_row,
    read_intrinsics,
)

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")

K = np.array([[520.0, 0.0, 318.5], [0.0, 510.0, 241.5], [0.0, 0.0, 1.0]])
D = np.array([0.06, -0.09, 0.0004, -0.0003, 0.01])
POINTS = np.array([[0.2, -0.1, 1.0], [-0.45, 0.3, 1.0], [0.0, 0.0, 1.0]])


def pixels_of(found: Intrinsics, points: np.ndarray) -> np.ndarray:
    """Where COLMAP's camera of the same model sees points."""
    camera = pycolmap.Camera(model=found.model, width=640, height=480, params=list(found.params))
    return np.array(camera.img_from_cam(points))


def written(path: Path, coefficients: np.ndarray) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", coefficients)
    storage.release()
    return path


@pytest.mark.parametrize("ending", ["yml", "xml"])
@pytest.mark.parametrize("count", [0, 4, 5])
def test_calibration_of_opencv_shows_points_where_opencv_does(tmp_path: Path, ending: str, count: int) -> None:
    found = read_intrinsics(str(written(tmp_path / f"c.{ending}", D[:count].reshape(1, -1) if count else np.zeros(5))))
    assert found.size_px == (640, 480)
    there, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, D[:count] if count else np.zeros(4))
    np.testing.assert_allclose(pixels_of(found, POINTS), there.reshape(-1, 2) + 0.5, atol=1e-6)


def test_calibration_of_ros_is_read_and_its_fisheye_is_one(tmp_path: Path) -> None:
    text = "image_width: 640\nimage_height: 480\ndistortion_model: {}\n"
    text += f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {K.ravel().tolist()}\n"
    text += f"distortion_coefficients:\n  rows: 1\n  cols: 4\n  data: {D[:4].tolist()}\n"
    (tmp_path / "a.yaml").write_text(text.format("plumb_bob"))
    there, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, D[:4])
    found = read_intrinsics(str(tmp_path / "a.yaml"))
    np.testing.assert_allclose(pixels_of(found, POINTS), there.reshape(-1, 2) + 0.5, atol=1e-6)
    (tmp_path / "b.yaml").write_text(text.format("equidistant"))
    wide = read_intrinsics(str(tmp_path / "b.yaml"))
    there, _ = cv2.fisheye.projectPoints(POINTS[:, None], np.zeros(3), np.zeros(3), K, D[:4])
    np.testing.assert_allclose(pixels_of(wide, POINTS), there.reshape(-1, 2) + 0.5, atol=1e-6)


def test_matrix_of_opencv_in_a_text_is_read(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "camera_matrix.txt", K)
    found = read_intrinsics(str(tmp_path / "camera_matrix.txt"))
    assert found == lens(520.0, 510.0, 319.0, 242.0)
    np.savetxt(tmp_path / "camera_matrix.txt", K[:2])
    with pytest.raises(ConfigError, match="it holds 6 numbers, a matrix has 9"):
        read_intrinsics(str(tmp_path / "camera_matrix.txt"))


def test_our_own_files_and_numbers_are_read_as_they_are(tmp_path: Path) -> None:
    camera = {"model": "OPENCV", "fx": 500.0, "fy": 501.0, "cx": 322.0, "cy": 238.0, "k1": 0.1}
    (tmp_path / "truth.json").write_text(json.dumps({"width_px": 640, "height_px": 480, "camera": camera}))
    found = read_intrinsics(str(tmp_path / "truth.json"))
    assert found == Intrinsics(
        model="OPENCV", params=(500.0, 501.0, 322.0, 238.0, 0.1, 0.0, 0.0, 0.0), size_px=(640, 480)
    )
    row = {"img_name": "a", "width": 640, "height": 480, "fx": 500.0, "fy": 501.0, "position": [0, 0, 0],
           "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}  # fmt: skip
    (tmp_path / "cameras.json").write_text(json.dumps([row, row]))
    assert read_intrinsics(str(tmp_path / "cameras.json")).params[:4] == (500.0, 501.0, 320.0, 240.0)
    (tmp_path / "two.json").write_text(json.dumps([row, {**row, "fx": 400.0}]))
    with pytest.raises(ConfigError, match="different lenses"):
        read_intrinsics(str(tmp_path / "two.json"))
    assert read_intrinsics("500, 501 322 238").params == (500.0, 501.0, 322.0, 238.0, 0.0, 0.0, 0.0, 0.0)
    assert read_intrinsics("500 501 322 238 .1 0 0 0 0.02").model == "FULL_OPENCV"
    assert lens_of_row({"fl_x": 9, "fl_y": 8, "w": 20, "h": 10}).params[:4] == (9.0, 8.0, 10.0, 5.0)
    assert lens_of_row({"fl_x": 9, "fl_y": 8, "cx": 1, "cy": 2, "camera_model": "OPENCV_FISHEYE", "k3": 3}) == (
        fisheye_lens(9, 8, 1, 2, [0, 0, 3])
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("500 500 320", "3 numbers"),
        ("500 five 320 240", "no file and no intrinsics"),
        ("-1 500 320 240", "focal lengths must be positive"),
        ("nan 500 320 240", "finite"),
        ("gone.yml", "No such file"),
        ("list.json", "no 'fx'|no 'fl_x'"),
        ("words.yaml", "none of camera_matrix"),
        ("broken.xml", "cannot be read as intrinsics"),
    ],
)
def test_what_is_no_lens_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("list.json").write_text('{"cx": 1}')
    Path("words.yaml").write_text("a: b\n")
    Path("broken.xml").write_text('<?xml version="1.0"?>\n<opencv_storage><camera_matrix>')
    with pytest.raises(ConfigError, match=words) as error:
        read_intrinsics(text)
    assert "\n" not in str(error.value)


def test_lens_is_fitted_to_images_that_were_made_smaller() -> None:
    given = lens(1040.0, 1020.0, 638.0, 484.0, [0.1], size_px=(1280, 960))
    fitted = fit_to_images(given, (2560, 1920), (640, 480))
    assert fitted.params == (520.0, 510.0, 319.0, 242.0, 0.1, 0.0, 0.0, 0.0)
    assert fitted.size_px == (640, 480)
    assert fit_to_images(lens(1040.0, 1020.0, 638.0, 484.0), (1280, 960), (640, 480)).params[:2] == (520.0, 510.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lens(1000, 1000, 960, 540, size_px=(1920, 1080)), "1920x1080 px, these have 640x480 px: calibrate"),
        (lens(500, 500, 240, 320, size_px=(480, 640)), "turned by 90 deg"),
        (lens(1000, 1000, 960, 540), "principal point at 960, 540"),
    ],
)
def test_lens_for_other_images_is_refused(given: Intrinsics, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        fit_to_images(given, (640, 480), (640, 480))


@pytest.mark.parametrize("coefficients", [D[:4], D])
@pytest.mark.parametrize("turned_deg", [90, 270])
def test_lens_of_a_sensor_shows_points_turned_as_its_images_are(coefficients: np.ndarray, turned_deg: int) -> None:
    given = lens(520.0, 510.0, 319.0, 242.0, list(coefficients), size_px=(640, 480))
    fitted = fit_to_images(given, (480, 640), (480, 640), turned_deg=turned_deg)
    before, (x, y, z) = pixels_of(given, POINTS), POINTS.T
    if turned_deg == 90:
        after, turned = np.stack([-y, x, z], axis=1), np.stack([480 - before[:, 1], before[:, 0]], axis=1)
    else:
        after, turned = np.stack([y, -x, z], axis=1), np.stack([before[:, 1], 640 - before[:, 0]], axis=1)
    np.testing.assert_allclose(pixels_of(fitted, after), turned, atol=1e-9)
    upright = lens(520.0, 510.0, 241.0, 318.0, size_px=(480, 640))
    assert fit_to_images(upright, (480, 640), (480, 640), turned_deg=turned_deg) == upright
