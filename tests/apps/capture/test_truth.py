from pathlib import Path

import numpy as np
import pytest

from readygo.apps.capture.truth import read_truth, truth_path, write_truth
from readygo.common.errors import SceneError


def test_truth_comes_back_under_the_names_that_images_get(tmp_path: Path) -> None:
    T = np.eye(4)
    T[:3, 3] = (1.0, 2.0, 1.5)
    frames = [{"image": 7, "T_world_camera": T.tolist()}, {"image": "0001.png", "T_world_camera": T.tolist()}]
    path = truth_path(tmp_path / "walk.mp4")
    assert path.name == "walk.truth.json"
    write_truth(path, {"frames": frames, "marker": {"corners_m": np.ones((4, 3)).tolist()}})
    truth = read_truth(path)
    assert sorted(truth.poses) == ["000007.jpg", "0001.jpg"]
    np.testing.assert_array_equal(truth.poses["000007.jpg"], T)
    np.testing.assert_array_equal(truth.content["marker"]["corners_m"], np.ones((4, 3)))


@pytest.mark.parametrize("text", ["", "[]", '{"format": "another"}'])
def test_other_files_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.truth.json"
    path.write_text(text)
    with pytest.raises(SceneError, match=r"a\.truth\.json"):
        read_truth(path)


def test_poses_of_360_degree_images_are_those_of_their_views(tmp_path: Path) -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], (1.0, 2.0, 1.5)
    frames = [{"image": 7, "T_world_camera": T.tolist()}]
    write_truth(tmp_path / "a.truth.json", {"frames": frames, "camera": {"model": "EQUIRECTANGULAR"}})
    poses = read_truth(tmp_path / "a.truth.json").poses
    assert len(poses) == 8
    np.testing.assert_array_equal(poses["view_0/000007.jpg"], T)
    np.testing.assert_allclose(poses["view_1/000007.jpg"][:3, 2], (0, -1, 0), atol=1e-12, err_msg="to the right")
    np.testing.assert_array_equal([pose[:3, 3] for pose in poses.values()], np.tile([1.0, 2.0, 1.5], (8, 1)))
