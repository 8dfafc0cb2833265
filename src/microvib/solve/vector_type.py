"""Numba types of lanes (``microvib.solve.vector``) and the functions on them."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_model,
)

from microvib.solve.vector import (
    WIDTH,
    exp,
    exponent,
    floor,
    nearest,
    picked,
    rows,
    sincos,
    some,
    where,
)

CALLED: Any = {"error_model": "numpy", "fastmath": {"contract", "arcp"}, "forceinline": True}
"""How an overload is compiled: like the kernel that calls it."""

_DOUBLE, _WORD, _BIT = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
_DOUBLES, _WORDS, _BITS = (ir.VectorType(of, WIDTH) for of in (_DOUBLE, _WORD, _BIT))


class _Lanes(types.Type):
    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        return Conversion.safe if other == types.float64 else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        return self if other == types.float64 else None


class _Mask(types.Type):
    pass


class _Rows(types.Type):
    pass


LANES, MASK, ROWS = _Lanes("Lanes"), _Mask("Mask"), _Rows("Rows")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


@register_model(_Rows)
class _RowsModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        members = [
            ("data", types.CPointer(types.float64)),
            ("size", types.intp),
            ("columns", types.intp),
        ]
        super().__init__(manager, kind, members)


make_attribute_wrapper(_Rows, "size", "size")


def _same(value: float) -> Any:
    return ir.Constant(_DOUBLES, [float(value)] * WIDTH)


def _splat(builder: Any, value: Any) -> Any:
    one = builder.insert_element(
        ir.Constant(_DOUBLES, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
    )
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), None))


@lower_cast(types.float64, LANES)
def _cast(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return _splat(builder, value)


def _define(
    function: Any, result: Any, arguments: tuple[Any, ...], build: Callable[..., Any]
) -> None:
    """Define ``function`` for these types by the instructions that ``build(builder, *values)``
    emits.
    """

    def lower(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return build(builder, *values)

    lower_builtin(function, *arguments)(lower)
    infer_global(function)(
        type("Template", (ConcreteTemplate,), {"cases": [signature(result, *arguments)]})
    )


def _call(name: str) -> Callable[..., Any]:
    """LLVM's intrinsic of that name, for vectors."""

    def build(builder: Any, *values: Any) -> Any:
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES] * len(values))
        called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
        return builder.call(called, values)

    return build


def _power(builder: Any, base: Any, exponent: Any) -> Any:
    """Lane by lane, for the processor has no such instruction; it is rarely needed."""
    kind = ir.FunctionType(_DOUBLE, [_DOUBLE, _DOUBLE])
    called = cgutils.get_or_insert_function(builder.module, kind, "llvm.pow.f64")
    result = ir.Constant(_DOUBLES, ir.Undefined)
    for k in range(WIDTH):
        lane = ir.Constant(ir.IntType(32), k)
        pair = [builder.extract_element(base, lane), builder.extract_element(exponent, lane)]
        result = builder.insert_element(result, builder.call(called, pair), lane)
    return result


def _two_to(builder: Any, n: Any) -> Any:
    """2^n for whole n, |n| < 1000: adding 1.5 x 2^52 + 1023 leaves n + 1023 in the lowest bits,
    which shift to the exponent.
    """
    words = builder.bitcast(builder.fadd(n, _same(1.5 * 2.0**52 + 1023.0)), _WORDS)
    return builder.bitcast(builder.shl(words, ir.Constant(_WORDS, [52] * WIDTH)), _DOUBLES)


# before that for lanes, which a number may become
_define(
    floor,
    types.float64,
    (types.float64,),
    lambda builder, x: builder.call(builder.module.declare_intrinsic("llvm.floor", [_DOUBLE]), [x]),
)

_function: Any
for _function, _build in (
    (operator.add, ir.IRBuilder.fadd),
    (operator.sub, ir.IRBuilder.fsub),
    (operator.mul, ir.IRBuilder.fmul),
    (operator.truediv, ir.IRBuilder.fdiv),
    (operator.pow, _power),
    (math.copysign, _call("copysign")),
):
    _define(_function, LANES, (LANES, LANES), _build)
for _function in (operator.iadd, operator.isub, operator.imul):
    _define(_function, LANES, (LANES, LANES), getattr(ir.IRBuilder, "f" + _function.__name__[1:]))
for _function, _build in (
    (operator.neg, lambda builder, x: builder.fsub(_same(-0.0), x)),
    (math.fabs, _call("fabs")),
    (math.sqrt, _call("sqrt")),
    (floor, _call("floor")),
    (nearest, _call("rint")),
    (exponent, _two_to),
):
    _define(_function, LANES, (LANES,), _build)
for _function, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _define(
        _function,
        MASK,
        (LANES, LANES),
        lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b),
    )
_define(operator.ne, MASK, (LANES, LANES), lambda builder, a, b: builder.fcmp_unordered("!=", a, b))
_define(operator.and_, MASK, (MASK, MASK), ir.IRBuilder.and_)
_define(operator.or_, MASK, (MASK, MASK), ir.IRBuilder.or_)
_define(where, LANES, (MASK, LANES, LANES), ir.IRBuilder.select)
_define(where, types.float64, (types.boolean, types.float64, types.float64), ir.IRBuilder.select)
_define(where, LANES, (types.boolean, LANES, LANES), ir.IRBuilder.select)


_define(some, types.boolean, (types.boolean,), lambda builder, condition: condition)
_define(some, types.boolean, (MASK,), lambda builder, condition: ir.Constant(_BIT, 1))


