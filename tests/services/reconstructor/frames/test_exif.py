import struct
from pathlib import Path

import pytest

from readygo.services.reconstructor.frames.exif import focal_of_35mm, read_exif


def exif(order: str, orientation: int, focal_35mm: int) -> bytes:
    """A JPEG's beginning with these two entries."""
    tiff = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8)
    tiff += struct.pack(order + "H", 2) + struct.pack(order + "HHIHH", 0x0112, 3, 1, orientation, 0)
    tiff += struct.pack(order + "HHII", 0x8769, 4, 1, 38) + struct.pack(order + "I", 0)
    tiff += struct.pack(order + "H", 1) + struct.pack(order + "HHIHH", 0xA405, 3, 1, focal_35mm, 0)
    return b"\xff\xd8\xff\xe1" + struct.pack(">H", len(tiff) + 8) + b"Exif\0\0" + tiff


@pytest.mark.parametrize("order", "<>")
def test_orientation_and_focal_length_are_read(tmp_path: Path, order: str) -> None:
    (tmp_path / "a.jpg").write_bytes(exif(order, 6, 26))
    assert read_exif(tmp_path / "a.jpg") == {"orientation": 6, "focal_35mm": 26}


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n", exif("<", 6, 26)[:30], b"\xff\xd8\xff\xda\0\0\0\0\0\0\0\0\0"])
def test_files_without_it_have_none(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.jpg").write_bytes(data)
    assert read_exif(tmp_path / "a.jpg") == {}


def test_focal_length_goes_by_the_diagonal() -> None:
    assert abs(focal_of_35mm(43.266615, 300, 400) - 500) < 1e-3
