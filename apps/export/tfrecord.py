"""TFRecord files of `tf.train.Example` messages, without TensorFlow.

A record is its length, the masked CRC-32C of that, the data, and the masked CRC-32C of the data, all little-endian:
https://www.tensorflow.org/tutorials/load_data/tfrecord. An Example maps names to lists of bytes, floats or integers:
https://github.com/tensorflow/tensorflow/blob/master/tensorflow/core/example/feature.proto.
"""

import struct
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from readygo.common.kernels import compiled

_POLYNOMIAL = 0x82F63B78
_MASK = 0xA282EAD8
_BYTES, _FLOATS, _INTEGERS = 1, 2, 3
"""Field numbers of a Feature's kinds in protobuf."""

Value = npt.NDArray[np.generic] | Sequence[bytes]


def record(data: bytes) -> bytes:
    """One record of a TFRecord file."""
    length = struct.pack("<Q", len(data))
    return b"".join([length, struct.pack("<I", _masked(length)), data, struct.pack("<I", _masked(data))])


def example(features: Mapping[str, Value]) -> bytes:
    """The bytes of a `tf.train.Example`: floats as floats, other numbers and booleans as integers, or bytes."""
    entries = (_field(1, name.encode()) + _field(2, _feature(value)) for name, value in features.items())
    return _field(1, b"".join(_field(1, entry) for entry in entries))


def _feature(value: Value) -> bytes:
    if not isinstance(value, np.ndarray):
        return _field(_BYTES, b"".join(_field(1, item) for item in value))
    if np.issubdtype(value.dtype, np.floating):
        return _field(_FLOATS, _field(1, value.astype("<f4").tobytes()))
    return _field(_INTEGERS, _field(1, b"".join(map(_varint, value.reshape(-1).astype(np.int64).tolist()))))


def _field(number: int, data: bytes) -> bytes:
    """A length-delimited field of a protobuf message."""
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    value &= (1 << 64) - 1
    parts = bytearray()
    while value > 0x7F:
        parts.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*parts, value])


def _masked(data: bytes) -> int:
    # The compiled code returns 64 bits.
    crc32c = int(_crc32c(np.frombuffer(data, np.uint8), _table())) & 0xFFFFFFFF
    return ((crc32c >> 15 | crc32c << 17) + _MASK) & 0xFFFFFFFF


@cache
def _table() -> npt.NDArray[np.uint32]:
    rows = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        rows = np.where(rows & 1, rows >> 1 ^ np.uint32(_POLYNOMIAL), rows >> 1)
    return rows


@compiled
def _crc32c(data: npt.NDArray[np.uint8], table: npt.NDArray[np.uint32]) -> np.uint32:
    crc = np.uint32(0xFFFFFFFF)
    for byte in data:
        crc = table[(crc ^ byte) & np.uint32(0xFF)] ^ (crc >> np.uint32(8))
    return ~crc
