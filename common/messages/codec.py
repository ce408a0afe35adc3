"""Messages as MessagePack: dataclasses become maps, arrays an extension type, nothing is ever pickled."""

import dataclasses
import enum
import functools
import types
import typing
from typing import Any, TypeVar

import msgpack
import numpy as np

from readygo.common.errors import BusError

Message = TypeVar("Message")
ARRAY_EXT = 1
_NEVER_OMITTED = object()
OMITTED_WHEN_DEFAULT = {"omitted_when_default": True}
"""Metadata of a field that was added to a message: while it has its default the bytes are those of before."""


def encode(message: Any) -> bytes:
    """MessagePack bytes of a message dataclass."""
    packed: bytes = msgpack.packb(_plain(message), default=_pack_array, use_bin_type=True)
    return packed


def decode(cls: type[Message], payload: bytes) -> Message:
    """The message of type `cls` in `payload`.

    Raises:
        BusError: If the payload is not such a message.
    """
    try:
        plain = msgpack.unpackb(payload, ext_hook=_unpack_array, raw=False, strict_map_key=False)
        message: Message = _build(cls, plain)
    except (ValueError, TypeError, KeyError, AttributeError, msgpack.UnpackException) as error:
        raise BusError(f"Payload of {len(payload)} bytes is no {cls.__name__}: {error}.") from error
    return message


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        items = ((name, getattr(value, name), default) for name, default in _fields(value.__class__))
        return {name: _plain(item) for name, item, default in items if default is _NEVER_OMITTED or item != default}
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


def _unpack_array(code: int, data: bytes) -> Any:
    if code != ARRAY_EXT:
        raise ValueError(f"unknown extension type {code}")
    unpacker = msgpack.Unpacker()
    unpacker.feed(data[:256])
    dtype, shape = unpacker.unpack()
    return np.frombuffer(data, dtype=np.dtype(dtype), offset=unpacker.tell()).reshape(shape)


@functools.cache
def _fields(cls: type) -> tuple[tuple[str, Any], ...]:
    """Names of a message's fields, and the value with which a field is left out."""
    return tuple((field.name, _omitted(field)) for field in dataclasses.fields(cls))


def _omitted(field: dataclasses.Field[Any]) -> Any:
    if field.metadata != OMITTED_WHEN_DEFAULT:
        return _NEVER_OMITTED
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _build(hint: Any, value: Any) -> Any:
    origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints = _hints(hint)
        return hint(**{key: _build(hints[key], item) for key, item in value.items() if key in hints})
    if origin is tuple:
        item_hint = typing.get_args(hint)[0]
        return tuple(_build(item_hint, item) for item in value)
    if origin in (types.UnionType, typing.Union):
        inner = next(arg for arg in typing.get_args(hint) if arg is not type(None))
        return None if value is None else _build(inner, value)
    if origin is dict:
        return dict(value)
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return hint(value)
    return value
