import cv2
import numpy as np
import pytest

from readygo.common.drawing.files import jpeg_bytes, png_bytes, quantise, write_png
from readygo.common.errors import ReadygoError

RED_LEFT = np.zeros((16, 32, 3), np.uint8)
RED_LEFT[:, :16] = (220, 30, 10)


def read(data):
    """Pixels of an encoded picture, RGB."""
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]


def test_colours_are_rounded_and_clipped():
    planes = np.array([-0.5, 0.5, 2.0], dtype=np.float32).reshape(3, 1, 1)
    np.testing.assert_array_equal(quantise(planes), [[[0, 128, 255]]])


def test_png_holds_the_very_pixels():
    data = png_bytes(RED_LEFT)
    assert data.startswith(b"\x89PNG")
    assert np.array_equal(read(data), RED_LEFT)


def test_jpeg_holds_about_the_pixels():
    data = jpeg_bytes(RED_LEFT)
    assert data.startswith(b"\xff\xd8")
    assert np.abs(read(data).astype(int) - RED_LEFT)[:, [4, 28]].max() < 8


def test_turned_picture_is_written_as_it_looks(tmp_path):
    write_png(tmp_path / "new" / "folder" / "a.png", RED_LEFT[:, ::-1])
    assert np.array_equal(read((tmp_path / "new" / "folder" / "a.png").read_bytes()), RED_LEFT[:, ::-1])


def test_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ReadygoError, match=r"a\.png"):
        write_png(tmp_path / "file" / "a.png", RED_LEFT)
