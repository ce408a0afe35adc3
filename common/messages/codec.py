"""Messages as MessagePack: dataclasses become maps, arrays an extension type, nothing is ever pickled.

All incoming bytes are validated: types are those that the message's class names, arrays have one of a few dtypes and as
many numbers as their shape says, and input larger than any of our messages is refused before it costs memory.
"""

import dataclasses
import enum
import functools
import math
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import msgpack
import numpy as np

from readygo.common.array_files import NUMBERS
from readygo.common.arrays import AnyArray
from readygo.common.errors import MessageError

Message = TypeVar("Message")
ARRAY_EXT = 1
MESSAGE_BYTES_MAX = 256 * 2**20
"""No message is larger [bytes]; an episode with all its images is the largest."""
ITEMS_MAX = 100_000
"""Most lists, maps and arrays in a message, unless its class defines another `ITEMS_MAX`."""
_LIST_MAX = 20_000
_STR_MAX = 16 * 2**20
_DIMENSIONS_MAX = 4
_DTYPES = {msgpack.packb([code, []])[:-1]: np.dtype(code) for code in NUMBERS}
"""What arrays may begin with. NumPy is given no other name: the one of a time of 0 seconds ends the process."""
_DTYPE_END = 5
_LIST_HEAD, _UNSIGNED_HEAD = 0x90, 0x80
_UNSIGNED_BYTES = {0xCC: 1, 0xCD: 2, 0xCE: 4}
"""Size of an unsigned number by the byte before it."""
_INT_MIN, _INT_MAX = -(2**63), 2**63 - 1
_PLAIN = frozenset({int, str, bytes, float, bool, types.NoneType, np.ndarray})
"""Types that are packed as they are: most of what a message holds."""
_NEVER_OMITTED = object()
OMITTED_WHEN_DEFAULT = {"omitted_when_default": True}
"""Metadata of a field that is left out of the bytes while it has its default."""
_Build = Callable[[Any], Any]


def encode(message: Any) -> bytes:
    """MessagePack bytes of a message dataclass."""
    packed: bytes = msgpack.packb(_plain(message), default=_pack_array, use_bin_type=True)
    return packed


def decode(cls: type[Message], payload: bytes) -> Message:
    """The message of type `cls` in `payload`.

    Fields that the class has not are left out: they are of a newer version.

    Raises:
        MessageError: If the payload is not such a message.
    """
    try:
        plain = unpack(payload, getattr(cls, "ITEMS_MAX", ITEMS_MAX))
        message: Message = _builder(cls)(plain)  # type: ignore[arg-type]
    except (ValueError, TypeError, LookupError, OverflowError, MemoryError, msgpack.UnpackException) as error:
        words = str(error) or type(error).__name__
        raise MessageError(f"Payload of {len(payload)} bytes is no {cls.__name__}: {words[:_WORDS_MAX]}.") from error
    return message


def unpack(payload: bytes, items_max: int) -> Any:
    """Plain values of a payload, arrays among them; the smallest bytes make the most objects, so these are counted.

    Args:
        payload: MessagePack.
        items_max: Lists, maps and arrays that it may hold.

    Raises:
        ValueError: If it is larger than `MESSAGE_BYTES_MAX`, holds more, or is damaged; msgpack and arrays that fit no
            shape also raise TypeError, LookupError, OverflowError, MemoryError and msgpack.UnpackException.
    """
    if len(payload) > MESSAGE_BYTES_MAX:
        raise ValueError(f"it is larger than {MESSAGE_BYTES_MAX} bytes")
    left = items_max

    def count(item: Any) -> Any:
        nonlocal left
        left -= 1
        if left < 0:
            raise ValueError(f"it holds more than {items_max} lists, maps and arrays")
        return item

    def array(code: int, data: bytes) -> Any:
        return count(_unpack_array(code, data))

    return msgpack.unpackb(
        payload,
        ext_hook=array,
        # What is smaller than this cannot hold too many.
        list_hook=count if len(payload) > items_max else None,
        object_hook=count if len(payload) > items_max else None,
        raw=False,
        strict_map_key=True,
        max_array_len=min(_LIST_MAX, len(payload)),
        max_map_len=min(_LIST_MAX, len(payload)),
        max_str_len=_STR_MAX,
    )


def _plain(value: Any) -> Any:
    if type(value) in _PLAIN:
        return value
    if (fields := _fields(value.__class__)) is not None:
        return {
            name: item if type(item) in _PLAIN else _plain(item)
            for name, item, default in [(name, getattr(value, name), default) for name, default in fields]
            if default is _NEVER_OMITTED or item != default
        }
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.generic):
        return value.item()
    return value


def _pack_array(value: Any) -> msgpack.ExtType:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{type(value).__name__} cannot travel in a message")
    header = msgpack.packb([value.dtype.str, list(value.shape)])
    return msgpack.ExtType(ARRAY_EXT, header + np.ascontiguousarray(value).tobytes())


