import dataclasses
import hashlib
import tracemalloc
import typing

import msgpack
import numpy as np
import pytest

from readygo.common.errors import MessageError
from readygo.common.messages import (
    AppendRequest,
    Blob,
    ClaimReply,
    ClaimRequest,
    EpisodeMotions,
    HumanLabels,
    HumanMotion,
    Motion,
    RenewRequest,
    RobotPlanRequest,
    Scenario,
    decode,
    encode,
)
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


def test_payload_larger_than_any_message_is_not_even_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.common.messages.codec.MESSAGE_BYTES_MAX", 10)
    with pytest.raises(MessageError, match="larger than 10 bytes"):
        decode(ClaimRequest, encode(ClaimRequest(worker="a long name")))
