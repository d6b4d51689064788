"""Linearised motions of known mechanisms: heavy top, Foucault's pendulum, four-bars, random trees and loops."""

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from urdf_links import link, robot, tip

import pinarm

ROOT = Path(pinarm.__file__).parents[1]
G = 9.81


def run(tmp_path, xml, about, **description):
    (tmp_path / "made.urdf").write_text(xml)
    with pinarm.file_root(tmp_path):
        return pinarm.run({
            "pinarm": 1, "mechanism": {"pinarm": 1, "robot": str(tmp_path / "made.urdf"), **description},
            "problem": {"kind": "linear", "about": about}, "outputs": ["mode.1.frequency"],
        })  # fmt: skip


def test_a_heavy_top_precesses_and_nods(tmp_path):
    """Steady precession W at the angle x, spin s: ``A x'' = V(x)'`` of the effective potential, closed form.

    With ``p = C (s + W cos x)`` constant and ``b = A W sin^2 x + p cos x`` constant,
    ``A x'' = (b - p cos x) (b cos x - p) / (A sin^3 x) + m g l sin x``.
    """
    mass, lever, transverse, polar, tilt, precession = 0.8, 0.1, 0.014, 0.004, 0.7, 3.0
    spin = (mass * G * lever / precession + transverse * precession * math.cos(tilt)) / polar - precession * math.cos(
        tilt
    )
    xml = robot(link("turn", "base", "0 0 1"), link("tilt", "turn_link", "1 0 0"),
                link("spin", "tilt_link", "0 0 1", mass=mass, com=f"0 0 {lever}",
                     inertia=(transverse - mass * lever**2,) * 2 + (polar,)))  # fmt: skip
    rates = {"turn": f"{precession} rad/s", "spin": f"{spin} rad/s"}
    about = {"steady": rates, "equilibrium": {"tilt": f"{tilt + 0.05} rad"}}
    result = run(tmp_path, xml, about, gravity={"direction": "-z"})
    p = polar * (spin + precession * math.cos(tilt))
    b = transverse * precession * math.sin(tilt) ** 2 + p * math.cos(tilt)

    def nod(x):
        sine, cosine = np.sin(x), np.cos(x)
        return ((b - p * cosine) * (b * cosine - p) / (transverse * sine**3) + mass * G * lever * sine) / transverse

    step = 1e-30
    expected = math.sqrt(-np.imag(nod(tilt + 1j * step)) / step)
    assert result["joint.tilt.position"].values == pytest.approx([tilt], rel=1e-9)
    assert result.arrays["eigenvalues"].values[0].imag.max() == pytest.approx(expected, rel=1e-9)


def test_foucaults_pendulum_turns_with_the_latitude(tmp_path):
    """On a table that turns with W about the vertical: ``w0 +- W`` seen from it, ``w0^2 = g / l``."""
    length, turning = 20.0, 0.05
    xml = robot(link("table", "base", "0 0 1", mass=1.0, inertia=(1e6, 1e6, 1e6)), link("x", "table_link", "1 0 0"),
                link("y", "x_link", "0 1 0", mass=3.0, com=f"0 0 {-length}"))  # fmt: skip
    result = run(tmp_path, xml, {"steady": {"table": f"{turning} rad/s"}}, gravity={"direction": "-z"})
    swinging = math.sqrt(G / length)
    found = np.sort(result.arrays["eigenvalues"].values[0].imag)[-2:]
    assert found == pytest.approx([swinging - turning, swinging + turning], rel=1e-6)  # of the table's inertia


def test_a_crank_rocker_has_the_period_of_its_own_small_motion():
    """Period by the integrator between passages of the equilibrium, extrapolated to the amplitude 0."""
    equilibrium = {"equilibrium": {"theta2": "-90 deg", "A": "40 deg", "theta4": "80 deg"}}
    spring = {"kind": "joint_spring", "joint": "theta2", "stiffness": "20 N*m/rad"}
    path = str(ROOT / "models/crank_rocker/mechanism.yaml")
    base = {"pinarm": 1, "mechanism": path, "outputs": ["theta2"]}
    linear = pinarm.run({**base, "problem": {"kind": "linear", "about": equilibrium, "loads": {"mount": spring}}})
    rest, frequency = float(linear["theta2"].values[0]), float(linear["mode.1.frequency"].values[0])
    places = {name: f"{float(linear[name].values[0])!r} rad" for name in ("A", "theta4")}

    def period(amplitude):
        motion = pinarm.run({
            **base, "accuracy": {"tolerance": 1e-12},
            "problem": {"kind": "forward", "time": {"end": f"{2.2 / frequency} s", "samples": 4001}, "start": places,
                        "initial": {"position": {"theta2": f"{rest + amplitude!r} rad"}}, "loads": {"mount": spring}},
        })  # fmt: skip
        t, x = motion["t"].values, motion["theta2"].values - rest
        passed = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
        crossings = t[passed] - x[passed] * (t[passed + 1] - t[passed]) / (x[passed + 1] - x[passed])
        return float(np.diff(crossings)[0])

    large, small = period(0.02), period(0.01)
    assert (4.0 * small - large) / 3.0 == pytest.approx(1.0 / frequency, rel=1e-6)


