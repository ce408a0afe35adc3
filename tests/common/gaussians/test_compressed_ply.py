import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import load_gaussians
from readygo.common.gaussians.spherical_harmonics import SH_C0

RANGES = ["x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"]
PACKED = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


def quantised(value, bits):
    return round(value * ((1 << bits) - 1))


def pack_111011(x, y, z):
    return quantised(x, 11) << 21 | quantised(y, 10) << 11 | quantised(z, 11)


def pack_8888(*values):
    return sum(quantised(v, 8) << shift for v, shift in zip(values, (24, 16, 8, 0), strict=True))


def pack_rotation(q_wxyz):
    q = np.asarray(q_wxyz) / np.linalg.norm(q_wxyz)
    largest = int(np.argmax(np.abs(q)))
    q = q * np.sign(q[largest])
    a, b, c = (quantised(q[i] / np.sqrt(2) + 0.5, 10) for i in range(4) if i != largest)
    return largest << 30 | a << 20 | b << 10 | c


def write(path, chunk_rows, vertex_rows, *, colours=True, sh=None):
    ranges = RANGES if colours else RANGES[:6]
    names = [f"{end}_{n}" for group in (ranges[:3], ranges[3:6], ranges[6:]) for end in ("min", "max") for n in group]
    header = ["ply", "format binary_little_endian 1.0", f"element chunk {len(chunk_rows)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element vertex {len(vertex_rows)}", *(f"property uint {name}" for name in PACKED)]
    body = np.asarray(chunk_rows, "<f4").tobytes() + np.asarray(vertex_rows, "<u4").tobytes()
    if sh is not None:
        header += [f"element sh {len(sh)}", *(f"property uchar f_rest_{i}" for i in range(sh.shape[1]))]
        body += sh.astype("<u1").tobytes()
    path.write_bytes(("\n".join([*header, "end_header"]) + "\n").encode() + body)
    return path


CHUNK = [-1, -2, -3, 1, 2, 3, -6, -6, -6, 0, 0, 0]
COLOURS = [0, 0, 0, 2, 2, 2]


def test_position_scale_and_colour_spread_over_the_chunk(tmp_path):
    row = [pack_111011(0, 1, 0.5), pack_rotation([1, 0, 0, 0]), pack_111011(1, 0, 0.5), pack_8888(0, 0.5, 1, 0.25)]
    cloud = load_gaussians(write(tmp_path / "a.ply", [CHUNK + COLOURS], [row]))
    np.testing.assert_allclose(cloud.means_m, [[-1, 2, 0]], atol=2e-3)
    np.testing.assert_allclose(cloud.scales_m, np.exp([[0, -6, -3]]), rtol=2e-3)
    np.testing.assert_allclose(0.5 + SH_C0 * cloud.sh[0, 0], [0, 1, 2], atol=5e-3)
    np.testing.assert_allclose(cloud.opacities, [0.25], atol=2e-3)


def test_older_files_without_colour_range_hold_plain_colours(tmp_path):
    row = [pack_111011(0, 0, 0), pack_rotation([1, 0, 0, 0]), pack_111011(0, 0, 0), pack_8888(0, 0.5, 1, 1)]
    cloud = load_gaussians(write(tmp_path / "a.ply", [CHUNK], [row], colours=False))
    np.testing.assert_allclose(0.5 + SH_C0 * cloud.sh[0, 0], [0, 0.5, 1], atol=3e-3)


def test_rotations_survive_packing(tmp_path):
    rng = np.random.default_rng(0)
    q = rng.normal(size=(40, 4))
    rows = [[0, pack_rotation(row), 0, 0] for row in q]
    cloud = load_gaussians(write(tmp_path / "a.ply", [CHUNK + COLOURS], rows))
    np.testing.assert_allclose(matrix_from_quat(cloud.quats_wxyz), matrix_from_quat(q), atol=4e-3)


def test_each_256_gaussians_have_their_own_chunk(tmp_path):
    other = [10, 10, 10, 11, 11, 11, *CHUNK[6:]]
    rows = [[pack_111011(0, 0, 0), pack_rotation([1, 0, 0, 0]), 0, 0]] * 257
    cloud = load_gaussians(write(tmp_path / "a.ply", [CHUNK + COLOURS, other + COLOURS], rows))
    np.testing.assert_allclose(cloud.means_m[255:], [[-1, -2, -3], [10, 10, 10]])


def test_sh_bytes_are_channel_by_channel_in_minus_4_to_4(tmp_path):
    sh = np.array([[0, 255, 128, 127, 0, 0, 255, 0, 64]], np.uint8)
    row = [[0, pack_rotation([1, 0, 0, 0]), 0, 0]]
    cloud = load_gaussians(write(tmp_path / "a.ply", [CHUNK + COLOURS], row, sh=sh))
    assert cloud.sh_degree == 1
    expected = np.array([[-4, 4, 0], [0, -4, -4], [4, -4, -2]]).T
    np.testing.assert_allclose(cloud.sh[0, 1:], expected, atol=0.02)


def test_counts_that_disagree_are_refused(tmp_path):
    rows = [[0, pack_rotation([1, 0, 0, 0]), 0, 0]]
    with pytest.raises(SceneError, match="1 chunks of 256 for 257"):
        load_gaussians(write(tmp_path / "a.ply", [CHUNK + COLOURS], rows * 257))
    with pytest.raises(SceneError, match="2 rows of spherical harmonics for 1"):
        load_gaussians(write(tmp_path / "b.ply", [CHUNK + COLOURS], rows, sh=np.zeros((2, 9))))
    with pytest.raises(SceneError, match="7 f_rest"):
        load_gaussians(write(tmp_path / "c.ply", [CHUNK + COLOURS], rows, sh=np.zeros((1, 7))))


def test_real_scenes_load_with_plausible_sizes(shared_data):
    flat = load_gaussians(shared_data / "scenes" / "showroom.compressed.ply")
    assert (len(flat), flat.sh_degree) == (729773, 0)
    low, high = np.percentile(flat.means_m, [1, 99], axis=0)
    np.testing.assert_allclose(high - low, [20.4, 24.1, 3.5], atol=0.2)
    bed = load_gaussians(shared_data / "scenes" / "flowers.compressed.ply")
    assert (len(bed), bed.sh_degree) == (92802, 2)
    assert np.abs(bed.sh[:, 1:]).mean() < 0.2
