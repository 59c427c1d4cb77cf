# SPDX-License-Identifier: Apache-2.0
"""
Lanes: eight numbers that a processor adds and multiplies at once.

Compiled functions calculate with lanes as with floats, and with both together: + - * /, comparisons, min, max, abs and
the square root. All lanes go the same way through a function: where they differ, `where` chooses for each of them.
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
"""Makes a value with LLVM's builder."""

COUNT = 8
"""How many stand side by side."""


class _Lanes(types.Type):
    """Floats side by side."""


class _Flags(types.Type):
    """Truths side by side: what comparing lanes gives."""


LANES, FLAGS = _Lanes('lanes'), _Flags('flags')
_INDEX = ir.IntType(32)
_FLOATS, _BITS, _TRUTHS = (ir.VectorType(one, COUNT) for one in (ir.DoubleType(), ir.IntType(64), ir.IntType(1)))
_FUSED = ('contract',)  # a product and a sum may be rounded once
# how a float stands in its bits: digits in the lower ones, above them the power of two
_DIGITS = 52
_BIAS = 1023
_TWO_TO_THE_DIGITS = 0x4330000000000000  # a float whose digits are a whole number
_ROOT_HALF = 0x3FE6A09E667F3BCD
_ONE = 0x3FF0000000000000


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, own: types.Type) -> None:
        super().__init__(manager, own, _FLOATS)


@register_model(_Flags)
class _FlagsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, own: types.Type) -> None:
        super().__init__(manager, own, _TRUTHS)


def _built(function: Any) -> Any:
    """Let compiled functions call a function that LLVM's builder makes."""
    return intrinsic(function)


def _built_by_constants(function: Any) -> Any:
    """Do the same for one that has to know constants among what it takes."""
    return intrinsic(prefer_literal=True)(function)


@_built
def rows_of(typing_context: Any, numbers: types.Type) -> tuple[Any, Build]:
    """Return where an array of floats stands, for `load` and `store`: nobody counts who refers to that."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        return context.make_array(numbers)(context, builder, values[0]).data

    return types.CPointer(types.float64)(numbers), code


@_built
def load(typing_context: Any, numbers: types.Type, place: types.Type) -> tuple[Any, Build]:
    """Return the lanes that stand in an array of floats from a place on."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        return builder.load(_pointer(builder, values), align=8)

    return LANES(numbers, place), code


@_built_by_constants
def loads(typing_context: Any, numbers: types.Type, place: types.Type, count: Any) -> tuple[Any, Build]:
    """Return as many lanes as a constant says, which stand one behind another in an array of floats from a place on."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        first = _pointer(builder, values)
        each = [builder.load(builder.gep(first, [_INDEX(rank)]), align=8) for rank in range(count.literal_value)]
        return context.make_tuple(builder, signature.return_type, each)

    return types.UniTuple(LANES, count.literal_value)(numbers, types.intp, count), code


@_built
def store(typing_context: Any, numbers: types.Type, place: types.Type, value: types.Type) -> tuple[Any, Build]:
    """Put lanes into an array of floats from a place on, or a float into each of them; several one behind another."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        first, kinds, each = _pointer(builder, values), signature.args[2:], values[2:]
        if isinstance(value, types.BaseTuple):
            kinds, each = kinds[0].types, unpack_tuple(builder, each[0])
        for rank, vector in enumerate(_vectors(context, builder, kinds, each)):
            builder.store(vector, builder.gep(first, [_INDEX(rank)]), align=8)
        return context.get_dummy_value()

    return types.none(numbers, place, value), code


@_built_by_constants
def floats(typing_context: Any, numbers: types.Type, place: types.Type, count: Any) -> tuple[Any, Build]:
    """Return as many floats as a constant says, which stand one behind another in an array from a place on."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        first = builder.gep(context.make_array(numbers)(context, builder, values[0]).data, [values[1]])
        each = [builder.load(builder.gep(first, [_INDEX(rank)])) for rank in range(count.literal_value)]
        return context.make_tuple(builder, signature.return_type, each)

    return types.UniTuple(types.float64, count.literal_value)(numbers, types.intp, count), code


def _pointer(builder: ir.IRBuilder, values: Sequence[ir.Value]) -> ir.Value:
    return builder.bitcast(builder.gep(values[0], [values[1]]), _FLOATS.as_pointer())


def power_of_two(whole: float) -> float:
    """Return two to the power of whole numbers from -1022 to 1023."""
    return math.ldexp(1.0, int(whole))


def exponent(x: float) -> float:
    """Return the whole power of two by which normal positive numbers differ from their `mantissa`."""
    digits, power = math.frexp(x)
    return float(power if digits >= math.sqrt(0.5) else power - 1)


def mantissa(x: float) -> float:
    """Return normal positive numbers times the power of two that brings them between the roots of a half and of two."""
    return math.ldexp(x, -int(exponent(x)))


def _kinds(value: ir.Value) -> tuple[ir.Type, ir.Type]:
    """Return LLVM's types of floats and of whole numbers, of lanes or one of each, as a value is."""
    return (_FLOATS, _BITS) if value.type == _FLOATS else (_FLOATS.element, _BITS.element)


