"""Loops in compiled code against the same in Python, which shares none of it."""

import ctypes

import numpy as np
import pinocchio as pin
import pytest
from catalogue import bennett, five_bar, four_bar, rssr, screw_jack, slider_crank
from linkage import GROUND, Linkage, random_body, random_joint
from motions import freely
from test_accelerations import random_linkage

import pinarm
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix, solve
from pinarm.engine.kernel import tree as kernel_tree
from pinarm.engine.kernel.library import SkylineStructure, absence, library, pointer
from pinarm.engine.kernel.tree import links_of
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems import compiled_motion
from pinarm.engine.motion.systems.loop_motion import Regularity
from pinarm.engine.motion.systems.loop_system import LoopSystem

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")
FREE = PrescribedCoordinates((), (), ())
KINDS = ("spherical", "rod", "point_on_line", "point_on_plane", "universal", "cylindrical", "revolute", "planar",
         "prismatic", "fixed")  # fmt: skip
SHARP = 1e-9
"""Relative to the largest acceleration. The Python route takes the rows apart by singular values: what it loses by
rounding grows with their condition, 1e4 in these linkages of no special kind."""


@pytest.fixture(autouse=True)
def _forgetting(forget_loops):
    forget_loops()


def closed_states(system, count=5):
    """Return random closed states of a mechanism that is closed at its neutral configuration."""
    model, random, found = system.rows.model, np.random.default_rng(3), []
    nothing = np.zeros((1, 0))
    while len(found) < count:
        q = pin.integrate(model, pin.neutral(model), random.uniform(-0.05, 0.05, model.nv))
        closed, v, _ = system.settled(q[None], random.normal(size=(1, model.nv)), nothing, nothing, np.zeros(1))
        found.append((closed[0], v[0]))
    return found


def compare(flow, closure, states):
    """Compare accelerations with those of the equation of motion, by singular values of the rows."""
    model, data = closure.model, closure.model.createData()
    flow.closing.near, flow.closing.tolerant = 0, flow.compiled.tolerant(flow.motion.q, flow.motion.measure.rank)
    for q, v in states:
        state = closure.state(q, v)
        force = -np.array(pin.nonLinearEffects(model, data, q, v))
        a = solve(closure.split(closure.rows(state)), mass_matrix(model, q), force, -closure.drift(state))
        found = flow.rates(0.0, np.concatenate([q, v]))[model.nq :]
        assert np.abs(found - a).max() <= SHARP * max(1.0, np.abs(a).max())


@pytest.mark.parametrize("kind", KINDS)
def test_accelerations_of_every_kind_are_those_of_the_singular_values(kind, tmp_path):
    linkage = random_linkage(0, loops=(kind,))
    mechanism = linkage.build(tmp_path, [name for name in linkage.joints if name.startswith("loop")])
    closure, dynamics = mechanism.closure, Dynamics.of(mechanism.model)
    near = pin.neutral(mechanism.model)
    general = LoopSystem.of(closure, dynamics, FREE, near)
    interval = general.interval(dynamics, 0.0, 1.0)
    assert interval.compiled, interval.remark
    compare(interval.compiled, closure, closed_states(general))


RODS = [("rod", 0, 2), ("rod", 1, 4), ("rod", 0, 6), ("spherical", 2, 6), ("rod", -1, 7)]
"""Kind and ends of the loops of ``nested``; -1 is the ground."""


def nested(seed):
    """A chain of eight bodies on random hinges, with loops within and across each other, most on bodies that move."""
    random = np.random.default_rng(seed)
    names = [f"body_{k}" for k in range(8)]
    joints = {
        f"tree_{k}": random_joint(random, "revolute", parent, name)
        for k, (parent, name) in enumerate(zip([GROUND, *names], names, strict=False))
    }
    for k, (kind, *ends) in enumerate(RODS):
        one, other = (names[end] if end >= 0 else GROUND for end in ends)
        joints[f"loop_{k}"] = random_joint(random, kind, one, other)
    return Linkage({name: random_body(random, 1.0) for name in names}, joints)


@pytest.mark.parametrize("seed", range(2))
def test_accelerations_of_loops_within_loops_are_those_of_the_singular_values(seed, tmp_path):
    """Their multipliers are eliminated where they end, one after the other."""
    linkage = nested(seed)
    mechanism = linkage.build(tmp_path, [name for name in linkage.joints if name.startswith("loop")])
    closure, dynamics = mechanism.closure, Dynamics.of(mechanism.model)
    general = LoopSystem.of(closure, dynamics, FREE, pin.neutral(mechanism.model))
    interval = general.interval(dynamics, 0.0, 1.0)
    assert interval.compiled, interval.remark
    ways = compiled_motion._loops(Regularity.of(closure, ())).ways
    assert sum(entry < 0 for way in ways for entry in way.passed) > 3
    assert all(len(way.passed) < 8 for way in ways[:3])
    compare(interval.compiled, closure, closed_states(general))


MOTIONS = [
    (four_bar(), "O"), (five_bar(), "M"), (rssr(), "A"), (rssr(), "B"), (bennett(), "axis_3"), (slider_crank(), "C"),
    (screw_jack(), "S"),
]  # fmt: skip


