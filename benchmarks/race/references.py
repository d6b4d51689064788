"""The right answers, kept in ``references.npz`` with their errors: ``python -m benchmarks.race.references [NAME...]``.

Each is computed twice, on routes that share no code. The equations of ``equations.py``, or elliptic functions, give the
answer; the largest difference to ``aba`` or ``constraintDynamics`` under SciPy's DOP853, at 1e-13, bounds its error.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from benchmarks.race.equations import STEP, Equations, bricard_tangent, crank_tangent
from benchmarks.race.mechanisms import Linkage
from benchmarks.race.problems import STARTS, Batch, Inverse, Motion, Problem, problems

FILE = Path(__file__).with_name("references.npz")
TOLERANCE = 1e-13
Array = np.ndarray


def reference(problem: Problem) -> tuple[Array, float]:
    """Return the right answer of a problem and the bound of its error."""
    if isinstance(problem, Inverse):
        return inverse(problem)
    with np.load(FILE) as kept:
        return kept[problem.name], float(kept[f"{problem.name}_error"])


CHECKED = 500
"""Samples of inverse dynamics that are compared."""


def inverse(problem: Inverse) -> tuple[Array, float]:
    """Return the first torques by Lagrange's equations, rates of M and V by complex steps; of loops in closed form."""
    equations = Equations(problem.linkage)
    q, v, a = (x[:CHECKED] for x in problem.states())
    if problem.drive is not None:
        return driven(problem.linkage, q, a), 1e-13
    near = q[:, None, :] + STEP * 1j * np.eye(equations.size)
    slopes, pull = equations.mass(near).imag / STEP, equations.potential(near).imag / STEP
    bias = np.einsum("nkij,nk,nj->ni", slopes, v, v) - 0.5 * np.einsum("nkij,ni,nj->nk", slopes, v, v)
    return np.einsum("nij,nj->ni", equations.mass(q), a) + bias + pull, 1e-13


def driven(linkage: Linkage, q: Array, a: Array) -> Array:
    """Return the torque of the drive in closed form: inertia times acceleration, and weights, shape (n, 1).

    Of the four-bar ``5/3 s'' - 2 g sin s``; of the manipulator the moments of its weights about the arm's axis.
    """
    s, dds = q[:, :1], a[:, :1]
    if len(linkage.bodies) == 3:
        return 5.0 / 3.0 * dds - 2.0 * 9.81 * np.sin(s)
    l, d, arm, support, link, counterweight, load = 2.0, 1.25, 100.0, 120.0, 60.0, 270.0, 600.0
    inertia = l**2 * ((arm + link) / 3 + support + load) + d**2 * (arm / 3 + counterweight) - l * d * arm / 3
    weight = 9.81 * (arm * (l - d) / 2 + (support + load) * l + link * l / 2 - counterweight * d)
    return inertia * dds + weight * np.cos(s)


def free_motion(problem: Motion) -> Array:
    """Return the answer by Hamilton's equations."""
    equations = Equations(problem.linkage)
    (q, v), n = equations.start(), equations.size

    def rate(t: float, y: Array) -> Array:
        return np.concatenate(equations.rate(y[:n], y[n:]))

    method = "LSODA" if problem.linkage.damping.any() else "DOP853"
    start = np.concatenate([q, equations.mass(q) @ v])
    found = solve_ivp(rate, (0.0, problem.end), start, method, t_eval=problem.times, rtol=TOLERANCE, atol=1e-14)
    q = found.y[:n].T
    if not problem.linkage.flight:
        return q
    turned = equations.frames(q)[0][0].reshape(len(q), 9)
    return np.hstack([q[:, :3], turned, q[:, 6:]])


def loop_motion(problem: Motion, tangent: Callable[[Array], Array]) -> Array:
    """Return the answer for one freedom, along the curve of closed positions."""
    equations, start = Equations(problem.linkage), np.append(problem.linkage.q, 0.0)

    def rate(t: float, y: Array) -> Array:
        return np.append(*equations.along(y[:-1], y[-1], tangent))

    found = solve_ivp(rate, (0.0, problem.end), start, "DOP853", t_eval=problem.times, rtol=TOLERANCE, atol=TOLERANCE)
    return found.y[:-1].T


