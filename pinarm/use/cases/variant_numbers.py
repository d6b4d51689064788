"""Numbers of cases that are solved together: each is asked of its own curve, states between rows are solved at once.

A number of a run, such as a maximum between rows or a mean, is found by functions that ask for states at instants which
follow from the states before. They are called for every case; one that lacks states is interrupted and says which, the
states that any case lacks are solved as one array, and the interrupted ones begin anew with these. So the numbers are
found by the same steps as those of a case alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.mechanism import some_variants
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.motion.variants import PrescribedVariants
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace
from pinarm.use.cases.case import Taken
from pinarm.use.result.curve import Spots
from pinarm.use.result.numbers import SectionNumber
from pinarm.use.result.row_lookup import Lookup


class Place(NamedTuple):
    """States of a case that are asked for.

    Attributes:
        case: The case.
        interval: An interval of its grid.
        t: Values of the parameter there, as bytes.
    """

    case: int
    interval: int
    t: bytes

    @property
    def instants(self) -> Array:
        """The values, shape (n,)."""
        return np.frombuffer(self.t)


class StatesMissing(Exception):
    """States of a case that have not been solved: ``places`` are intervals, and values of the parameter as bytes."""

    def __init__(self, places: Sequence[tuple[int, bytes]]) -> None:
        self.places = places


class CaseQuantities(Quantities, kw_only=True):
    """The quantities of one of several cases: ``shared`` are those of all, ``case`` is its place among them."""

    shared: Quantities
    case: int

    def __getitem__(self, name: str) -> Series:
        """Return a quantity of the case; see ``Quantities``."""
        series = self.shared[name]
        values, terms = series.values, np.broadcast_to(series.terms, series.values.shape)
        case = min(self.case, values.shape[1] - 1)
        return replace(series, values=values[:, case], terms=terms[:, case])


class CaseLookup(Lookup, frozen=True):
    """A run of one of several cases: ``solved`` are the quantities by interval and values of the parameter."""

    solved: dict[tuple[int, bytes], Quantities] = {}

    def quantities_at(self, interval: int, t: Array) -> Quantities:
        self.announce([(interval, t)])
        return self.solved[interval, t.tobytes()]

    def heights(self, height: Callable[[Quantities], Array], spots: Spots) -> list[Array]:
        self.announce(spots)
        return [height(self.solved[interval, t.tobytes()]) for interval, t in spots]

    def announce(self, places: Spots) -> None:
        """Ask for states at places.

        Raises:
            StatesMissing: Some have not been solved.
        """
        asked = [(interval, t.tobytes()) for interval, t in places]
        if missing := [place for place in asked if place not in self.solved]:
            raise StatesMissing(missing)


@dataclass(frozen=True, eq=False)
class VariantNumbers:
    """Cases that have been solved together, of which numbers are wanted.

    Attributes:
        variants: Their motions.
        run: The rows.
        quantities: Their quantities.
        block: Number of rows -> the number of cases whose states are solved at once.
    """

    variants: PrescribedVariants
    run: Trajectory
    quantities: Quantities
    block: Callable[[int], int]

    def told(self, wanted: Sequence[Taken], sound: Flags) -> tuple[list[Array], Array, Flags]:
        """Return numbers of the cases that are sound so far.

        Returns:
            The numbers that are wanted, in order [SI], each of shape (k,); the largest error of a quadrature relative
            to its number, NaN where there is none, shape (k,); and which cases have them, shape (k,).
        """
        numbers, quadrature, sound = list[Array](), np.full(len(sound), np.nan), sound.copy()
        of_curves = self._of_curves(wanted, sound)
        for place, entry in enumerate(wanted):
            if place not in of_curves:
                numbers += entry.of_rows(self.quantities)
                continue
            value, error = of_curves[place].T
            numbers.append(value)
            both = (value != 0.0) & (error != 0.0)
            quadrature = np.fmax(quadrature, np.where(both, error / np.abs(value), np.nan))
        return numbers, quadrature, sound

    def _of_curves(self, wanted: Sequence[Taken], sound: Flags) -> dict[int, Array]:
        """Return numbers of a run with the errors of their quadratures, by their places, each of shape (k, 2).

        Cases that have no such number are not sound.
        """
        numbers = [(place, entry.number) for place, entry in enumerate(wanted)]
        asked = {place: number for place, number in numbers if number and not isinstance(number, SectionNumber)}
        known = {place: np.full((len(sound), 2), np.nan) for place in asked}
        left = [(place, case) for place in asked for case in np.flatnonzero(sound).tolist()]
        while left:
            lacking, missing = list[tuple[int, int]](), dict[Place, None]()
            for place, case in left:
                try:
                    known[place][case] = asked[place].told(self._lookups[case])
                except StatesMissing as states:
                    lacking.append((place, case))
                    missing |= dict.fromkeys(Place(case, *spot) for spot in states.places)
                except InputError:  # the case alone says why
                    sound[case] = False
            self._solve([*missing], sound)
            left = [(place, case) for place, case in lacking if sound[case]]
        return known

    @cached_property
    def _lookups(self) -> list[CaseLookup]:
        """The runs of all cases."""
        rows = (replace(self.run, grid=grid) for grid in self.variants.grids)
        each = (CaseQuantities(run, shared=self.quantities, case=case) for case, run in enumerate(rows))
        return [CaseLookup(quantities, self.variants.motion) for quantities in each]

    def _solve(self, places: Sequence[Place], sound: Flags) -> None:
        """Solve states of cases, as many of one number of rows at once as suits processors."""
        alike = dict[int, list[Place]]()
        for place in places:
            alike.setdefault(len(place.t), []).append(place)
        for some in alike.values():
            size = self.block(len(some[0].instants))
            for start in range(0, len(some), size):
                self._solve_alike(some[start : start + size], sound)

    def _solve_alike(self, places: Sequence[Place], sound: Flags) -> None:
        """Solve states at as many instants of each case.

        One place is solved beside itself: NumPy adds up the numbers of a single state in another order, and they would
        have other last digits alone than beside others.
        """
        places = places if len(places) > 1 else [*places, *places]
        cases = np.array([place.case for place in places])
        grids = [_at(self.variants.grids[place.case], place) for place in places]
        mechanism = some_variants(self.variants.mechanism, cases)
        run, good = self.variants.some(mechanism, cases, grids).at(self._near(places, cases))
        quantities = self.quantities.of(run)
        sound[cases[~good]] = False
        for k, place in enumerate(places):
            solved = CaseQuantities(self.variants.run, shared=quantities, case=k)
            self._lookups[place.case].solved[place.interval, place.t] = solved

    def _near(self, places: Sequence[Place], cases: Indices) -> Array:
        """Return configurations near those at places, shape (n, places, nq): those of rows, moved on to the places."""
        q, v, a = (x[:, np.minimum(cases, x.shape[1] - 1)] for x in (self.run.q, self.run.v, self.run.a))
        rows, steps = zip(*(_nearest(self.variants.grids[place.case], place) for place in places), strict=True)
        row, h = np.stack(rows, axis=1), np.stack(steps, axis=1)[..., None]
        every = np.arange(len(places))
        if self.run.separate:
            return np.asarray(q[row, every])
        return np.asarray(q[row, every] + h * (v[row, every] + 0.5 * h * a[row, every]))


def _at(grid: Grid, place: Place) -> Grid:
    """Return the grid of instants of one interval."""
    t = place.instants
    return Grid(t, (grid.cuts[place.interval], grid.cuts[place.interval + 1]), (0, len(t)))


def _nearest(grid: Grid, place: Place) -> tuple[Indices, Array]:
    """Return the rows of a grid that are nearest to instants of an interval, and how far from these [s], shape (n,)."""
    first, end = grid.rows[place.interval], grid.rows[place.interval + 1]
    first, end = (first, end) if first < end else (0, len(grid.t))
    known, t = grid.t[first:end], place.instants
    rows = np.abs(known - t[:, None]).argmin(axis=1)
    return first + rows, t - known[rows]
