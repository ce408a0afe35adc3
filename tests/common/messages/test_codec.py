import dataclasses
import enum
import hashlib
import math
import tracemalloc
import types
import typing
from collections.abc import Mapping

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from readygo.common.arrays import AnyArray, Float32Array
from readygo.common.errors import MessageError
from readygo.common.messages import (
    AppendRequest,
    Blob,
    ClaimReply,
    ClaimRequest,
    EpisodeMotions,
    HumanMotion,
    Motion,
    RenewRequest,
    RobotPlanRequest,
    Scenario,
    codec,
    decode,
    encode,
)
from readygo.common.messages.codec import ITEMS_MAX, MESSAGE_BYTES_MAX
from readygo.common.messages.samples import HumanLabels
from tests.common.messages.examples import MESSAGES, header, message, sample


def _plain(value: typing.Any) -> typing.Any:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.tolist()
    if dataclasses.is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    return [_plain(item) for item in value] if isinstance(value, (tuple, list)) else value


@pytest.mark.parametrize("cls", MESSAGES, ids=lambda cls: cls.__name__)
def test_every_message_round_trips(cls: type) -> None:
    one = message(cls)
    assert _plain(decode(cls, encode(one))) == _plain(one)


OLD_DIGEST = "d5622e95c6c006518bface14e4fb73ba1b0a132ecee91b14784b3e8e1dd2efc7"
"""Of an append whose messages had neither outputs nor distortion nor labels yet."""
LABELS_DIGEST = "6849e2472c6eb5428766d83d6fa038fd5528e54a4e1849a9cce5981f8839c5cd"
NEW_DIGEST = "4421117732129706089e16af539a3501bf68b869fcc5d4025958f5b714d0a852"


@pytest.mark.parametrize(
    ("header", "sample", "want"),
    [
        (header(), sample(), OLD_DIGEST),
        (
            header(distortion_model="kannala_brandt", distortion=(0.1, 0.2, 0.3, 0.4)),
            sample(outputs={"depth": b"png16", "mask": b"png8"}),
            NEW_DIGEST,
        ),
        (header(labels=True), sample(labels=(message(HumanLabels),)), LABELS_DIGEST),
    ],
    ids=["plain", "outputs", "labels"],
)
def test_wire_format_of_an_append_does_not_change_silently(header, sample, want) -> None:
    request = AppendRequest(attempt=1, header=header, first_seq=0, samples=(sample,), last=True)
    digest = hashlib.sha256(encode(request)).hexdigest()
    assert digest == want, f"the wire format changed: {digest}"


def test_message_without_the_new_fields_takes_their_defaults() -> None:
    request = AppendRequest(attempt=1, header=header(), first_seq=0, samples=(sample(),), last=True)
    assert b"outputs" not in encode(request)
    assert b"distortion" not in encode(request)
    assert b"labels" not in encode(request)
    assert decode(AppendRequest, encode(request)) == request


def test_missing_new_field_takes_its_default() -> None:
    old = encode(Blob(sha256="a" * 64))
    assert decode(Blob, old.replace(b"\xa4data\xc4\x00", b"").replace(b"\x82", b"\x81", 1)).data == b""


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x93\x01\x02\x03", b"\x81\xa6status"])
def test_damaged_payload_is_refused_in_our_words(payload: bytes) -> None:
    with pytest.raises(MessageError, match="is no ClaimReply"):
        decode(ClaimReply, payload)


def test_nested_motions_survive_in_requests() -> None:
    motions = EpisodeMotions(humans=(HumanMotion(avatar="ann", motion=message(Motion)),))
    request = RobotPlanRequest(scenario=message(Scenario), motions=motions)
    back = decode(RobotPlanRequest, encode(request))
    np.testing.assert_array_equal(back.motions.humans[0].motion.root_m, np.ones((2, 3), np.float32))


FEW_BYTES = {
    "a dtype that kills": b"\x81\xa1x" + msgpack.packb(msgpack.ExtType(1, msgpack.packb(["m8[s/0]", [1]]) + bytes(8))),
    "more numbers than bytes": b"\x81\xa1x" + msgpack.packb(msgpack.ExtType(1, b"\x92\xa3<f8\x91\xce\xff\xff\xff\xff")),
    "no numbers, much shape": b"\x81\xa1x"
    + msgpack.packb(msgpack.ExtType(1, b"\x92\xa3<f8\x93\x00\xce\xff\xff\xff\xff\xce\xff\xff\xff\xff")),
    "five dimensions": b"\x81\xa1x" + msgpack.packb(msgpack.ExtType(1, b"\x92\xa3|u1\x95\1\1\1\1\1a")),
    "a shape that is cut off": b"\x81\xa1x" + msgpack.packb(msgpack.ExtType(1, b"\x92\xa3<f8\x92\xcd\x00")),
    "another extension": b"\x81\xa1x" + msgpack.packb(msgpack.ExtType(7, b"a")),
    "a list for a text": msgpack.packb({"worker": ["w"]}),
    "nothing for a text": msgpack.packb({"worker": None}),
    "no text": msgpack.packb({}),
    "a thousand lists deep": b"\x81\xa6worker" + b"\x91" * 1000 + b"\x90",
    "two thousand lists deep": b"\x81\xa6worker" + b"\x91" * 2000 + b"\x90",
    "a length without its bytes": b"\x81\xa6worker\xdb\xff\xff\xff\xff",
    "no UTF-8": b"\x81\xa6worker\xa2\xff\xfe",
}


