from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.common.frames import swap_opengl_axes
from readygo.services.reconstructor.given.capture import (
    GivenCapture,
    check_poses,
    image_file,
    named_error,
    pose_matrices,
)
from readygo.services.reconstructor.given.depth import DepthFile
from readygo.services.reconstructor.poses.intrinsics import lens
from tests.services.reconstructor.given.known import POSES, opengl


def test_opengl_axes_become_opencv_axes() -> None:
    np.testing.assert_allclose(swap_opengl_axes(np.stack([opengl(row) for row in range(4)])), POSES, atol=1e-12)


@pytest.mark.parametrize("wrong", [np.diag([1.0, 1, -1, 1]), np.diag([2.0, 2, 2, 1]), np.full((4, 4), np.nan)])
def test_first_pose_that_is_none_is_named(wrong: np.ndarray) -> None:
    check_poses(POSES)
    with pytest.raises(ValueError, match="pose of frame 1 is no rotation"):
        check_poses(np.stack([POSES[0], wrong, wrong]))


def test_capture_has_as_many_poses_as_images_and_keeps_them_together() -> None:
    more = {"kind": "test", "files": (), "metric": True, "rough": False}
    lenses = tuple(lens(10.0 + row, 10, 5, 5) for row in range(4))
    images = tuple(Path(f"{row}.jpg") for row in range(4))
    depth = (None, DepthFile(path=Path("1.png")), None, None)
    whole = GivenCapture(images=images, lenses=lenses, T_world_camera=POSES, depth=depth, **more)  # type: ignore[arg-type]
    assert whole.all_files == [*images, Path("1.png")]
    some = whole.select([3, 1])
    assert some.depth == (None, depth[1])
    assert [path.name for path in some.images] == ["3.jpg", "1.jpg"]
    assert [each.params[0] for each in some.lenses] == [13.0, 11.0]
    np.testing.assert_array_equal(some.T_world_camera, POSES[[3, 1]])
    bare = GivenCapture(images=images, lenses=lenses, T_world_camera=POSES, **more)  # type: ignore[arg-type]
    assert bare.depth == (None,) * 4
    with pytest.raises(ValueError, match="as many"):
        GivenCapture(images=images, lenses=lenses[:1], T_world_camera=POSES, **more)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="as many"):
        GivenCapture(images=images, lenses=lenses, T_world_camera=POSES, depth=depth[:2], **more)  # type: ignore[arg-type]


def test_image_of_a_name_is_found_by_its_ending(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    assert image_file(tmp_path, "a") == tmp_path / "a.png"
    assert image_file(tmp_path, "b") == tmp_path / "b.jpg"


def test_errors_are_one_line() -> None:
    assert str(named_error(Path("a"), "a film", KeyError("w"))) == "a cannot be read as a film: no 'w'."
    assert str(named_error(Path("a"), "a film", ValueError("it is dark"))) == "a cannot be read as a film: it is dark."


def test_quaternions_and_positions_are_poses() -> None:
    quats = Rotation.from_matrix(POSES[:, :3, :3]).as_quat()
    np.testing.assert_allclose(pose_matrices(quats, POSES[:, :3, 3]), POSES, atol=1e-12)
    with pytest.raises(ValueError, match="not the length 1"):
        pose_matrices(1.1 * quats, POSES[:, :3, 3])
    with pytest.raises(ValueError, match="not the length 1"):
        pose_matrices(quats, np.nan * POSES[:, :3, 3])
