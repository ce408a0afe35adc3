import zlib

import cv2
import numpy as np
import pytest

from common.rasterizer.png import encode_png

RNG = np.random.default_rng(0)


def decoded(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    return image[..., ::-1] if image.ndim == 3 else image


def noise(dtype: type, *shape: int) -> np.ndarray:
    return RNG.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)


@pytest.mark.parametrize(
    "pixels",
    [
        noise(np.uint16, 17, 33),
        noise(np.uint8, 9, 7),
        noise(np.uint8, 9, 7, 3),
        noise(np.uint16, 5, 6, 3),
        noise(np.uint16, 1, 1),
        noise(np.uint16, 1, 300),
        noise(np.uint8, 300, 1),
        np.zeros((6, 5), np.uint16),
        np.full((144, 256), 65535, np.uint16),
        np.arange(65536, dtype=np.uint16).reshape(256, 256),
        np.add.outer(np.arange(0, 9000, 30), np.arange(400)).astype(np.uint16),
        noise(np.uint16, 20, 30)[::2, ::3],
    ],
    ids=lambda pixels: f"{pixels.dtype}-{'x'.join(map(str, pixels.shape))}",
)
def test_other_readers_find_every_pixel(pixels: np.ndarray) -> None:
    back = decoded(encode_png(pixels))
    assert back.dtype == pixels.dtype
    np.testing.assert_array_equal(back, pixels)


def test_every_prediction_error_has_a_code() -> None:
    # Steps of every size, up and down, in both bytes.
    steps = np.concatenate([[0, size, 0, 65535 - size] for size in range(0, 65536, 97)]).astype(np.uint16)
    pixels = np.resize(steps, (64, 44))
    np.testing.assert_array_equal(decoded(encode_png(pixels)), pixels)


def test_checksums_are_those_that_strict_readers_demand() -> None:
    data = encode_png(noise(np.uint16, 12, 13))
    offset, names = 8, []
    while offset < len(data):
        length = int.from_bytes(data[offset : offset + 4], "big")
        body = data[offset + 4 : offset + 8 + length]
        assert int.from_bytes(data[offset + 8 + length : offset + 12 + length], "big") == zlib.crc32(body)
        names.append(body[:4])
        if body[:4] == b"IDAT":
            # zlib refuses a wrong Adler-32, an incomplete code and bytes that are left over.
            stream = zlib.decompressobj()
            assert len(stream.decompress(body[4:])) == 12 * 27
            assert stream.eof
            assert stream.unused_data == b""
        offset += 12 + length
    assert names == [b"IHDR", b"IDAT", b"IEND"]


def test_surfaces_become_small() -> None:
    y, x = np.mgrid[0:144, 0:256]
    depth_mm = (2000 + 3 * y + 5 * x + RNG.integers(-2, 3, y.shape)).astype(np.uint16)
    assert len(encode_png(depth_mm)) < 0.45 * depth_mm.nbytes


@pytest.mark.parametrize(
    "pixels",
    [np.zeros((4, 4), np.float32), np.zeros((4, 4, 2), np.uint8), np.zeros(4, np.uint8)],
    ids=["float", "two channels", "row"],
)
def test_what_is_no_image_is_refused(pixels: np.ndarray) -> None:
    with pytest.raises(ValueError, match="pixels must be uint8 or uint16"):
        encode_png(pixels)
