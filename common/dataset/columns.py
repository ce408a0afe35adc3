"""Bytes of many messages at once: a row is one message, a column has some bytes of every row.

The fields are those that the protobuf library writes: https://protobuf.dev/programming-guides/encoding.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from mcap.opcode import Opcode

from readygo.common.arrays import BoolArray, Float64Array, Int64Array, UInt8Array, UInt64Array
from readygo.common.dataset.records import MESSAGE_DTYPE, MESSAGE_FIELDS_SIZE
from readygo.common.dataset.schemas import NS_PER_S

_DOUBLE, _LENGTH = 1, 2
"""How a field is encoded, beside its number in its tag: eight bytes; a length, and so many bytes."""
_TAGGED_DOUBLE = np.dtype([("tag", "u1"), ("value", "<f8")])


@dataclass(frozen=True, eq=False)
class Column:
    """Some bytes of each of N rows: of `rows` those that are `there`, both of shape (N, W)."""

    rows: UInt8Array
    there: BoolArray

    @cached_property
    def sizes(self) -> Int64Array:
        """Bytes of each row, shape (N,)."""
        counts: Int64Array = np.count_nonzero(self.there, axis=1)
        return counts

    def where(self, mask: BoolArray | None) -> "Column":
        """The column with no bytes in the rows where `mask`, shape (N,), is False; None keeps all rows."""
        return self if mask is None else Column(self.rows, self.there & mask[:, None])


@dataclass(frozen=True, eq=False)
class Pieces:
    """The bytes of each row as they were made elsewhere, such as those of an image."""

    rows: Sequence[bytes]

    @cached_property
    def sizes(self) -> Int64Array:
        """Bytes of each row, shape (N,)."""
        return np.fromiter(map(len, self.rows), dtype=np.int64, count=len(self.rows))

    def where(self, mask: BoolArray | None) -> "Pieces":
        """The pieces with no bytes in the rows where `mask`, shape (N,), is False; None keeps all rows."""
        if mask is None:
            return self
        return Pieces([row if kept else b"" for row, kept in zip(self.rows, mask, strict=True)])


Part = Column | Pieces


def constant(content: bytes, count: int) -> Column:
    """A column with the same bytes in all of `count` rows."""
    rows = np.empty((count, len(content)), dtype=np.uint8)
    rows[:] = np.frombuffer(content, dtype=np.uint8)
    return _whole(rows)


def nothing(count: int) -> Column:
    """No bytes in any of `count` rows."""
    return Column(np.empty((count, 0), dtype=np.uint8), np.empty((count, 0), dtype=np.bool_))


def join_columns(*columns: Column) -> Column:
    """The bytes of columns one after the other."""
    rows, there = [column.rows for column in columns], [column.there for column in columns]
    return Column(np.concatenate(rows, axis=1), np.concatenate(there, axis=1))


def fold_rows(column: Column, count: int) -> Column:
    """`count` rows, each of them the bytes of as many of the column's rows one after the other."""
    return Column(column.rows.reshape(count, -1), column.there.reshape(count, -1))


def whole_numbers(number: int, values: UInt64Array) -> Column:
    """A field that is a whole number, shape (N,); nothing where it is zero."""
    return _encode_varints(number << 3, values).where(values != 0)


def flags(number: int, values: BoolArray) -> Column:
    """A field that is true or false, shape (N,); nothing where it is false."""
    return constant(bytes((number << 3, 1)), len(values)).where(values)


def doubles(number: int, *values: Float64Array) -> Column:
    """Fields from `number` on that are numbers, shape (N,) each; nothing where one is zero."""
    table = np.empty((len(values[0]), len(values)), dtype=_TAGGED_DOUBLE)
    table["tag"] = [field << 3 | _DOUBLE for field in range(number, number + len(values))]
    stacked = np.stack(values, axis=1)
    table["value"] = stacked
    # Minus zero, which has a bit, is written.
    there = np.repeat(stacked.view(np.uint64) != 0, _TAGGED_DOUBLE.itemsize, axis=1)
    return Column(table.view(np.uint8), there)


def field_head(number: int, *parts: Part) -> Column:
    """What goes before `parts` in a field that is a message or bytes made of them."""
    lengths = sizes_of(parts)
    return _encode_varints(number << 3 | _LENGTH, lengths.astype(np.uint64))


def field(number: int, content: Column) -> Column:
    """A field that is a message or bytes."""
    return join_columns(field_head(number, content), content)


def stamps(times_ns: UInt64Array) -> Column:
    """The first field of a message, with its time [ns], shape (N,)."""
    seconds, nanos = np.divmod(times_ns, np.uint64(NS_PER_S))
    return field(1, join_columns(whole_numbers(1, seconds), whole_numbers(2, nanos)))


def record_heads(channel: int, payload_sizes: Int64Array, times_ns: UInt64Array) -> Column:
    """What goes before the payloads in the records of messages 0, 1, 2, ... of a channel."""
    table = np.empty((len(times_ns), 1), dtype=MESSAGE_DTYPE)
    head = table[:, 0]
    head["opcode"], head["channel"] = Opcode.MESSAGE, channel
    head["length"] = MESSAGE_FIELDS_SIZE + payload_sizes
    head["sequence"] = np.arange(len(times_ns))
    head["log_time_ns"] = head["publish_time_ns"] = times_ns
    return _whole(table.view(np.uint8))


def sizes_of(parts: Iterable[Part]) -> Int64Array:
    """Bytes of each row in all `parts`, shape (N,)."""
    total, *others = [part.sizes for part in parts]
    for sizes in others:
        total = total + sizes
    return total


def bytes_of(parts: Sequence[Part]) -> list[bytes | memoryview]:
    """The bytes of all rows one after the other, each row's parts in their order; no piece is copied."""
    table = join_columns(nothing(len(parts[0].rows)), *[part for part in parts if isinstance(part, Column)])
    packed = table.rows[table.there].data
    pieces = [part for part in parts if isinstance(part, Pieces)]
    if not pieces:
        return [packed]
    sizes = np.stack([part.sizes if isinstance(part, Column) else np.zeros_like(part.sizes) for part in parts], axis=1)
    ends = sizes.cumsum().reshape(sizes.shape)
    cuts = ends[:, [isinstance(part, Pieces) for part in parts]].ravel().tolist()
    found: list[bytes | memoryview] = []
    begin = 0
    for cut, piece in zip(cuts, chain.from_iterable(zip(*[part.rows for part in pieces], strict=True)), strict=True):
        found += (packed[begin:cut], piece)
        begin = cut
    return [*found, packed[begin:]]


def rows_of(parts: Sequence[Part]) -> list[bytes]:
    """The bytes of each row."""
    together, ends = b"".join(bytes_of(parts)), sizes_of(parts).cumsum().tolist()
    return [together[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]


def _whole(rows: UInt8Array) -> Column:
    return Column(rows, np.ones(rows.shape, dtype=np.bool_))


def _encode_varints(tag: int, values: UInt64Array) -> Column:
    """A tag and whole numbers, seven bits to a byte, all of whose bytes but the last have their highest bit."""
    width = max(1, -(-int(values.max()).bit_length() // 7))
    rest = values[:, None] >> np.arange(0, 7 * width, 7, dtype=np.uint64)
    rows, there = np.empty((len(values), 1 + width), dtype=np.uint8), np.ones((len(values), 1 + width), dtype=np.bool_)
    there[:, 2:] = rest[:, 1:] != 0
    rows[:, 0], rows[:, 1:] = tag, rest & np.uint64(0x7F)
    rows[:, 1:-1] |= there[:, 2:].view(np.uint8) << 7
    return Column(rows, there)
