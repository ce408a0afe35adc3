"""Sixteen-lane values (see `readygo.common.simd.types`) from rows of 3 or 4 numbers and from images, and their sums.

There are no bounds checks: the caller guarantees that what is read and written lies within the array.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from readygo.common.simd.memory import pointer_to, shuffle_lanes
from readygo.common.simd.types import F16, LANES, as_i32, call_llvm, f32_vector, i32_vector
from readygo.services.reconstructor.differentiable.partial_sums import within_quarters

_i32 = ir.IntType(32)
_quarter = ir.VectorType(ir.FloatType(), 4)
_intrinsic: Any = intrinsic
_tuple: Any = types.UniTuple
_three, _four = _tuple(F16, 3), _tuple(F16, 4)


def _first_lanes(context: Any, builder: Any, kind: Any, count: Any) -> Any:
    """Mask of the lanes below the scalar `count`."""
    limit = as_i32(context, builder, kind, count)
    return builder.icmp_signed("<", ir.Constant(i32_vector, list(range(LANES))), limit)


@_intrinsic
def load_first(typing_context: Any, array: Any, index: Any, count: Any) -> Any:
    """F16 from the first `count` float32 elements at `index`, zero in the other lanes, whose memory is not touched."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = pointer_to(context, builder, sig, args, f32_vector)
        mask = _first_lanes(context, builder, sig.args[2], args[2])
        zero = ir.Constant(f32_vector, None)
        return call_llvm(builder, "llvm.masked.load.v16f32.p0", f32_vector, [pointer, ir.Constant(_i32, 4), mask, zero])

    return F16(array, index, count), emit


@_intrinsic
def store_first(typing_context: Any, array: Any, index: Any, count: Any, value: Any) -> Any:
    """Write the first `count` lanes to the float32 elements at `index`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = pointer_to(context, builder, sig, args, f32_vector)
        mask = _first_lanes(context, builder, sig.args[2], args[2])
        name = "llvm.masked.store.v16f32.p0"
        call_llvm(builder, name, ir.VoidType(), [args[3], pointer, ir.Constant(_i32, 4), mask])
        return context.get_dummy_value()

    return types.void(array, index, count, F16), emit


def _copy(size: int) -> Any:
    def function(typing_context: Any, target: Any, place: Any, source: Any, index: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            row = ir.VectorType(ir.FloatType(), size)
            to = pointer_to(context, builder, sig, args, row)
            of = pointer_to(context, builder, types.void(*sig.args[2:]), args[2:], row)
            value = builder.load(of)
            value.align = 4
            builder.store(value, to).align = 4
            return context.get_dummy_value()

        return types.void(target, place, source, index), emit

    function.__doc__ = f"Copy {size} float32 elements from `source` at `index` to `target` at `place`."
    return _intrinsic(function)


copy_three, copy_four = _copy(3), _copy(4)


@_intrinsic
def stream_f16(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write an F16 past the caches to the 16 float32 elements at `index`, which begin on a cache line."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        store = builder.store(args[2], pointer_to(context, builder, sig, args, f32_vector))
        store.align = 64
        store.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(_i32, 1)]))
        return context.get_dummy_value()

    return types.void(array, index, F16), emit


def _rows_of_four(context: Any, builder: Any, sig: Any, args: Any) -> list[Any]:
    """Pointers to four pixels in each of four image rows."""
    stride = context.cast(builder, args[2], sig.args[2], types.intp)
    index = context.cast(builder, args[1], sig.args[1], types.intp)
    array = context.make_array(sig.args[0])(context, builder, args[0])
    pointers = []
    for _ in range(4):
        pointers.append(builder.bitcast(builder.gep(array.data, [index]), _quarter.as_pointer()))
        index = builder.add(index, stride)
    return pointers


@_intrinsic
def load_block(typing_context: Any, array: Any, index: Any, stride: Any) -> Any:
    """F16 of the 4x4 pixels at `index` of a float32 image whose rows are `stride` apart."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        rows = []
        for pointer in _rows_of_four(context, builder, sig, args):
            row = builder.load(pointer)
            row.align = 4
            rows.append(row)
        eight = ir.Constant(ir.VectorType(_i32, 8), list(range(8)))
        upper, lower = (builder.shuffle_vector(rows[k], rows[k + 1], eight) for k in (0, 2))
        return builder.shuffle_vector(upper, lower, ir.Constant(i32_vector, list(range(LANES))))

    return F16(array, index, stride), emit


