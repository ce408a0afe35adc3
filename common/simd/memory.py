"""Loads, stores and shuffles of sixteen-lane values (see `types`); indices count array elements.

There are no bounds checks: the caller guarantees that the lanes lie within the array.

Legend: a shuffle takes lanes by number out of two vectors in a row, so that lane 16 is the second one's first; a
quarter is 4 lanes, 128 bits, within which shuffles are cheap on every machine. The alignment of a load or store is that
of its elements: arrays may begin anywhere. Bits of masks and sets: lane or element 0 is the lowest.
"""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from readygo.common.simd.types import F16, I16, LANES, M16, call_llvm, f32_vector, i32_vector

_i32 = ir.IntType(32)
_intrinsic: Any = intrinsic
_i16_vector = ir.VectorType(ir.IntType(16), LANES)
_quarter = ir.VectorType(ir.FloatType(), 4)


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


def _words(builder: Any, bits: Any) -> Any:
    """The lowest 16 bits of an int64, 64 times."""
    undefined = ir.Constant(ir.VectorType(ir.IntType(16), 64), ir.Undefined)
    first = builder.insert_element(undefined, builder.trunc(bits, ir.IntType(16)), ir.Constant(_i32, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_i32, 64), [0] * 64))


@_intrinsic
def touching(typing_context: Any, array: Any, index: Any, bits: Any) -> Any:
    """Which of the 64 uint16 elements at `index` share a set bit with the scalar `bits`, as an int64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.IntType(16), 64)
        value = builder.load(pointer_to(context, builder, sig, args, vector))
        value.align = 2
        shared = builder.icmp_unsigned("!=", builder.and_(value, _words(builder, args[2])), ir.Constant(vector, None))
        return builder.bitcast(shared, ir.IntType(64))

    return types.int64(array, index, types.int64), emit


@_intrinsic
def forget(typing_context: Any, array: Any, index: Any) -> Any:
    """Set the 64 uint16 elements at `index` to 0."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.IntType(16), 64)
        builder.store(ir.Constant(vector, None), pointer_to(context, builder, sig, args, vector)).align = 2
        return context.get_dummy_value()

    return types.void(array, index), emit


@_intrinsic
def mark(typing_context: Any, array: Any, index: Any, which: Any, bits: Any) -> Any:
    """Set `bits` in those of the 64 uint16 elements at `index` whose bit is set in the int64 `which`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.IntType(16), 64)
        pointer = pointer_to(context, builder, sig, args, vector)
        old = builder.load(pointer)
        old.align = 2
        chosen = builder.sext(builder.bitcast(args[2], ir.VectorType(ir.IntType(1), 64)), vector)
        wanted = builder.and_(chosen, _words(builder, args[3]))
        builder.store(builder.or_(old, wanted), pointer).align = 2
        return context.get_dummy_value()

    return types.void(array, index, types.int64, types.int64), emit


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


def shuffle_lanes(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:
    """The LLVM value of these lanes of two vectors in a row."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_i32, LANES), lanes))


def per_quarter(*lanes: int) -> list[int]:
    """Lane numbers that pick the same lanes within each of the four 128-bit quarters."""
    return [lane + 4 * quarter for quarter in range(4) for lane in lanes]


def _join_vectors(builder: Any, parts: list[Any], lanes: int) -> Any:
    """One vector of vectors of `lanes` lanes each, two to the power of something of them."""
    while len(parts) > 1:
        pairs = zip(parts[::2], parts[1::2], strict=True)
        lanes *= 2
        all_lanes = ir.Constant(ir.VectorType(_i32, lanes), list(range(lanes)))
        parts = [builder.shuffle_vector(a, b, all_lanes) for a, b in pairs]
    return parts[0]


def _columns_of_quarters(builder: Any, rows: list[Any]) -> list[Any]:
    """The 4x4 matrices that the quarters of four vectors make, each transposed.

    Rows a b c d become a0 b0 a1 b1, c0 d0 c1 d1 (`low`) and a2 b2 a3 b3, c2 d2 c3 d3 (`high`), then a0 b0 c0 d0 and so
    on.
    """
    low, high = per_quarter(0, 16, 1, 17), per_quarter(2, 18, 3, 19)
    low_pair, high_pair = per_quarter(0, 1, 16, 17), per_quarter(2, 3, 18, 19)
    a, b, c, d = rows
    out = []
    for pick in (low, high):
        ab, cd = shuffle_lanes(builder, a, b, pick), shuffle_lanes(builder, c, d, pick)
        out += [shuffle_lanes(builder, ab, cd, low_pair), shuffle_lanes(builder, ab, cd, high_pair)]
    return out


@_intrinsic
def transpose(
    typing_context: Any, source: Any, index: Any, stride: Any, target: Any, place: Any, target_stride: Any
) -> Any:
    """Write the transposed 16x16 float32 matrix at `index`, with rows `stride` apart, to other memory at `place`.

    Four columns at a time, of which a quarter is loaded: few enough values for the registers of AVX2.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def row(first: int, number: int, lane: int, vector: Any) -> Any:
            # Arguments 0..2 are the source's array, index and stride, 3..5 the target's.
            array, begin, apart = args[first : first + 3]
            kinds = sig.args[first : first + 3]
            begin, apart = (
                context.cast(builder, value, kind, types.intp)
                for value, kind in zip((begin, apart), kinds[1:], strict=True)
            )
            begin = builder.add(begin, builder.mul(apart, ir.Constant(apart.type, number)))
            begin = builder.add(begin, ir.Constant(apart.type, lane))
            of_begin = types.void(kinds[0], types.intp)
            return pointer_to(context, builder, of_begin, [array, begin], vector)

        # Quarter q of vector `number` is row number + 4 q at the columns first .. first + 3. The 4x4 matrices of the
        # quarters, transposed, are these four columns as a whole.
        for first in range(0, LANES, 4):
            rows = []
            for number in range(4):
                quarters = [builder.load(row(0, number + k, first, _quarter)) for k in range(0, LANES, 4)]
                for quarter in quarters:
                    quarter.align = 4
                rows.append(_join_vectors(builder, quarters, 4))
            for number, column in enumerate(_columns_of_quarters(builder, rows)):
                builder.store(column, row(3, first + number, 0, f32_vector)).align = 4
        return context.get_dummy_value()

    return types.void(source, index, stride, target, place, target_stride), emit
