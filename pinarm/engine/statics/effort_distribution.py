"""Efforts of drives that carry a load: ``A x = b``, with ``A = (S T)^T`` of ``actuation`` and ``b = T^T demand``.

With as many drives as degrees of freedom the load determines them. ``shared_efforts`` chooses where there are more.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.kinematics.abscissa import instant
from pinarm.errors import DrivesError, DynamicsError
from pinarm.mechanics.coordinates import Coordinate
from pinarm.records import ValueRecord

CARRIED = 1e-9
"""Largest part of a load that no drive carries, relative to the load: rounding leaves 1e-13."""

ROUNDED = 1e-12
"""Part of the terms of a load that is taken for their rounding: 1e-16 of each, of terms that cancel or act across."""


class EffortDistribution(Protocol):
    """How the efforts of d drives follow from the load on f free motions."""

    def efforts(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        """Return the efforts [N*m or N], shape (n, d), and in which rows they are determined and carry the load.

        Args:
            ways: A, shape (n, f, d).
            load: b, shape (n, f).
            least: Smallest singular value of A that determines efforts, shape (n,).
            rounding: How large a part of b may be and still be its rounding, shape (n,).
        """
        ...

    def refusal(
        self, t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
        motions: Mapping[str, Array],
    ) -> DynamicsError | DrivesError:  # fmt: skip
        """Return why there are no efforts in one row, shapes (f, d) and (f,).

        ``motions`` are what coordinates do in the free motions, by name, each of shape (f,).
        """
        ...


class UniqueEfforts(ValueRecord, frozen=True):
    """The efforts that the load determines; more drives than degrees of freedom are refused."""

    def efforts(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        """Return the efforts; see ``EffortDistribution``."""
        effort, good = least_efforts(ways, load, least, rounding)
        return effort, good & (ways.shape[2] <= ways.shape[1])

    def refusal(
        self, t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
        motions: Mapping[str, Array],
    ) -> DynamicsError | DrivesError:  # fmt: skip
        """Return why there are none; see ``EffortDistribution``."""
        freedom, names = len(load), ", ".join(drives)
        if len(drives) > freedom:
            return DrivesError(
                f"at {instant(t)} there are more drives than degrees of freedom, {len(drives)} and {freedom}: "
                f"the efforts of {names} are not determined",
                expected=f"as many drives as degrees of freedom, {freedom}",
                hint="the others removed from drives, or share: least_squares, bounded or weights, which choose among "
                "the efforts that carry the load",
            )  # fmt: skip
        return undetermined(t, drives, ways, load, least, rounding, motions)


UNIQUE = UniqueEfforts()
"""What holds where nothing is said of sharing."""


def undetermined(
    t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
    motions: Mapping[str, Array],
) -> DynamicsError | DrivesError:  # fmt: skip
    """Return that drives are at a dead point, or too few to carry the load; shapes (f, d) and (f,)."""
    u, s, vt = np.linalg.svd(ways)
    r, freedom = int((s >= least).sum()), len(load)
    uncarried = load - ways @ (vt[:r].T @ ((u[:, :r].T @ load) / s[:r]))
    left = np.abs(uncarried).max()
    too_few = len(drives) < freedom and left > max(CARRIED * np.abs(load).max(), rounding)
    if min(len(drives), freedom) > r and not too_few:
        shares = np.abs(vt[r:]).max(axis=0)
        weak = ", ".join(name for name, share in zip(drives, shares, strict=True) if share > 1e-6)
        return DynamicsError(
            f"at {instant(t)} the efforts of {weak} are not determined: the mechanism is at a dead point of these "
            "drives",
            expected="drives that can move the mechanism at every instant", t=t,
        )  # fmt: skip
    lacking = max(motions, key=lambda name: abs(float(motions[name] @ uncarried)))
    return DrivesError(
        f"at {instant(t)} the drives {', '.join(drives)} leave a load of {left:.3g} N*m or N uncarried: {lacking} "
        "moves while they rest",
        expected=f"{freedom} drives, as many as the mechanism has degrees of freedom",
        hint=f"drives: [{', '.join([*drives, lacking])}{', ...' if len(drives) + 1 < freedom else ''}]",
    )


def least_efforts(ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
    """Return the efforts with the least sum of squares that carry a load, and in which rows they do.

    Arguments and shapes are those of ``EffortDistribution.efforts``.
    """
    u, s, vt = _singular_values(ways)
    with np.errstate(divide="ignore", invalid="ignore"):  # at dead points, which are refused
        effort = np.zeros((len(load), ways.shape[2]))
        for _ in range(2):  # after the first time small efforts have rounding of the large ones
            left = load - np.einsum("nfd,nd->nf", ways, effort)
            effort += np.einsum("nrd,nr->nd", vt, np.einsum("nfr,nf->nr", u, left) / s)
        good = (s >= least[:, None]).all(axis=1) & carried(ways, effort, load, rounding)
    return effort, good


def carried(ways: Array, effort: Array, load: Array, rounding: Array) -> Flags:
    """Return in which rows efforts carry a load, but for rounding; shapes (n, f, d), (n, d), (n, f), (n,)."""
    left = np.abs(load - np.einsum("nfd,nd->nf", ways, effort)).max(axis=1, initial=0.0)
    terms = np.abs(ways * effort[:, None]).max(axis=(1, 2), initial=0.0)
    size = np.maximum(terms, np.abs(load).max(axis=1, initial=0.0))
    return np.asarray(~(left > np.maximum(CARRIED * size, rounding)))


def _singular_values(ways: Array) -> tuple[Array, Array, Array]:
    """Return U, S and V^T of matrices, shape (n, f, d); of single numbers without the cost of a decomposition."""
    if ways.shape[1:] == (1, 1):
        return np.ones_like(ways), np.abs(ways[:, 0]), np.where(ways < 0.0, -1.0, 1.0)
    u, s, vt = np.linalg.svd(ways, full_matrices=False)
    return u, s, vt
