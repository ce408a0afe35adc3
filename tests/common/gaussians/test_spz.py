import gzip
import struct
import tracemalloc

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians.files import read_source
from readygo.common.gaussians.spz import cloud_from_spz
from tests.common.gaussians.other_formats import spz_bytes, write_spz, write_spz4

POSITION = bytes([0, 0x18, 0, 0, 0xE0, 0xFF, 1, 0, 0])


def packed(path, *parts, version=3, count=1, degree=0, bits=12):
    header = struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, bits, 0, 0)
    path.write_bytes(gzip.compress(header + b"".join(parts)))
    return path


def test_one_gaussian_of_known_bytes(tmp_path):
    # The largest is y (1): then x = +511/511 sqrt(1/2), z = 0, w = -256/511 sqrt(1/2).
    word = 1 << 30 | 511 << 20 | 0 << 10 | 1 << 9 | 256
    sh = bytes([128, 255, 0, 129, 128, 127, 192, 64, 160])
    path = packed(
        tmp_path / "a",
        POSITION,
        b"\x33",
        b"\x80\x00\xff",
        bytes([160, 112, 255]),
        struct.pack("<I", word),
        sh,
        degree=1,
    )
    source = read_source(path)
    cloud = source.cloud
    assert source.kind == ".spz"
    np.testing.assert_array_equal(cloud.means_m, np.float32([[1.5, -2, 1 / 4096]]))
    assert cloud.opacities[0] == pytest.approx(0.2)
    np.testing.assert_allclose(cloud.sh[0, 0], [(128 / 255 - 0.5) / 0.15, -0.5 / 0.15, 0.5 / 0.15], rtol=1e-5)
    np.testing.assert_allclose(cloud.scales_m[0], np.exp([0, -3, 5.9375]), rtol=1e-6)
    x, w = 0.5**0.5, -256 / 511 * 0.5**0.5
    np.testing.assert_allclose(cloud.quats_wxyz[0], [w, x, np.sqrt(1 - x * x - w * w), 0], atol=1e-6)
    expected = np.array([[0, 127, -128], [1, 0, -1], [64, -64, 32]]) / 128
    np.testing.assert_array_equal(cloud.sh[0, 1:], expected)


def test_older_versions_of_known_bytes(tmp_path):
    rest = b"\xff", b"\x80\x80\x80", bytes([160, 160, 160]), bytes([255, 0, 127])
    second = cloud_from_spz(packed(tmp_path / "b", POSITION, *rest, version=2))
    np.testing.assert_allclose(second.quats_wxyz[0], [0, 1, -1, -1 / 255], atol=1e-6)
    half = np.float16([1.5, -2, 0.1]).tobytes()
    first = cloud_from_spz(packed(tmp_path / "a", half, *rest, version=1))
    np.testing.assert_array_equal(first.means_m, np.float16([[1.5, -2, 0.1]]).astype(np.float32))


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_written_cloud_comes_back_within_a_step(tmp_path, make_cloud, version, coefficients):
    cloud = make_cloud(300, seed=version, coefficients=coefficients)
    path = tmp_path / "a"
    read = cloud_from_spz(write_spz4(cloud, path) if version == 4 else write_spz(cloud, path, version=version))
    position_m = 0.5 / 4096 if version > 1 else 4.0 / 2048
    assert np.abs(read.means_m - cloud.means_m).max() <= 1.01 * position_m
    assert np.abs(np.log(read.scales_m / cloud.scales_m)).max() <= 1.01 / 32
    assert np.abs(read.opacities - cloud.opacities).max() <= 0.51 / 255
    assert np.abs(read.sh[:, 0] - cloud.sh[:, 0]).max() <= 0.51 / 255 / 0.15
    # Of the smallest three, each is wrong by half a step; of x, y, z in bytes, w can be wrong by much more near 0.
    cos = np.abs((read.quats_wxyz * cloud.quats_wxyz).sum(axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(cos, 1))).max() <= (0.3 if version >= 3 else 12.0)
    rest = np.clip(cloud.sh[:, 1:], -1, 127 / 128)
    assert np.abs(read.sh[:, 1:4] - rest[:, :3]).max(initial=0) <= 4.51 / 128
    assert np.abs(read.sh[:, 4:] - rest[:, 3:]).max(initial=0) <= 8.51 / 128


