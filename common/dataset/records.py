"""MCAP records at the byte level: offsets, checksums and nothing decoded.

The mcap package's readers stop at the first damaged byte and give no file offsets; salvage, index and validation need
both. Source of the layout: the MCAP file format specification, https://mcap.dev/spec.
"""

import functools
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from readygo.common.errors import DatasetError

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")
MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time [ns], publish time [ns]; the payload follows."""
MESSAGE_DTYPE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time_ns", "<u8"),
        ("publish_time_ns", "<u8"),
    ]
)
"""`MESSAGE_HEADER` of many messages."""
MESSAGE_FIELDS_SIZE = MESSAGE_HEADER.size - RECORD_HEADER.size
CHUNK_FIELDS = struct.Struct("<QQQI")
"""First time [ns], last time [ns], uncompressed size, CRC-32; compression and data follow, each with its length."""


@dataclass(frozen=True, slots=True)
class Record:
    """A record's place in a buffer."""

    opcode: int
    offset: int
    """Where the record begins, opcode and length included."""
    body: int
    end: int


@dataclass(frozen=True, slots=True)
class Message:
    """A message record's header and the place of its payload in a buffer."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    offset: int
    """Where the record begins."""
    body: int
    end: int


@dataclass(frozen=True, slots=True)
class ChunkSpan:
    """A chunk record's header and the place of its uncompressed records in a buffer."""

    start_time_ns: int
    end_time_ns: int
    crc32: int
    body: int
    end: int


def iter_records(buffer: memoryview) -> Iterator[Record]:
    """The records of an MCAP file up to and including the footer.

    Raises:
        DatasetError: If a record is cut off.
    """
    offset, size = len(MAGIC), len(buffer)
    while True:
        if offset + RECORD_HEADER.size > size:
            raise DatasetError(f"the file ends at byte {size} without a footer")
        opcode, length = RECORD_HEADER.unpack_from(buffer, offset)
        body = offset + RECORD_HEADER.size
        if opcode == 0 or body + length > size:
            raise DatasetError(f"the record at byte {offset} is cut off or damaged")
        yield Record(opcode, offset, body, body + length)
        if opcode == Opcode.FOOTER:
            return
        offset = body + length


def chunk_span(buffer: memoryview, record: Record) -> ChunkSpan:
    """Where a chunk's records are.

    Raises:
        DatasetError: If the chunk is compressed or its lengths contradict each other.
    """
    if record.end - record.body < CHUNK_FIELDS.size + 12:
        raise DatasetError(f"the chunk at byte {record.offset} is too short")
    start_ns, end_ns, size, crc32 = CHUNK_FIELDS.unpack_from(buffer, record.body)
    offset = record.body + CHUNK_FIELDS.size
    (name_length,) = struct.unpack_from("<I", buffer, offset)
    if name_length:
        raise DatasetError(f"the chunk at byte {record.offset} is compressed; shards are not")
    (stored,) = struct.unpack_from("<Q", buffer, offset + 4)
    body = offset + 12
    if stored != size or body + stored != record.end:
        raise DatasetError(f"the chunk at byte {record.offset} has contradicting lengths")
    return ChunkSpan(start_ns, end_ns, crc32, body, record.end)


def chunk_spans(buffer: memoryview) -> Iterator[ChunkSpan]:
    """Where the records of each chunk of an MCAP file are.

    Raises:
        DatasetError: If a record is cut off, or as `chunk_span`.
    """
    return (chunk_span(buffer, record) for record in iter_records(buffer) if record.opcode == Opcode.CHUNK)


def is_intact(buffer: memoryview, chunk: ChunkSpan) -> bool:
    """True if the chunk's bytes match its CRC-32."""
    return zlib.crc32(buffer[chunk.body : chunk.end]) == chunk.crc32


def iter_messages(buffer: memoryview, body: int, end: int) -> Iterator[Message]:
    """The messages among a chunk's records.

    Raises:
        DatasetError: If a record is cut off.
    """
    offset = body
    while offset < end:
        if offset + RECORD_HEADER.size > end:
            raise DatasetError(f"the record at byte {offset} is cut off")
        opcode, length = RECORD_HEADER.unpack_from(buffer, offset)
        record_end = offset + RECORD_HEADER.size + length
        if record_end > end or (opcode == Opcode.MESSAGE and length < MESSAGE_FIELDS_SIZE):
            raise DatasetError(f"the record at byte {offset} is cut off or damaged")
        if opcode == Opcode.MESSAGE:
            _, _, channel, sequence, log_ns, publish_ns = MESSAGE_HEADER.unpack_from(buffer, offset)
            yield Message(channel, sequence, log_ns, publish_ns, offset, offset + MESSAGE_HEADER.size, record_end)
        offset = record_end


def field_span(buffer: memoryview, body: int, end: int, number: int) -> tuple[int, int]:
    """Offset and length of a length-delimited field of a protobuf message, (end, 0) when it is absent.

    Raises:
        DatasetError: If the bytes are no protobuf message.
    """
    offset = body
    while offset < end:
        tag, offset = _varint(buffer, offset, end)
        wire = tag & 7
        length = {1: 8, 5: 4}.get(wire, 0)
        if wire == 0:
            _, offset = _varint(buffer, offset, end)
        elif wire == 2:
            length, offset = _varint(buffer, offset, end)
            if tag >> 3 == number and offset + length <= end:
                return offset, length
        elif wire not in (1, 5):
            break
        offset += length
    if offset != end:
        raise DatasetError(f"the message at byte {body} is no protobuf message")
    return end, 0


def _varint(buffer: memoryview, offset: int, end: int) -> tuple[int, int]:
    value = shift = 0
    while offset < end and shift < 64:
        byte = buffer[offset]
        offset += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, offset
        shift += 7
    raise DatasetError(f"the message before byte {offset} is no protobuf message")


_CRC32_POLYNOMIAL = 0xEDB88320
_CRC32_ONE = 1 << 31
"""The polynomial 1: the highest bit is the lowest power."""


def joined_crc32(first: int, second: int, second_size: int) -> int:
    """CRC-32 of two pieces of bytes one after the other, of their CRC-32s and the size of the second one.

    Source: crc32_combine of zlib, https://github.com/madler/zlib/blob/v1.3.1/crc32.c.
    """
    for bit in range(second_size.bit_length()):
        if second_size >> bit & 1:
            first = _crc32_product(_crc32_shift(bit), first)
    return first ^ second


@functools.cache
def _crc32_shift(bit: int) -> int:
    """What 2 ** bit bytes of zeros multiply a CRC-32 by."""
    if bit == 0:
        return _CRC32_ONE >> 8
    half = _crc32_shift(bit - 1)
    return _crc32_product(half, half)


def _crc32_product(a: int, b: int) -> int:
    """Product of two polynomials modulo that of CRC-32."""
    product = 0
    while a:
        if a & _CRC32_ONE:
            product ^= b
        a = a << 1 & 0xFFFFFFFF
        b = b >> 1 ^ (_CRC32_POLYNOMIAL if b & 1 else 0)
    return product