def equal_bars(problem: Motion) -> Array:
    """Return the answer of N four-bars: ``theta'' = k sin theta`` by Jacobi's amplitude."""
    count = len(problem.linkage.loops)
    k = ((count + 1) / 2 + count) * 9.81 / ((count + 1) / 3 + count)
    r = 0.5 * np.sqrt(1.0 + 4.0 * k)
    m = k / r**2
    angle = np.pi + 2.0 * ellipj(r * problem.times - ellipk(m), m)[3]
    return angle[:, None] * problem.linkage.v


def crosses(problem: Motion) -> Array:
    """Return the answer of a scissor by Lagrange's equations of two angles, in closed form.

    All rising bars stand at alpha, all falling ones at beta. With u, of length sqrt(2), along a rising bar and w, of
    length sqrt(1/2), along half a falling one, the two centres of cross k are both at ``(k + 1) u / 2 + k w``.
    """
    count, mass, moment = len(problem.linkage.bodies) // 2, 2.0, 1.0 / 6.0
    k = np.arange(count)
    along, across = 0.5 * (k + 1.0), 1.0 * k
    a = 2.0 * mass * (along**2).sum() + count * moment
    b = 0.5 * mass * (across**2).sum() + count * moment
    c = mass * (along * across).sum()  # times u . w = -sin(alpha - beta)
    lift = 9.81 * mass * np.array([2.0**0.5 * along.sum(), 0.5**0.5 * across.sum()])

    def rate(t: float, y: Array) -> list[float]:
        alpha, beta, da, db = y
        s, cosine = np.sin(alpha - beta), np.cos(alpha - beta)
        pull = lift * np.cos([alpha + np.pi / 4, beta - np.pi / 4])
        force = c * cosine * np.array([-(db**2), da**2]) - pull
        return [da, db, *np.linalg.solve([[a, -c * s], [-c * s, b]], force)]

    found = solve_ivp(rate, (0.0, problem.end), np.zeros(4), "DOP853", t_eval=problem.times, rtol=TOLERANCE, atol=1e-14)
    return found.y[:2].T @ bars(count).T


def bars(count: int) -> Array:
    """Return the angles of a scissor's joints by those of its rising and falling bars, shape (2 count, 2)."""
    alike = np.tile([[1.0, -1.0], [-1.0, 1.0]], (count, 1))
    alike[0] = 1.0, 0.0
    return alike


