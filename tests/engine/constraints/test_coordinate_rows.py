"""Coordinates of every kind: their rows at many states against Pinocchio in one state, and against real differences."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.mechanics.ball_joints import BallAngle, BallCoordinate, balls_of, coordinate_at
from pinarm.mechanics.coordinates import Distance, PointCoordinate, Rotation, coordinates_of, rotation
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.mechanics.loops.lower_pairs import Cylindrical, Helical, Planar, loop_coordinates
from pinarm.mechanics.rotors import GearedRotor, tied_joint
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"

ARM = (
    {"name": "swing", "at": "0.1 0.2 0.3", "axis": "1 2 3"}, {"name": "tilt", "at": "0.3 -0.2 0.1", "axis": "3 -1 1"},
    {"name": "body", "kind": "floating", "at": "1 0 0"}, {"name": "last", "at": "0.2 0 0", "axis": "0 1 1"},
)  # fmt: skip
SWING, LAST = "swing_link", "last_link"


def model_of(chain):
    xml = chain(*ARM).replace('<origin xyz="1 0 0"/>', '<origin xyz="1 0 0" rpy="0.4 -0.5 0.6"/>')
    return build_model(xml).model


def coordinates(model):
    """One of each kind."""
    body, joints = balls_of(model)["body"], joints_of(model)
    own = coordinates_of(model, joints, {})
    found = [kind.of(model, body, k) for kind in (BallCoordinate, BallAngle) for k in range(3)]
    found += [Rotation(body=LAST, about=axis).bind(model, joints) for axis in "xyz"]
    found += [Rotation(body=LAST, about="y", relative_to=SWING).bind(model, joints)]
    found += [Distance(between=(SWING, LAST)).bind(model, joints), coordinate_at(model, 0)]
    found += [PointCoordinate(point=LAST, along=(1.0, 2.0, -0.5)).bind(model, joints)]
    kinds = [kind(between=(SWING, LAST)) for kind in (Cylindrical, Planar)]
    for definition in (*kinds, Helical(between=(SWING, LAST), lead=0.3)):
        found += loop_coordinates(model, [definition.bind(model, "L")]).values()
    return [*found, *(tied_joint("gear", found[k], joints["last"], own) for k in (0, 6, -1))]


def value(coordinate, state):
    return coordinate.gap(state)[0] if isinstance(coordinate, GearedRotor) else coordinate.value(state)


@pytest.fixture
def model(chain):
    return model_of(chain)


@pytest.fixture
def states(model):
    generator = np.random.default_rng(5)
    q = np.array([pin.integrate(model, pin.neutral(model), 0.8 * x) for x in generator.normal(size=(9, model.nv))])
    return q, generator.normal(size=(9, model.nv))


def test_many_states_are_single_states(model, states):
    for coordinate in coordinates(model):
        rows, one = ConstraintRows.of(model, [coordinate]).at(states[0]), []
        for q, v in zip(*states, strict=True):
            here = Kinematics.at(model, q, v)
            own = coordinate.rows(here)[0] if isinstance(coordinate, GearedRotor) else coordinate.row(here)
            one.append([value(coordinate, here), *own, np.ravel(coordinate.drift(here))[0]])
        many = np.column_stack([rows.gaps, rows.matrices[:, 0], rows.drifts(states[1])])
        assert many == pytest.approx(np.array(one), rel=1e-12, abs=1e-12), coordinate


def test_complex_steps_are_the_slopes(model, states, differentiate):
    """Value, row and drift along each velocity, against real differences of order 8."""
    q, v = states[0][0], states[1][0]
    steps = q + 1e-30j * pin.tangentMap(model, q).T
    for coordinate in coordinates(model):
        rows = ConstraintRows.of(model, [coordinate])
        for k, way in enumerate(np.eye(model.nv)):

            def terms(x, way=way, rows=rows):
                here = rows.at(pin.integrate(model, q, x * way)[None])
                return np.array([here.gaps[0, 0], here.matrices[0, 0] @ v, here.drifts(v[None])[0, 0]])

            here = rows.at(steps[k : k + 1])
            found = here.gaps[0, 0], here.matrices[0, 0] @ v, here.drifts(v[None] + 0j)[0, 0]
            assert np.imag(found) / 1e-30 == pytest.approx(differentiate(terms, 0.0, h=2e-3), abs=1e-7), coordinate


def test_a_rotation_vector_near_zero_has_the_series(model):
    """At rest in the reference, and beside it: the row is that of an angular velocity but for the angle."""
    coordinate = rotation(model.getFrameId(SWING), 2)
    q = np.array([pin.neutral(model)] * 3)
    q[:, 0] = 0.0, 1e-9, 0.9e-2
    rows = ConstraintRows.of(model, [coordinate]).at(q).matrices[:, 0]
    one = [coordinate.row(Kinematics.at(model, x)) for x in q]
    assert rows == pytest.approx(np.array(one), abs=1e-14)


def test_turns_of_a_rotor_behind_an_angle_that_other_joints_count_are_those_of_single_states():
    """The angle of a loop joint between parallel joints, in states of two turns."""
    bar = Mechanism.load(MODELS / "four_bar" / "mechanism.yaml", values={
        "drives.D": {"along": "top_1.angle", "ratio": 2, "rotor_inertia": "1e-3 kg*m^2"},
    })  # fmt: skip
    start = bar.configurations({"upright_0": 0.4, "coupler_0": -0.4, "upright_1": 0.4})
    turned = start + np.linspace(0.0, 12.0, 9)[:, None] * bar.rates({
        "upright_0": 1.0, "coupler_0": -1.0, "upright_1": 1.0, "D.rotor": -1.0,
    })  # fmt: skip
    one = [bar.closure.gap(bar.closure.state(q)) for q in turned]
    assert bar.closure.constraint_rows.at(turned).gaps == pytest.approx(np.array(one), abs=1e-12)
