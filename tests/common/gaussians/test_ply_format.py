import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians.ply_format import columns, read_ply, require_fields
from tests.common.gaussians.ply_files import FIELDS, good_row, write_ply

HEADER = """ply
format binary_little_endian 1.0
comment two elements
element first 2
property uchar a
property double b
element second 1
property int16 c
end_header
"""


def test_elements_come_in_their_order_with_their_own_layouts(tmp_path):
    first = np.array([(1, 0.5), (200, -2.0)], dtype=[("a", "<u1"), ("b", "<f8")])
    (tmp_path / "a.ply").write_bytes(HEADER.encode() + first.tobytes() + np.int16(-7).tobytes())
    tables = read_ply(tmp_path / "a.ply")
    assert list(tables) == ["first", "second"]
    np.testing.assert_array_equal(tables["first"], first)
    assert tables["second"]["c"].tolist() == [-7]
    side_by_side = columns(tables["first"], ["b", "a"])
    assert side_by_side.dtype == np.float32
    assert side_by_side.tolist() == [[0.5, 1.0], [-2.0, 200.0]]


def test_first_missing_field_is_named(tmp_path):
    table = read_ply(write_ply(tmp_path / "a.ply", FIELDS, [good_row()]))["vertex"]
    require_fields(table, ["x", "rot_3"], tmp_path / "a.ply", "a cloud")
    with pytest.raises(SceneError, match="lacks the property 'red': it is not a cloud"):
        require_fields(table, ["x", "red", "green"], tmp_path / "a.ply", "a cloud")


def test_property_that_is_named_twice_is_refused(tmp_path):
    with pytest.raises(SceneError, match="names a property twice"):
        read_ply(write_ply(tmp_path / "a.ply", ["x", "y", "x"], [[0, 0, 0]]))


def test_truncated_file_tells_expected_and_found_bytes(tmp_path):
    path = write_ply(tmp_path / "a.ply", FIELDS, [good_row()] * 3)
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    with pytest.raises(SceneError, match=f"truncated: {len(whole)} bytes expected, {len(whole) - 5} found"):
        read_ply(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK\x03\x04 something else", "not a PLY file"),
        (b"", "not a PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", "binary_little_endian"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex x\nend_header\n", "broken PLY header"),
        (b"ply\nformat binary_little_endian 1.0\nproperty list uchar int vertex_indices\n", "a mesh"),
        (b"ply\ncomment " + b"x" * 9000, "broken PLY header"),
        (b"ply\n" + b"comment\n" * 2000, "no 'end_header'"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=message) as caught:
        read_ply(path)
    assert "\n" not in str(caught.value)
    assert "a.ply" in str(caught.value)


def test_missing_file_is_a_scene_error(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        read_ply(tmp_path / "none.ply")