def crosses_by_pinocchio(problem: Motion) -> Array:
    """Return the same with masses and forces by ``crba`` and ``nonLinearEffects`` along the two freedoms."""
    import pinocchio as pin

    from benchmarks.race.engines.pinocchio import model_of

    model = model_of(problem.linkage)
    data, ways = model.createData(), bars(len(problem.linkage.bodies) // 2)

    def rate(t: float, y: Array) -> Array:
        q, v = ways @ y[:2], ways @ y[2:]
        upper = np.triu(pin.crba(model, data, q))
        mass = ways.T @ (upper + np.triu(upper, 1).T) @ ways
        return np.append(y[2:], np.linalg.solve(mass, -ways.T @ pin.nonLinearEffects(model, data, q, v)))

    found = solve_ivp(rate, (0.0, problem.end), np.zeros(4), "DOP853", t_eval=problem.times, rtol=TOLERANCE, atol=1e-14)
    return found.y[:2].T @ ways.T


def rods(problem: Motion) -> Array:
    """Return the answer of a chain of rods by Lagrange's equations of their angles to the vertical.

    With the mass ``c_j`` of half a rod j and of all beyond it, ``sum_j M_ij cos(phi_i - phi_j) phi_j''
    + M_ij sin(phi_i - phi_j) phi_j'^2 + g c_i sin phi_i = 0``, ``M_ij = c_max(i, j)``, and ``1/3`` for ``1/2`` in M_ii.
    """
    n = len(problem.linkage.bodies)
    beyond = n - 1.0 - np.arange(n)
    carried = np.minimum.outer(beyond, beyond) + 0.5
    np.fill_diagonal(carried, beyond + 1.0 / 3.0)

    def rate(t: float, y: Array) -> Array:
        angle, v = y.reshape(2, n)
        s, c = np.sin(angle), np.cos(angle)
        apart = carried * (np.outer(s, c) - np.outer(c, s))
        mass = carried * (np.outer(c, c) + np.outer(s, s))
        return np.concatenate([v, np.linalg.solve(mass, -apart @ v**2 - 9.81 * (beyond + 0.5) * s)])

    start = np.concatenate([np.cumsum(problem.linkage.q), np.zeros(n)])
    found = solve_ivp(rate, (0.0, problem.end), start, "DOP853", t_eval=problem.times, rtol=1e-12, atol=1e-12)
    return np.diff(found.y[:n].T, axis=1, prepend=0.0)


def rods_by_pinocchio(problem: Motion) -> Array:
    """Return the same by ``aba``, in buffers of the model's size: ``pin.Data(model)`` would take 50 GB."""
    import pinocchio as pin

    from benchmarks.race.engines.pinocchio import integration, model_of
    from pinarm.mechanics.geometry.kinematics import new_data

    model = model_of(problem.linkage)
    data, still = new_data(model), np.zeros(model.nv)
    return integration(problem, lambda q, v: pin.aba(model, data, q, v, still), "DOP853", 1e-12)()


OWN = {"scissor_50": (crosses, crosses_by_pinocchio), "chain_1000": (rods, rods_by_pinocchio)}
"""The two routes of linkages that have their own equations."""


def batch(problem: Batch) -> Array:
    """Return the last angles by Hamilton's equations, one step for all."""
    equations, n = Equations(problem.linkage), len(problem.linkage.q)
    q, v = problem.starts()
    p = (equations.mass(q) @ v[..., None])[..., 0]

    def rate(t: float, y: Array) -> Array:
        q, p = y.reshape(2, STARTS, n)
        return np.concatenate([x.ravel() for x in equations.rate(q, p)])

    start = np.concatenate([q.ravel(), p.ravel()])
    found = solve_ivp(rate, (0.0, problem.end), start, "DOP853", rtol=3e-14, atol=1e-13)
    return found.y[: n * STARTS, -1].reshape(STARTS, n)


def first(problem: Problem) -> Array:
    """Return the answer itself."""
    if isinstance(problem, Batch):
        return batch(problem)
    assert isinstance(problem, Motion)
    if problem.name in OWN:
        return OWN[problem.name][0](problem)
    if problem.alike:
        return equal_bars(problem)
    if not problem.linkage.loops:
        return free_motion(problem)
    return loop_motion(problem, crank_tangent(Equations(problem.linkage)) if problem.regular else bricard_tangent)


def second(problem: Problem) -> Array:
    """Return the answer by Pinocchio and SciPy; that of the four-bars by their pendulum's equation."""
    from benchmarks.race.engines import pinocchio

    if isinstance(problem, Batch):
        return pinocchio.together(problem, 1, "DOP853", TOLERANCE)()
    assert isinstance(problem, Motion)
    if problem.name in OWN:
        return OWN[problem.name][1](problem)
    if problem.alike:
        count = len(problem.linkage.loops)
        k = ((count + 1) / 2 + count) * 9.81 / ((count + 1) / 3 + count)
        found = solve_ivp(lambda t, y: [y[1], k * np.sin(y[0])], (0.0, problem.end), [0.0, 1.0], "DOP853",
                          t_eval=problem.times, rtol=TOLERANCE, atol=TOLERANCE)  # fmt: skip
        return found.y[0][:, None] * problem.linkage.v
    if problem.linkage.loops:
        held = (0.0, 0.0) if problem.regular else (100.0, 20.0)
        return pinocchio.integration(problem, pinocchio.closed(problem.linkage, held, 1e-6, 3), "DOP853", 1e-12)()
    return pinocchio.integration(problem, pinocchio.tree(problem.linkage), "DOP853", TOLERANCE)()


def main() -> None:
    """Compute all answers, or those that are named, and keep them beside the others."""
    kept = dict(np.load(FILE)) if FILE.exists() else {}
    for problem in problems().values():
        if isinstance(problem, Inverse) or (sys.argv[1:] and problem.name not in sys.argv[1:]):
            continue
        answer = first(problem)
        error = float(np.abs(answer - second(problem)).max())
        print(f"{problem.name:16s} two routes differ by {error:.1e}", flush=True)
        kept |= {problem.name: answer, f"{problem.name}_error": np.array(error)}
    np.savez_compressed(FILE, **kept)


if __name__ == "__main__":
    main()