@pytest.mark.parametrize("payload", FEW_BYTES.values(), ids=FEW_BYTES)
def test_hostile_bytes_are_refused_in_our_words(payload: bytes) -> None:
    with pytest.raises(MessageError, match="is no ClaimRequest") as error:
        decode(ClaimRequest, payload)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, 1.0, "1", True, None, [1]])
def test_whole_number_that_is_none_or_too_large_is_refused(value: object) -> None:
    fields = {"worker": "w", "index": value, "attempt": 1}
    with pytest.raises(MessageError, match="is no RenewRequest"):
        decode(RenewRequest, msgpack.packb(fields) if value != -(2**63) - 1 else b"\x81\xa5index\xd3")


def _lists(count: int, each: int) -> bytes:
    return b"\xdd" + count.to_bytes(4, "big") + (b"\xdd" + each.to_bytes(4, "big") + b"\x90" * each) * count


@pytest.mark.parametrize("lists", [_lists(1, 2_000_000), _lists(200, 10_000)])
def test_many_empty_lists_cost_no_more_than_they_are_long(lists: bytes) -> None:
    payload = b"\x81\xa6worker" + lists
    tracemalloc.start()
    try:
        with pytest.raises(MessageError, match=r"max_array_len|more than 100000 lists"):
            decode(ClaimRequest, payload)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


class Kind(enum.Enum):
    LEFT = "left"
    RIGHT = "right"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inner:
    ITEMS_MAX: typing.ClassVar[int] = 5
    rows: tuple[tuple[int, ...], ...] = ()
    pair: tuple[float, float] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Crooked:
    """Every kind of field."""

    kind: Kind = Kind.RIGHT
    count: int = -7
    share: float = 0.3
    flag: bool = False
    text: str = "é/\n"
    data: bytes = b"\xff\x00"
    inner: Inner = dataclasses.field(default_factory=Inner)
    named: dict[str, tuple[float, ...]] = dataclasses.field(default_factory=dict)
    least: float = dataclasses.field(default=2.5, metadata={"omitted_when_default": True})
    array: Float32Array | None = None
    free: typing.Any = None


DTYPES = ("|b1", "|u1", "|i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
WHOLE = st.integers(-(2**63), 2**63 - 1)
NUMBER = st.floats(allow_nan=False)
CROOKED = st.builds(
    Crooked,
    kind=st.sampled_from(Kind),
    count=WHOLE,
    share=NUMBER,
    flag=st.booleans(),
    text=st.text(),
    data=st.binary(),
    inner=st.builds(
        Inner,
        rows=st.lists(st.lists(WHOLE, max_size=3).map(tuple), max_size=4).map(tuple),
        pair=st.none() | st.tuples(NUMBER, NUMBER),
    ),
    named=st.dictionaries(st.text(), st.lists(NUMBER, max_size=3).map(tuple)),
    least=NUMBER | st.just(2.5),
    free=st.none() | st.lists(st.text() | WHOLE),
)


@settings(max_examples=25, deadline=None)
@given(CROOKED)
def test_fields_of_every_kind_come_back_and_one_with_its_default_may_stay_away(value: Crooked) -> None:
    packed = msgpack.unpackb(encode(value))
    assert list(packed) == [name for name in Crooked.__annotations__ if name != "least" or value.least != 2.5]
    assert (packed["kind"], packed["inner"]["rows"]) == (value.kind.value, [*map(list, value.inner.rows)])
    assert decode(Crooked, encode(value)) == value
    assert decode(Crooked, msgpack.packb({**packed, "newer": 1})) == value


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(
        st.sampled_from([*DTYPES]).map(np.dtype),
        hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5),
    )
)
def test_arrays_come_back_with_type_shape_and_bytes(array: AnyArray) -> None:
    for sent in (array, array.T):
        back = decode(Crooked, encode(Crooked(array=sent))).array
        assert back is not None
        assert (back.dtype, back.shape, back.tobytes()) == (sent.dtype, sent.shape, sent.tobytes())


@pytest.mark.parametrize("side", [0, 1, 127, 128, 255, 256, 65_535, 65_536])
def test_every_way_to_write_a_length_is_read(side: int) -> None:
    array = (np.arange(2 * side) % 251).astype(np.uint8).reshape(side, 2)
    assert np.array_equal(decode(Crooked, encode(Crooked(array=array))).array, array)
    short = msgpack.packb(["|u1", [side, 2]]) + bytes(2 * side + 1)
    with pytest.raises(MessageError, match=rf"an array of shape \[{side}, 2\] has {2 * side + 1} bytes"):
        decode(Crooked, msgpack.packb({"array": msgpack.ExtType(1, short)}))


