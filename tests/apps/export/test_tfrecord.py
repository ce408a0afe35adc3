import struct

import numpy as np
import pytest

from readygo.apps.export.tfrecord import example, record


def test_checksums_are_those_of_the_published_format() -> None:
    """CRC-32C of "123456789" is 0xE3069283 (RFC 3720); it is rotated by 15 bits and shifted by 0xA282EAD8."""
    data = b"123456789"
    written = record(data)
    assert struct.unpack("<Q", written[:8]) == (9,)
    assert written[12:21] == data
    masked = ((0xE3069283 >> 15 | 0xE3069283 << 17) + 0xA282EAD8) & 0xFFFFFFFF
    assert struct.unpack("<I", written[21:]) == (masked,)


@pytest.mark.parametrize("value", [0, 1, 300, -1, 2**62])
def test_integers_are_varints(value: int) -> None:
    data = example({"a": np.array([value])})
    unsigned, found, shift = value % 2**64, 0, 0
    for byte in data[data.index(b"\x1a") + 4 :]:
        found |= (byte & 0x7F) << shift
        shift += 7
    assert found == unsigned


def test_known_message_has_known_bytes() -> None:
    """Example{features{feature{key: "x" value{float_list{value: [1.0]}}}}}."""
    assert example({"x": np.array([1.0])}).hex() == "0a0f0a0d0a0178120812060a040000803f"
    assert example({"x": [b"ab"]}).hex() == "0a0d0a0b0a017812060a040a026162"