# pi/2 and log 2 as sums of parts (Cody-Waite); the first have so few bits that their products with
# n < 2^20 are exact
_PI_1, _PI_2, _PI_3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
_LOG_1, _LOG_2 = 0.6931471804855391, 7.440617110012397e-11


@overload(sincos, jit_options=CALLED)
def _sincos(x):
    if x == types.float64:
        return lambda x: (math.sin(x), math.cos(x))

    def lanes(x):
        # Taylor's series about the nearest multiple of pi/2; the first term left out is below 1e-16
        n = nearest(x * (2.0 / math.pi))
        r = ((x - n * _PI_1) - n * _PI_2) - n * _PI_3
        q = r * r
        s = -1.0 / 1307674368000.0
        s = s * q + 1.0 / 6227020800.0
        s = s * q - 1.0 / 39916800.0
        s = s * q + 1.0 / 362880.0
        s = s * q - 1.0 / 5040.0
        s = s * q + 1.0 / 120.0
        s = s * q - 1.0 / 6.0
        s = r + r * q * s
        c = 1.0 / 20922789888000.0
        c = c * q - 1.0 / 87178291200.0
        c = c * q + 1.0 / 479001600.0
        c = c * q - 1.0 / 3628800.0
        c = c * q + 1.0 / 40320.0
        c = c * q - 1.0 / 720.0
        c = c * q + 1.0 / 24.0
        c = 1.0 + q * (c * q - 0.5)
        half = floor(0.5 * n)
        odd = n - 2.0 * half
        sign = 1.0 - 2.0 * (half - 2.0 * floor(0.5 * half))
        swap = odd != 0.0
        return where(swap, c, s) * sign, where(swap, -s, c) * sign

    return lanes


@overload(exp, jit_options=CALLED)
def _exp(x):
    if x == types.float64:
        return lambda x: math.exp(x)

    def lanes(x):
        x = where(x > -700.0, x, -700.0)
        n = nearest(x * (1.0 / math.log(2.0)))
        r = (x - n * _LOG_1) - n * _LOG_2
        e = 1.0 / 6227020800.0
        e = e * r + 1.0 / 479001600.0
        e = e * r + 1.0 / 39916800.0
        e = e * r + 1.0 / 3628800.0
        e = e * r + 1.0 / 362880.0
        e = e * r + 1.0 / 40320.0
        e = e * r + 1.0 / 5040.0
        e = e * r + 1.0 / 720.0
        e = e * r + 1.0 / 120.0
        e = e * r + 1.0 / 24.0
        e = e * r + 1.0 / 6.0
        e = e * r + 0.5
        e = 1.0 + (r + r * r * e)
        return e * exponent(n)

    return lanes


@intrinsic
def _picked(typingctx: Any, array: Any, index: Any) -> Any:
    """Entries of an array (n,), lane by lane."""

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        base = context.make_array(sig.args[0])(context, builder, values[0]).data
        places, result = builder.fptosi(values[1], _WORDS), ir.Constant(_DOUBLES, ir.Undefined)
        for k in range(WIDTH):
            lane = ir.Constant(ir.IntType(32), k)
            entry = builder.load(builder.gep(base, [builder.extract_element(places, lane)]))
            result = builder.insert_element(result, entry, lane)
        return result

    return LANES(array, LANES), build


@overload(picked, jit_options=CALLED)
def _picked_of(array, index):
    if index == types.float64:
        return lambda array, index: array[int(index)]
    return lambda array, index: _picked(array, index)  # type: ignore[call-arg]


@intrinsic
def _rows(typingctx: Any, array: Any, first: Any, size: Any, columns: Any) -> Any:
    """``size`` rows of an array (m, WIDTH), from row ``first`` on, as lanes; also indexed in two
    dimensions with ``columns``.
    """

    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        base = context.make_array(sig.args[0])(context, builder, values[0]).data
        made = cgutils.create_struct_proxy(ROWS)(context, builder)
        made.data = builder.gep(base, [builder.mul(values[1], ir.Constant(_WORD, WIDTH))])
        made.size, made.columns = values[2], values[3]
        return made._getvalue()

    return ROWS(array, types.intp, types.intp, types.intp), build


@overload(rows, jit_options=CALLED)
def _rows_of(array, first, size, columns):
    return lambda array, first, size, columns: _rows(array, first, size, columns)  # type: ignore[call-arg]


def _place(context: Any, builder: Any, kind: Any, lanes: Any, index: Any) -> Any:
    """Pointer to the lanes at an index, or at a pair of indices."""
    held = cgutils.create_struct_proxy(ROWS)(context, builder, lanes)
    if isinstance(kind, types.BaseTuple):
        index = builder.add(
            builder.mul(builder.extract_value(index, 0), held.columns),
            builder.extract_value(index, 1),
        )
    start = builder.gep(held.data, [builder.mul(index, ir.Constant(_WORD, WIDTH))])
    return builder.bitcast(start, _DOUBLES.as_pointer())


_INDICES = (types.intp, types.UniTuple(types.intp, 2))


@infer_global(operator.getitem)
class _Get(ConcreteTemplate):
    cases = tuple(signature(LANES, ROWS, index) for index in _INDICES)


@infer_global(operator.setitem)
class _Set(ConcreteTemplate):
    cases = tuple(signature(types.none, ROWS, index, LANES) for index in _INDICES)


def _get(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    return builder.load(_place(context, builder, sig.args[1], *values), align=8)


def _set(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    builder.store(values[2], _place(context, builder, sig.args[1], *values[:2]), align=8)
    return context.get_dummy_value()


for _index in _INDICES:
    lower_builtin(operator.getitem, ROWS, _index)(_get)
    lower_builtin(operator.setitem, ROWS, _index, LANES)(_set)
