"""Loads, stores and shuffles of sixteen-lane values (see `types`); indices count array elements.

There are no bounds checks: the caller guarantees that the lanes lie within the array.
"""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from readygo.common.simd.types import F16, I16, LANES, M16, call_llvm, f32_vector, i32_vector

_i32 = ir.IntType(32)
_intrinsic: Any = intrinsic
_i16_vector = ir.VectorType(ir.IntType(16), LANES)


def pointer_to(context: Any, builder: Any, sig: Any, args: Any, pointee: Any) -> Any:
    """Pointer to element `args[1]` of the array `args[0]`."""
    array = context.make_array(sig.args[0])(context, builder, args[0])
    index = context.cast(builder, args[1], sig.args[1], types.intp)
    return builder.bitcast(builder.gep(array.data, [index]), pointee.as_pointer())


def _load(result: Any, stored: Any, align: int, widen: Any, doc: str) -> Any:
    def function(typing_context: Any, array: Any, index: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            value = builder.load(pointer_to(context, builder, sig, args, stored))
            value.align = align
            return widen(builder, value)

        return result(array, index), emit

    function.__doc__ = doc
    return _intrinsic(function)


def _store(vector: Any, stored: Any, doc: str) -> Any:
    def function(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            builder.store(args[2], pointer_to(context, builder, sig, args, stored)).align = 4
            return context.get_dummy_value()

        return types.void(array, index, vector), emit

    function.__doc__ = doc
    return _intrinsic(function)


load_f16 = _load(F16, f32_vector, 4, lambda b, v: v, "F16 from 16 float32 elements at `index`.")
load_i16 = _load(I16, i32_vector, 4, lambda b, v: v, "I16 from 16 int32 elements at `index`.")
load_short = _load(
    F16,
    _i16_vector,
    2,
    lambda b, v: b.sitofp(b.sext(v, i32_vector), f32_vector),
    "F16 of the values of 16 int16 elements at `index`.",
)
store_f16 = _store(F16, f32_vector, "Write an F16 to 16 float32 elements at `index`.")
store_i16 = _store(I16, i32_vector, "Write an I16 to 16 int32 elements at `index`.")


@_intrinsic
def touching(typing_context: Any, array: Any, index: Any, bits: Any) -> Any:
    """Which of the 64 uint16 elements at `index` share a set bit with the scalar `bits`, as an int64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.IntType(16), 64)
        value = builder.load(pointer_to(context, builder, sig, args, vector))
        value.align = 2
        first = builder.insert_element(
            ir.Constant(vector, ir.Undefined), builder.trunc(args[2], ir.IntType(16)), ir.Constant(_i32, 0)
        )
        wanted = builder.shuffle_vector(
            first, ir.Constant(vector, ir.Undefined), ir.Constant(ir.VectorType(_i32, 64), [0] * 64)
        )
        shared = builder.icmp_unsigned("!=", builder.and_(value, wanted), ir.Constant(vector, None))
        return builder.bitcast(shared, ir.IntType(64))

    return types.int64(array, index, types.int64), emit


@_intrinsic
def peek(typing_context: Any, array: Any, index: Any) -> Any:
    """Element `index` of an array, without numba's treatment of negative indices."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = builder.load(pointer_to(context, builder, sig, args, context.get_data_type(sig.args[0].dtype)))
        return value

    return array.dtype(array, index), emit


@_intrinsic
def poke(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write element `index` of an array, without numba's treatment of negative indices."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        dtype = sig.args[0].dtype
        stored = context.cast(builder, args[2], sig.args[2], dtype)
        builder.store(stored, pointer_to(context, builder, sig, args, context.get_data_type(dtype)))
        return context.get_dummy_value()

    return types.void(array, index, value), emit


@_intrinsic
def compress(typing_context: Any, mask: Any, value: Any) -> Any:
    """The lanes of the I16 `value` where `mask` holds, moved to the front; the rest is undefined."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = "llvm.experimental.vector.compress.v16i32"
        return call_llvm(builder, name, i32_vector, [args[1], args[0], ir.Constant(i32_vector, ir.Undefined)])

    return I16(M16, I16), emit


@_intrinsic
def prefetch(typing_context: Any, array: Any, index: Any) -> Any:
    """Ask the cache for the line of an element; harmless beyond the array."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = pointer_to(context, builder, sig, args, ir.IntType(8))
        read, keep, data = (ir.Constant(_i32, number) for number in (0, 3, 1))
        function_type = ir.FunctionType(ir.VoidType(), [pointer.type, _i32, _i32, _i32])
        function = builder.module.globals.get("llvm.prefetch.p0")
        if function is None:
            function = ir.Function(builder.module, function_type, "llvm.prefetch.p0")
        builder.call(function, [pointer, read, keep, data])
        return context.get_dummy_value()

    return types.void(array, index), emit


def shuffled(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:
    """The LLVM value of these lanes of two vectors in a row."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_i32, LANES), lanes))


def per_quarter(*lanes: int) -> list[int]:
    """The same pick within each of the four 128-bit quarters."""
    return [lane + 4 * quarter for quarter in range(4) for lane in lanes]


def _quarters(*picks: int) -> list[int]:
    """Whole 128-bit quarters: two of the first vector, then two of the second."""
    return [16 * (place > 1) + 4 * quarter + lane for place, quarter in enumerate(picks) for lane in range(4)]


def _transpose(builder: Any, rows: list[Any]) -> list[Any]:
    """Transpose 16 vectors by unpacking pairs within quarters, then moving quarters."""
    low, high = per_quarter(0, 16, 1, 17), per_quarter(2, 18, 3, 19)
    low_pair, high_pair = per_quarter(0, 1, 16, 17), per_quarter(2, 3, 18, 19)
    even, odd = _quarters(0, 2, 0, 2), _quarters(1, 3, 1, 3)
    t = [shuffled(builder, rows[k & ~1], rows[k | 1], high if k & 1 else low) for k in range(16)]
    r: list[Any] = []
    for k in range(0, 16, 4):
        r += [
            shuffled(builder, t[k + half], t[k + 2 + half], pick) for half in (0, 1) for pick in (low_pair, high_pair)
        ]
    t = [shuffled(builder, r[g + k], r[g + 4 + k], pick) for g in (0, 8) for pick in (even, odd) for k in range(4)]
    out: list[Any] = [None] * 16
    for k in range(4):
        out[k] = shuffled(builder, t[k], t[8 + k], even)
        out[8 + k] = shuffled(builder, t[k], t[8 + k], odd)
        out[4 + k] = shuffled(builder, t[4 + k], t[12 + k], even)
        out[12 + k] = shuffled(builder, t[4 + k], t[12 + k], odd)
    return out


@_intrinsic
def transpose_in_place(typing_context: Any, array: Any, index: Any) -> Any:
    """Transpose the 16x16 float32 matrix at `index`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first = pointer_to(context, builder, sig, args, f32_vector)
        places = [builder.gep(first, [ir.Constant(_i32, k)]) for k in range(LANES)]
        rows = []
        for place in places:
            row = builder.load(place)
            row.align = 4
            rows.append(row)
        for place, row in zip(places, _transpose(builder, rows), strict=True):
            builder.store(row, place).align = 4
        return context.get_dummy_value()

    return types.void(array, index), emit
