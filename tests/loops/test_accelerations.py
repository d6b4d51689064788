"""Random trees with random loops: accelerations and multipliers against two routes that share nothing with ours.

Newton-Euler equations of all bodies in extended precision (``newton_euler``), and Pinocchio's ``constraintDynamics``.
"""

import numpy as np
import pinocchio as pin
import pytest
from linkage import GROUND, SIMPLE, Linkage, random_body, random_joint
from motions import free, poses, wrench
from newton_euler import LONG, newton_euler

TREE = ("revolute", "revolute", "prismatic", "cylindrical", "spherical", "universal", "planar")
LOOP = ("spherical", "rod", "point_on_line", "point_on_plane", "universal", "cylindrical", "revolute", "planar")
BALLS = ("spherical", "revolute")
EXTENDED = pytest.mark.skipif(np.finfo(LONG).eps > 1e-18, reason="no extended precision on this machine")


def random_linkage(seed, loops=LOOP, spread=0.0):
    """Two to five bodies on a random tree, and one or two loops that leave at least one freedom.

    ``spread``: masses of the bodies are scaled by up to ten to this power, either way.
    """
    generator = np.random.default_rng(seed)
    while True:
        n = int(generator.integers(2, 6))
        names = [f"body_{k}" for k in range(n)]
        bodies = {name: random_body(generator, 10.0 ** generator.uniform(-spread, spread)) for name in names}
        joints, freedom = {}, 0
        for k, name in enumerate(names):
            kind = str(generator.choice(TREE))
            parent = GROUND if k == 0 else str(generator.choice([GROUND, *names[:k]]))
            joints[f"tree_{k}"] = random_joint(generator, kind, parent, name)
            freedom += len(SIMPLE[kind])
        for k in range(int(generator.integers(1, 3))):
            kind, ends = str(generator.choice(loops)), list(generator.permutation([GROUND, *names])[:2])
            joints[f"loop_{k}"] = random_joint(generator, kind, str(ends[0]), str(ends[1]))
            freedom -= 6 - len(SIMPLE[kind])
        if freedom >= 1:
            return Linkage(bodies, joints)


def moving(linkage, folder, seed, end=0.1, samples=3):
    """A motion from random velocities that the loops allow."""
    mechanism = linkage.build(folder, [name for name in linkage.joints if name.startswith("loop")])
    closure, model = mechanism.closure, mechanism.model
    state = closure.state(pin.neutral(model))
    rows = closure.rows(state)
    v = np.random.default_rng(seed).normal(size=model.nv)
    v -= np.linalg.lstsq(rows, rows @ v, rcond=1e-9)[0]
    velocity = {name: float(v[joint.v]) for name, joint in mechanism.joints.items()}
    return free(mechanism, end, samples, velocity=velocity, tolerance=1e-11)


def compare(linkage, run, dependent=1e-9, accuracy=1e-10):
    """Accelerations of all bodies and wrenches of all loops against Newton and Euler."""
    for row, pose in enumerate(poses(linkage, run)):
        right = newton_euler(linkage, pose, dependent)
        assert right.open < 1e-11
        assert right.speed < 1e-9
        size = max(np.abs([*right.acceleration.values(), *right.alpha.values()]).max(), 1.0)
        for body in linkage.bodies:
            assert pose.acceleration[body] == pytest.approx(right.acceleration[body], abs=accuracy * size)
            assert pose.alpha[body] == pytest.approx(right.alpha[body], abs=accuracy * size)
        force = max(float(np.abs(one).max()) for one in right.wrench.values())
        if right.redundant:
            continue
        for name in linkage.joints:
            if name.startswith("loop"):
                found = [values[row] for values in wrench(linkage, run, name).values()]
                assert found == pytest.approx(right.wrench[name], abs=accuracy * force)


@pytest.mark.parametrize("seed", [*range(10), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(10, 100))])
def test_a_random_mechanism_moves_as_newton_and_euler_say(seed, tmp_path):
    linkage = random_linkage(seed)
    compare(linkage, moving(linkage, tmp_path, seed))


@EXTENDED
@pytest.mark.parametrize("seed", range(6))
def test_masses_may_differ_by_six_orders(seed, tmp_path):
    linkage = random_linkage(1000 + seed, spread=3.0)
    compare(linkage, moving(linkage, tmp_path, seed, end=1e-3), accuracy=1e-8)


@pytest.mark.parametrize(("seed", "loops", "spread"), [(3004, BALLS, 2.5), (1012, LOOP, 3.5)])
def test_velocities_are_the_integral_of_the_accelerations_also_where_masses_differ(seed, loops, spread, tmp_path):
    """The steps and the table have different routes to the acceleration where loops are closed by points.

    The last linkage is far from regular in all its positions: no reason for what is done close to singular ones.
    """
    linkage = random_linkage(seed, loops, spread)
    run = moving(linkage, tmp_path, seed, end=0.08, samples=401)
    h = run.grid.t[1] - run.grid.t[0]
    weights = h * 2 / 45 * np.array([7.0, 32.0, 12.0, 32.0, 7.0])  # Boole's rule
    gained = sum(weights[k] * run.a[k : len(run) - 4 + k : 4] for k in range(5)).sum(axis=0)
    assert run.v[-1] - run.v[0] == pytest.approx(gained, abs=2e-9 * max(1.0, np.abs(run.v).max()))


class TestConstraintDynamics:
    """Ball joints and rigid connections are Pinocchio's own constraints."""

    @pytest.mark.parametrize("seed", range(6))
    def test_accelerations_and_forces_are_the_same(self, seed, tmp_path):
        linkage = random_linkage(2000 + seed, ("spherical", "fixed"))
        run = moving(linkage, tmp_path, seed)
        model, closure = run.mechanism.model, run.mechanism.closure
        models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for one in closure.constraints:
            kind = pin.ContactType.CONTACT_3D if one.kind == "spherical" else pin.ContactType.CONTACT_6D
            first, second = model.frames[one.first], model.frames[one.second]
            models.append(pin.RigidConstraintModel(
                kind, model, first.parentJoint, first.placement, second.parentJoint, second.placement, pin.LOCAL
            ))  # fmt: skip
            datas.append(models[-1].createData())
        data = model.createData()
        pin.initConstraintDynamics(model, data, models, datas)
        settings = pin.ProximalSettings(1e-14, 1e-10, 20)
        for row in range(len(run)):
            q, v = run.q[row], run.v[row]
            a = pin.constraintDynamics(model, data, q, v, np.zeros(model.nv), models, datas, settings)
            assert run.a[row] == pytest.approx(a, rel=1e-8, abs=1e-8 * np.abs(a).max())