def _all(kind: ir.Type, number: float) -> ir.Constant:
    return kind([number] * COUNT) if kind in (_FLOATS, _BITS) else kind(number)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """Return one of two numbers, in each lane by its own condition."""
    return yes if condition else no


def some(condition: Any) -> bool:
    """Tell whether something is true in some lane: what none needs can be left out."""
    return bool(condition)


def _vectors(
    context: Any, builder: ir.IRBuilder, kinds: Sequence[types.Type], values: Sequence[ir.Value]
) -> list[ir.Value]:
    """Return values as LLVM's vectors, a float in each lane."""
    return [
        value if kind in (LANES, FLAGS) else _spread(builder, context.cast(builder, value, kind, types.float64))
        for kind, value in zip(kinds, values)
    ]


def _spread(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    nowhere = ir.Constant(_FLOATS, ir.Undefined)
    first = builder.insert_element(nowhere, value, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, nowhere, ir.Constant(ir.VectorType(_INDEX, COUNT), None))


def _of_one(function: Callable[..., Any], build: Build, kinds: Sequence[types.Type] = (LANES,)) -> None:
    """Let compiled functions call a function with lanes, or with what else it takes, as LLVM's builder makes it."""
    type_callable(function)(lambda context: lambda own: own if own in kinds else None)
    for kind in kinds:
        lower_builtin(function, kind)(lambda context, builder, signature, values: build(builder, *values))


def _of_two(function: Callable[..., Any], build: Build, result: types.Type = LANES) -> None:
    """Let compiled functions call a function with lanes twice, or with lanes and a float."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
        return build(builder, *_vectors(context, builder, signature.args, values))

    type_callable(function)(lambda context: lambda one, other: result if LANES in (one, other) else None)
    for kinds in ((LANES, LANES), (LANES, types.Number), (types.Number, LANES)):
        lower_builtin(function, *kinds)(code)


def _of_library(name: str) -> Build:
    def build(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        kind = ir.FunctionType(_FLOATS, [_FLOATS])
        return builder.call(get_or_insert_function(builder.module, kind, f'llvm.{name}.v{COUNT}f64'), [value])

    return build


def _comparison(sign: str) -> Build:
    return lambda builder, one, other: builder.fcmp_ordered(sign, one, other)


def _preferred(sign: str) -> Build:
    """Return what chooses the second of two numbers where it compares so with the first; so a first NaN stays."""
    return lambda builder, one, other: builder.select(builder.fcmp_ordered(sign, other, one), other, one)


for _one, _in_place, _build in (
    (operator.add, operator.iadd, lambda builder, one, other: builder.fadd(one, other, flags=_FUSED)),
    (operator.sub, operator.isub, lambda builder, one, other: builder.fsub(one, other, flags=_FUSED)),
    (operator.mul, operator.imul, lambda builder, one, other: builder.fmul(one, other, flags=_FUSED)),
    (operator.truediv, operator.itruediv, lambda builder, one, other: builder.fdiv(one, other)),
):
    _of_two(_one, _build)
    _of_two(_in_place, _build)
_of_one(operator.neg, lambda builder, value: builder.fsub(_all(_FLOATS, -0.0), value))
_of_two(operator.lt, _comparison('<'), FLAGS)
_of_two(operator.le, _comparison('<='), FLAGS)
_of_two(operator.gt, _comparison('>'), FLAGS)
_of_two(operator.ge, _comparison('>='), FLAGS)
_of_two(min, _preferred('<'))
_of_two(max, _preferred('>'))
_of_one(abs, _of_library('fabs'))
_of_one(math.sqrt, _of_library('sqrt'))


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
    together = builder.bitcast(values[0], ir.IntType(COUNT))
    return builder.icmp_unsigned('!=', together, together.type(0))


@lower_builtin(some, types.Boolean)
def _some(context: Any, builder: ir.IRBuilder, signature: Any, values: Sequence[ir.Value]) -> ir.Value:
    return values[0]


def _power_of_two(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    number, bits = _kinds(value)
    digits = builder.bitcast(builder.fadd(value, _all(number, 1.5 * 2.0**_DIGITS)), bits)
    return builder.bitcast(builder.shl(builder.add(digits, _all(bits, _BIAS)), _all(bits, _DIGITS)), number)


def _exponent(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    number, bits = _kinds(value)
    power = builder.lshr(_above_root_half(builder, value), _all(bits, _DIGITS))
    shifted = builder.bitcast(builder.or_(power, _all(bits, _TWO_TO_THE_DIGITS)), number)
    return builder.fsub(shifted, _all(number, 2.0**_DIGITS + _BIAS))


def _mantissa(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    number, bits = _kinds(value)
    digits = builder.and_(_above_root_half(builder, value), _all(bits, 2**_DIGITS - 1))
    return builder.bitcast(builder.add(digits, _all(bits, _ROOT_HALF)), number)


def _above_root_half(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    _, bits = _kinds(value)
    return builder.add(builder.bitcast(value, bits), _all(bits, _ONE - _ROOT_HALF))


for _function, _of_bits in ((power_of_two, _power_of_two), (exponent, _exponent), (mantissa, _mantissa)):
    _of_one(_function, _of_bits, (LANES, types.float64))
