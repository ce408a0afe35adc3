import dataclasses
import os

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import load_gaussians
from readygo.common.gaussians.files import read_gaussians, with_unit_rotations
from readygo.common.gaussians.ply import save_ply
from tests.common.gaussians.ply_files import FIELDS, good_row, write_ply


@pytest.mark.parametrize(
    ("column", "value", "kind"),
    [
        (0, np.nan, "position"),
        (3, np.inf, "colour"),
        (6, np.nan, "opacity"),
        (7, 1000.0, "scale"),
        (8, np.nan, "scale"),
        (12, np.nan, "rotation"),
    ],
)
def test_numbers_that_are_not_finite_are_counted(tmp_path, column, value, kind):
    rows = [good_row() for _ in range(4)]
    rows[1][column] = rows[3][column] = value
    with pytest.raises(SceneError, match=rf"2 of 4 Gaussians .*\({kind} not finite[^:]*: 2\)"):
        load_gaussians(write_ply(tmp_path / "a.ply", FIELDS, rows))


def test_rotation_of_length_zero_is_refused(tmp_path):
    row = good_row()
    row[10] = 0
    with pytest.raises(SceneError, match="1 of 1 Gaussians"):
        load_gaussians(write_ply(tmp_path / "a.ply", FIELDS, [row]))


def test_file_is_read_with_whatever_numbers_it_holds(tmp_path):
    row = good_row()
    row[0], row[10] = np.nan, 0
    cloud = read_gaussians(write_ply(tmp_path / "a.ply", FIELDS, [row]))
    assert np.isnan(cloud.means_m[0, 0])
    assert not cloud.quats_wxyz.any()


def test_rotations_get_length_one_and_keep_their_direction(make_cloud):
    cloud = make_cloud(10)
    longer = dataclasses.replace(cloud, quats_wxyz=np.float32(3.0) * cloud.quats_wxyz)
    np.testing.assert_allclose(with_unit_rotations(longer).quats_wxyz, cloud.quats_wxyz, atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"ply\nformat binary_little_endian 1.0\nelement face 0\nend_header\n", "no element 'vertex'"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nend_header\n", "empty"),
    ],
)
def test_files_without_gaussians_are_refused(tmp_path, content, message):
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(SceneError, match=message):
        load_gaussians(tmp_path / "a.ply")


def test_real_object_loads(shared_data):
    cloud = load_gaussians(shared_data / "scenes" / "guitar.ply")
    assert len(cloud) == 90854
    assert cloud.sh_degree == 0
    assert 0 < cloud.opacities.min() < cloud.opacities.max() <= 1


CLAIM = b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "none of what can be read: .ply of 3DGS"),
        (b"\x89PNG\r\n\x1a\n" + bytes(4096), "none of what can be read"),
        (b"a text of thirty-two characters." * 40, "none of what can be read"),
        (CLAIM + b"property float x\nend_header\n", "truncated: 4000000000"),
        (CLAIM + b"end_header\n", "without properties"),
    ],
)
def test_other_files_and_what_they_claim_are_refused(tmp_path, content, message):
    (tmp_path / "a.splat").write_bytes(content)
    with pytest.raises(SceneError, match=message) as refusal:
        read_gaussians(tmp_path / "a.splat")
    assert "\n" not in str(refusal.value)


def test_missing_files_and_devices_are_refused(tmp_path):
    with pytest.raises(SceneError, match="cannot be read: No such file"):
        read_gaussians(tmp_path / "none.ply")
    with pytest.raises(SceneError, match="it is a pipe or a device"):
        read_gaussians("/dev/null")


@pytest.mark.parametrize("name", ["a.ply", "a.splat", "a.spz", "a.ckpt"])
def test_pipe_is_refused_and_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(SceneError, match=rf"{name} cannot be read: it is a pipe or a device, no regular file\.$"):
        read_gaussians(tmp_path / name)
    with pytest.raises(SceneError, match="no file can have this name"):
        read_gaussians(tmp_path / "a\0.ply")


def test_file_with_more_than_the_machine_has_room_for_is_refused(tmp_path, make_cloud, monkeypatch):
    save_ply(make_cloud(3), tmp_path / "a.ply")

    def full(*_):
        raise MemoryError

    monkeypatch.setattr("readygo.common.gaussians.files.read_ply", full)
    with pytest.raises(SceneError, match=r"a\.ply holds more Gaussians than this machine has memory for"):
        read_gaussians(tmp_path / "a.ply")
