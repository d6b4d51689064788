"""A result of one's own arrays: quantities, plots, checks, tables and replays of measured or foreign motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal

from numpy.typing import ArrayLike

from pinarm.arrays import as_rows, real, same_rows
from pinarm.engine.motion.recorded_motion import RecordedRows
from pinarm.engine.quantities.state_arrays import refuse_foreign
from pinarm.engine.series import require_unit
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import SECOND
from pinarm.problems.recorded import check_rows, named_columns
from pinarm.use.facade import Result, Scenario
from pinarm.use.mechanism import Mechanism


def result(
    mechanism: Mechanism, t: ArrayLike, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None,
    tau: ArrayLike | None = None, *, derivatives: Literal["given", "spline"] = "given", drives: Sequence[str] = (),
    loads: Mapping[str, Any] = MappingProxyType({}), **keys: Any,
) -> Result:  # fmt: skip
    """Return the result of a motion that is given row by row, as of a scenario of ``kind: recorded``.

    What is not given is not invented: quantities that need velocities or accelerations are refused, unless
    ``derivatives="spline"`` takes both from the spline of degree 5 through the positions. The result's figures tell how
    open the loops are, how well given velocities are the rate of the positions and accelerations that of the
    velocities, how much a spline's derivatives change without every second row, and how far given efforts are from the
    equation of motion.

    Args:
        mechanism: What moves.
        t: Instants [s], not descending, shape (n,).
        q: Configurations in pinarm's convention, shape (n, nq); see ``Mechanism.from_pinocchio``.
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).
        tau: Efforts of the drives at the joints [N*m or N], shape (n, nv); those of inverse dynamics where they are
            left out and accelerations are known.
        derivatives: ``given``, as far as they are, or those of a ``spline``.
        drives: Coordinates that the drives act along where efforts are left out; every joint of an open chain where
            none is named. Without any a mechanism with loops tells no forces.
        loads: Applied forces, springs and dampers of this run by name, as a scenario file has them.
        keys: Further keys of a scenario file: ``outputs``, the joints' positions where they are left out, ``expect``,
            ``numbers``, ``symbols``, ``title``, ...

    Raises:
        InputError: Shapes do not fit, a number is not finite, or instants descend.
        DynamicsError: The drives do not determine their efforts.
    """
    rows = _rows(mechanism, t, q, v, a, tau)
    problem: dict[str, Any] = {"kind": "recorded", "columns": named_columns(mechanism, rows)}
    problem |= {"derivatives": derivatives, "loads": loads, **({"drives": list(drives)} if drives else {})}
    moving = [*mechanism.joints, *(f"joint.{name}.{angle}" for name in mechanism.balls for angle in ANGLES)]
    data = {"pinarm": 1, "title": mechanism.title, "outputs": moving, **keys, "mechanism": mechanism}
    solved = Scenario.of_data({**data, "problem": problem}).run()
    solved.numbers()  # so that those are refused at once that these rows do not have
    return solved


ANGLES = ("roll", "pitch", "yaw")
"""Quantities of a ball joint that stand for its position."""


def _rows(
    mechanism: Mechanism, t: ArrayLike, q: ArrayLike, v: ArrayLike | None, a: ArrayLike | None, tau: ArrayLike | None
) -> RecordedRows:
    require_unit(t, "t", SECOND)
    instants, nq, nv = real(t, "t"), mechanism.model.nq, mechanism.model.nv
    if instants.ndim != 1:
        raise InputError(f"t has the shape {instants.shape}", expected="(n,)")
    given = {"v": v, "a": a, "tau": tau}
    refuse_foreign(mechanism, q=q, **given)
    positions = as_rows(real(q, "q"), nq, "q")
    arrays = {name: None if x is None else as_rows(real(x, name), nv, name) for name, x in given.items()}
    same_rows(instants, positions, *(x for x in arrays.values() if x is not None))
    rows = RecordedRows(instants, positions, **arrays)
    check_rows(mechanism, rows)
    return rows
