import base64
import json
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


def test_image_of_too_many_pixels_is_not_decoded(tmp_path: Path) -> None:
    data = bytearray(cv2.imencode(".png", np.zeros((3, 4, 3), np.uint8))[1].tobytes())
    data[16:24] = struct.pack(">II", 20_000, 20_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    views = [{"buffer": 0, "byteLength": len(data)}]
    assert gltf(tmp_path / "a.gltf", bytes(data), bufferViews=views, images=[{"bufferView": 0}]).image(0) is None


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