def test_array_types_may_be_aliases_as_numpy_2_5_writes_them() -> None:
    class Alias:
        """Stands for the `typing.TypeAliasType` of Python 3.12."""

        __value__ = np.ndarray[typing.Any, typing.Any]

    array = np.arange(3, dtype=np.float32)
    build = codec._builder(types.GenericAlias(Alias(), (np.float32,)))
    assert build(array) is array
    with pytest.raises(TypeError, match="ndarray was due"):
        build([0.0, 1.0])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"kind": "up"}, "'up' is not a valid Kind"),
        ({"kind": 1}, "a text was due, not int 1"),
        ({"share": "0.5"}, "a number was due, not str '0.5'"),
        ({"share": True}, "a number was due, not bool True"),
        ({"flag": 1}, "bool was due, not int 1"),
        ({"data": "a"}, "bytes was due, not str 'a'"),
        ({"inner": [1]}, "a map was due, not <class 'list'>"),
        ({"inner": {"pair": [1.0]}}, "a list of 2 was due, not <class 'list'>"),
        ({"inner": {"pair": [1.0, 2.0, 3.0]}}, "a list of 2 was due"),
        ({"inner": {"rows": "ab"}}, "a list of values was due, not str 'ab'"),
        ({"inner": {"rows": [["a"]]}}, "a whole number of 64 bits was due, not str 'a'"),
        ({"named": {"a": None}}, "a list of values was due, not <class 'NoneType'>"),
        ({"array": [1.0]}, "ndarray was due, not <class 'list'>"),
        ({"text": b"a"}, "a text was due, not <class 'bytes'>"),
    ],
)
def test_value_of_another_type_is_refused_by_what_was_due(fields: Mapping[str, object], words: str) -> None:
    with pytest.raises(MessageError) as error:
        decode(Crooked, msgpack.packb(fields))
    assert words in str(error.value)
    assert str(error.value).startswith(f"Payload of {len(msgpack.packb(fields))} bytes is no Crooked: ")


def test_number_may_be_written_as_a_whole_one_and_numpys_as_plain_ones() -> None:
    assert decode(Crooked, msgpack.packb({"share": 3, "count": 2**63 - 1})) == Crooked(share=3, count=2**63 - 1)
    assert decode(Crooked, msgpack.packb({"count": -(2**63)})).count == -(2**63)
    assert decode(Crooked, encode(Crooked(share=np.float32(0.25), count=np.int16(-3)))) == Crooked(share=0.25, count=-3)
    assert math.isnan(decode(Crooked, encode(Crooked(share=math.nan))).share)
    with pytest.raises(TypeError, match="set cannot travel in a message"):
        encode(Crooked(free={1}))


@pytest.mark.parametrize("more", [0, 1])
def test_limits_may_be_reached_and_not_passed(more: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of lists and maps, of items, of texts and of a whole message; those of a class are its own."""
    within = {
        "list": encode(Inner(rows=((0,) * (20_000 + more),))),
        "map": encode(Crooked(named={str(n): () for n in range(20_000 + more)})),
        "items": encode(Inner(rows=((1, 2, 3),) * (3 + more))),
        "items of any class": encode(Crooked(free=[[[]] * 19_999] * 4 + [[[]] * (19_994 + more)])),
        "text": encode(Crooked(text="a" * (16 * 2**20 + more))),
    }
    monkeypatch.setattr("readygo.common.messages.codec.MESSAGE_BYTES_MAX", 2**40)
    for name, payload in within.items():
        cls = Inner if name in ("list", "items") else Crooked
        if more:
            with pytest.raises(MessageError):
                decode(cls, payload)
        else:
            decode(cls, payload)
    payload = encode(Crooked())
    monkeypatch.setattr("readygo.common.messages.codec.MESSAGE_BYTES_MAX", len(payload) - more)
    if more:
        with pytest.raises(MessageError, match=f"larger than {len(payload) - 1} bytes"):
            decode(Crooked, payload)
    else:
        assert decode(Crooked, payload) == Crooked()


def test_arrays_count_as_lists_and_maps_do() -> None:
    assert (MESSAGE_BYTES_MAX, ITEMS_MAX) == (268_435_456, 100_000)
    empty = msgpack.ExtType(1, b"\x92\xa3|u1\x91\0")
    decode(Inner, msgpack.packb({"newer": [empty] * 3}))
    with pytest.raises(MessageError, match="more than 5 lists, maps and arrays"):
        decode(Inner, msgpack.packb({"newer": [empty] * 4}))


def test_payload_larger_than_any_message_is_not_even_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.common.messages.codec.MESSAGE_BYTES_MAX", 10)
    with pytest.raises(MessageError, match="larger than 10 bytes"):
        decode(ClaimRequest, encode(ClaimRequest(worker="a long name")))
