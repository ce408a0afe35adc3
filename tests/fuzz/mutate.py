"""Inputs that resemble valid ones: bytes are flipped, copied, cut and replaced, and texts, numbers and tables mutated.

Everything follows from the generator that is passed in.
"""

import gzip
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import msgpack
import numpy as np

Mutate = Callable[[bytes, "Dice"], bytes]

BYTES_MAX = 1 << 18
"""Inputs are not grown beyond this."""
_SIZES = (0, 1, 2, 4, 8)
_WHOLE = (
    0,
    1,
    2,
    127,
    128,
    255,
    256,
    2**15,
    2**16 - 1,
    2**24,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**40,
    2**63 - 1,
    2**64 - 1,
)
_TEXT = (
    b"0", b"-1", b"1e400", b"-1e308", b"1e-320", b"nan", b"inf", b"NaN", b"Infinity", b"9" * 30,
    b"9" * 5000, b"0x" + b"f" * 30,
    b"2147483648", b"9223372036854775808", b"1000000000000", b"true", b"null", b'""', b"[]", b"{}",
    b'"\\u0000"', b"1979-05-27",
)  # fmt: skip
_DEEP = (b"[" * 2000, b"{" * 2000, b"[" * 40 + b"]" * 40, b'{"a":' * 900, b"a." * 200, b"{a=" * 300, b"[[a]]\n" * 50)
_PIECES = (
    b"\xff",
    b"\xc3\x28",
    b"\x00",
    b"\xef\xbb\xbf",
    b"\r\n",
    b"\x1b[2J",
    "é".encode() * 50,
    b"../..",
    b"/dev/zero",
)
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 255, 2**31, 2**53, 2**63 - 1, -(2**63), 10**12, 0.0, -0.5, 1e-300, 1e300, "", "a",
    "\x00", "nan",
    "../../x", "é" * 100, [], {}, [[]], [0], [1e300] * 3, {"a": 1}, ["a"] * 3,
)  # fmt: skip


