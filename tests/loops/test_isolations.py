"""Equations of isolations on random chains and loops hold in random states; others are hyperstatic by self-stresses."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from random_chains import closed_chain, open_chain

import pinarm
from pinarm.engine.kinematics.assembly import beside, generic_near
from pinarm.errors import InputError


def states(mechanism: pinarm.Mechanism, generator: np.random.Generator) -> tuple[list[np.ndarray], int]:
    """Two random closed states, each (q, v, a), and the mobility."""
    model, closure, found, free = mechanism.model, mechanism.closure, [], np.eye(mechanism.model.nv)
    if closure.size:
        near = beside(mechanism, generic_near(mechanism, {}))[1:3]
    else:
        near = [pin.integrate(model, pin.neutral(model), generator.uniform(-1.0, 1.0, model.nv)) for _ in range(2)]
    for q in near:
        drift = np.zeros(model.nv)
        if closure.size:
            free = closure.split(closure.rows(closure.state(q))).free
        v = free @ generator.normal(size=free.shape[1])
        if closure.size:
            state = closure.state(q, v)
            drift = np.linalg.lstsq(closure.rows(state), closure.drift(state), rcond=None)[0]
        found.append((q, v, free @ generator.normal(size=free.shape[1]) - drift))
    return found, free.shape[1]


@pytest.mark.parametrize("make", [open_chain, closed_chain])
@pytest.mark.parametrize("seed", range(4))
def test_equations_hold_or_the_unknown_is_hyperstatic(make: object, seed: int, tmp_path: Path) -> None:
    generator = np.random.default_rng(seed)
    linkage = make(generator)  # type: ignore[operator]
    tree = len(linkage.joints) == len(linkage.bodies)
    mechanism = linkage.build(tmp_path, () if tree else [list(linkage.joints)[-1]])
    rows, mobility = states(mechanism, generator)
    names = list(mechanism.joints)
    drives = [] if tree else names[:mobility]
    asked = [f"joint.{name}.effort" for name in (drives or names)]
    asked += [f"joint.{names[-1]}.force.x", f"joint.{names[0]}.moment.about.body0.along.body0.y"]
    asked += [f"loop.{one.name}.force.along.body0.y" for one in mechanism.constraints]
    for q, v, a in rows:
        quantities = mechanism.at(q, v, a, drives=drives)
        for name in asked:
            found = mechanism.isolate(name, q, v, a, drives=drives)
            try:
                value = float(quantities[name].values)
            except InputError:  # by self-stresses
                assert not found.equations
                continue
            assert found.equations, name
            assert found.residual < 1e-12
            assert found.value == pytest.approx(value, abs=1e-12 * found.scale)
