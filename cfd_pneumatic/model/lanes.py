# SPDX-License-Identifier: Apache-2.0
"""
Lanes: eight numbers that a processor adds and multiplies at once.

Compiled functions calculate with lanes as with floats, and with both together: + - * /, comparisons, min, max, abs and
the square root. All lanes take the same path through a function. `where` chooses a value for each lane by a condition.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

from numba import types
from numba.core.cgutils import get_or_insert_function, ir, unpack_tuple  # type: ignore[attr-defined]  # as Numba has it
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

Build = Callable[..., Any]
"""Function that makes a value with LLVM's builder."""

COUNT = 8
"""Number of lanes."""


class _Lanes(types.Type):
    """Numba's type of lanes: a float in each."""


class _Flags(types.Type):
    """Numba's type of a comparison of lanes: a truth value in each."""


LANES, FLAGS = _Lanes('lanes'), _Flags('flags')
_INDEX = ir.IntType(32)
_FLOATS, _BITS, _TRUTHS = (ir.VectorType(kind, COUNT) for kind in (ir.DoubleType(), ir.IntType(64), ir.IntType(1)))
_FUSED = ('contract',)  # a product and a sum may be rounded once
# bits of a float: digits in the lower bits, above them the power of two
_DIGITS = 52
_BIAS = 1023
_TWO_TO_THE_DIGITS = 0x4330000000000000  # a float whose digits are a whole number
_ROOT_HALF = 0x3FE6A09E667F3BCD
_ONE = 0x3FF0000000000000


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, _FLOATS)


@register_model(_Flags)
class _FlagsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, _TRUTHS)


def _llvm_intrinsic(function: Any) -> Any:
    """Let compiled functions call a function that LLVM's builder makes."""
    return intrinsic(function)


def _llvm_intrinsic_of_constants(function: Any) -> Any:
    """Let compiled functions call a function that LLVM's builder makes from constant arguments."""
    return intrinsic(prefer_literal=True)(function)


@_llvm_intrinsic
def rows_address(typing_context: Any, numbers: types.Type) -> tuple[Any, Build]:
    """Return the address of an array of floats, for `load` and `store`; references to the address are not counted."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        return context.make_array(numbers)(context, builder, values[0]).data

    return types.CPointer(types.float64)(numbers), code


@_llvm_intrinsic
def load(typing_context: Any, numbers: types.Type, place: types.Type) -> tuple[Any, Build]:
    """Return the lanes at a place in an array of floats."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        return builder.load(_pointer(builder, values), align=8)

    return LANES(numbers, place), code


@_llvm_intrinsic_of_constants
def load_rows(typing_context: Any, numbers: types.Type, place: types.Type, count: Any) -> tuple[Any, Build]:
    """Return a constant number of consecutive lanes from a place in an array of floats."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        first = _pointer(builder, values)
        vectors = [builder.load(builder.gep(first, [_INDEX(rank)]), align=8) for rank in range(count.literal_value)]
        return context.make_tuple(builder, signature.return_type, vectors)

    return types.UniTuple(LANES, count.literal_value)(numbers, types.intp, count), code


@_llvm_intrinsic
def store(typing_context: Any, numbers: types.Type, place: types.Type, value: types.Type) -> tuple[Any, Build]:
    """Write lanes at a place in an array of floats, or a float into each lane; a tuple is written consecutively."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        first, kinds, parts = _pointer(builder, values), signature.args[2:], values[2:]
        if isinstance(value, types.BaseTuple):
            kinds, parts = kinds[0].types, unpack_tuple(builder, parts[0])
        for rank, vector in enumerate(_vectors(context, builder, kinds, parts)):
            builder.store(vector, builder.gep(first, [_INDEX(rank)]), align=8)
        return context.get_dummy_value()

    return types.none(numbers, place, value), code


@_llvm_intrinsic_of_constants
def load_floats(typing_context: Any, numbers: types.Type, place: types.Type, count: Any) -> tuple[Any, Build]:
    """Return a constant number of consecutive floats from a place in an array."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        first = builder.gep(context.make_array(numbers)(context, builder, values[0]).data, [values[1]])
        numbers_read = [builder.load(builder.gep(first, [_INDEX(rank)])) for rank in range(count.literal_value)]
        return context.make_tuple(builder, signature.return_type, numbers_read)

    return types.UniTuple(types.float64, count.literal_value)(numbers, types.intp, count), code


def _pointer(builder: ir.IRBuilder, values: Sequence[ir.Value]) -> ir.Value:
    return builder.bitcast(builder.gep(values[0], [values[1]]), _FLOATS.as_pointer())


def power_of_two(whole: float) -> float:
    """Return two to the power of a whole number from -1022 to 1023."""
    return math.ldexp(1.0, int(whole))


def exponent(x: float) -> float:
    """Return the power of two between a normal positive number and its `mantissa`, a whole number."""
    digits, power = math.frexp(x)
    return float(power if digits >= math.sqrt(0.5) else power - 1)


def mantissa(x: float) -> float:
    """Return a normal positive number scaled by a power of two to between sqrt(0.5) and sqrt(2)."""
    return math.ldexp(x, -int(exponent(x)))


def _kinds(value: ir.Value) -> tuple[ir.Type, ir.Type]:
    """Return LLVM's types of floats and of whole numbers, as lanes if the value is lanes."""
    return (_FLOATS, _BITS) if value.type == _FLOATS else (_FLOATS.element, _BITS.element)


def _constant(kind: ir.Type, number: float) -> ir.Constant:
    return kind([number] * COUNT) if kind in (_FLOATS, _BITS) else kind(number)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """Return `yes` where the condition is true, else `no`; chosen for each lane."""
    return yes if condition else no