@pytest.mark.parametrize(("linkage", "cut"), MOTIONS)
def test_motions_are_those_of_python(linkage, cut, tmp_path, calls, without):
    mechanism = linkage.build(tmp_path, [cut])
    first = next(iter(mechanism.joints))
    end = 0.1 if cut == "S" else 0.5
    run = lambda: freely(mechanism, end, 6, velocity={first: 4.0}, tolerance=1e-9)  # noqa: E731
    found = run()
    assert calls
    taken, expected = len(calls), without(run)
    assert len(calls) == taken
    assert found.figures["steps"] == pytest.approx(expected.figures["steps"], rel=0.05)
    for one, other in zip((found.rows.q, found.rows.v), (expected.rows.q, expected.rows.v), strict=True):
        assert np.abs(one - other).max() <= 1e-7 * np.abs(other).max()  # Python closes all stages of Bennett's linkage


@pytest.mark.slow
@pytest.mark.parametrize("name", ["andrews_squeezing", "change_point_four_bar_free", "rssr_free"])
def test_scenarios_with_loops_are_the_same_with_the_library_and_without(name, calls, without):
    """As far as the motion amplifies rounding: past singular positions, up to the errors that their keys allow."""
    run = lambda: pinarm.run(f"scenarios/{name}.yaml")  # noqa: E731
    found = run()
    assert calls
    expected = without(run)
    assert found.notes() == expected.notes()
    assert found.figures["evaluations"] == pytest.approx(expected.figures["evaluations"], rel=0.05)
    assert np.abs(found.trajectory.q - expected.trajectory.q).max() <= 1e-6 * np.abs(expected.trajectory.q).max()


EQUAL = "scenarios/four_bar_equal_rods.yaml"


class TestSingularPositions:
    """A four-bar of equal rods passes positions with all rods in line; on its branch the uprights are parallel."""

    @pytest.mark.parametrize("tolerance", [1e-4, 1e-8, 1e-12])
    def test_are_passed_on_the_branch(self, tolerance, calls):
        found = pinarm.run(EQUAL, {"accuracy.tolerance": tolerance})
        assert calls
        q = found.trajectory.q
        assert np.abs(q[:, 0]).max() > 3.0 * np.pi  # it has turned past them
        assert np.abs(q[:, 0] - q[:, 2]).max() < 1e-2 or np.abs(q[:, 0] + q[:, 1]).max() < 1e-2


class TestWrongKernel:
    def test_is_not_used_and_the_run_says_so(self, tmp_path, monkeypatch, calls):

        def heavier(model):
            known = links_of(model)
            known.links["inertia"] *= 1.0 + 1e-9
            return known

        monkeypatch.setattr(kernel_tree, "links_of", heavier)
        mechanism = rssr().build(tmp_path, ["A"])
        found = freely(mechanism, 0.1, 3, velocity={"O": 4.0}, tolerance=1e-9)
        assert not calls
        assert any("the compiled kernel is not used" in note for note in found.notes)


class TestSkyline:
    """Rows of random lengths, against numpy."""

    @pytest.fixture(params=range(3))
    def matrix(self, request):
        random = np.random.default_rng(request.param)
        n = int(random.integers(1, 30))
        first = np.array([int(random.integers(0, k + 1)) for k in range(n)], np.intp)
        rows = np.tril(random.normal(size=(n, n)))
        rows[np.arange(n)[None] < first[:, None]] = 0.0
        whole = rows @ rows.T
        reach = np.array([np.flatnonzero(whole[k])[0] for k in range(n)], np.intp)
        return whole, reach

    def skyline(self, whole, first):
        sizes = np.arange(len(whole)) - first + 1
        origin = np.cumsum(sizes) - np.arange(len(whole)) - 1
        entry = np.concatenate([whole[k, first[k] : k + 1] for k in range(len(whole))])
        arrays = first, origin, entry, np.zeros_like(entry)
        return SkylineStructure(len(whole), *map(pointer, arrays)), arrays

    def test_factorises(self, matrix):
        whole, first = matrix
        structure, (_, origin, _, factor) = self.skyline(whole, first)
        assert library().skyline_factorise(ctypes.byref(structure), ctypes.c_double(0.5)) == 0
        lower = np.zeros_like(whole)
        for k in range(len(whole)):
            lower[k, first[k] : k + 1] = factor[origin[k] + first[k] : origin[k] + k + 1]
        pivots = np.diag(lower).copy()
        np.fill_diagonal(lower, 1.0)
        assert lower * pivots @ lower.T == pytest.approx(whole + 0.5 * np.eye(len(whole)), rel=1e-12, abs=1e-12)

    def test_counts_eigenvalues_and_finds_them(self, matrix):
        whole, first = matrix
        structure, _kept = self.skyline(whole, first)
        values = np.linalg.eigvalsh(whole)
        for bound in (0.1, 1.0, 10.0):
            found = library().skyline_factorise(ctypes.byref(structure), ctypes.c_double(-bound))
            assert found == (values < bound).sum()
        library().skyline_eigenvalue.restype = ctypes.c_double
        for above in range(min(3, len(whole))):
            wanted = values[::-1][above]
            if wanted > 1e-6 * values[-1]:
                bracket = [ctypes.c_double(x) for x in (1e-8 * values[-1], 2.0 * values[-1], 1e-9)]
                found = library().skyline_eigenvalue(ctypes.byref(structure), ctypes.c_ssize_t(above), *bracket)
                assert found == pytest.approx(wanted, rel=1e-8)
