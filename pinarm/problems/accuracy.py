"""Accuracy of the integration: method, tolerance or step, and bounds on the number of steps."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec

from pinarm.engine.integration.methods import METHODS, REMOVED, MethodName, described
from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import Duration, InputStruct

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Method

TOLERANCE = 1e-9
"""Tolerance of an adaptive method where none is given."""


class Accuracy(InputStruct, frozen=True):
    """How accurate the result is wanted.

    Attributes:
        method: How motions are integrated over time, such as ``rk4``.
        tolerance: Local error of a step of an adaptive method, relative to ``1 + |y|`` in SI, or to the largest |y|
            of a motion that is smaller than 0.1; 1e-9 where it is left out. The global error is usually ten to a
            hundred times larger; ``run --verify`` estimates it.
        step: Longest step of a method with steps of one length.
        target: Largest global error wanted in every output, relative to its largest absolute value over the run, such
            as ``1e-6``. The cheapest setting is looked for whose bound of the error is below it (see ``run --verify``),
            of the method if one is given; tolerance and step are then not used.
        max_steps: Number of steps after which the time integration gives up, rejected ones included, such as
            ``1000000``.
        max_events: Number of impacts, slips that begin or end, and switches of relays after which it gives up, such as
            ``10000``; the motion until then is kept.
    """

    unoffered: ClassVar[Collection[str]] = REMOVED
    method: Annotated[MethodName, msgspec.Meta(description=described())] = "dop853"
    tolerance: Annotated[float, msgspec.Meta(ge=1e-14, le=1e-2)] | None = None
    step: Duration | None = None
    target: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] | None = None
    max_steps: Annotated[int, msgspec.Meta(ge=1)] = 200_000
    max_events: Annotated[int, msgspec.Meta(ge=1)] = 10_000

    def check(self) -> None:
        """Refuse a tolerance for steps of one length, and a step for a method that chooses its own.

        The name of a removed method becomes that of the method that has replaced it.
        """
        msgspec.structs.force_setattr(self, "method", REMOVED.get(self.method, self.method))
        by = METHODS[self.method].setting
        if by == "step" and self.step is None and self.target is None:
            raise InputError(f"the method {self.method} takes steps of one length and needs it", hint="step: 1 ms")
        other = {"step": "tolerance", "tolerance": "step"}[by]
        if getattr(self, other) is not None:
            with within(other):
                raise InputError(f"the method {self.method} has no {other}", expected=f"{by}, or another method")

    def integrator(self) -> Method:
        return METHODS[self.method].make(self.setting[1])

    @property
    def setting(self) -> tuple[str, float]:
        by = METHODS[self.method].setting
        wanted = self.step if by == "step" else self.tolerance
        return by, TOLERANCE if wanted is None else float(wanted)

    @property
    def setting_keys(self) -> dict[str, Any]:
        return setting_keys(self.method, self.setting[1])


def setting_keys(method: MethodName, value: float) -> dict[str, Any]:
    """Return a setting of the integration as the keys of a file, from a method and its tolerance, or its step [s]."""
    return (
        {"method": method, "step": f"{value!r} s"}
        if METHODS[method].setting == "step"
        else {"method": method, "tolerance": value}
    )
