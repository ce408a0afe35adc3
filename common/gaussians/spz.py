"""Niantic's .spz files, versions 1 to 4: attribute after attribute, each quantised, gzipped or (version 4) in zstd.

| attribute | bytes | meaning of a byte b |
|---|---|---|
| position | 9 (version 1: 6) | three signed 24-bit numbers / 2^fractional bits (version 1: three float16) |
| opacity | 1 | b / 255 |
| colour | 3 | (b / 255 - 0.5) / 0.15 is the SH coefficient of degree 0 |
| scale | 3 | exp(b / 16 - 10) |
| rotation | 4 | the three smaller of x, y, z, w, see `_smallest_three` |
| rotation of versions 1 and 2 | 3 | b / 127.5 - 1 for x, y, z; w is not negative |
| SH | 9, 24, 45, 72 | (b - 128) / 128, coefficient by coefficient, red, green and blue side by side |

By convention the axes are right, up, back: y points up. The vendors' extensions are left out, and so are the SH
coefficients of degree 4, which nothing here draws.

Source: nianticlabs/spz, README.md and `load-spz.cc` (MIT).
"""

import io
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.errors import SceneError
from readygo.common.files import read_regular
from readygo.common.gaussians.activations import scales_from_logs
from readygo.common.gaussians.cloud import GaussianCloud

MAGIC = b"NGSP"
GZIP_MAGIC = b"\x1f\x8b"
COLOUR_SCALE = 0.15

_HEADER = struct.Struct("<4sIIBBBB")
_SH_ROWS = (0, 3, 8, 15, 24)
"""Coefficients above degree 0, by degree."""
_RATIO_MAX = 16
"""Files that claim to unpack to more than this many times their size, and a megabyte, are refused: usual is 3."""
_SLACK_BYTES = 1 << 20
_EXTENSION_BYTES_MAX = 1 << 20
_ZSTD_HEADER_BYTES = 32
_ZSTD_WINDOW_MAX = 1 << 27


@dataclass(frozen=True)
class _Header:
    version: int
    count: int
    sh_degree: int
    fractional_bits: int
    streams: int

    @property
    def row_bytes(self) -> tuple[int, ...]:
        """Bytes of a Gaussian in each attribute, in their order in the file."""
        position = 6 if self.version == 1 else 9
        rotation = 4 if self.version >= 3 else 3
        return position, 1, 3, 3, rotation, 3 * _SH_ROWS[self.sh_degree]


def cloud_from_spz(path: Path) -> GaussianCloud:
    """Gaussians of a file, in its axes; not validated.

    Raises:
        SceneError: If the file is damaged, of an unknown version, or claims more than it can hold.
        OSError: If it cannot be read.
    """
    data = read_regular(path)
    header, (position, opacity, colour, scale, rotation, sh) = (
        _zstd_attributes(data, path) if data.startswith(MAGIC) else _gzip_attributes(data, path)
    )
    rest = min(_SH_ROWS[header.sh_degree], _SH_ROWS[3])
    coefficients = np.empty((header.count, 1 + rest, 3), np.float32)
    coefficients[:, 0] = (colour / 255.0 - 0.5) / COLOUR_SCALE
    coefficients[:, 1:] = (sh[:, : 3 * rest].reshape(header.count, rest, 3).astype(np.float32) - 128.0) / 128.0
    return GaussianCloud(
        means_m=_positions(position, header),
        quats_wxyz=_smallest_three(rotation) if header.version >= 3 else _first_three(rotation),
        scales_m=scales_from_logs(scale.astype(np.float32) / np.float32(16.0) - np.float32(10.0)),
        opacities=opacity[:, 0].astype(np.float32) / np.float32(255.0),
        sh=coefficients,
    )


def _gzip_attributes(data: bytes, path: Path) -> tuple[_Header, list[UInt8Array]]:
    inflate = zlib.decompressobj(16 + zlib.MAX_WBITS)
    try:
        start = inflate.decompress(data, _HEADER.size)
        if not start.startswith(MAGIC) and (inflate.eof or start):
            raise SceneError(f"{path} is compressed with gzip, but holds no .spz; unpack it first.")
        header = _header(start, (1, 2, 3), len(data), path)
        expected = header.count * sum(header.row_bytes)
        body = inflate.decompress(inflate.unconsumed_tail, expected) if expected else b""
        # What follows are extensions and gzip's checksum, which is compared when the end is reached.
        inflate.decompress(inflate.unconsumed_tail, _EXTENSION_BYTES_MAX)
    except zlib.error as error:
        raise SceneError(f"{path} is damaged: {error}; copy or export it again.") from error
    if len(body) < expected or not inflate.eof:
        raise SceneError(f"{path} is truncated: {len(body)} of {expected} bytes unpacked; copy or export it again.")
    ends = np.cumsum([header.count * size for size in header.row_bytes])[:-1]
    parts = np.split(np.frombuffer(body, np.uint8), ends)
    return header, [part.reshape(header.count, size) for part, size in zip(parts, header.row_bytes, strict=True)]