def some(condition: Any) -> bool:
    """Return whether a condition is true in any lane; a computation that no lane needs can be skipped."""
    return bool(condition)


def _vectors(
    context: Any, builder: ir.IRBuilder, kinds: Sequence[types.Type], values: Sequence[ir.Value]
) -> list[ir.Value]:
    """Return values as LLVM's vectors; a float is copied into each lane."""
    return [
        value if kind in (LANES, FLAGS) else _broadcast(builder, context.cast(builder, value, kind, types.float64))
        for kind, value in zip(kinds, values)
    ]


def _broadcast(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    undefined = ir.Constant(_FLOATS, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INDEX, COUNT), None))


def _register_unary(function: Callable[..., Any], build: Build, kinds: Sequence[types.Type] = (LANES,)) -> None:
    """Register how LLVM's builder makes a function of one argument, lanes by default."""
    type_callable(function)(lambda context: lambda kind: kind if kind in kinds else None)
    for kind in kinds:
        lower_builtin(function, kind)(lambda context, builder, signature, values: build(builder, *values))


def _register_binary(function: Callable[..., Any], build: Build, result: types.Type = LANES) -> None:
    """Register how LLVM's builder makes a function of two arguments: lanes, or lanes and a float."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        return build(builder, *_vectors(context, builder, signature.args, values))

    type_callable(function)(lambda context: lambda first, second: result if LANES in (first, second) else None)
    for kinds in ((LANES, LANES), (LANES, types.Number), (types.Number, LANES)):
        lower_builtin(function, *kinds)(code)


def _library_call(name: str) -> Build:
    def build(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        kind = ir.FunctionType(_FLOATS, [_FLOATS])
        return builder.call(get_or_insert_function(builder.module, kind, f'llvm.{name}.v{COUNT}f64'), [value])

    return build


def _comparison(sign: str) -> Build:
    return lambda builder, first, second: builder.fcmp_ordered(sign, first, second)


def _selection(sign: str) -> Build:
    """Return a builder that selects the second number if it compares so with the first; a first NaN stays."""
    return lambda builder, first, second: builder.select(builder.fcmp_ordered(sign, second, first), second, first)


for _operator, _in_place, _build in (
    (operator.add, operator.iadd, lambda builder, first, second: builder.fadd(first, second, flags=_FUSED)),
    (operator.sub, operator.isub, lambda builder, first, second: builder.fsub(first, second, flags=_FUSED)),
    (operator.mul, operator.imul, lambda builder, first, second: builder.fmul(first, second, flags=_FUSED)),
    (operator.truediv, operator.itruediv, lambda builder, first, second: builder.fdiv(first, second)),
):
    _register_binary(_operator, _build)
    _register_binary(_in_place, _build)
_register_unary(operator.neg, lambda builder, value: builder.fsub(_constant(_FLOATS, -0.0), value))
_register_binary(operator.lt, _comparison('<'), FLAGS)
_register_binary(operator.le, _comparison('<='), FLAGS)
_register_binary(operator.gt, _comparison('>'), FLAGS)
_register_binary(operator.ge, _comparison('>='), FLAGS)
_register_binary(min, _selection('<'))
_register_binary(max, _selection('>'))
_register_unary(abs, _library_call('fabs'))
_register_unary(math.sqrt, _library_call('sqrt'))


@type_callable(where)
def _type_of_where(context: Any) -> Callable[..., types.Type]:
    return lambda condition, yes, no: LANES if condition == FLAGS else types.float64


@lower_builtin(where, FLAGS, types.Any, types.Any)
def _where_of_flags(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
    return builder.select(*_vectors(context, builder, signature.args, values))


@lower_builtin(where, types.Boolean, types.Number, types.Number)
def _where(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
    yes, no = (context.cast(builder, value, kind, types.float64) for kind, value in zip(signature.args[1:], values[1:]))
    return builder.select(values[0], yes, no)


@type_callable(some)
def _type_of_some(context: Any) -> Callable[..., types.Type]:
    return lambda condition: types.boolean


@lower_builtin(some, FLAGS)
def _some_of_flags(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
    flags = builder.bitcast(values[0], ir.IntType(COUNT))
    return builder.icmp_unsigned('!=', flags, flags.type(0))


@lower_builtin(some, types.Boolean)
def _some(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
    return values[0]


def _power_of_two(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    number, bits = _kinds(value)
    digits = builder.bitcast(builder.fadd(value, _constant(number, 1.5 * 2.0**_DIGITS)), bits)
    return builder.bitcast(builder.shl(builder.add(digits, _constant(bits, _BIAS)), _constant(bits, _DIGITS)), number)


def _exponent(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    number, bits = _kinds(value)
    power = builder.lshr(_above_root_half(builder, value), _constant(bits, _DIGITS))
    shifted = builder.bitcast(builder.or_(power, _constant(bits, _TWO_TO_THE_DIGITS)), number)
    return builder.fsub(shifted, _constant(number, 2.0**_DIGITS + _BIAS))


def _mantissa(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    number, bits = _kinds(value)
    digits = builder.and_(_above_root_half(builder, value), _constant(bits, 2**_DIGITS - 1))
    return builder.bitcast(builder.add(digits, _constant(bits, _ROOT_HALF)), number)


def _above_root_half(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    _, bits = _kinds(value)
    return builder.add(builder.bitcast(value, bits), _constant(bits, _ONE - _ROOT_HALF))


for _function, _build_from_bits in ((power_of_two, _power_of_two), (exponent, _exponent), (mantissa, _mantissa)):
    _register_unary(_function, _build_from_bits, (LANES, types.float64))
