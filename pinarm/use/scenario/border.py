"""Search along the border beyond which runs are refused, where the objective falls towards it.

From a point p inside, rays p + t (a + B y) end at the border or at the bounds: a is the way from p to the border down
the slope, B is across it, and y has a dimension less than the unknowns. The objective at the ends of rays is as
smooth as border and objective are, however the border lies; its least over y is searched without slopes (COBYQA), and
again from there until it is no less.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from pinarm.arrays import Array
from pinarm.use.scenario.landscape import ACTIVE, DIFFERENCE, Landscape

AHEAD = DIFFERENCE * 10.0 ** np.arange(4)
"""Ways down the slope, scaled, within which a border is looked for."""

NONE = 1e-3
"""Slope that bounds and conditions leave, relative to the slope without them, up to which they hold a point."""

DEPTH, SHALLOWEST = 0.05, 1e-3
"""Way back up the slope to where rays begin, scaled, and the least that is tried."""

LONGEST, SHARP = 2.0, 1e-9
"""Longest ray and how sharply its end is found, of the first one."""

RADII, WIDEST, RUNS = (0.02, 1e-7), 0.3, 40
"""First and last radius, scaled, half width and most rays for each dimension of a search across."""

AGAIN, LESS = 10, 1e-7
"""Searches at most, each with rays from another point; and by how much the objective is less after one that counts."""

ALONG_BORDER = "along the border of what can be run, from the best of the ends"


@dataclass(frozen=True, eq=False)
class Border:
    """Where rays from a point inside end.

    Attributes:
        landscape: What is searched.
        inside: The point, scaled, shape (k,).
        ahead: From there to the border down the slope, shape (k,).
        across: Directions across, orthonormal, shape (k, k - 1).
    """

    landscape: Landscape = field(repr=False)
    inside: Array
    ahead: Array
    across: Array

    @classmethod
    def beside(cls, landscape: Landscape, x: Array) -> Self | None:
        """Return the border that is met down the slope from a scaled point; none where the objective rises before."""
        way = _descent(landscape, x)
        if not way.any() or not cls._is_met(landscape, x, way):
            return None
        back = DEPTH
        while landscape.trial(x - back * way).refusal:
            back *= 0.5
            if back < SHALLOWEST:
                return None
        inside = np.clip(x - back * way, 0.0, 1.0)
        ahead = x + AHEAD[-1] * way - inside
        border = cls(landscape, inside, ahead, np.linalg.svd(ahead[:, None])[0][:, 1:])
        return cls(landscape, inside, border.end(np.zeros(len(x) - 1)) - inside, border.across)

    @staticmethod
    def _is_met(landscape: Landscape, x: Array, way: Array) -> bool:
        lowest = landscape.height(x)
        for length in AHEAD:
            if landscape.trial(x + length * way).refusal:
                return True
            if landscape.height(x + length * way) >= lowest:
                return False
        return False

    def end(self, y: Array) -> Array:
        """Return the last point of a ray that can be run, scaled."""
        ray = self.ahead + self.across @ y
        walls = np.where(ray > 0.0, 1.0 - self.inside, -self.inside)
        near, far = 0.0, float(np.min(walls[ray != 0.0] / ray[ray != 0.0], initial=LONGEST))
        if not self.landscape.trial(self.inside + far * ray).refusal:
            return np.asarray(self.inside + far * ray)
        while far - near > SHARP:
            middle = 0.5 * (near + far)
            near, far = (near, middle) if self.landscape.trial(self.inside + middle * ray).refusal else (middle, far)
        return np.asarray(self.inside + near * ray)

    def lowest(self) -> Array:
        """Return the lowest end of a ray that is found, scaled."""
        from scipy.optimize import NonlinearConstraint, minimize

        first, last = RADII
        k = self.across.shape[1]
        if not k:
            return self.end(np.zeros(0))
        upper = np.where(self.landscape.equations, 0.0, np.inf)
        kept = NonlinearConstraint(lambda y: self.landscape.margins(self.end(y)), np.zeros(len(upper)), upper)
        ended = minimize(
            lambda y: self.landscape.height(self.end(y)), np.zeros(k), bounds=[(-WIDEST, WIDEST)] * k, method="COBYQA",
            constraints=(kept,) if len(upper) else (),
            options={"initial_tr_radius": first, "final_tr_radius": last, "maxfev": RUNS * k},
        )  # fmt: skip
        return self.end(ended.x)


def _descent(landscape: Landscape, x: Array) -> Array:
    """Return the direction in which the objective falls most with bounds and conditions kept; 0 where there is none."""
    from scipy.optimize import nnls

    slopes, units = landscape.slopes(x), np.eye(len(x))
    margins = slopes[1:] if len(landscape.sizes) else slopes[:0]
    near = landscape.margins(x) <= ACTIVE
    holding = [
        *units[x <= 0.0],
        *-units[x >= 1.0],
        *margins[near | landscape.equations],
        *-margins[landscape.equations],
    ]
    held = np.array(holding).reshape(-1, len(x)).T
    way = (held @ nnls(held, slopes[0])[0] if holding else 0.0) - slopes[0]
    size = float(np.linalg.norm(way))
    return np.asarray(way / size if size > NONE * np.linalg.norm(slopes[0]) else np.zeros(len(x)))


def along_border(landscape: Landscape, start: Array) -> str:
    """Search along the border beside a scaled point, and tell how it ended."""
    x = start
    for _ in range(AGAIN):
        border = Border.beside(landscape, x)
        lowest = border.lowest() if border else x
        if landscape.rank(lowest) >= landscape.rank(x) or landscape.height(x) - landscape.height(lowest) < LESS:
            break
        x = lowest
    return ALONG_BORDER
