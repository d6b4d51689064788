"""Quantities by name: what can be asked of a trajectory.

The families of names stand in ``families``; ``docs/quantities.md`` lists them. Vectors are in world axes; ``.along.B``
before the component gives them in the axes of link B: ``point.P.velocity.along.arm_2.x``. The component ``norm`` is the
length. Formulas combine quantities with the published symbols, the model's arguments, ``g``, the magnitude of gravity,
and numbers with units, ``(2e4 N/m)*Y``. A name with several meanings is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import cached_property

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspace import one_blas_thread
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.families import FAMILIES, family
from pinarm.engine.quantities.family import RATES, Asked, Evaluation, Family, UnknownQuantity
from pinarm.engine.quantities.reactions import Reactions
from pinarm.engine.series import Series
from pinarm.errors import ExpressionError, InputError, UnitError, choices, require_name
from pinarm.input.formulas.expressions import Expression
from pinarm.input.formulas.grammar import CONSTANTS
from pinarm.input.units import Unit, unit
from pinarm.mechanics.geometry.kinematics import one_run
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer
from pinarm.records import replace

MAX_DEPTH = 50
"""Symbols may stand for symbols; deeper nesting would exhaust the interpreter's stack."""

OPERATORS = set("+-*/(), ")

EXTREMES = {"least": np.min, "greatest": np.max}
"""Last words of names, and what they tell of values that rigid bodies with friction allow in one row."""

OPEN = 1e-9
"""Width of these values, relative to the largest of all rows, that rounding leaves."""


