"""Sixteen-lane SIMD values for numba kernels: F16 (float32), I16 (int32) and M16 (mask).

Every operation is one IEEE-754 operation per lane: no fast-math flags, so no contraction, no reciprocal estimates and
no reassociation. Kernels that fuse a multiply and an add say so with `fma`. AVX2 and AVX-512 machines therefore compute
the same bits; x86-64 machines without fused multiply-adds round twice (see `fuses_multiply_adds`).

Shuffles and memory access are in `memory`.

How it works: a value is one LLVM vector (<16 x float>, <16 x i32>, <16 x i1>), which LLVM splits into the registers of
the machine: one of AVX-512, two of AVX2. An `@intrinsic` gets the types of its arguments from numba and returns its
signature and a function that emits LLVM instructions; names there:

    context, builder    numba's target context and llvmlite's builder of instructions
    sig, args           numba types and LLVM values of the arguments; scalars among them are splatted to all lanes
    splat               a scalar in every lane: put into lane 0 of an undefined vector, which is then shuffled
    mask                one bit per lane; `mask_bits` makes an integer of it, lane 0 the lowest bit

Source: LLVM language reference, https://llvm.org/docs/LangRef.html.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 16
f32_vector = ir.VectorType(ir.FloatType(), LANES)
i32_vector = ir.VectorType(ir.IntType(32), LANES)
bit_vector = ir.VectorType(ir.IntType(1), LANES)
_i32 = ir.IntType(32)
# Any: the stubs of numba describe intrinsics as methods of their typing context.
_intrinsic: Any = intrinsic
_type_callable: Any = type_callable
_lower_builtin: Any = lower_builtin


class F16Type(types.Type):
    """Sixteen float32 lanes."""

    def __init__(self) -> None:
        super().__init__(name="F16")


class I16Type(types.Type):
    """Sixteen int32 lanes."""

    def __init__(self) -> None:
        super().__init__(name="I16")


class M16Type(types.Type):
    """Sixteen booleans."""

    def __init__(self) -> None:
        super().__init__(name="M16")


F16, I16, M16 = F16Type(), I16Type(), M16Type()


def _register(vector_type: type, llvm_type: ir.Type) -> None:
    """Tell numba that values of a type are LLVM vectors, passed around like numbers."""

    class Model(models.PrimitiveModel):
        def __init__(self, manager: Any, numba_type: Any) -> None:
            super().__init__(manager, numba_type, llvm_type)  # type: ignore[no-untyped-call]

    register_model(vector_type)(Model)


for _vector_type, _llvm_type in ((F16Type, f32_vector), (I16Type, i32_vector), (M16Type, bit_vector)):
    _register(_vector_type, _llvm_type)


def splat(builder: Any, scalar: Any, vector: ir.VectorType) -> Any:
    """LLVM value with `scalar` in every lane."""
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.Constant(_i32, 0))
    lanes = ir.Constant(ir.VectorType(_i32, LANES), [0] * LANES)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), lanes)


def call_llvm(builder: Any, name: str, result: Any, args: list[Any]) -> Any:
    """Call the LLVM intrinsic `name`."""
    function = builder.module.globals.get(name)
    if function is None:
        function = ir.Function(builder.module, ir.FunctionType(result, [arg.type for arg in args]), name)
    return builder.call(function, args)


def as_f32(context: Any, builder: Any, numba_type: Any, value: Any) -> Any:
    """A float32 vector of an F16 or of a scalar."""
    if isinstance(numba_type, F16Type):
        return value
    return splat(builder, context.cast(builder, value, numba_type, types.float32), f32_vector)


def as_i32(context: Any, builder: Any, numba_type: Any, value: Any) -> Any:
    """An int32 vector of an I16 or of a scalar."""
    if isinstance(numba_type, I16Type):
        return value
    return splat(builder, context.cast(builder, value, numba_type, types.int32), i32_vector)


def _define_operator(op: Any, vector: Any, widen: Any, result: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Make `op` work on two vectors and on a vector and a scalar."""
    scalar = types.Number

    @_type_callable(op)
    def _type(context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            kinds = (type(vector), scalar)
            if isinstance(a, kinds) and isinstance(b, kinds) and not (isinstance(a, scalar) and isinstance(b, scalar)):
                return result
            return None

        return typer

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (widen(context, builder, kind, arg) for kind, arg in zip(sig.args, args, strict=True))
        return emit(builder, a, b)

    for kinds in ((type(vector), type(vector)), (type(vector), scalar), (scalar, type(vector))):
        _lower_builtin(op, *kinds)(lower)


def _method(name: str) -> Callable[[Any, Any, Any], Any]:
    """Emits the builder's instruction `name`."""
    return lambda builder, x, y: getattr(builder, name)(x, y)


def _float_compare(predicate: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, x, y: builder.fcmp_ordered(predicate, x, y)


def _integer_compare(predicate: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, x, y: builder.icmp_signed(predicate, x, y)


for _op, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define_operator(_op, F16, as_f32, F16, _method(_name))
for _op, _name in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _define_operator(_op, F16, as_f32, M16, _float_compare(_name))
    _define_operator(_op, I16, as_i32, M16, _integer_compare(_name))
for _op, _name in (
    (operator.add, "add"),
    (operator.sub, "sub"),
    (operator.mul, "mul"),
    (operator.and_, "and_"),
    (operator.or_, "or_"),
    (operator.lshift, "shl"),
    (operator.rshift, "ashr"),
):
    _define_operator(_op, I16, as_i32, I16, _method(_name))


@_type_callable(operator.and_)
def _type_mask_and(context: Any) -> Any:
    return lambda a, b: M16 if isinstance(a, M16Type) and isinstance(b, M16Type) else None


@_lower_builtin(operator.and_, M16Type, M16Type)
def _lower_mask_and(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.and_(*args)


@_intrinsic
def f16(typing_context: Any, x: Any) -> Any:
    """F16 with the scalar `x` in every lane."""
    return F16(x), lambda context, builder, sig, args: as_f32(context, builder, sig.args[0], args[0])


@_intrinsic
def i16(typing_context: Any, x: Any) -> Any:
    """I16 with the scalar `x` in every lane."""
    return I16(x), lambda context, builder, sig, args: as_i32(context, builder, sig.args[0], args[0])


def fuses_multiply_adds() -> bool:
    """True if kernels round `fma` once: the machine that numba compiles for can, or is no x86-64 machine.

    Without the instruction, LLVM would call a library function per lane.
    """
    return "+fma" in _cpu_features() or not _is_x86()


def register_lanes() -> int:
    """Float32 lanes of a register of the machine that numba compiles for; 8 or 16, as kernels hold nothing smaller."""
    return LANES if "+avx512f" in _cpu_features() else 8


def _cpu_features() -> list[str]:
    _, _, features = cpu_target.target_context.codegen().magic_tuple()
    names: list[str] = features.split(",")
    return names


def _is_x86() -> bool:
    triple, _, _ = cpu_target.target_context.codegen().magic_tuple()
    return bool(triple.startswith(("x86_64", "i686")))


def _multiply_add(doc: str, negate: int) -> Any:
    """The intrinsic a * b + c with argument `negate` negated first; 3: none of them."""

    def function(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            vectors = [as_f32(context, builder, kind, arg) for kind, arg in zip(sig.args, args, strict=True)]
            x, y, z = (builder.fneg(v) if place == negate else v for place, v in enumerate(vectors))
            if fuses_multiply_adds():
                return call_llvm(builder, "llvm.fma.v16f32", f32_vector, [x, y, z])
            return builder.fadd(builder.fmul(x, y), z)

        return F16(a, b, c), emit

    function.__doc__ = doc
    return _intrinsic(function)


fma = _multiply_add("`a * b + c`; arguments are F16 or scalars; rounded once where the machine can.", 3)
fms = _multiply_add("`a * b - c`, see `fma`.", 2)
fnma = _multiply_add("`c - a * b`, see `fma`.", 0)


def _unary(name: str, doc: str) -> Any:
    def function(typing_context: Any, x: Any) -> Any:
        return F16(F16), lambda context, builder, sig, args: call_llvm(builder, name, f32_vector, list(args))

    function.__doc__ = doc
    return _intrinsic(function)


sqrt = _unary("llvm.sqrt.v16f32", "Square root.")


def _choose(predicate: str, doc: str) -> Any:
    def function(typing_context: Any, a: Any, b: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            x, y = (as_f32(context, builder, kind, arg) for kind, arg in zip(sig.args, args, strict=True))
            # x < y ? x : y is what MINPS and MAXPS do: an ordered comparison is false where either is NaN.
            return builder.select(builder.fcmp_ordered(predicate, x, y), x, y)

        return F16(a, b), emit

    function.__doc__ = doc
    return _intrinsic(function)


minimum = _choose("<", "Smaller of `a` and `b` (F16 or scalars); `b` where either is NaN.")
maximum = _choose(">", "Larger of `a` and `b` (F16 or scalars); `b` where either is NaN.")


@_intrinsic
def where(typing_context: Any, mask: Any, a: Any, b: Any) -> Any:
    """`a` where `mask` holds, else `b`; F16 or scalars."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (as_f32(context, builder, kind, arg) for kind, arg in zip(sig.args[1:], args[1:], strict=True))
        return builder.select(args[0], x, y)

    return F16(mask, a, b), emit


@_intrinsic
def integer_minimum(typing_context: Any, a: Any, b: Any) -> Any:
    """Smaller of `a` and `b` (I16 or scalars)."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (as_i32(context, builder, kind, arg) for kind, arg in zip(sig.args, args, strict=True))
        return builder.select(builder.icmp_signed("<", x, y), x, y)

    return I16(a, b), emit


@_intrinsic
def integer_where(typing_context: Any, mask: Any, a: Any, b: Any) -> Any:
    """`a` where `mask` holds, else `b`; I16 or scalars."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (as_i32(context, builder, kind, arg) for kind, arg in zip(sig.args[1:], args[1:], strict=True))
        return builder.select(args[0], x, y)

    return I16(mask, a, b), emit


@_intrinsic
def truncate(typing_context: Any, x: Any) -> Any:
    """F16 to I16, towards zero; lanes beyond int32 are undefined and must be masked out."""
    return I16(F16), lambda context, builder, sig, args: builder.fptosi(args[0], i32_vector)


@_intrinsic
def to_float(typing_context: Any, x: Any) -> Any:
    """I16 to F16, rounded to the nearest float32."""
    return F16(I16), lambda context, builder, sig, args: builder.sitofp(args[0], f32_vector)


@_intrinsic
def bit_pattern(typing_context: Any, x: Any) -> Any:
    """The bits of an F16 as I16."""
    return I16(F16), lambda context, builder, sig, args: builder.bitcast(args[0], i32_vector)


@_intrinsic
def float_of_bits(typing_context: Any, x: Any) -> Any:
    """The F16 whose bits are an I16."""
    return F16(I16), lambda context, builder, sig, args: builder.bitcast(args[0], f32_vector)


@_intrinsic
def mask_bits(typing_context: Any, mask: Any) -> Any:
    """The mask as an int64; lane 0 is the lowest bit."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(M16), emit


@_intrinsic
def holds_somewhere(typing_context: Any, mask: Any) -> Any:
    """True if the mask holds in a lane."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call_llvm(builder, "llvm.vector.reduce.or.v16i1", ir.IntType(1), list(args))

    return types.boolean(M16), emit


@_intrinsic
def has_bit(typing_context: Any, value: Any, bits: Any) -> Any:
    """Lanes of the I16 `value` that share a set bit with the scalar `bits`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        common = builder.and_(args[0], as_i32(context, builder, sig.args[1], args[1]))
        return builder.icmp_signed("!=", common, ir.Constant(i32_vector, None))

    return M16(value, bits), emit


@_intrinsic
def lane_number(typing_context: Any) -> Any:
    """I16 of 0, 1, .. 15."""
    return I16(), lambda context, builder, sig, args: ir.Constant(i32_vector, list(range(LANES)))


@_intrinsic
def count_bits(typing_context: Any, bits: Any) -> Any:
    """Number of set bits of an int64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call_llvm(builder, "llvm.ctpop.i64", ir.IntType(64), list(args))

    return types.int64(types.int64), emit


@_intrinsic
def lowest_bit(typing_context: Any, bits: Any) -> Any:
    """Index of the lowest set bit of an int64 that is not 0."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call_llvm(builder, "llvm.cttz.i64", ir.IntType(64), [args[0], ir.Constant(ir.IntType(1), 1)])

    return types.int64(types.int64), emit


@_intrinsic
def float_bits(typing_context: Any, x: Any) -> Any:
    """The bits of a scalar float32 as an int64 in 0..2^32."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], _i32), ir.IntType(64))

    return types.int64(types.float32), emit


@_intrinsic
def float_with_bits(typing_context: Any, bits: Any) -> Any:
    """The scalar float32 whose bits are the lowest 32 of an int64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.bitcast(builder.trunc(args[0], _i32), ir.FloatType())

    return types.float32(types.int64), emit
