"""glTF 2.0 containers: .glb and .gltf, their accessors and images.

Source: Khronos Group, glTF 2.0 Specification.
"""

import base64
import math
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.documents import parse_json
from readygo.common.errors import AvatarError
from readygo.common.files import read_regular
from readygo.common.images.encoded import PICTURES, PIXELS_MAX, decode_pixels, encoded_size_px

GLB_MAGIC = b"glTF"
GLTF_BYTES_MAX = 128 * 2**20
"""Largest size of the file, and of each file that it refers to [bytes]."""
NUMBERS_MAX = 2**24
"""Numbers of all accessors that are read; a file may name the same bytes again and again."""
PRIMITIVES_MAX = 2**14
"""Parts of meshes that are read."""
TEXELS_MAX = 2**26
"""Pixels of all textures; one has at most `PIXELS_MAX`."""
_JSON_CHUNK, _BIN_CHUNK = 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_UNREADABLE = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")

Json = Mapping[str, Any]


class GltfFile:
    """One file with its buffers.

    Args:
        path: A .glb, or a .gltf whose buffers lie beside it or within it.

    Raises:
        AvatarError: If it is not glTF 2.0, is truncated, or its geometry is compressed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            data = read_regular(path, bytes_max=GLTF_BYTES_MAX)
        except OSError as error:
            raise AvatarError(f"{path} cannot be read: {error.strerror}.") from error
        text, self._binary = _chunks(path, data) if data[:4] == GLB_MAGIC else (data, b"")
        try:
            self.json: Json = parse_json(text, bytes_max=GLTF_BYTES_MAX)
        except ValueError as error:
            raise AvatarError(f"{path} is not glTF: its JSON cannot be read ({error}).") from error
        asset = self.json.get("asset") if isinstance(self.json, dict) else None
        version = str(asset.get("version", "")) if isinstance(asset, dict) else ""
        if not version.startswith("2"):
            raise AvatarError(f"{path} is glTF of version {version or 'unknown'}; only 2.x is read.")
        required = self.json.get("extensionsRequired", [])
        compressed = [name for name in _UNREADABLE if isinstance(required, list) and name in required]
        if compressed:
            raise AvatarError(f"{path} needs {', '.join(compressed)}; export it without compression.")
        self._buffers: dict[int, bytes] = {}
        self._images: dict[int, UInt8Array | None] = {}
        self._left = {"numbers": NUMBERS_MAX, "parts": PRIMITIVES_MAX, "pixels of textures": TEXELS_MAX}

    def items(self, kind: str) -> Sequence[Json]:
        """The file's nodes, meshes, skins, ...; empty if it has none."""
        found: Sequence[Json] = self.json.get(kind, [])
        return found

    @property
    def extensions(self) -> Json:
        """Those of the whole file."""
        found = self.json.get("extensions", {})
        return found if isinstance(found, dict) else {}

    def primitives(self, mesh: int) -> Sequence[Json]:
        """The parts of a mesh.

        Raises:
            AvatarError: If the file has too many.
        """
        found: Sequence[Json] = self.items("meshes")[mesh]["primitives"]
        self._take("parts", 1 + len(found))
        return found

    def _take(self, what: str, count: int) -> None:
        self._left[what] -= count
        if self._left[what] < 0:
            limit = {"numbers": NUMBERS_MAX, "parts": PRIMITIVES_MAX, "pixels of textures": TEXELS_MAX}[what]
            raise AvatarError(f"{self.path} holds more than {limit:,} {what}: give a smaller figure.")

    def accessor(self, number: int) -> AnyArray:
        """Values of an accessor, shape (count, size); normalised integers become floats in -1..1.

        Raises:
            AvatarError: If it reaches beyond its buffer, or is of an unknown kind.
        """
        try:
            entry = self.items("accessors")[number]
            dtype, size = np.dtype(_COMPONENTS[entry["componentType"]]), _SIZES[entry["type"]]
            count = int(entry["count"])
            if count < 1:
                raise ValueError("nothing in it")
            self._take("numbers", count * size)
            values = self._values(entry, dtype, size, count)
            if "sparse" in entry:
                values = self._with_sparse(values, entry["sparse"], dtype, size)
        except (LookupError, TypeError, ValueError, AttributeError, OverflowError, struct.error) as error:
            raise AvatarError(f"{self.path}: accessor {number} cannot be read; the file is damaged.") from error
        if entry.get("normalized") and dtype.kind in "iu":
            return np.maximum(values.astype(np.float64) / np.iinfo(dtype).max, -1.0)
        return values

    def _values(self, entry: Json, dtype: np.dtype[Any], size: int, count: int) -> AnyArray:
        if "bufferView" not in entry:
            return np.zeros((count, size), dtype)
        view = self.items("bufferViews")[entry["bufferView"]]
        data = self._view(entry["bufferView"])[int(entry.get("byteOffset", 0)) :]
        stride = int(view.get("byteStride", dtype.itemsize * size))
        if count < 1 or stride < dtype.itemsize * size or (count - 1) * stride + dtype.itemsize * size > len(data):
            raise ValueError("beyond the buffer")
        return np.ndarray((count, size), dtype, data, strides=(stride, dtype.itemsize)).copy()

    def _with_sparse(self, values: AnyArray, sparse: Json, dtype: np.dtype[Any], size: int) -> AnyArray:
        count = int(sparse["count"])
        index = self._values(sparse["indices"], np.dtype(_COMPONENTS[sparse["indices"]["componentType"]]), 1, count)
        values[index[:, 0]] = self._values(sparse["values"], dtype, size, count)
        return values

    def image(self, number: int) -> UInt8Array | None:
        """Pixels of an image as RGBA, shape (H, W, 4); None if it is missing, or no readable PNG, JPEG or WebP.

        Raises:
            AvatarError: If it is too large.
        """
        if number not in self._images:
            self._images[number] = self._decode_image(number)
        return self._images[number]

    def _decode_image(self, number: int) -> UInt8Array | None:
        import cv2

        try:
            entry = self.items("images")[number]
            data = self._view(entry["bufferView"]) if "bufferView" in entry else self._resource(str(entry["uri"]))
        except (LookupError, TypeError, ValueError, AttributeError, OverflowError):
            return None
        size_px = encoded_size_px(data)
        if size_px is None or math.prod(size_px) < 1:
            return None
        if math.prod(size_px) > PIXELS_MAX:
            raise AvatarError(
                f"{self.path}: image {number} is {size_px[1]}x{size_px[0]} px, more than {PIXELS_MAX:,}; shrink it."
            )
        self._take("pixels of textures", math.prod(size_px))
        pixels = decode_pixels(data, cv2.IMREAD_UNCHANGED, formats=PICTURES)
        if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
            return None
        if pixels.dtype == np.uint16:
            pixels = (pixels // 256).astype(np.uint8)
        if pixels.ndim == 2 or pixels.shape[2] == 1:
            return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGBA), dtype=np.uint8)
        code = cv2.COLOR_BGR2RGBA if pixels.shape[2] == 3 else cv2.COLOR_BGRA2RGBA
        return np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)

    def _view(self, number: int) -> bytes:
        view = self.items("bufferViews")[number]
        start = int(view.get("byteOffset", 0))
        data = self._buffer(int(view["buffer"]))[start : start + int(view["byteLength"])]
        if start < 0 or len(data) < int(view["byteLength"]):
            raise ValueError("beyond the buffer")
        return data

    def _buffer(self, number: int) -> bytes:
        if number not in self._buffers:
            uri = self.items("buffers")[number].get("uri")
            self._buffers[number] = self._binary if uri is None else self._resource(uri)
        return self._buffers[number]

    def _resource(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        folder = self.path.parent.resolve()
        try:
            place = (folder / unquote(uri)).resolve()
            if not place.is_relative_to(folder):
                raise AvatarError(f"{self.path} refers to {uri!r}, which lies outside of its folder.")
            return read_regular(place, bytes_max=GLTF_BYTES_MAX)
        except (OSError, ValueError, RuntimeError) as error:
            why = getattr(error, "strerror", None) or error
            raise AvatarError(f"{self.path} refers to {uri!r}, which cannot be read: {why}.") from error


def base_colour_texture(material: Json) -> Json | None:
    """What a material says of its base colour's texture: its number, and where it lies; None if it has none."""
    glossy = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    found: Json | None = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", glossy.get("diffuseTexture"))
    return found


def texture_transform(reference: Json) -> Json:
    """The extension KHR_texture_transform of a reference to a texture; empty without it."""
    found: Json = reference.get("extensions", {}).get("KHR_texture_transform", {})
    return found


def uv_set(reference: Json) -> int:
    """The set of texture coordinates that a texture lies at: 1 for TEXCOORD_1."""
    return int(texture_transform(reference).get("texCoord", reference.get("texCoord", 0)))


def _chunks(path: Path, data: bytes) -> tuple[bytes, bytes]:
    """JSON and binary chunk of a .glb."""
    text, binary, place = None, b"", 12
    while place + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, place)
        chunk = data[place + 8 : place + 8 + length]
        if len(chunk) < length:
            raise AvatarError(f"{path} is truncated: a chunk of {length} bytes ends after {len(chunk)}.")
        if kind == _JSON_CHUNK and text is None:
            text = chunk
        elif kind == _BIN_CHUNK and not binary:
            binary = chunk
        place += 8 + length + (-length) % 4
    if text is None:
        raise AvatarError(f"{path} is a .glb without JSON; the file is damaged.")
    return text, binary