class Dice:
    """Small choices from one generator."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def below(self, end: int) -> int:
        """A whole number below `end`, which is at least 1."""
        return int(self.rng.integers(end))

    def one(self, choices: Sequence[Any]) -> Any:
        """One of some."""
        return choices[int(self.rng.integers(len(choices)))]

    def place(self, data: bytes) -> int:
        """An offset, in one of two cases within the first bytes, where headers are."""
        return self.below(min(len(data), 96) + 1 if self.below(2) else len(data) + 1)


def _flip(data: bytes, dice: Dice) -> bytes:
    changed = bytearray(data)
    for _ in range(1 + dice.below(4)):
        if changed:
            changed[min(dice.place(data), len(changed) - 1)] ^= 1 << dice.below(8)
    return bytes(changed)


def _set(data: bytes, dice: Dice) -> bytes:
    at = dice.place(data)
    return data[:at] + bytes([dice.one((0, 1, 0x7F, 0x80, 0xFF, dice.below(256)))]) + data[at + 1 :]


def _number(data: bytes, dice: Dice) -> bytes:
    """A number of 1, 2, 4 or 8 bytes becomes another one: lengths, counts, offsets."""
    size, at = 1 << dice.below(4), dice.place(data)
    if dice.below(2):
        at -= at % size
    old = int.from_bytes(data[at : at + size], "little")
    new = dice.one((*_WHOLE, old + 1, old - 1, old * 2, old * 1000, len(data), len(data) - at)) % (1 << 8 * size)
    return data[:at] + new.to_bytes(size, dice.one(("little", "little", "big"))) + data[at + size :]


def _float(data: bytes, dice: Dice) -> bytes:
    at, form = dice.place(data), dice.one(("<f", "<d"))
    value = dice.one((float("nan"), float("inf"), -float("inf"), 1e38, -1e30, 1e-40, 0.0))
    packed = struct.pack(form, value)
    return data[:at] + packed + data[at + len(packed) :]


def _copy(data: bytes, dice: Dice) -> bytes:
    begin, size, at = dice.place(data), dice.below(64) + 1, dice.place(data)
    return data[:at] + data[begin : begin + size] * (1 + dice.below(4)) + data[at:]


def _cut(data: bytes, dice: Dice) -> bytes:
    at = dice.place(data)
    return data[:at] if dice.below(2) else data[:at] + data[at + 1 + dice.below(32) :]


def _insert(data: bytes, dice: Dice) -> bytes:
    at = dice.place(data)
    return data[:at] + dice.one((bytes(dice.below(64)), dice.rng.bytes(dice.below(32) + 1), b"\xff" * 8)) + data[at:]


def _splice(data: bytes, dice: Dice) -> bytes:
    return data[: dice.place(data)] + data[dice.place(data) :]


_BINARY = (_flip, _flip, _set, _number, _number, _float, _copy, _cut, _insert, _splice)


def binary(data: bytes, dice: Dice) -> bytes:
    """Bytes, one to three times changed."""
    for _ in range(dice.one((1, 1, 1, 2, 3))):
        data = dice.one(_BINARY)(data, dice)
    return data[:BYTES_MAX]


def text(data: bytes, dice: Dice) -> bytes:
    """Text of any kind: values, lines and nesting; in one of eight cases plain bytes."""
    for _ in range(dice.one((1, 1, 2, 3))):
        data = _changed_text(data, dice)
    return data[:BYTES_MAX]


def _changed_text(data: bytes, dice: Dice) -> bytes:
    match dice.below(8):
        case 0:
            return binary(data, dice)
        case 1 | 2:
            return _with_value(data, dice, dice.one(_TEXT))
        case 3:
            return _with_value(data, dice, dice.one((*_DEEP, *_PIECES)))
        case 4:
            at = dice.place(data)
            return data[:at] + dice.one((*_DEEP, *_PIECES, *_TEXT)) + data[at:]
        case _:
            lines = data.split(b"\n")
            k = dice.below(len(lines))
            which = dice.below(4)
            if which == 0:
                del lines[k]
            elif which == 1:
                lines.insert(dice.below(len(lines) + 1), lines[k])
            elif which == 2:
                lines[k] = binary(lines[k], dice)
            else:
                lines[k], other = lines[dice.below(len(lines))], lines[k]
                lines.append(other)
            return b"\n".join(lines)


def _with_value(data: bytes, dice: Dice, value: bytes) -> bytes:
    """One value, what stands between a sign such as = and the next one, becomes another."""
    ends = [at for at, byte in enumerate(data) if byte in b"=:,[]{}\n ()"]
    if len(ends) < 2:
        return value
    k = dice.below(len(ends) - 1)
    return data[: ends[k] + 1] + value + data[ends[k + 1] :]


def tree(value: Any, dice: Dice) -> Any:
    """A plain value (of JSON or MessagePack) with one node changed, removed, repeated or nested."""
    if isinstance(value, (dict, list)) and value and dice.below(8):
        changed: Any = dict(value) if isinstance(value, dict) else list(value)
        key = dice.one(list(changed)) if isinstance(changed, dict) else dice.below(len(changed))
        match dice.below(10):
            case 0:
                del changed[key]
            case 1 if isinstance(changed, list):
                changed.extend([changed[key]] * (1 + dice.below(3)))
            case 1:
                changed[dice.one(("a", "", "\x00", "extensions", "count"))] = changed[key]
            case 2 | 3:
                changed[key] = _other(changed[key], dice)
            case _:
                changed[key] = tree(changed[key], dice)
        return changed
    return _other(value, dice)


def _other(value: Any, dice: Dice) -> Any:
    if type(value) in (int, float) and dice.below(2):
        return dice.one(
            (value + 1, -value, value * 1000, value * 10**9, int(value) if abs(value) < 1e18 else 0, value - 1)
        )
    if dice.below(24) == 0:
        nested: Any = value
        for _ in range(dice.one((5, 40, 500))):
            nested = [nested] if dice.below(2) else {"a": nested}
        return nested
    return dice.one(_VALUES)


def json_text(data: bytes, dice: Dice) -> bytes:
    """JSON: half of the inputs stay JSON."""
    if dice.below(2):
        return text(data, dice)
    try:
        value = json.loads(data)
        for _ in range(1 + dice.below(3)):
            value = tree(value, dice)
        return json.dumps(value).encode()[:BYTES_MAX]
    except (ValueError, OverflowError, RecursionError):
        # It has become what JSON cannot hold.
        return text(data, dice)


def message_pack(data: bytes, dice: Dice) -> bytes:
    """MessagePack: half of the inputs stay such."""
    if dice.below(2):
        return binary(data, dice)
    try:
        value = msgpack.unpackb(data, strict_map_key=False)
        for _ in range(1 + dice.below(3)):
            value = tree(value, dice)
        return bytes(msgpack.packb(value))[:BYTES_MAX]
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException):
        return binary(data, dice)


def zipped(inner: Mutate) -> Mutate:
    """An archive: in two of three cases one file in it is mutated and packed again, with the right checksum."""

    def mutate(data: bytes, dice: Dice) -> bytes:
        if not dice.below(3):
            return binary(data, dice)
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files = [(name, archive.read(name)) for name in archive.namelist()]
        k = dice.below(len(files))
        name, content = files[k]
        match dice.below(8):
            case 0:
                del files[k]
            case 1:
                files.append((name, inner(content, dice)))
            case 2:
                files[k] = (dice.one([other for other, _ in files]), content)
            case _:
                files[k] = (name, inner(content, dice))
        kept = io.BytesIO()
        kind = dice.one((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
        with zipfile.ZipFile(kept, "w", kind) as archive:
            for name, content in {name: content for name, content in files}.items():
                archive.writestr(name, content)
        return kept.getvalue()

    return mutate


def npy(data: bytes, dice: Dice) -> bytes:
    """A file of one array: its header is text."""
    if not dice.below(3) or data[:6] != b"\x93NUMPY":
        return binary(data, dice)
    size = int.from_bytes(data[8:10], "little")
    header, body = data[10 : 10 + size], data[10 + size :]
    dtypes = (
        b"'m8[s/0]'",
        b"'|O'",
        b"'<f8'",
        b"'<U9'",
        b"'|V0'",
        b"'>i4'",
        b"'M8[ns]'",
        b"'<c16'",
        b"[('a', '<f4')]",
        b"'{'",
    )
    match dice.below(5):
        case 0:
            header = header.replace(header.split(b", 'fortran")[0].split(b": ")[-1], dice.one(dtypes))
        case 1:
            shapes = (
                b"(0,)",
                b"(1000000000000,)",
                b"(-1,)",
                b"(2147483648, 2147483648)",
                b"()",
                b"(1" + b",1" * 70 + b")",
            )
            header = header.split(b"'shape'")[0] + b"'shape': " + dice.one(shapes) + b", }\n"
        case 2:
            header = text(header, dice)
        case _:
            body = binary(body, dice)
    return data[:8] + (len(header) % 2**16).to_bytes(2, "little") + header + body


def glb(data: bytes, dice: Dice) -> bytes:
    """A .glb: its JSON is mutated in three of four cases, and its lengths fit then."""
    if not dice.below(4):
        return binary(data, dice)
    size = int.from_bytes(data[12:16], "little")
    document, rest = json_text(data[20 : 20 + size].rstrip(b" "), dice), data[20 + size :]
    document += b" " * (-len(document) % 4)
    return data[:12] + struct.pack("<I4s", len(document), b"JSON") + document + rest


def gzipped(data: bytes, dice: Dice) -> bytes:
    """Something in gzip."""
    if data[:2] != b"\x1f\x8b" or not dice.below(3):
        return binary(data, dice)
    return gzip.compress(binary(gzip.decompress(data), dice), 1)


def png(data: bytes, dice: Dice) -> bytes:
    """A PNG whose pieces have the right checksums in half of the cases."""
    changed = binary(data, dice)
    if data[:4] != b"\x89PNG" or dice.below(2):
        return changed
    fixed, at = bytearray(changed), 8
    while at + 12 <= len(fixed):
        size = int.from_bytes(fixed[at : at + 4], "big")
        if at + 12 + size > len(fixed):
            break
        fixed[at + 8 + size : at + 12 + size] = zlib.crc32(fixed[at + 4 : at + 8 + size]).to_bytes(4, "big")
        at += 12 + size
    return bytes(fixed)


def mcap(data: bytes, dice: Dice) -> bytes:
    """An MCAP file whose chunks have the right checksums in half of the cases."""
    changed = bytearray(binary(data, dice))
    if dice.below(2):
        return bytes(changed)
    at = 8
    while at + 9 <= len(changed):
        kind, size = changed[at], int.from_bytes(changed[at + 1 : at + 9], "little")
        if at + 9 + size > len(changed):
            break
        if kind == 6 and size > 40:
            body = at + 9 + 40 + int.from_bytes(changed[at + 37 : at + 41], "little")
            changed[at + 33 : at + 37] = zlib.crc32(changed[body : at + 9 + size]).to_bytes(4, "little")
        at += 9 + size
    return bytes(changed)


def lines_of_http(data: bytes, dice: Dice) -> bytes:
    """The head of a request: its values are addresses and cookies."""
    lines = data.split(b"\r\n")
    for _ in range(1 + dice.below(2)):
        k = dice.below(len(lines))
        pieces = (
            b"[::1",
            b"]",
            b"//",
            b"[",
            b"http://[",
            b"%00",
            b"\xff",
            b"token=",
            b"?token=x",
            b":99999",
            b"@",
            b"\\",
            b"\x00",
            b"a" * 300,
        )
        at = dice.below(len(lines[k]) + 1)
        lines[k] = lines[k][:at] + dice.one(pieces) + lines[k][at + dice.below(4) :]
    changed = b"\r\n".join(lines)
    return binary(changed, dice) if not dice.below(4) else changed
