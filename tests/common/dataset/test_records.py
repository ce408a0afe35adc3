import struct
import zlib

import pytest
from mcap.opcode import Opcode

from readygo.common.dataset.records import (
    CHUNK_FIELDS,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    chunk_span,
    field_span,
    is_intact,
    iter_messages,
    iter_records,
    joined_crc32,
)
from readygo.common.errors import DatasetError


def record(opcode: int, body: bytes) -> bytes:
    return RECORD_HEADER.pack(opcode, len(body)) + body


def message(channel: int, sequence: int, payload: bytes) -> bytes:
    return MESSAGE_HEADER.pack(Opcode.MESSAGE, 22 + len(payload), channel, sequence, 7, 8) + payload


def chunk(data: bytes, *, size: int | None = None, compression: bytes = b"") -> bytes:
    fields = CHUNK_FIELDS.pack(1, 9, len(data) if size is None else size, zlib.crc32(data))
    name = struct.pack("<I", len(compression)) + compression
    return record(Opcode.CHUNK, fields + name + struct.pack("<Q", len(data)) + data)


MESSAGES = message(3, 0, b"first") + record(Opcode.CHANNEL, b"x" * 30) + message(4, 1, b"second")
FILE = MAGIC + record(Opcode.HEADER, b"abc") + chunk(MESSAGES) + record(Opcode.FOOTER, bytes(20)) + MAGIC


def the_chunk(data: bytes):
    view = memoryview(MAGIC + data + record(Opcode.FOOTER, b""))
    return view, chunk_span(view, next(iter_records(view)))


def test_records_are_found_up_to_the_footer() -> None:
    view = memoryview(FILE)
    found = list(iter_records(view))
    assert [one.opcode for one in found] == [Opcode.HEADER, Opcode.CHUNK, Opcode.FOOTER]
    assert found[0].offset == len(MAGIC)
    assert bytes(view[found[0].body : found[0].end]) == b"abc"
    assert found[-1].end == len(FILE) - len(MAGIC)


@pytest.mark.parametrize(
    ("cut", "message"),
    [(len(MAGIC) + 20 + 9, "without a footer"), (len(MAGIC) + 1, "is cut off or damaged"), (60, "is cut off or dam")],
)
def test_cut_off_file_is_refused_with_the_place(cut: int, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        list(iter_records(memoryview(FILE[:-cut])))


def test_chunk_shows_its_times_and_its_data() -> None:
    view, span = the_chunk(chunk(MESSAGES))
    assert (span.start_time_ns, span.end_time_ns) == (1, 9)
    assert bytes(view[span.body : span.end]) == MESSAGES
    assert is_intact(view, span)


def test_flipped_bit_of_a_chunk_is_noticed() -> None:
    view, span = the_chunk(chunk(MESSAGES))
    damaged = bytearray(view)
    damaged[span.body + 3] ^= 1
    assert not is_intact(memoryview(damaged), span)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (chunk(MESSAGES, compression=b"zstd"), "is compressed; shards are not"),
        (chunk(MESSAGES, size=len(MESSAGES) + 1), "has contradicting lengths"),
        (record(Opcode.CHUNK, b"short"), "is too short"),
    ],
    ids=["compressed", "lengths", "short"],
)
def test_odd_chunk_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        the_chunk(data)


def test_messages_of_a_chunk_are_found_among_other_records() -> None:
    view = memoryview(MESSAGES)
    first, second = iter_messages(view, 0, len(view))
    assert (first.channel, first.sequence, first.log_time_ns, first.publish_time_ns) == (3, 0, 7, 8)
    assert [bytes(view[one.body : one.end]) for one in (first, second)] == [b"first", b"second"]
    assert second.offset == len(MESSAGES) - MESSAGE_HEADER.size - len(b"second")


@pytest.mark.parametrize("cut", [1, len(b"second") + 5, len(b"second") + 25])
def test_cut_off_message_is_refused(cut: int) -> None:
    view = memoryview(MESSAGES)
    with pytest.raises(DatasetError, match="is cut off"):
        list(iter_messages(view, 0, len(view) - cut))


def test_field_of_a_protobuf_message_is_found_behind_others() -> None:
    # Field 1: varint 300; field 2: fixed 32 bits; field 3: fixed 64 bits; field 4: 200 bytes; field 5: 2 bytes.
    view = memoryview(b"\x08\xac\x02" + b"\x15abcd" + b"\x19abcdefgh" + b"\x22\xc8\x01" + b"x" * 200 + b"\x2a\x02yz")
    offset, length = field_span(view, 0, len(view), 4)
    assert bytes(view[offset : offset + length]) == b"x" * 200
    offset, length = field_span(view, 0, len(view), 5)
    assert bytes(view[offset : offset + length]) == b"yz"
    assert field_span(view, 0, len(view), 6) == (len(view), 0)


@pytest.mark.parametrize("data", [b"\x2a\x05yz", b"\x0b\x00", b"\x08" + b"\xff" * 12, b"\x15ab"])
def test_bytes_that_are_no_protobuf_message_are_refused(data: bytes) -> None:
    with pytest.raises(DatasetError, match="no protobuf message"):
        field_span(memoryview(data), 0, len(data), 5)


@pytest.mark.parametrize("first", [b"", b"abc", b"q" * 1000])
@pytest.mark.parametrize("second", [b"", b"x", b"w" * 123_457])
def test_crc32_of_two_pieces_is_that_of_both_together(first: bytes, second: bytes) -> None:
    assert joined_crc32(zlib.crc32(first), zlib.crc32(second), len(second)) == zlib.crc32(first + second)