def _zstd_attributes(data: bytes, path: Path) -> tuple[_Header, list[UInt8Array]]:
    """Version 4: a plain header of 32 bytes, a table of sizes, and a zstd stream for each attribute."""
    header = _header(data, (4,), len(data), path)
    if len(data) < _ZSTD_HEADER_BYTES:
        raise SceneError(f"{path} is truncated: its header is cut off; copy or export it again.")
    (at,) = struct.unpack_from("<I", data, _HEADER.size)
    sizes = [size for size in header.row_bytes if size]
    if header.streams < len(sizes) or at + 16 * header.streams > len(data):
        raise SceneError(f"{path} is damaged: its table of contents does not fit; copy or export it again.")
    table = [struct.unpack_from("<QQ", data, at + 16 * k) for k in range(header.streams)]
    at += 16 * header.streams
    attributes = []
    for (packed, _), size in zip(table, sizes, strict=False):
        attributes.append(_zstd(data[at : at + packed], header.count * size, path).reshape(header.count, size))
        at += packed
    if len(attributes) < len(header.row_bytes):
        attributes.append(np.empty((header.count, 0), np.uint8))
    return header, attributes


def _zstd(packed: bytes, expected: int, path: Path) -> UInt8Array:
    import zstandard

    try:
        reader = zstandard.ZstdDecompressor(max_window_size=_ZSTD_WINDOW_MAX).stream_reader(io.BytesIO(packed))
        body = reader.read(expected)
    except zstandard.ZstdError as error:
        raise SceneError(f"{path} is damaged: {error}; copy or export it again.") from error
    if len(body) < expected:
        raise SceneError(f"{path} is truncated: {len(body)} of {expected} bytes unpacked; copy or export it again.")
    return np.frombuffer(body, np.uint8)


def _header(start: bytes, versions: tuple[int, ...], file_bytes: int, path: Path) -> _Header:
    if len(start) < _HEADER.size:
        raise SceneError(f"{path} is truncated: its header is cut off; copy or export it again.")
    _, version, count, sh_degree, fractional_bits, _, streams = _HEADER.unpack_from(start)
    if version not in versions or sh_degree >= len(_SH_ROWS) or fractional_bits > 24:
        what = f"version {version}, SH degree {sh_degree} and {fractional_bits} fractional bits"
        raise SceneError(f"{path} is .spz of {what}; readygo reads versions 1 to 4 with SH degrees 0 to 4.")
    header = _Header(version, count, sh_degree, fractional_bits, streams)
    if count * sum(header.row_bytes) > _RATIO_MAX * file_bytes + _SLACK_BYTES:
        raise SceneError(f"{path} claims {count} Gaussians, which its {file_bytes} bytes cannot hold; export it again.")
    return header


def _positions(stored: UInt8Array, header: _Header) -> Float32Array:
    if header.version == 1:
        return np.ascontiguousarray(stored).view("<f2").astype(np.float32)
    low, middle, high = (stored[:, k::3].astype(np.int32) for k in range(3))
    fixed = low | middle << 8 | (high - ((high & 0x80) << 1)) << 16
    return (fixed / float(1 << header.fractional_bits)).astype(np.float32)


def _first_three(stored: UInt8Array) -> Float32Array:
    quats = np.empty((len(stored), 4), np.float32)
    quats[:, 1:] = stored / 127.5 - 1.0
    quats[:, 0] = np.sqrt(np.maximum(0.0, 1.0 - (quats[:, 1:].astype(np.float64) ** 2).sum(axis=1)))
    return quats


def _smallest_three(stored: UInt8Array) -> Float32Array:
    """Quaternions of words whose top two bits name the largest of x, y, z, w; the others follow from the top.

    Words are little-endian. Each other component has a sign bit and nine bits of magnitude / 511 * sqrt(1/2). The
    largest is positive.
    """
    words = np.ascontiguousarray(stored).view("<u4")[:, 0]
    fields = np.stack([words >> 20, words >> 10, words], axis=1) & 1023
    small = (fields & 511) * (np.sqrt(0.5) / 511.0) * np.where(fields & 512, -1.0, 1.0)
    largest = np.sqrt(np.maximum(0.0, 1.0 - (small * small).sum(axis=1)))
    xyzw = np.empty((len(words), 4), np.float32)
    for component in range(4):
        rows = words >> 30 == component
        xyzw[rows, component] = largest[rows]
        xyzw[np.ix_(rows, [k for k in range(4) if k != component])] = small[rows]
    return xyzw[:, [3, 0, 1, 2]]
