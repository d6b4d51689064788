"""A sampled controller during a run: what it remembers from one sample to the next."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.control.controller import Controller, Given, Sampling
from pinarm.mechanics.laws.motion_law import MotionLaw


class Sampler:
    """The memory of a sampled controller.

    Args:
        controller: The controller.
        sampling: When it acts, and what its sensors see.
        reference: What its signals should be at the samples, shape (n, s, 3).
    """

    def __init__(self, controller: Controller, sampling: Sampling, reference: Array) -> None:
        self.controller, self.sampling, self.reference = controller, sampling, reference
        self.coarse = bool(sampling.resolution.any())
        self.differs = sampling.rates == "difference"
        self.integral = np.zeros(controller.integrals)
        self.mode: int | None = None
        self.last: Array | None = None

    def sample(self, number: int, t: float, q: Array, v: Array, excess: Array) -> Array:
        """Return the command of a sample, before the limits [N*m or N], shape (k,).

        Args:
            number: Of the sample.
            t: Its instant [s].
            q: Configuration of the mechanism, shape (nq,).
            v: Its velocity, shape (nv,).
            excess: What motors withhold of the commands in force; see ``Given``.
        """
        controller, sampling = self.controller, self.sampling
        measured = controller.measure(q, v)
        if self.coarse:
            step = np.where(sampling.resolution > 0.0, sampling.resolution, 1.0)
            rounded = np.round(measured[:, 0] / step) * step
            measured[:, 0] = np.where(sampling.resolution > 0.0, rounded, measured[:, 0])
        if self.differs:
            before = measured[:, 0].copy() if self.last is None else self.last
            self.last = measured[:, 0].copy()
            measured[:, 1] = (self.last - before) / sampling.period
        given = Given(t, q, v, measured, self.reference[number], self.integral, excess=excess)
        if controller.integrals:
            self.integral = controller.clamped(self.integral + sampling.period * controller.rates(given))
            given = given._replace(integral=self.integral)
        self.mode = controller.mode(given, self.mode)
        return controller.command(given if not self.mode else given._replace(mode=self.mode))


def reference_after(laws: tuple[MotionLaw, ...], t: Array, slack: float = 0.0) -> Array:
    """Return values, rates and accelerations of laws at instants, shape (n,), each after a jump; shape (n, s, 3).

    A jump that is later by the slack [s] or less is at the instant itself.
    """
    found = np.empty((len(t), len(laws), 3))
    for k, law in enumerate(laws):
        for piece in law.smooth_pieces:
            here = (t >= piece.start - slack) & (t < piece.end - slack)
            if here.any():
                found[here, k] = np.array(piece.function(t[here])).T
    return found