def _unpack_array(code: int, data: bytes) -> AnyArray:
    if code != ARRAY_EXT:
        raise ValueError(f"unknown extension type {code}")
    dtype = _DTYPES.get(data[:_DTYPE_END])
    if dtype is None:
        raise ValueError(f"no array of a message begins with {data[:_DTYPE_END]!r}")
    shape, offset = _shape(data)
    if math.prod(shape) * dtype.itemsize != len(data) - offset or max(shape, default=0) > len(data):
        raise ValueError(f"an array of shape {shape} has {len(data) - offset} bytes")
    return np.frombuffer(data, dtype=dtype, offset=offset).reshape(shape)


def _shape(data: bytes) -> tuple[list[int], int]:
    """Shape of an array, and where its numbers begin: the quick way of unpacking a few whole numbers."""
    count = data[_DTYPE_END] - _LIST_HEAD
    if not 0 <= count <= _DIMENSIONS_MAX:
        raise ValueError(f"an array of a message has at most {_DIMENSIONS_MAX} dimensions")
    shape, offset = [], _DTYPE_END + 1
    for _ in range(count):
        head, offset = data[offset], offset + 1
        size = 0 if head < _UNSIGNED_HEAD else _UNSIGNED_BYTES[head]
        shape.append(int.from_bytes(data[offset : offset + size], "big") if size else head)
        offset += size
    return shape, offset


@functools.cache
def _fields(cls: type) -> tuple[tuple[str, Any], ...] | None:
    """Names of a message's fields, and the value with which a field is left out; None of any other class."""
    if not dataclasses.is_dataclass(cls):
        return None
    return tuple((field.name, _field_default(field)) for field in dataclasses.fields(cls))


def _field_default(field: dataclasses.Field[Any]) -> Any:
    if field.metadata != OMITTED_WHEN_DEFAULT:
        return _NEVER_OMITTED
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


@functools.cache
def _builder(hint: Any) -> _Build:
    """What makes a value of a field's type of the plain one.

    What it makes raises TypeError or ValueError at anything else.
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    # From numpy 2.5 on, NDArray is a type alias on Python 3.12 and newer.
    origin = typing.get_origin(getattr(origin, "__value__", None)) or origin
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _of_dataclass(hint)
    if origin is tuple:
        items = _builder(arguments[0])
        return _of_tuple(items, None if arguments[-1] is Ellipsis else len(arguments))
    if origin in (types.UnionType, typing.Union):
        inner = _builder(next(argument for argument in arguments if argument is not types.NoneType))
        return lambda value: None if value is None else inner(value)
    if origin is dict:
        values = _builder(arguments[1])
        return lambda value: {_text(key): values(item) for key, item in _mapping(value).items()}
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return lambda value: hint(_text(value))
    return _LEAVES[origin or hint]


def _of_dataclass(cls: Any) -> _Build:
    hints = typing.get_type_hints(cls)
    builds = {field.name: _builder(hints[field.name]) for field in dataclasses.fields(cls)}

    def build(value: Any) -> Any:
        return cls(**{key: builds[key](item) for key, item in _mapping(value).items() if key in builds})

    return build


def _of_tuple(items: _Build, count: int | None) -> _Build:
    def build(value: Any) -> tuple[Any, ...]:
        if type(value) is not list or len(value) != (len(value) if count is None else count):
            raise TypeError(f"a list of {'values' if count is None else count} was due, not {_words(value)}")
        return tuple(map(items, value))

    return build


def _mapping(value: Any) -> dict[Any, Any]:
    if type(value) is not dict:
        raise TypeError(f"a map was due, not {_words(value)}")
    return value


def _text(value: Any) -> str:
    if type(value) is not str:
        raise TypeError(f"a text was due, not {_words(value)}")
    return value


def _whole(value: Any) -> int:
    if type(value) is not int or not _INT_MIN <= value <= _INT_MAX:
        raise TypeError(f"a whole number of 64 bits was due, not {_words(value)}")
    return value


def _number(value: Any) -> float:
    # A float may have been written as a whole number.
    if type(value) is not float and type(value) is not int:
        raise TypeError(f"a number was due, not {_words(value)}")
    return value


def _instance(kind: type) -> _Build:
    def build(value: Any) -> Any:
        if type(value) is not kind:
            raise TypeError(f"{kind.__name__} was due, not {_words(value)}")
        return value

    return build


def _words(value: Any) -> str:
    return (
        f"{type(value).__name__} {value!r}"[:_WORDS_MAX] if isinstance(value, (int, float, str)) else str(type(value))
    )


_WORDS_MAX = 200
_LEAVES: dict[Any, _Build] = {
    str: _text,
    int: _whole,
    float: _number,
    bool: _instance(bool),
    bytes: _instance(bytes),
    np.ndarray: _instance(np.ndarray),
    Any: lambda value: value,
}
