import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud, load_gaussians, save_ply

FIELDS = [
    "x",
    "y",
    "z",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
]


def cloud_of(count=50, coefficients=16, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(count, 4))
    return GaussianCloud(
        means_m=rng.normal(size=(count, 3)).astype(np.float32),
        quats_wxyz=(q / np.linalg.norm(q, axis=1, keepdims=True)).astype(np.float32),
        scales_m=np.exp(rng.normal(-4, 1, (count, 3))).astype(np.float32),
        opacities=rng.random(count).astype(np.float32),
        sh=rng.normal(size=(count, coefficients, 3)).astype(np.float32),
    )


def write_ply(path, fields, rows, *, count=None, form="binary_little_endian 1.0"):
    header = ["ply", f"format {form}", f"element vertex {len(rows) if count is None else count}"]
    header += [f"property float {name}" for name in fields] + ["end_header"]
    path.write_bytes(("\n".join(header) + "\n").encode() + np.asarray(rows, "<f4").tobytes())
    return path


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_saved_cloud_loads_as_it_was(tmp_path, coefficients):
    cloud = cloud_of(coefficients=coefficients)
    save_ply(cloud, tmp_path / "a.ply")
    back = load_gaussians(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.means_m, cloud.means_m)
    np.testing.assert_array_equal(back.sh, cloud.sh)
    np.testing.assert_allclose(back.quats_wxyz, cloud.quats_wxyz, atol=1e-7)
    np.testing.assert_allclose(back.scales_m, cloud.scales_m, rtol=1e-6)
    np.testing.assert_allclose(back.opacities, cloud.opacities, atol=1e-6)
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]


def test_opacities_of_zero_and_one_survive(tmp_path):
    cloud = cloud_of(2, 1)
    whole = GaussianCloud(
        means_m=cloud.means_m,
        quats_wxyz=cloud.quats_wxyz,
        scales_m=cloud.scales_m,
        opacities=np.float32([0, 1]),
        sh=cloud.sh,
    )
    save_ply(whole, tmp_path / "a.ply")
    np.testing.assert_allclose(load_gaussians(tmp_path / "a.ply").opacities, [0, 1], atol=1e-12)


def test_stored_numbers_are_logits_logs_and_channel_by_channel_sh(tmp_path):
    fields = [*FIELDS, *(f"f_rest_{i}" for i in range(9)), "nx"]
    row = [1, 2, 3, 0.1, 0.2, 0.3, 0.0, np.log(0.5), 0, -1, 0, 0, 0, 2, *range(9), 7]
    cloud = load_gaussians(write_ply(tmp_path / "a.ply", fields, [row]))
    np.testing.assert_allclose(cloud.means_m, [[1, 2, 3]])
    np.testing.assert_allclose(cloud.opacities, [0.5])
    np.testing.assert_allclose(cloud.scales_m, [[0.5, 1, np.exp(-1)]], rtol=1e-6)
    np.testing.assert_allclose(cloud.quats_wxyz, [[0, 0, 0, 1]])
    np.testing.assert_allclose(cloud.sh[0], [[0.1, 0.2, 0.3], [0, 3, 6], [1, 4, 7], [2, 5, 8]], rtol=1e-6)


def good_row():
    return [0.0, 0, 0, 0, 0, 0, 0, -3, -3, -3, 1, 0, 0, 0]


def test_truncated_file_tells_expected_and_found_bytes(tmp_path):
    path = write_ply(tmp_path / "a.ply", FIELDS, [good_row()] * 3)
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    with pytest.raises(SceneError, match=f"truncated: {len(whole)} bytes expected, {len(whole) - 5} found"):
        load_gaussians(path)


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


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK\x03\x04 something else", "not a PLY file"),
        (b"", "not a PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", "binary_little_endian"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex x\nend_header\n", "broken PLY header"),
        (b"ply\nformat binary_little_endian 1.0\nproperty list uchar int vertex_indices\n", "a mesh"),
        (b"ply\nformat binary_little_endian 1.0\nelement face 0\nend_header\n", "no element 'vertex'"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nend_header\n", "empty"),
        (b"ply\ncomment " + b"x" * 9000, "broken PLY header"),
        (b"ply\n" + b"comment\n" * 2000, "no 'end_header'"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=message) as caught:
        load_gaussians(path)
    assert "\n" not in str(caught.value)
    assert "a.ply" in str(caught.value)


def test_missing_file_is_a_scene_error(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        load_gaussians(tmp_path / "none.ply")


def test_point_cloud_lacks_a_named_property(tmp_path):
    with pytest.raises(SceneError, match="lacks the property 'f_dc_0'"):
        load_gaussians(write_ply(tmp_path / "a.ply", ["x", "y", "z"], [[0, 0, 0]]))


def test_wrong_number_of_sh_properties_is_refused(tmp_path):
    fields = [*FIELDS, *(f"f_rest_{i}" for i in range(8))]
    with pytest.raises(SceneError, match="8 f_rest properties"):
        load_gaussians(write_ply(tmp_path / "a.ply", fields, [good_row() + [0] * 8]))


def test_real_object_loads(shared_data):
    cloud = load_gaussians(shared_data / "scenes" / "guitar.ply")
    assert len(cloud) == 90854
    assert cloud.sh_degree == 0
    assert 0 < cloud.opacities.min() < cloud.opacities.max() <= 1