def test_sh_of_degree_4_is_left_out_and_extensions_are_skipped(tmp_path, make_cloud):
    cloud = make_cloud(20, coefficients=16)
    body = spz_bytes(cloud)
    wider = np.frombuffer(body[-20 * 45 :], np.uint8).reshape(20, 15, 3)
    wider = np.concatenate([wider, np.full((20, 9, 3), 7, np.uint8)], axis=1).tobytes()
    header = bytearray(body[:16])
    header[12], header[14] = 4, 2
    (tmp_path / "a").write_bytes(gzip.compress(bytes(header) + body[16 : -20 * 45] + wider + b"\x02\0\xbe\xadmore"))
    read = cloud_from_spz(tmp_path / "a")
    np.testing.assert_array_equal(read.sh, cloud_from_spz(write_spz(cloud, tmp_path / "b")).sh)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda raw: gzip.compress(raw)[:-9], "truncated"),
        (lambda raw: gzip.compress(raw)[:40], "truncated"),
        (lambda raw: gzip.compress(raw[:-1]), "truncated"),
        (lambda raw: gzip.compress(raw)[:200] + b"xxxx" + gzip.compress(raw)[204:], "damaged"),
        (lambda raw: gzip.compress(raw[:4] + struct.pack("<I", 9) + raw[8:]), "version 9"),
        (lambda raw: gzip.compress(raw[:12] + b"\x05" + raw[13:]), "SH degree 5"),
        (lambda raw: gzip.compress(b"ply\n" + raw), "holds no .spz"),
        (lambda raw: gzip.compress(b""), "holds no .spz"),
        (lambda raw: gzip.compress(raw[:8]), "header is cut off"),
        (lambda raw: raw, "version 3"),
        (lambda raw: raw[:4] + b"\x04\0\0\0" + raw[8:], "table of contents"),
        (lambda raw: raw[:10], "header is cut off"),
        (lambda raw: gzip.compress(raw[:8] + bytes(4) + raw[12:16]), "empty"),
    ],
)
def test_damaged_files_are_refused(tmp_path, make_cloud, change, message):
    (tmp_path / "a.spz").write_bytes(change(spz_bytes(make_cloud(50))))
    with pytest.raises(SceneError, match=message):
        read_source(tmp_path / "a.spz")


@pytest.mark.parametrize("claimed", [10**6, 2**32 - 1])
def test_what_cannot_be_there_is_not_allocated(tmp_path, make_cloud, claimed):
    raw = spz_bytes(make_cloud(5, coefficients=16), count=claimed)
    bomb = gzip.compress(raw + bytes(40_000_000))
    for name, content in (("a", gzip.compress(raw)), ("b", bomb)):
        (tmp_path / name).write_bytes(content)
        tracemalloc.start()
        with pytest.raises(SceneError, match=r"cannot hold|truncated"):
            read_source(tmp_path / name)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
        tracemalloc.stop()


def test_zstd_streams_that_are_short_or_broken_are_refused(tmp_path, make_cloud):
    import zstandard

    cloud = make_cloud(50)
    short = [zstandard.ZstdCompressor().compress(b"few")] * 5
    with pytest.raises(SceneError, match="truncated: 3 of 450"):
        cloud_from_spz(write_spz4(cloud, tmp_path / "a", streams=short))
    with pytest.raises(SceneError, match="damaged"):
        cloud_from_spz(write_spz4(cloud, tmp_path / "a", streams=[b"no zstd"] * 5))
