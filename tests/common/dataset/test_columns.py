"""Fields of many messages at once, beside those of the protobuf library."""

import math

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from readygo.common.dataset import columns, schemas
from readygo.common.dataset.columns import Pieces
from readygo.common.dataset.records import iter_messages

NUMBERS = (0.0, -0.0, 1.5, -2.5, math.inf, math.nan, 5e-324)
WHOLE = (0, 1, 127, 128, 16_383, 16_384, 2**40, 2**64 - 1)


@pytest.mark.parametrize("times_ns", [[0], [0, 1, 999_999_999, 10**9, 127 * 10**9 + 50_000_000, 128 * 10**9, 2**63]])
def test_times_are_those_of_the_library(times_ns: list[int]) -> None:
    stamps = columns.stamps(np.array(times_ns, dtype=np.uint64))
    want = [schemas.serialize(CompressedImage(timestamp=schemas.timestamp(time_ns))) for time_ns in times_ns]
    assert columns.rows_of([stamps]) == want


def test_numbers_are_those_of_the_library() -> None:
    points = np.array([(x, y, z) for x in NUMBERS for y in NUMBERS for z in NUMBERS])
    want = [schemas.serialize(Vector3(x=x, y=y, z=z)) for x, y, z in points.tolist()]
    assert columns.rows_of([columns.doubles(1, *points.T)]) == want


@pytest.mark.parametrize("values", [WHOLE, (0,), (0, 0)])
def test_whole_numbers_are_those_of_the_library(values: tuple[int, ...]) -> None:
    found = columns.whole_numbers(2, np.array(values, dtype=np.uint64))
    assert columns.rows_of([found]) == [
        schemas.serialize(schemas.EPISODE_START.message(seed=value)) for value in values
    ]


def test_what_is_true_is_written_and_what_is_false_is_not() -> None:
    found = columns.flags(3, np.array([True, False]))
    assert columns.rows_of([found]) == [schemas.serialize(schemas.TRUTH.message(human_visible=v)) for v in (1, 0)]


@pytest.mark.parametrize("size", [0, 5, 127, 128, 20_000])
def test_fields_have_their_length_before_them(size: int) -> None:
    images = Pieces([b"x" * size, b"y"])
    rows = columns.rows_of([columns.field_head(2, images).where(images.sizes > 0), images])
    assert rows == [schemas.serialize(CompressedImage(data=image)) for image in images.rows]


def test_rows_that_are_left_out_have_no_bytes() -> None:
    some = np.array([True, False])
    parts = (columns.constant(b"ab", 2).where(some), Pieces([b"c", b"d"]).where(some), columns.nothing(2))
    assert columns.rows_of(parts) == [b"abc", b""]
    assert columns.sizes_of(parts).tolist() == [3, 0]


def test_rows_follow_each_other_with_their_parts_in_order() -> None:
    images = Pieces([b"first", b"", b"third"])
    parts = [columns.constant(b"<", 3), images, columns.constant(b"|", 3), images, columns.constant(b">", 3)]
    found = columns.bytes_of(parts)
    assert b"".join(found) == b"<first|first><|><third|third>"
    assert any(piece is images.rows[0] for piece in found), "images are not copied"


def test_folded_rows_are_put_together() -> None:
    column = columns.whole_numbers(1, np.array([1, 0, 3, 4], dtype=np.uint64))
    assert columns.rows_of([columns.fold_rows(column, 2)]) == [b"\x08\x01", b"\x08\x03\x08\x04"]


def test_heads_of_records_are_those_of_a_chunk() -> None:
    payloads = Pieces([b"abc", b""])
    heads = columns.record_heads(7, payloads.sizes, np.array([5, 9], dtype=np.uint64))
    data = memoryview(b"".join(columns.bytes_of([heads, payloads])))
    found = [
        (m.channel, m.sequence, m.log_time_ns, m.publish_time_ns, bytes(data[m.body : m.end]))
        for m in iter_messages(data, 0, len(data))
    ]
    assert found == [(7, 0, 5, 5, b"abc"), (7, 1, 9, 9, b"")]
