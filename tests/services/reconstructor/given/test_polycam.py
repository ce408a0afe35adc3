import json
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.given.depth import DepthFile
from readygo.services.reconstructor.given.polycam import check_polycam, find_polycam, read_polycam
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
    write_images,
)


def export(folder: Path, images: str = "images", cameras: str = "cameras") -> Path:
    """Raw data of four key frames, named by their times."""
    write_images(folder / "keyframes" / images, [f"100{row}.jpg" for row in range(4)])
    place = folder / "keyframes" / cameras
    place.mkdir(parents=True)
    for row in range(4):
        T = arkit(row)
        pose = {f"t_{i}{j}": T[i, j] for i in range(3) for j in range(4)}
        lens = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH_PX, "height": HEIGHT_PX}
        (place / f"100{row}.json").write_text(json.dumps({**pose, **lens, "blur_score": 90.0, "timestamp": row}))
    return folder


def test_camera_sees_a_point_at_its_pixel(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    found = find_polycam(export(tmp_path))
    assert found is not None
    capture = read_polycam(*found)
    for row in range(4):
        np.testing.assert_allclose(seen_by(capture, row, ARKIT_POINT_M), pixel(row), atol=1e-9)
        assert capture.images[row].name == f"100{row}.jpg"
    assert (capture.metric, capture.rough, capture.up) == (True, True, (0.0, 1.0, 0.0))
    assert (capture.T_world_camera[:, 1, 3] > 1.0).all(), "cameras are above the floor along y"


def test_corrected_cameras_go_first_and_stay_as_they_are(tmp_path: Path) -> None:
    export(export(tmp_path), "corrected_images", "corrected_cameras")
    found = find_polycam(tmp_path)
    assert found == (tmp_path / "keyframes" / "corrected_images", tmp_path / "keyframes" / "corrected_cameras")
    assert not read_polycam(*found).rough
    assert find_polycam(tmp_path / "keyframes") == found


def test_other_folders_are_no_export(tmp_path: Path) -> None:
    assert find_polycam(tmp_path) is None
    check_polycam(tmp_path)
    (tmp_path / "keyframes" / "images").mkdir(parents=True)
    assert find_polycam(tmp_path) is None
    with pytest.raises(SceneError, match="export the raw data"):
        check_polycam(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t_12": None}, "cannot be read as a camera of Polycam"),
        ({"fx": 0.0}, "focal lengths"),
        ({"t_00": 5.0}, "frame 2"),
    ],
)
def test_broken_cameras_are_refused_in_one_line(tmp_path: Path, change: dict[str, object], words: str) -> None:
    found = find_polycam(export(tmp_path))
    assert found is not None
    file = found[1] / "1002.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(SceneError, match=words):
        read_polycam(*found)


def test_depth_images_and_confidences_belong_to_their_images(tmp_path: Path) -> None:
    found = find_polycam(export(tmp_path))
    assert found is not None
    assert read_polycam(*found).depth == (None,) * 4
    for folder, names in {"depth": (0, 2), "confidence": (2,)}.items():
        write_images(tmp_path / "keyframes" / folder, [f"100{row}.png" for row in names])
    first, second, third, last = read_polycam(*found).depth
    place = tmp_path / "keyframes"
    assert first == DepthFile(path=place / "depth" / "1000.png", far_m=5.0)
    assert third == DepthFile(
        path=place / "depth" / "1002.png", confidence=place / "confidence" / "1002.png", far_m=5.0
    )
    assert (second, last) == (None, None)
