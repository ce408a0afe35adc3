import base64
import json
import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from readygo.common.avatars.importers.gltf_file import GltfFile
from readygo.common.errors import AvatarError
from tests.common.avatars.importers.humans import write_glb


def gltf(path: Path, data: bytes, **entries: Any) -> GltfFile:
    """A .gltf with one buffer inside of it and a view of all of it."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document: Mapping[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        **entries,
    }
    path.write_text(json.dumps(document))
    return GltfFile(path)


def test_accessor_steps_over_what_lies_between_its_values(tmp_path: Path) -> None:
    data = np.arange(8, dtype="<u2").tobytes()
    view = {"buffer": 0, "byteOffset": 2, "byteLength": 14, "byteStride": 6}
    accessor = {"bufferView": 0, "byteOffset": 2, "componentType": 5123, "count": 2, "type": "VEC2"}
    file = gltf(tmp_path / "a.gltf", data, bufferViews=[view], accessors=[accessor])
    assert file.accessor(0).tolist() == [[2, 3], [5, 6]]


def test_normalised_integers_lie_in_minus_one_to_one(tmp_path: Path) -> None:
    accessor = {"bufferView": 0, "componentType": 5120, "count": 3, "type": "SCALAR", "normalized": True}
    file = gltf(tmp_path / "a.gltf", np.array([127, 0, -128], np.int8).tobytes(), accessors=[accessor])
    assert file.accessor(0)[:, 0].tolist() == [1.0, 0.0, -1.0]


def test_sparse_values_stand_in_for_zeros(tmp_path: Path) -> None:
    data = np.array([1, 3], "<u2").tobytes() + np.array([5, 7], "<f4").tobytes()
    views = [{"buffer": 0, "byteLength": 4}, {"buffer": 0, "byteOffset": 4, "byteLength": 8}]
    sparse = {"count": 2, "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 1}}
    accessor = {"componentType": 5126, "count": 4, "type": "SCALAR", "sparse": sparse}
    file = gltf(tmp_path / "a.gltf", data, bufferViews=views, accessors=[accessor])
    assert file.accessor(0)[:, 0].tolist() == [0.0, 5.0, 0.0, 7.0]


@pytest.mark.parametrize("change", [{"count": 4}, {"byteOffset": 4}, {"componentType": 1}, {"type": "VEC9"}])
def test_accessor_beyond_its_buffer_or_of_an_unknown_kind_is_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "SCALAR"}
    file = gltf(tmp_path / "a.gltf", bytes(12), accessors=[accessor | change])
    with pytest.raises(AvatarError, match="accessor 0 cannot be read"):
        file.accessor(0)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_image_comes_as_rgba(tmp_path: Path, depth: type) -> None:
    bgr = np.zeros((2, 3, 3), depth)
    bgr[..., 2] = np.iinfo(depth).max
    png = bytes(cv2.imencode(".png", bgr)[1])
    file = gltf(tmp_path / "a.gltf", png, images=[{"bufferView": 0}, {"bufferView": 5}])
    pixels = file.image(0)
    assert pixels is not None
    assert pixels.dtype == np.uint8
    assert pixels.tolist() == [[[255, 0, 0, 255]] * 3] * 2
    assert file.image(1) is None


def test_buffer_beside_the_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "a b.bin").write_bytes(np.array([2.5], "<f4").tobytes())
    accessor = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}
    buffers = [{"uri": "a%20b.bin", "byteLength": 4}]
    views = [{"buffer": 0, "byteLength": 4}]
    file = gltf(tmp_path / "a.gltf", b"", buffers=buffers, bufferViews=views, accessors=[accessor])
    assert file.accessor(0).tolist() == [[2.5]]


@pytest.mark.parametrize(
    ("uri", "words"), [("../secret.bin", "outside of its folder"), ("none.bin", "'none.bin', which cannot be read")]
)
def test_buffers_outside_of_the_folder_and_missing_ones_are_refused(tmp_path: Path, uri: str, words: str) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(4))
    (tmp_path / "in").mkdir()
    accessor = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}
    file = gltf(tmp_path / "in" / "a.gltf", bytes(4), buffers=[{"uri": uri, "byteLength": 4}], accessors=[accessor])
    with pytest.raises(AvatarError, match=words):
        file.accessor(0)


def test_truncated_and_foreign_files_are_refused(tmp_path: Path) -> None:
    data = write_glb(tmp_path / "p.glb").read_bytes()
    for size in (8, 200, len(data) // 2, len(data) - 400):
        (tmp_path / "short.glb").write_bytes(data[:size])
        with pytest.raises(AvatarError):
            GltfFile(tmp_path / "short.glb")
    (tmp_path / "old.gltf").write_text(json.dumps({"asset": {"version": "1.0"}}))
    with pytest.raises(AvatarError, match=r"version 1\.0"):
        GltfFile(tmp_path / "old.gltf")


def test_compressed_geometry_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="needs KHR_draco_mesh_compression"):
        gltf(tmp_path / "a.gltf", b"", extensionsRequired=["KHR_texture_transform", "KHR_draco_mesh_compression"])


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"componentType": 5126, "count": 10**12, "type": "VEC3"}, "more than 16,777,216 numbers"),
        ({"componentType": 5126, "count": 1e300, "type": "VEC3"}, "more than 16,777,216 numbers"),
        ({"componentType": 5126, "count": -1, "type": "VEC3"}, "cannot be read"),
        ({"bufferView": 0, "componentType": 5126, "count": float("inf"), "type": "VEC3"}, "cannot be read"),
        ({"bufferView": 0, "byteOffset": "a", "componentType": 5126, "count": 1, "type": "SCALAR"}, "cannot be read"),
    ],
)
def test_accessor_costs_no_more_than_its_bytes(tmp_path: Path, entry: dict[str, Any], words: str) -> None:
    file = gltf(tmp_path / "a.gltf", bytes(12), accessors=[entry])
    with pytest.raises(AvatarError, match=words):
        file.accessor(0)


def test_same_bytes_may_not_be_read_again_and_again(tmp_path: Path) -> None:
    entry = {"bufferView": 0, "componentType": 5121, "count": 2**20, "type": "VEC4"}
    file = gltf(tmp_path / "a.gltf", bytes(2**22), accessors=[entry])
    for _ in range(4):
        file.accessor(0)
    with pytest.raises(AvatarError, match="numbers: give a smaller figure"):
        file.accessor(0)


def _png_claiming(width_px: int, height_px: int) -> bytes:
    png = bytes(cv2.imencode(".png", np.zeros((1, 1), np.uint8))[1])
    head = png[12:16] + struct.pack(">II", width_px, height_px) + png[24:29]
    return png[:12] + head + struct.pack(">I", zlib.crc32(head)) + png[33:]


def test_texture_that_claims_too_many_pixels_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    file = gltf(tmp_path / "a.gltf", _png_claiming(20_000, 20_000), images=[{"bufferView": 0}])
    with pytest.raises(AvatarError, match="image 0 is 20000x20000 px, more than"):
        file.image(0)


def test_textures_have_a_limit_together_and_are_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.common.avatars.importers.gltf_file.TEXELS_MAX", 8)
    png = bytes(cv2.imencode(".png", np.zeros((2, 3, 3), np.uint8))[1])
    file = gltf(tmp_path / "a.gltf", png, images=[{"bufferView": 0}, {"bufferView": 0}])
    assert file.image(0) is file.image(0)
    with pytest.raises(AvatarError, match="pixels of textures"):
        file.image(1)


def test_webp_is_read(tmp_path: Path) -> None:
    for quality in (80, 101):
        data = bytes(cv2.imencode(".webp", np.zeros((4, 6, 3), np.uint8), [cv2.IMWRITE_WEBP_QUALITY, quality])[1])
        pixels = gltf(tmp_path / "a.gltf", data, images=[{"bufferView": 0}]).image(0)
        assert pixels is not None
        assert pixels.shape == (4, 6, 4)


def test_pipes_and_names_that_no_file_has_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bin")
    os.mkfifo(tmp_path / "pipe.glb")
    with pytest.raises(AvatarError, match="cannot be read"):
        GltfFile(tmp_path / "pipe.glb")
    accessor = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}
    for uri in ("pipe.bin", "a%00b", "a" * 5000, 7):
        file = gltf(tmp_path / "a.gltf", bytes(4), buffers=[{"uri": uri, "byteLength": 4}], accessors=[accessor])
        with pytest.raises(AvatarError, match="cannot be read"):
            file.accessor(0)


def test_deep_json_is_refused(tmp_path: Path) -> None:
    text = b'{"asset": {"version": "2.0"}, "a": ' + b"[" * 100_000
    text += b" " * (-len(text) % 4)
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text)
    with pytest.raises(AvatarError, match="nest deeper"):
        GltfFile(tmp_path / "a.glb")


def test_parts_of_meshes_have_a_limit(tmp_path: Path) -> None:
    file = gltf(tmp_path / "a.gltf", bytes(4), meshes=[{"primitives": [{}] * 10_000}])
    assert len(file.primitives(0)) == 10_000
    with pytest.raises(AvatarError, match="16,384 parts"):
        file.primitives(0)


def test_extensions_of_another_shape_are_none(tmp_path: Path) -> None:
    assert gltf(tmp_path / "a.gltf", bytes(4), extensions=[1]).extensions == {}
