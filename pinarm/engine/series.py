"""A named array with its unit, which takes part in numpy's arithmetic.

=============================================  ==================================================================
``a + b``, ``maximum``, ``hypot``, ...         one dimension, the unit of the first; a bare number is in that unit
``a < b``, ``a == b``, ...                     likewise; the answer is a plain array, which can be used as a mask
``a*b``, ``a/b``, ``a @ b``, ``sqrt``, ``**``  the unit follows from those of the operands; bare numbers have none
``sin``, ``exp``, ...                          of angles and other plain numbers only
=============================================  ==================================================================

Whatever else numpy does, such as ``np.trapezoid``, takes the bare values (``np.asarray``), and gives a plain array.
What it puts side by side or compares, as ``np.concatenate``, ``np.where``, ``np.allclose`` and ``np.interp`` do, has
one dimension, and is taken in the unit of the first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import force_setattr
from numpy.lib.mixins import NDArrayOperatorsMixin

from pinarm.arrays import Array, Flags
from pinarm.errors import UnitError
from pinarm.input.formulas.expressions import Measure, Rule, power, pure, root, same
from pinarm.input.units import ANGLES, DIMENSIONLESS, Unit, unit
from pinarm.records import AbstractRecord, replace

ROUNDING = 1e-12
"""Size relative to that of its terms below which all of a quantity is their rounding."""

MOST = 60
"""Characters of the name of a result, which tells how it was computed."""


class Series(NDArrayOperatorsMixin, AbstractRecord, frozen=True):
    """A named array with its unit. It never changes: ``a += b`` makes another one.

    ``np.asarray(series)`` gives the values without copying them; ``series[3]`` of a single axis is a float, and slices
    and masks give a ``Series``. ``==`` compares value by value, as numpy does, so that a ``Series`` has no hash.

    Attributes:
        name: As it was asked for, or how it was computed.
        unit: Unit of the values; ``None`` where it is not known, which fits every other unit.
        values: One per row of a run, shape (n,), or of the shape in which states or motions were given; read-only.
        doubt: Why the values are one choice of many; empty where they are determined.
        unbounded: Whether infinite values are meant: ends of a band that has none.
        terms: Sizes of what values are sums of, where they may cancel: rounding is relative to these; shape of the
            values, or () where nothing is known of them.
    """

    name: str
    unit: Unit | None
    values: Array
    doubt: str = ""
    unbounded: bool = False
    terms: Array | float = 0.0

    @property
    def known(self) -> Flags:
        """Mask of the values that are numbers, shape (n,); infinite values count in an ``unbounded`` series."""
        return ~np.isnan(self.values) if self.unbounded else np.isfinite(self.values)

    def __post_init__(self) -> None:
        values = np.asarray(self.values).view()
        values.flags.writeable = False
        force_setattr(self, "values", values)

    @property
    def si(self) -> Array:
        """Values in SI, angles in rad."""
        return self.values if self.unit is None or self.unit.factor == 1.0 else self.values * self.unit.factor

    @property
    def label(self) -> str:
        """Name and unit, for headings."""
        text = str(self.unit) if self.unit else "?"
        return self.name if text == "1" else f"{self.name} [{text}]"

    def to(self, other: str | Unit) -> Series:
        """Return the quantity in another unit: ``series.to("deg")``, or the unit of a series, ``other.unit``.

        Raises:
            UnitError: There is no such unit, or it is of another dimension.
        """
        wanted = other if isinstance(other, Unit) else unit(other)
        same([Measure(self.unit), Measure(wanted)])
        factor = (self.unit.factor if self.unit else 1.0) / wanted.factor
        return replace(self, unit=wanted, values=self.values * factor, terms=self.terms * factor)

    def without_rounding(self) -> Series:
        """Return the series; with zeros if all its values are rounding of the terms."""
        size, terms = (float(np.max(np.abs(x), initial=0.0)) for x in (self.values, self.terms))
        return replace(self, values=np.zeros_like(self.values)) if size < ROUNDING * terms else self

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    @property
    def ndim(self) -> int:
        return self.values.ndim

    @property
    def size(self) -> int:
        return self.values.size

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.values.dtype

    @property
    def T(self) -> Series:
        """The series with its axes reversed."""
        return replace(self, values=self.values.T, terms=np.transpose(self.terms))

    def tolist(self) -> Any:
        """Return the values as lists of numbers."""
        return self.values.tolist()

    def max(self, axis: int | tuple[int, ...] | None = None, **options: Any) -> Any:
        """Return the largest value, or a ``Series`` of those along an axis; see ``numpy.max``."""
        return self._reduced("max", axis, options)

    def min(self, axis: int | tuple[int, ...] | None = None, **options: Any) -> Any:
        """Return the smallest value, or a ``Series`` of those along an axis; see ``numpy.min``."""
        return self._reduced("min", axis, options)

    def mean(self, axis: int | tuple[int, ...] | None = None, **options: Any) -> Any:
        """Return the mean of the rows (not over time), or a ``Series`` of those along an axis; see ``numpy.mean``."""
        return self._reduced("mean", axis, options)

    def sum(self, axis: int | tuple[int, ...] | None = None, **options: Any) -> Any:
        """Return the sum, or a ``Series`` of those along an axis; see ``numpy.sum``."""
        return self._reduced("sum", axis, options)

    def std(self, axis: int | tuple[int, ...] | None = None, **options: Any) -> Any:
        """Return the standard deviation, or a ``Series`` of those along an axis; see ``numpy.std``."""
        return self._reduced("std", axis, options)

    def _reduced(self, how: str, axis: Any, options: Mapping[str, Any]) -> Any:
        if isinstance(options.get("initial"), Series):
            options = {**options, "initial": _alike({"own": self, "initial": options["initial"]})["initial"]}
        reduced = getattr(self.values, how)(axis=axis, **options)
        return replace(self, name=f"{how}({self.name})", values=reduced, terms=0.0) if np.ndim(reduced) else reduced

    def argmax(self, axis: int | None = None, **options: Any) -> Any:
        """Return where the largest value stands; see ``numpy.argmax``."""
        return self.values.argmax(axis=axis, **options)

    def argmin(self, axis: int | None = None, **options: Any) -> Any:
        """Return where the smallest value stands; see ``numpy.argmin``."""
        return self.values.argmin(axis=axis, **options)

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[Any]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, index: Any) -> Any:
        picked = self.values[index]
        if not isinstance(picked, np.ndarray):
            return picked
        return replace(self, values=picked, terms=np.broadcast_to(self.terms, self.shape)[index])

    def __float__(self) -> float:
        return float(self.values)

    def __bool__(self) -> bool:
        return bool(self.values)

    def __format__(self, form: str) -> str:
        return format(self.values[()] if form and not self.ndim else repr(self), form)

    def __repr__(self) -> str:
        doubt = f"; {self.doubt}" if self.doubt else ""
        return f"{self.label}: {_extent(self.values)}{doubt}"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.values, dtype=dtype, copy=copy)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = (), **options: Any) -> Any:
        """Apply one of numpy's elementwise functions, and give what comes out its unit.

        Raises:
            UnitError: Dimensions do not go together, or the function has no meaning for quantities.
            TypeError: A ``Series`` is to be written to.
        """
        if not all(isinstance(x, Series | np.ndarray | np.generic | Real | Sequence) for x in inputs):
            return NotImplemented
        if method == "at" or any(isinstance(x, Series) for x in out):
            raise TypeError("a Series is never changed: write x = np.add(x, y), not np.add(x, y, out=x)")
        folded = method in ("reduce", "accumulate", "reduceat")
        said = _said(ufunc.__name__, inputs[:1] if folded else inputs)
        try:
            arrays, measured = _prepared(ufunc.__name__, inputs[:1] if folded else inputs, folded=folded)
        except UnitError as error:
            raise UnitError(f"{said}: {error.message}", expected=error.expected, hint=error.hint) from None
        if isinstance(options.get("initial"), Series):
            options["initial"] = _alike({"own": inputs[0], "initial": options["initial"]})["initial"]
        values = getattr(ufunc, method)(*arrays, *inputs[len(arrays) :], **options, **({"out": out} if out else {}))
        if measured is _PLAIN or out or (folded and not np.ndim(values)):
            return values
        doubt = next((x.doubt for x in inputs if isinstance(x, Series) and x.doubt), "")
        return Series(said, measured.unit, values, doubt)

    def __array_function__(self, function: Any, types: Any, args: Sequence[Any], options: Mapping[str, Any]) -> Any:
        """Apply another function of numpy to the bare values; see the head of this module.

        Raises:
            UnitError: It puts quantities of different dimensions side by side.
        """
        name = function.__name__
        if name in _METHODS and isinstance(args[0] if args else None, Series):
            return getattr(args[0], _METHODS[name])(*args[1:], **options)
        if name == "unwrap" and len(args) < 4:
            options = {"period": _TURN, **options}
        places, keys = _OTHERS.get(name, ((), ()))
        whole: dict[Any, Any] = {**dict(enumerate(args)), **options}
        apart = {key: x for key, x in whole.items() if key in places or key in keys}
        alike = {key: x for key, x in whole.items() if key not in apart}
        try:
            given = (
                _alike(apart) | _alike(alike) if name in _TOGETHER else {k: _bare(x, None) for k, x in whole.items()}
            )
        except UnitError as error:
            raise UnitError(f"{name}: {error.message}", expected=error.expected, hint=error.hint) from None
        return function(*(given[k] for k in range(len(args))), **{key: given[key] for key in options})

    if TYPE_CHECKING:  # numpy's mixin tells no types

        def _operation(self, other: Any) -> Series: ...

        def _comparison(self, other: Any) -> Flags: ...

        def _unary(self) -> Series: ...

        __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _operation
        __pow__ = __rpow__ = __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = _operation
        __lt__ = __le__ = __gt__ = __ge__ = _comparison
        __neg__ = __pos__ = __abs__ = _unary

    __iadd__, __isub__ = NDArrayOperatorsMixin.__add__, NDArrayOperatorsMixin.__sub__
    __imul__, __itruediv__ = NDArrayOperatorsMixin.__mul__, NDArrayOperatorsMixin.__truediv__
    __ipow__, __ifloordiv__ = NDArrayOperatorsMixin.__pow__, NDArrayOperatorsMixin.__floordiv__


def _giving(text: str) -> Rule:
    measured = Measure(unit(text))

    def rule(measures: Sequence[Measure]) -> Measure:
        pure(measures)
        return measured

    return rule


def _product(measures: Sequence[Measure]) -> Measure:
    a, b = (measure.unit for measure in measures)
    return Measure(None if a is None or b is None else a * b)


def _quotient(measures: Sequence[Measure]) -> Measure:
    a, b = (measure.unit for measure in measures)
    return Measure(None if a is None or b is None else a / b)


def _to_the(exponent: Fraction | int) -> Rule:
    return lambda measures: power(measures[0], Measure(DIMENSIONLESS, Fraction(exponent)))


def require_unit(x: object, name: str, *units: Unit) -> None:
    """Refuse a ``Series`` in place of numbers in SI where it measures something else."""
    if isinstance(x, Series) and x.unit is not None and x.unit.dimension not in {unit.dimension for unit in units}:
        raise UnitError(f"{name} is in {x.unit}", expected=f"a unit such as {' or '.join(map(str, units))}")


_PLAIN = Measure(DIMENSIONLESS)
"""Of answers to questions, which come out as plain arrays."""

_ALIKE: Mapping[str, Measure | None] = {
    **dict.fromkeys(("add", "subtract", "maximum", "minimum", "fmax", "fmin", "hypot", "remainder", "fmod")),
    **dict.fromkeys(("negative", "positive", "absolute", "fabs", "conjugate")),
    **dict.fromkeys(("less", "less_equal", "greater", "greater_equal", "equal", "not_equal"), _PLAIN),
    **dict.fromkeys(("isfinite", "isnan", "isinf", "signbit", "sign"), _PLAIN),
    "floor_divide": Measure(DIMENSIONLESS),
    "arctan2": Measure(unit("rad")),
}
"""Functions of quantities of one dimension, and the unit of their value; ``None`` for the same unit."""

_TO_RADIANS = ("radians", "deg2rad")
"""Functions that take bare numbers for degrees, and so angles alone: a quantity without a unit would be either."""

_LOGIC = ("logical_and", "logical_or", "logical_xor", "logical_not")

_RULES: Mapping[str, Rule] = {
    **dict.fromkeys(("sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh"), pure),
    **dict.fromkeys(("exp", "exp2", "expm1", "log", "log2", "log10", "log1p"), pure),
    **dict.fromkeys(("floor", "ceil", "trunc", "rint"), pure),
    **dict.fromkeys(("arcsin", "arccos", "arctan"), _giving("rad")),
    **dict.fromkeys(("degrees", "rad2deg"), _giving("deg")),
    **dict.fromkeys(("multiply", "matmul", "vecdot", "matvec", "vecmat"), _product),
    **dict.fromkeys(("power", "float_power"), lambda measures: power(*measures)),
    "divide": _quotient,
    "reciprocal": _to_the(-1),
    "square": _to_the(2),
    "cbrt": _to_the(Fraction(1, 3)),
    "sqrt": root,
}
"""Functions of values in SI whose unit follows from those of the arguments."""

_SYMBOLS: Mapping[str, str] = {
    "add": " + ", "subtract": " - ", "multiply": "*", "divide": "/", "floor_divide": "//", "remainder": " % ",
    "power": "**", "matmul": " @ ", "less": " < ", "less_equal": " <= ", "greater": " > ", "greater_equal": " >= ",
    "equal": " == ", "not_equal": " != ",
}  # fmt: skip


_METHODS: Mapping[str, str] = {
    "amax": "max",
    "amin": "min",
    **{name: name for name in ("max", "min", "mean", "sum", "std", "argmax", "argmin")},
}


_TOGETHER = frozenset((
    "concatenate", "stack", "block", "hstack", "vstack", "dstack", "column_stack", "allclose", "isclose", "array_equal",
    "array_equiv", "union1d", "intersect1d", "setdiff1d", "setxor1d", "linspace", "geomspace", "histogram",
    "histogram_bin_edges", "nanmax", "nanmin", "nansum", "append", "insert", "isin", "searchsorted", "digitize",
    "where", "choose", "select", "clip", "interp", "diff", "ediff1d", "pad", "nan_to_num", "unwrap",
))  # fmt: skip
"""Functions that put quantities side by side or compare them: all of one unit, but for ``_OTHERS``."""

_OTHERS: Mapping[str, tuple[Sequence[int], Sequence[str]]] = {"interp": ((2, 3, 4), ("fp", "left", "right"))}
"""Function -> places and names of arguments that have another unit than the rest."""


_TURN = Series("turn", unit("rad"), np.array(2.0 * np.pi))
"""Period of ``unwrap`` where no other is given."""


def _alike(given: Mapping[Any, Any]) -> dict[Any, Any]:
    common = same([Measure(x.unit) for x in _quantities([*given.values()])])
    return {key: _bare(x, common.unit) for key, x in given.items()}


def _quantities(x: Any) -> Iterator[Series]:
    """Yield every ``Series`` in an argument, which may be a list."""
    if isinstance(x, Series):
        yield x
    elif isinstance(x, list | tuple):
        for part in x:
            yield from _quantities(part)


def _bare(x: Any, wanted: Unit | None) -> Any:
    """Return an argument with the values of every ``Series`` in it, in a unit, or as they are."""
    if isinstance(x, list | tuple):
        return type(x)([_bare(part, wanted) for part in x])
    return _in(x, wanted)


def _prepared(function: str, inputs: Sequence[Any], *, folded: bool) -> tuple[list[Any], Measure]:
    """Return the arguments of one of numpy's functions as plain arrays in units that fit, and the value's measure."""
    units = [x.unit for x in inputs if isinstance(x, Series)]
    if function in _LOGIC:
        return [_in(x, None) for x in inputs], _PLAIN
    if function in _ALIKE:
        common = same([Measure(measured) for measured in units])
        return [_in(x, common.unit) for x in inputs], _ALIKE[function] or common
    if function in _TO_RADIANS:
        pure([Measure(measured) for measured in units])
        if not any(word in str(units[0]) for word in ANGLES):
            raise UnitError("whether this is an angle in degrees is not known", hint="np.asarray(series), if it is")
        return [_in(inputs[0], unit("deg"))], Measure(unit("rad"))
    if function not in _RULES:
        raise UnitError("this function does not tell a unit", hint="np.asarray(series), for the bare values")
    if _scales(function, inputs):
        return [_in(x, None) for x in inputs], Measure(units[0])
    rule = pure if folded else _RULES[function]
    measured = rule([_measure(x) for x in inputs])
    return [_in(x, x.unit.si if isinstance(x, Series) and x.unit else None) for x in inputs], measured


def _scales(function: str, inputs: Sequence[Any]) -> bool:
    bare = tuple(not isinstance(x, Series) for x in inputs)
    return (function, bare) in (("multiply", (False, True)), ("multiply", (True, False)), ("divide", (False, True)))


def _in(x: Any, wanted: Unit | None) -> Any:
    """Return the values of a quantity in a unit, or as they are; what is bare stays as it is."""
    if not isinstance(x, Series):
        return x
    if wanted is None or x.unit is None or x.unit.factor == wanted.factor:
        return x.values
    return x.values * (x.unit.factor / wanted.factor)


def _measure(x: Any) -> Measure:
    """Return the measure of an argument in SI: its unit, and the number where it is a single one."""
    if isinstance(x, Series):
        return Measure(x.unit.si if x.unit else None)
    return Measure(DIMENSIONLESS, _fraction(float(x)) if isinstance(x, Real) else None)


def _fraction(number: float) -> Fraction | None:
    """Return a number as the simplest fraction that it can be read as, such as 1/3; ``None`` where it is not finite."""
    if not np.isfinite(number):
        return None
    simple = Fraction(number).limit_denominator(1000)
    return simple if float(simple) == number else Fraction(number)


def _said(function: str, inputs: Sequence[Any]) -> str:
    symbol = _SYMBOLS.get(function)
    if symbol and len(inputs) == 2:
        text = symbol.join(map(_operand, inputs))
    elif function == "negative":
        text = f"-{_operand(inputs[0])}"
    else:
        text = f"{'abs' if function == 'absolute' else function}({', '.join(map(_name, inputs))})"
    return text if len(text) <= MOST else f"{text[: MOST - 3]}..."


def _operand(x: Any) -> str:
    name = _name(x)
    return f"({name})" if set(name) & set(" */-+") else name


def _name(x: Any) -> str:
    if isinstance(x, Series):
        return x.name
    return f"{x:g}" if isinstance(x, Real) else "array"


def _extent(values: Array) -> str:
    """Return the number or shape of the values, and their finite bounds, as text; a scalar as its value."""
    if not values.ndim:
        return f"{values[()]:.5g}" if values.dtype.kind in "fiu" else str(values[()])
    count = str(values.size) if values.ndim == 1 else str(values.shape)
    finite = values[np.isfinite(values)] if values.dtype.kind in "fiu" else values[:0]
    return f"{count} values" + (f", {finite.min():.5g} to {finite.max():.5g}" if len(finite) else "")