class Quantities(Struct, eq=False, dict=True, weakref=True):
    """The quantities of one trajectory; what needs a pass over the rows is computed once, when first asked.

    Attributes:
        undetermined: ``refuse``, or ``minimum_norm`` for reactions that rigid bodies do not determine.
    """

    trajectory: Trajectory
    symbols: Mapping[str, Expression] = {}
    undetermined: str = "refuse"
    whole: Quantities | None = None
    _known: dict[str, Series] = {}
    _open: list[str] = []

    def __repr__(self) -> str:
        return f"<Quantities of {self.trajectory!r}>"

    def of(self, rows: Trajectory) -> Quantities:
        return Quantities(rows, self.symbols, self.undetermined, self.whole or self)

    @cached_property
    def evaluation(self) -> Evaluation:
        return Evaluation(self.trajectory, self.undetermined, judged=self.whole is None)

    @property
    def _judged(self) -> Evaluation:
        return (self.whole or self).evaluation

    @property
    def reactions(self) -> Reactions:
        return self.evaluation.reactions

    def figures(self) -> dict[str, Array]:
        """Return the residuals of the reactions computed so far."""
        return self.reactions.figures() if "reactions" in vars(self.evaluation) else {}

    @cached_property
    def _families(self) -> dict[str, Family]:
        return {}

    def _family(self, word: str) -> Family:
        if word not in self._families:
            members = family(word, self.evaluation)
            if len(self.trajectory.row_axes) > 1 and not members.of_variants:
                raise VariantsDiffer(word)
            self._families[word] = members
        return self._families[word]

    @property
    def parameter(self) -> Series:
        run = self.trajectory
        return Series(run.parameter, run.unit, run.parameters)

    def __getitem__(self, name: str) -> Series:
        """Return a quantity by its name, a symbol, or a formula of them.

        Raises:
            InputError: There is no such quantity, or a name means several; the message lists what there is.
        """
        require_name(name)
        if name not in self._known:
            with one_run(), one_blas_thread(self.trajectory.mechanism.model.nv):
                series = self._extreme(name)
                if series is None:
                    series = self._require_known(self._find(name))
                    doubt = series.doubt or self._judged.friction_doubts.get(name) or self._left_open(name, series)
                    if doubt != series.doubt:
                        series = replace(series, doubt=doubt)
                if (
                    series.values.shape not in self._shapes
                ):  # it would be spread along another axis than that of variants
                    raise VariantsDiffer(name)
                self._known[name] = series
        return self._known[name]

    @cached_property
    def _shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes that a quantity may have: (n,), or (n, 1) and (n, k) of k variants."""
        run, model = self.trajectory, self.trajectory.mechanism.model
        return (run.row_axes, (len(run), len(model))) if isinstance(model, ModelVariants) else (run.row_axes,)

    @cached_property
    def others(self) -> list[Quantities]:
        others = self.trajectory.others
        return [Quantities(other, self.symbols, self.undetermined, self.whole) for other in others]

    def _extreme(self, name: str) -> Series | None:
        """Return the least or greatest value of a quantity that friction may leave open; ``None`` of another name."""
        base, _, extreme = name.rpartition(".")
        if extreme not in EXTREMES or not base:
            return None
        try:
            told = self[base]
        except InputError:  # the last word belongs to a name
            return None
        values = EXTREMES[extreme](self._values(told, base), axis=0)
        return replace(told, name=name, values=values, doubt="", unbounded=self._endless)

    @property
    def _endless(self) -> bool:
        return any(other.trajectory.endless is not None for other in self.others)

    def _values(self, told: Series, name: str) -> Array:
        """Return the values of a quantity with each of ``others``, infinite where it has no end that is known."""
        values = np.array([told.values, *(other[name].values for other in self.others)])
        slack = OPEN * np.abs(values).max(initial=0.0)
        for k, other in enumerate(self.others, 1):
            if (endless := other.trajectory.endless) is not None:
                beyond = values[k] - told.values
                infinite = np.where(np.abs(beyond) > slack, np.copysign(np.inf, beyond), told.values)
                values[k] = np.where(endless, infinite, values[k])
        return values

    def open_rows(self, name: str) -> Flags:
        """Return in which rows joints at rest share a load in a way that leaves a quantity open, shape (n,)."""
        if not self.others or self._extreme(name) is not None:
            return np.zeros(len(self.trajectory), dtype=bool)
        values = self._values(self[name], name)
        return np.asarray(np.ptp(values, axis=0) > OPEN * np.abs(values[np.isfinite(values)]).max(initial=0.0))

    def bounds(self, name: str) -> tuple[Series, Series]:
        low, high = (self[f"{name}.{extreme}"] for extreme in EXTREMES) if self.others else (self[name], self[name])
        return low, high

    def determined(self, name: str) -> Series:
        """Return a quantity that does not depend on how several frictions at rest, or stops, share a load.

        Raises:
            InputError: It does, in some row.
        """
        series = self[name]
        if self.open_rows(name).any():
            raise InputError(
                f"'{name}': {self._left_open(name, series)}",
                expected="a quantity that does not depend on which friction or stop holds how much",
                hint=" or ".join(f"'{name}.{extreme}'" for extreme in EXTREMES),
            )
        return series

    def _left_open(self, name: str, series: Series) -> str:
        """Return the doubt about a quantity that joints at rest leave open; empty where it is determined."""
        if not self.others:
            return ""
        values, self._known[name] = self._values(series, name), series
        rows = np.flatnonzero(self.open_rows(name))
        if not len(rows):
            return ""
        run, row = self.trajectory, int(rows[0])
        low, high = values[:, row].min(), values[:, row].max()
        return (
            f"not determined in {len(rows)} of {len(run)} rows, as several frictions or stops hold one motion: at "
            f"{run.parameter} = {run.grid.t[row]:.6g} {run.unit} anything from {low:.6g} to {high:.6g} "
            f"{series.unit or ''}; '{name}.least' and '{name}.greatest' tell it for all rows"
        )

    def _require_known(self, series: Series) -> Series:
        """Return a quantity, unless it depends on velocities or accelerations that are not known, which are NaN."""
        if self.trajectory.unknown and np.isnan(series.values).any():
            raise InputError(f"'{series.name}': {self.trajectory.unknown}", hint=self.trajectory.remedy)
        return series

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def _ipython_key_completions_(self) -> list[str]:
        return self.names()

    def names(self) -> list[str]:
        """Return the names of all quantities, for messages and completion."""
        mechanism = self.trajectory.mechanism
        return [
            self.trajectory.parameter, "g", *self.symbols, *mechanism.symbols, *mechanism.arguments,
            *mechanism.coordinates, *self.trajectory.columns,
            *(f"{word}.{name}" for word in FAMILIES for name in self._family(word).names()),
        ]  # fmt: skip

    def _constant(self, value: float | Array) -> Array:
        """Return a number in all rows, shape (n,), or those of k variants, shape (n, k)."""
        return np.array(np.broadcast_to(value, np.broadcast_shapes(self.trajectory.row_axes, np.shape(value))))

    def _find(self, name: str) -> Series:
        mechanism = self.trajectory.mechanism
        self._require_one_meaning(name)
        if name == self.trajectory.parameter:
            return self.parameter
        for symbols in (self.symbols, mechanism.symbols):
            if name in symbols:
                return self._evaluate(name, symbols[name])
        if name in mechanism.arguments:
            return Series(name, mechanism.argument_units.get(name), self._constant(mechanism.arguments[name]))
        if name == "g":
            return Series(name, unit("m/s^2"), self._constant(mechanism.gravity))
        if name in mechanism.coordinates:
            return self._family("coordinate").rate(Asked(name, (name,)), name, "position")
        if name in self.trajectory.columns:
            return self.trajectory.columns[name]
        word, _, rest = name.partition(".")
        if word not in FAMILIES or not rest:
            return self._evaluate(name, Expression.parse(name), formula=True)
        try:
            return self._of_family(word, name, rest)
        except InputError as error:
            if not set(name) & OPERATORS:  # names from models may hold such marks too, so they are tried first
                raise (self._unknown(name) if isinstance(error, UnknownQuantity) else error) from None
        return self._evaluate(name, Expression.parse(name), formula=True)

    def _of_family(self, word: str, name: str, rest: str) -> Series:
        """Return a quantity of a family; where these are some states of a run, with the doubts about the whole run."""
        of = self._family(word)
        series = of.series(Asked(name, tuple(self._words(rest))))
        if self.whole is None or not (of.undetermined and self._judged.doubtful):
            return series
        return replace(series, doubt=self.whole[name].doubt)

    def _require_one_meaning(self, name: str) -> None:
        """Raise where a name stands for several things; symbols may take those of constants and ``g``."""
        if name not in self._several and name not in self.trajectory.mechanism.worded:
            return
        run, mechanism = self.trajectory, self.trajectory.mechanism
        known, arguments = {*self.symbols, *mechanism.symbols}, mechanism.arguments
        coordinate = mechanism.coordinates.get(name)
        swept = coordinate is not None and coordinate.unit == run.unit  # that coordinate itself runs along the rows
        named = {
            "a symbol": name in known,
            "an argument of the model": name in arguments,
            "a coordinate": coordinate is not None,
            "what runs along the rows": name == run.parameter and not swept,
            "a quantity of the mechanism": (name in known or name in mechanism.worded) and self.is_quantity(name),
            "a constant": name in ("g", *CONSTANTS) and name not in known,
        }
        meanings = [meaning for meaning, holds in named.items() if holds]
        if len(meanings) > 1:
            hint = f"coordinate.{name}.position, or another name" if named["a coordinate"] else "another name"
            raise InputError(f"'{name}' is {' and '.join(meanings)}", expected="one meaning for each name", hint=hint)

    @cached_property
    def _several(self) -> set[str]:
        """Names that stand for more than a quantity, besides those that the mechanism gives a meaning."""
        return {self.trajectory.parameter, "g", *CONSTANTS, *self.symbols}

    def is_rate(self, name: str) -> bool:
        """Tell whether a name is that of a joint's coordinate, or of a rate of it, and stands for nothing else."""
        mechanism, (word, _, rest) = self.trajectory.mechanism, name.partition(".")
        joint, _, rate = rest.rpartition(".")
        own = word == "joint" and rate in RATES and joint in mechanism.joints and rest not in self._dotted
        return own and name not in self._several and name not in mechanism.worded

    def is_quantity(self, name: str) -> bool:
        """Tell whether a name with dots is that of a quantity."""
        word, _, rest = name.partition(".")
        if word not in FAMILIES or not rest:
            return False
        try:
            self._of_family(word, name, rest)
        except InputError:
            return False
        return True

    @cached_property
    def _dotted(self) -> set[str]:
        """Names of joints, links, drives, loop joints, couplings and force elements that have dots in them."""
        forces = self.trajectory.dynamics.forces
        return {*self.trajectory.mechanism.dotted_names, *(name for name in forces if "." in name)}

    def asked(self, name: str) -> Asked:
        return Asked(name, tuple(self._words(name.partition(".")[2])))

    def _words(self, text: str) -> list[str]:
        """Return the words of a name between its dots, those of a joint's or link's own name together."""
        words, joined = text.split("."), []
        if not self._dotted:
            return words
        while words:
            ends = range(len(words), 1, -1)
            size = next((end for end in ends if ".".join(words[:end]) in self._dotted), 1)
            joined.append(".".join(words[:size]))
            words = words[size:]
        return joined

    def _evaluate(self, name: str, expression: Expression, *, formula: bool = False) -> Series:
        if name in self._open:
            raise ExpressionError(f"the symbol '{name}' is defined by itself: {' -> '.join([*self._open, name])}")
        if len(self._open) >= MAX_DEPTH:
            raise ExpressionError(f"the symbol '{self._open[0]}' stands for symbols nested more than {MAX_DEPTH} deep")
        if formula and expression.names == {name}:
            raise self._unknown(name)
        self._open.append(name)
        try:
            operands = self._operands(expression)
        finally:
            self._open.pop()
        values = expression.evaluate({inner: series.values for inner, series in operands.items()})
        dimension = expression.dimension({inner: series.unit for inner, series in operands.items()})
        alone = operands.get(expression.text.strip())
        measured = alone.unit if alone is not None else Unit(1.0, dimension.dimension) if dimension else None
        doubt = next((series.doubt for series in operands.values() if series.doubt), "")
        constant = self._constant(values) if np.ndim(values) == 0 else np.asarray(values)
        return Series(name, measured, constant, doubt, terms=0.0 if alone is None else alone.terms)

    def switches(self, name: str) -> list[Array]:
        """Return functions that change their sign wherever formulas behind a name go from one smooth part to another.

        Returns:
            Values at the rows, each of shape (n,); see ``Expression.switches``.

        Raises:
            InputError: There is no such quantity.
        """
        symbols = {**self.trajectory.mechanism.symbols, **self.symbols}
        switches, pending, met = list[Array](), [name], set[str]()
        while pending:
            symbol = pending.pop()
            if symbol in met or not (symbol in symbols or set(symbol) & OPERATORS):
                continue
            met.add(symbol)
            expression = symbols.get(symbol) or Expression.parse(symbol)
            operands = self._operands(expression)
            switches += expression.switches({inner: series.values for inner, series in operands.items()})
            pending += sorted(operands)
        return switches

    def check_symbols(self, symbols: Iterable[str], locate: Callable[..., AbstractContextManager[None]]) -> None:
        """Raise where a symbol stands for what does not exist, for what cannot be added, or for itself.

        What exists is no mistake, also where this run does not tell it, as forces of a kinematic one.

        Raises:
            InputError: Says which, and where it stands.
        """
        for name in symbols:
            with locate("symbols", name):
                try:
                    self[name]
                except (UnknownQuantity, ExpressionError, UnitError):
                    raise
                except InputError:
                    continue

    def figure(self, text: str) -> Array:
        """Return the value of a formula that holds printed figures, which come without units; shape () or (n,).

        Raises:
            InputError: A quantity in it does not exist, or is not determined; see ``determined``.
        """
        expression = Expression.parse(text)
        operands = self._operands(expression)
        for name in operands:
            self.determined(name)
        return np.asarray(expression.evaluate({inner: series.values for inner, series in operands.items()}), float)

    def _operands(self, expression: Expression) -> dict[str, Series]:
        self._require_units(expression)
        for inner in expression.names:
            self._require_one_meaning(inner)
        constants = {*CONSTANTS} - {*self.symbols, *self.trajectory.mechanism.symbols}  # which symbols override
        return {inner: self[inner] for inner in expression.names if inner not in constants}

    def _require_units(self, expression: Expression) -> None:
        """Raise where what reads as a number with a unit may be a product of names whose ``*`` was forgotten."""
        mechanism = self.trajectory.mechanism
        names = {"g", *self.symbols, *mechanism.symbols, *mechanism.arguments, *mechanism.coordinates}
        for number in expression.measured:
            if number.words <= names:
                said = " and ".join(f"'{word}'" for word in sorted(number.words))
                raise InputError(
                    f"'{number.text}' is a number with a unit, and {said} a name here too",
                    expected="a * before the name, or a unit that is none, such as mm for m",
                )

    def _unknown(self, name: str) -> InputError:
        available = self.names()
        kind = name.partition(".")[0]
        near = [other for other in available if other.startswith(f"{kind}.")] or available
        expected, hint = choices(name, near, most=16)
        return UnknownQuantity(name, expected, hint)
