"""Bytes that nobody of us has written: whatever comes, it is a message or is refused in our words."""

import contextlib
import random
from collections.abc import Iterator
from typing import Any

import msgpack
import pytest

from readygo.common.errors import MessageError
from readygo.common.messages import decode, encode
from tests.common.messages.examples import MESSAGES, message

NASTY = [
    b"\xc0",
    b"\xc1",
    b"\xcf" + b"\xff" * 8,
    b"\xcb\x7f\xf8" + bytes(6),
    b"\xdd\xff\xff\xff\xff",
    b"\xdf\x00\x0f\xff\xff",
    b"\xdb\x7f\xff\xff\xff",
    b"\xc6\x7f\xff\xff\xff",
    b"\xc7\x10\x01\x92\xa7m8[s/0]\x91\x01",
    b"\xc7\x0b\x01\x92\xa3<f8\x91\xce\xff\xff\xff\xff",
    b"\x92\xa3|O8\x91\x01",
    b"\x91" * 40,
]


def _value(rng: random.Random, depth: int = 0) -> Any:
    """Any plain value."""
    kinds = [
        lambda: rng.choice([0, -1, 2**31, 2**63, -(2**63), 2**64 - 1]),
        lambda: rng.choice([0.0, -0.0, float("nan"), float("inf"), 1e300]),
        lambda: rng.choice(["", "a", "../..", "\x00", "é" * 300]),
        lambda: rng.randbytes(rng.randrange(20)),
        lambda: rng.choice([None, True, False]),
        lambda: msgpack.ExtType(rng.choice([1, 1, 5]), rng.choice(NASTY) + rng.randbytes(8)),
        lambda: [_value(rng, depth + 1) for _ in range(rng.randrange(5))],
        lambda: {rng.choice("abc"): _value(rng, depth + 1) for _ in range(rng.randrange(3))},
    ]
    return rng.choice(kinds[:6] if depth > 2 else kinds)()


def _bytes(rng: random.Random, golden: bytes, other: bytes) -> bytes:
    """Bytes that resemble `golden` more or less."""
    cut = rng.randrange(len(golden) + 1)
    match rng.randrange(7):
        case 0:
            return rng.randbytes(rng.randrange(64))
        case 1:
            return golden[:cut]
        case 2:
            return golden[:cut] + rng.choice(NASTY) + golden[cut + rng.randrange(4) :]
        case 3:
            return golden[:cut] + other[rng.randrange(len(other) + 1) :]
        case 4:
            fields = msgpack.unpackb(golden, strict_map_key=False)
            for name in rng.sample(sorted(fields), min(len(fields), rng.randint(1, 2))):
                fields[name] = _value(rng)
            return bytes(msgpack.packb(fields))
        case _:
            changed = bytearray(golden)
            for _ in range(min(len(changed), rng.randint(1, 4))):
                changed[rng.randrange(len(changed))] = rng.randrange(256)
            return bytes(changed)


def inputs(count: int, seed: int) -> Iterator[tuple[type, bytes]]:
    """Message classes and bytes that are given for them."""
    rng = random.Random(seed)
    golden = [encode(message(cls)) for cls in MESSAGES]
    for number in range(count):
        turn = number % len(MESSAGES)
        yield MESSAGES[turn], _bytes(rng, golden[turn], rng.choice(golden))


def test_whatever_comes_is_a_message_or_refused_in_our_words(request: pytest.FixtureRequest) -> None:
    count, taken = request.config.getoption("--fuzz"), 0
    for cls, payload in inputs(count, seed=count):
        with contextlib.suppress(MessageError):
            decoded = decode(cls, payload)
            taken += 1
            assert isinstance(decode(cls, encode(decoded)), cls)
    assert 0.01 * count < taken < 0.5 * count