def random_tree(generator, n):
    parts = ["base"]
    links = []
    for k in range(n):
        parent = parts[int(generator.integers(max(0, len(parts) - 2), len(parts)))]
        axis, at, com = (" ".join(f"{x:.6f}" for x in generator.normal(size=3) * size) for size in (1.0, 0.3, 0.2))
        inertia = tuple(0.05 + 0.02 * generator.random(3))
        links.append(link(f"j{k}", parent, axis, at=at, mass=1.0 + float(generator.random()), com=com, inertia=inertia,
                          kind="prismatic" if generator.random() < 0.3 else "continuous"))  # fmt: skip
        parts.append(f"j{k}_link")
    return robot(*links, tip("one", "j1_link", "0.1 0.2 0.1"), tip("two", f"j{n - 1}_link", "0.3 -0.1 0.2"))


@pytest.mark.parametrize("seed", range(3))
def test_random_trees_move_as_exp_of_a(seed, mechanism):
    """A small deviation after 0.2 s, by an integrator of SciPy over Pinocchio's ``aba``, at two amplitudes."""
    generator = np.random.default_rng(seed)
    made = mechanism(random_tree(generator, 5))
    model, nv = made.model, made.model.nv
    q = 0.5 * generator.normal(size=nv)
    tau = pin.rnea(model, model.createData(), q, np.zeros(nv), np.zeros(nv))
    linear = made.linearise(q, None, tau)
    x = generator.normal(size=2 * nv)
    data = model.createData()

    def moved(amplitude):
        def rates(t, y):
            return np.concatenate([y[nv:], pin.aba(model, data, y[:nv], y[nv:], tau)])

        begin = np.concatenate([q, np.zeros(nv)]) + amplitude * x
        found = solve_ivp(rates, (0.0, 0.2), begin, "DOP853", rtol=1e-13, atol=1e-14)
        return (found.y[:, -1] - np.concatenate([q, np.zeros(nv)])) / amplitude

    expected = expm(0.2 * linear.A) @ x
    both = [0.5 * (moved(e) + moved(-e)) for e in (1e-3, 5e-4)]  # even powers cancel
    found = (4.0 * both[1] - both[0]) / 3.0
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_random_loops_have_the_slopes_of_their_accelerations(seed, mechanism, differentiate):
    """A rod, a plane or a line closes a random tree: A against real differences of ``forward`` at closed positions."""
    generator = np.random.default_rng(10 + seed)
    kind = [
        {"kind": "rod", "length": None},
        {"kind": "point_on_plane", "axis": "y"},
        {"kind": "point_on_line", "axis": "x"},
    ][seed]
    made = mechanism(random_tree(generator, 6))
    q = 0.3 * generator.normal(size=made.model.nv)
    apart = float(np.linalg.norm(made.frame("two", q)[:3, 3] - made.frame("one", q)[:3, 3]))
    if "length" in kind:
        kind = {"kind": "rod", "length": f"{apart!r} m"}
    made = mechanism(random_tree(np.random.default_rng(10 + seed), 6), loops={"L": {**kind, "between": ["one", "two"]}})
    q = closed(made, q)
    rows = made.closure.rows(made.closure.state(q))
    v = np.linalg.svd(rows)[2][len(rows) :].T @ generator.normal(size=made.model.nv - len(rows))
    tau = generator.normal(size=made.model.nv)
    linear = made.linearise(q, v, tau)
    motion, free = linear.motion, linear.motion.independent

    def accelerated(x, column):
        position = closed(made, pin.integrate(made.model, q, x * motion.position[:, column]), free)
        g = made.closure.rows(made.closure.state(position))
        rates = (v + x * motion.velocity[:, column])[free]
        others = np.setdiff1d(np.arange(len(v)), free)
        whole = np.zeros(len(v))
        whole[free], whole[others] = rates, -np.linalg.lstsq(g[:, others], g[:, free] @ rates)[0]
        return made.forward(position, whole, tau)[free]

    for column in range(2 * len(free)):
        wanted = differentiate(lambda x, column=column: accelerated(x, column), 0.0, h=2e-3)
        assert linear.A[len(free) :, column] == pytest.approx(wanted, rel=1e-6, abs=1e-6 * (1.0 + np.abs(wanted).max()))


def closed(made, q, kept=()):
    """Return a closed configuration by Newton's method; some joints keep their place."""
    moving = np.setdiff1d(np.arange(made.model.nv), np.asarray(kept, dtype=int))
    for _ in range(50):
        state, step = made.closure.state(q), np.zeros(made.model.nv)
        step[moving] = -np.linalg.lstsq(made.closure.rows(state)[:, moving], made.closure.gap(state))[0]
        q = pin.integrate(made.model, q, step)
    return q
