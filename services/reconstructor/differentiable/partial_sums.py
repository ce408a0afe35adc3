"""Sums over the lanes of many F16 values (see `readygo.common.simd.types`), taken only in the end.

Until then a sum is kept in as many parts as a register of this machine has lanes, so that a dozen of them fit into its
registers: those of AVX2 hold eight, to which both halves of an F16 are added. Results of machines with other registers
therefore differ by what rounding does.

`totals` adds the lanes of sixteen sums at once. Adding two shuffles of a pair of vectors halves the lanes of both,
which then share one vector: after four rounds every lane is a whole sum. A reduction of each alone would take four
rounds each.
"""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, models, register_model

from readygo.common.simd.memory import per_quarter
from readygo.common.simd.types import F16, LANES, call_llvm, f32_vector, fuses_multiply_adds, register_lanes

_i32 = ir.IntType(32)
_intrinsic: Any = intrinsic
SUMS = 11
"""Sums that are taken together."""


def place_of(number: int) -> int:
    """The lane in which `totals` has a sum."""
    return 4 * (number % 4) + number // 4


class PartialSumType(types.Type):
    """Numba type of a sum in parts."""

    def __init__(self) -> None:
        super().__init__(name="PartialSum")


PartialSum = PartialSumType()


def _register() -> ir.VectorType:
    return ir.VectorType(ir.FloatType(), register_lanes())


class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _register())  # type: ignore[no-untyped-call]


register_model(PartialSumType)(_Model)


def _shuffle(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_i32, len(lanes)), lanes))


def _registers(builder: Any, value: Any) -> list[Any]:
    """The F16 as registers."""
    size = register_lanes()
    undefined = ir.Constant(f32_vector, ir.Undefined)
    return [_shuffle(builder, value, undefined, list(range(k, k + size))) for k in range(0, LANES, size)]


@_intrinsic
def no_sum(typing_context: Any) -> Any:
    """A sum of nothing."""
    return PartialSum(), lambda context, builder, sig, args: ir.Constant(_register(), None)


@_intrinsic
def add(typing_context: Any, total: Any, x: Any) -> Any:
    """`total` with the lanes of the F16 `x`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = args[0]
        for part in _registers(builder, args[1]):
            value = builder.fadd(value, part)
        return value

    return PartialSum(PartialSum, F16), emit


@_intrinsic
def add_product(typing_context: Any, total: Any, a: Any, b: Any) -> Any:
    """`total` with the products of the lanes of the F16 `a` and `b`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = args[0]
        for x, y in zip(*(_registers(builder, arg) for arg in args[1:]), strict=True):
            if fuses_multiply_adds():
                value = call_llvm(builder, f"llvm.fma.v{register_lanes()}f32", _register(), [x, y, value])
            else:
                value = builder.fadd(builder.fmul(x, y), value)
        return value

    return PartialSum(PartialSum, F16, F16), emit


def _merge_lanes(builder: Any, a: Any, b: Any, near: list[int], far: list[int]) -> Any:
    """Sum of two shuffles of a pair of vectors."""
    return builder.fadd(_shuffle(builder, a, b, near), _shuffle(builder, a, b, far))


def _lanes_of(size: int, *picks: int) -> list[int]:
    """Runs of `size` lanes."""
    return [size * pick + lane for pick in picks for lane in range(size)]


def _by_quarters(builder: Any, sums: list[Any]) -> Any:
    """Merge as many sums as a register has quarters, a quarter of the lanes each.

    Halves (two sums) or quarters (four sums) of each are added, until each has 4 lanes, one after the other.
    """
    if len(sums) == 2:
        return _merge_lanes(builder, sums[0], sums[1], _lanes_of(4, 0, 2), _lanes_of(4, 1, 3))
    ab, cd = (_merge_lanes(builder, sums[k], sums[k + 1], _lanes_of(8, 0, 2), _lanes_of(8, 1, 3)) for k in (0, 2))
    return _merge_lanes(builder, ab, cd, _lanes_of(4, 0, 2, 4, 6), _lanes_of(4, 1, 3, 5, 7))


def within_quarters(builder: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """LLVM value in which lane k of each 128-bit quarter is the sum of that quarter of the k-th vector."""
    quarters = range(a.type.count // 4)

    def pick(*lanes: int) -> list[int]:
        # `per_quarter` counts the second vector's lanes from 16 on.
        all_lanes = per_quarter(*lanes)[: 4 * len(quarters)]
        return [lane if lane < LANES else lane - LANES + a.type.count for lane in all_lanes]

    # Per quarter: a0 + a2, b0 + b2, a1 + a3, b1 + b3, then the sums of a, b, c, d.
    ab, cd = (_merge_lanes(builder, *pair, pick(0, 16, 1, 17), pick(2, 18, 3, 19)) for pair in ((a, b), (c, d)))
    return _merge_lanes(builder, ab, cd, pick(0, 1, 16, 17), pick(2, 3, 18, 19))


def _totals(builder: Any, sums: list[Any]) -> Any:
    """The whole sums, sum n in lane `place_of(n)`; those that are missing to sixteen are zero."""
    zero = ir.Constant(_register(), None)
    sums = [*sums, *[zero] * (LANES - len(sums))]
    quarters = register_lanes() // 4
    rows = [
        within_quarters(
            builder, *(_by_quarters(builder, sums[4 * k + first : 4 * k + first + quarters]) for k in range(4))
        )
        for first in range(0, 4, quarters)
    ]
    return rows[0] if len(rows) == 1 else _shuffle(builder, rows[0], rows[1], list(range(LANES)))


@_intrinsic
def totals(
    typing_context: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, i: Any, j: Any, k: Any
) -> Any:
    """F16 with the whole sums, see `place_of`; the other lanes are zero."""
    return F16(*[PartialSum] * SUMS), lambda context, builder, sig, args: _totals(builder, list(args))
