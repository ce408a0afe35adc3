"""What a JPEG says of its camera: the few EXIF entries that matter here."""

import math
import struct
from pathlib import Path

from readygo.common.files import open_regular

_ORIENTATION, _EXIF_BLOCK, _FOCAL_35MM = 0x0112, 0x8769, 0xA405
_SHORT, _LONG = 3, 4
_DIAGONAL_35MM = math.hypot(36.0, 24.0)


def read_exif(path: Path) -> dict[str, int]:
    """`orientation` (1-8) and `focal_35mm` [mm], as far as a file has them; empty for other than JPEG."""
    with open_regular(path) as stream:
        block = _exif_block(stream.read(1 << 17))
    if block is None:
        return {}
    try:
        order = {b"II": "<", b"MM": ">"}[block[:2]]
        entries = _entries(block, order, struct.unpack_from(order + "I", block, 4)[0])
        if _EXIF_BLOCK in entries:
            entries |= _entries(block, order, entries[_EXIF_BLOCK])
    except (KeyError, struct.error):
        return {}
    named = {"orientation": entries.get(_ORIENTATION, 0), "focal_35mm": entries.get(_FOCAL_35MM, 0)}
    return {name: value for name, value in named.items() if value > 0}


def focal_of_35mm(focal_35mm: float, width_px: int, height_px: int) -> float:
    """Focal length [px] of one that is given for film of 36 x 24 mm; CIPA goes by the diagonal."""
    return focal_35mm / _DIAGONAL_35MM * math.hypot(width_px, height_px)


def _exif_block(data: bytes) -> bytes | None:
    """The TIFF part of a JPEG's APP1 segment."""
    if data[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 10 <= len(data) and data[at] == 0xFF:
        kind, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if kind == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return data[at + 10 : at + 2 + length]
        if kind == 0xDA:
            return None
        at += 2 + length
    return None


def _entries(block: bytes, order: str, at: int) -> dict[int, int]:
    """Tags of a directory whose value is one whole number."""
    (count,) = struct.unpack_from(order + "H", block, at)
    found = {}
    for number in range(count):
        tag, kind, _ = struct.unpack_from(order + "HHI", block, at + 2 + 12 * number)
        if kind in (_SHORT, _LONG):
            (found[tag],) = struct.unpack_from(order + ("H" if kind == _SHORT else "I"), block, at + 10 + 12 * number)
    return found
