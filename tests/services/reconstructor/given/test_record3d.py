import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.common.errors import SceneError
from readygo.services.reconstructor.given.depth import DepthFile
from readygo.services.reconstructor.given.record3d import find_record3d, read_record3d
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


def export(folder: Path, **change: Any) -> tuple[Path, Path]:
    write_images(folder / "rgb", [f"{row}.jpg" for row in range(4)])
    poses = [[*Rotation.from_matrix(arkit(row)[:3, :3]).as_quat(), *arkit(row)[:3, 3]] for row in range(4)]
    K_by_columns = [FX, 0.0, 0.0, 0.0, FY, 0.0, CX, CY, 1.0]
    row = {"K": K_by_columns, "w": WIDTH_PX, "h": HEIGHT_PX, "fps": 60, "poses": poses, **change}
    (folder / "metadata").write_text(json.dumps(row))
    found = find_record3d(folder)
    assert found is not None
    return found


def test_camera_sees_a_point_at_its_pixel(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    capture = read_record3d(*export(tmp_path))
    for row in range(4):
        np.testing.assert_allclose(seen_by(capture, row, ARKIT_POINT_M), pixel(row), atol=1e-9)
        assert capture.images[row] == tmp_path / "rgb" / f"{row}.jpg"
    assert (capture.metric, capture.rough, capture.up) == (True, True, (0.0, 1.0, 0.0))


def test_lens_of_each_frame_goes_first(tmp_path: Path) -> None:
    each = [[FX + row, FY, CX, CY] for row in range(4)]
    capture = read_record3d(*export(tmp_path, perFrameIntrinsicCoeffs=each))
    assert [lens.params[0] for lens in capture.lenses] == [60.0, 61.0, 62.0, 63.0]


def test_other_folders_are_no_export(tmp_path: Path) -> None:
    (tmp_path / "metadata").write_text("{}")
    assert find_record3d(tmp_path) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"poses": [[0, 0, 0, 2, 0, 0, 0]]}, "quaternion has not the length 1"),
        ({"poses": [[1, 2, 3]]}, "cannot be read as metadata of Record3D"),
        ({"K": [1, 2]}, "cannot be read as metadata of Record3D"),
        ({"w": "wide"}, "cannot be read as metadata of Record3D"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words) as error:
        read_record3d(*export(tmp_path, **change))
    assert "\n" not in str(error.value)


def test_depths_are_beside_the_images_or_among_them(tmp_path: Path) -> None:
    found = export(tmp_path)
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "2.exr").touch()
    assert read_record3d(*found).depth == (
        None,
        None,
        DepthFile(path=tmp_path / "depth" / "2.exr", far_m=5.0),
        None,
    )
    (tmp_path / "rgb").rename(tmp_path / "rgbd")
    (tmp_path / "depth" / "2.exr").unlink()
    for name in ("1.depth", "1.conf", "3.depth"):
        (tmp_path / "rgbd" / name).touch()
    _, second, _, last = read_record3d(found[0], tmp_path / "rgbd").depth
    assert second == DepthFile(path=tmp_path / "rgbd" / "1.depth", confidence=tmp_path / "rgbd" / "1.conf", far_m=5.0)
    assert last == DepthFile(path=tmp_path / "rgbd" / "3.depth", far_m=5.0)