@_intrinsic
def store_block(typing_context: Any, array: Any, index: Any, stride: Any, value: Any) -> Any:
    """Write an F16 to the 4x4 pixels at `index` of a float32 image whose rows are `stride` apart."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        for k, pointer in enumerate(_rows_of_four(context, builder, sig, args)):
            lanes = ir.Constant(ir.VectorType(_i32, 4), list(range(4 * k, 4 * k + 4)))
            row = builder.shuffle_vector(args[3], ir.Constant(f32_vector, ir.Undefined), lanes)
            builder.store(row, pointer).align = 4
        return context.get_dummy_value()

    return types.void(array, index, stride, F16), emit


def _tuple_of(result: Any, arity: int, emit_values: Callable[[Any, Any], list[Any]], doc: str) -> Any:
    """An intrinsic of `arity` F16 values that gives a tuple of as many."""

    def signature(*values: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return context.make_tuple(builder, sig.return_type, emit_values(builder, list(args)))

        return result(*values), emit

    def three(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
        return signature(a, b, c)

    def four(typing_context: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
        return signature(a, b, c, d)

    function = three if arity == 3 else four
    function.__doc__ = doc
    return _intrinsic(function)


def _pick(builder: Any, sources: list[Any], places: list[tuple[int, int]]) -> Any:
    """Lanes (source, lane) of up to three vectors."""
    first = [lane + 16 * source if source < 2 else 0 for source, lane in places]
    value = shuffle_lanes(builder, sources[0], sources[1], first)
    if all(source < 2 for source, _ in places):
        return value
    second = [16 + lane if source == 2 else place for place, (source, lane) in enumerate(places)]
    return shuffle_lanes(builder, value, sources[2], second)


def _rows_to_columns_of_three(builder: Any, rows: list[Any]) -> list[Any]:
    """Number k of lane n stands at place 3 n + k of the three vectors in a row."""
    return [_pick(builder, rows, [divmod(3 * lane + k, 16) for lane in range(16)]) for k in range(3)]


def _columns_to_rows_of_three(builder: Any, columns: list[Any]) -> list[Any]:
    """Place p of the three vectors in a row gets number p mod 3 of lane p / 3."""
    return [
        _pick(builder, columns, [((16 * k + lane) % 3, (16 * k + lane) // 3) for lane in range(16)]) for k in range(3)
    ]


def _columns_to_rows_of_four(builder: Any, columns: list[Any]) -> list[Any]:
    """Alternate the numbers of two columns, then once more."""
    low = [lane // 2 + 16 * (lane & 1) for lane in range(16)]
    high = [lane + 8 for lane in low]
    a, b, c, d = columns
    out = []
    for lanes in (low, high):
        even, odd = shuffle_lanes(builder, a, c, lanes), shuffle_lanes(builder, b, d, lanes)
        out += [shuffle_lanes(builder, even, odd, low), shuffle_lanes(builder, even, odd, high)]
    return out


columns_of_three = _tuple_of(
    _three, 3, _rows_to_columns_of_three, "48 numbers x0 y0 z0 x1 .. in three F16 to the F16 of all x, all y and all z."
)
rows_of_three = _tuple_of(_three, 3, _columns_to_rows_of_three, "The inverse of `columns_of_three`.")
rows_of_four = _tuple_of(_four, 4, _columns_to_rows_of_four, "One F16 per column to 64 numbers in rows of four.")


@_intrinsic
def add_block_sums(typing_context: Any, array: Any, index: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Add the sums of the lanes of four F16 to the four float32 elements at `index`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = pointer_to(context, builder, sig, args, _quarter)
        sums = _halves(builder, _halves(builder, within_quarters(builder, *args[2:]), 16), 8)
        old = builder.load(pointer)
        old.align = 4
        builder.store(builder.fadd(old, sums), pointer).align = 4
        return context.get_dummy_value()

    return types.void(array, index, F16, F16, F16, F16), emit


def _halves(builder: Any, value: Any, lanes: int) -> Any:
    """Sum of the lower and the upper half of a vector of `lanes` lanes."""
    half = ir.VectorType(_i32, lanes // 2)
    undefined = ir.Constant(value.type, ir.Undefined)
    low, high = (
        builder.shuffle_vector(value, undefined, ir.Constant(half, list(range(first, first + lanes // 2))))
        for first in (0, lanes // 2)
    )
    return builder.fadd(low, high)
