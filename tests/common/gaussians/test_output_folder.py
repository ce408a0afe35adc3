import json

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import load_gaussians, save_ply
from readygo.common.gaussians.files import read_source
from readygo.common.gaussians.output_folder import beside, newest_gaussians, ranks
from tests.common.gaussians.other_formats import camera_row


@pytest.fixture
def output(tmp_path, make_cloud):
    """Of 3DGS: two iterations, points that it began with, cameras."""
    for step in (7000, 30000):
        place = tmp_path / "lobby" / "point_cloud" / f"iteration_{step}"
        place.mkdir(parents=True)
        save_ply(make_cloud(step // 1000), place / "point_cloud.ply")
    (tmp_path / "lobby" / "input.ply").write_bytes(b"points")
    (tmp_path / "lobby" / "cameras.json").write_text(json.dumps([camera_row(0, np.eye(4))]))
    return tmp_path / "lobby"


@pytest.mark.parametrize(
    "part", [".", "point_cloud", "point_cloud/iteration_30000", "point_cloud/iteration_30000/point_cloud.ply"]
)
def test_newest_iteration_is_read_with_its_cameras_from_any_depth(output, part):
    source = read_source(output / part)
    assert len(source.cloud) == 30
    assert source.file.parent.name == "iteration_30000"
    assert len(source.views) == 1
    np.testing.assert_array_equal(source.up, [0, -1, 0])


def test_older_iteration_can_be_named(output):
    assert len(load_gaussians(output / "point_cloud" / "iteration_7000")) == 7


def test_folder_without_cameras_has_none(output):
    (output / "cameras.json").unlink()
    source = read_source(output)
    assert source.views is None
    assert source.up is None


def test_file_beside_other_cameras_takes_none_of_them(output, make_cloud):
    save_ply(make_cloud(3), output / "edited.ply")
    assert read_source(output / "edited.ply").views is None


def test_folder_without_gaussians_says_what_was_looked_for(tmp_path):
    with pytest.raises(SceneError, match=r"holds no Gaussians of a training \(point_cloud/iteration_"):
        read_source(tmp_path)


def test_steps_are_compared_as_numbers(tmp_path):
    (tmp_path / "ckpts").mkdir()
    for name in ("ckpt_999_rank0.pt", "ckpt_29999_rank0.pt", "ckpt_29999_rank1.pt", "ckpt_6999_rank0.pt"):
        (tmp_path / "ckpts" / name).touch()
    newest = newest_gaussians(tmp_path)
    assert newest.name.startswith("ckpt_29999_")
    assert [path.name for path in ranks(newest)] == ["ckpt_29999_rank0.pt", "ckpt_29999_rank1.pt"]
    assert ranks(tmp_path / "other.pt") == [tmp_path / "other.pt"]


def test_plys_that_gsplat_exports_are_found(tmp_path, make_cloud):
    (tmp_path / "ply").mkdir()
    for step in (6999, 29999):
        save_ply(make_cloud(step // 1000), tmp_path / "ply" / f"point_cloud_{step}.ply")
    assert len(load_gaussians(tmp_path)) == 29


def test_what_lies_far_above_is_not_beside(tmp_path):
    (tmp_path / "cameras.json").touch()
    assert beside(tmp_path / "a" / "b" / "c" / "d.ply", "cameras.json") is None
    assert beside(tmp_path / "a" / "d.ckpt", "cameras.json") == tmp_path / "cameras.json"
