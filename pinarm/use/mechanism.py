"""``pinarm.Mechanism``: a mechanism with methods for users. Nothing below the results imports it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine import mechanism
from pinarm.engine.mechanism_loading import load_mechanism, mechanism_of_model
from pinarm.errors import InputError, require_map, require_path
from pinarm.input.yaml.document import Values

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.linear.derivatives import EquationDerivatives
    from pinarm.engine.linear.linear_states import Linearisation
    from pinarm.engine.quantities.catalogue import QuantityCatalogue
    from pinarm.engine.quantities.states import States
    from pinarm.use.facade import Result
    from pinarm.use.method.isolation import Isolation


class Mechanism(mechanism.Mechanism, frozen=True):
    """A mechanism with its names, and what can be asked of it in single states.

    Its fields, such as ``model``, ``joints``, ``balls``, ``coordinates``, ``constraints``, ``drives``, ``forces``,
    ``arguments`` and ``notes``, are those of ``engine.mechanism.Mechanism``.
    """

    def _repr_html_(self) -> str:
        """Return bodies, joints, loops, forces and drives as tables, for notebooks."""
        from pinarm.use.show.structure import mechanism_tables
        from pinarm.use.show.text import tag, text

        return tag("h4", text(self.title)) + "".join(table.html() for table in mechanism_tables(self))

    @classmethod
    def load(
        cls, path: str | Path, arguments: Mapping[str, float | str] | None = None, *, values: Values | None = None
    ) -> Mechanism:
        """Load a mechanism file, a URDF, xacro, MJCF or SDF file, or a robot of example-robot-data by its name.

        Args:
            path: ``models/arm/mechanism.yaml``, ``arm.urdf``, ``arm.urdf.xacro``, ``arm.xml``, or a name such as
                ``panda``.
            arguments: Values for the model's arguments: numbers in SI, or text with units.
            values: Other values than those of the mechanism file, or what such a file beside a model would say:
                ``{"gravity": "none", "base": "floating", "drives.knee.ratio": 100}``, or texts
                ``["drives.knee.ratio=100"]``. Bare numbers are in SI; see ``pinarm.load``.

        Raises:
            InputError: The mechanism file has a mistake, or a path of ``values`` leads nowhere.
            ModelError: The model has one.
        """
        require_path(path, "a mechanism file or a model, or a robot's name")
        require_map(arguments or {}, "arguments", "{'m_A': '0.2 kg'}")
        return with_methods(load_mechanism(path, arguments, values))

    @classmethod
    def of(cls, model: pin.Model, **keys: Any) -> Mechanism:
        """Return the mechanism of a ``pin.Model`` and of what a mechanism file would say beside it.

        The model is written as URDF and read again, so that a result of the mechanism can be saved. Joints keep their
        names and motions, links and frames theirs; q and v are in pinarm's convention and order, and
        ``from_pinocchio`` and ``to_pinocchio`` convert those of ``model``. Damping, dry friction, armatures, limits and
        gravity are taken; ``pinarm.explain`` lists what there is, and in its notes what is not taken.

        Args:
            model: Any number of joints, but for composite, mimicking, helical and ellipsoid ones.
            keys: Keys of a mechanism file: ``loops={"closing": {"kind": "revolute", "between": ["a", "b"]}}``,
                ``drives``, ``forces``, ``points={"tip": {"link": "hand", "at": ["0 m", "0 m", "10 cm"]}}``,
                ``gravity``, ``couplings``, ``coordinates``, ``symbols``, ``title``, ...

        Raises:
            InputError: A key has a mistake, or it is no ``pin.Model``.
            ModelError: The model has a joint that pinarm does not have, or two frames with the same name.
        """
        return with_methods(mechanism_of_model(model, keys))

    def inverse(self, q: Array, v: Array, a: Array, *, drives: Sequence[str] = (), t: float = 0.0) -> Array:
        """Return the efforts that the drives must give, rotors included; the constraints carry the rest.

        Args:
            q: Configurations, shape (..., nq): any leading axes, or none for one state.
            v: Velocities, shape (..., nv).
            a: Accelerations, shape (..., nv).
            drives: Coordinates that drives act along, needed where there are loops; otherwise every joint that mimics
                no other has one.
            t: Instant at which forces that follow laws are taken [s].

        Returns:
            Efforts at the joints [N*m or N], shape (..., nv). Drives along other coordinates, such as distances, count
            with what they do at the joints; ``at(q, v, a, drives=["leg"])["coordinate.leg.effort"]`` is that of each.

        Raises:
            InputError: The shapes do not fit, a state tears a loop or a coupling, the drives cannot carry the load, or
                a cable would have to push, or a cam to pull, which cannot.
            DynamicsError: The drives do not determine their efforts.
        """
        from pinarm.engine.quantities import states

        return states.inverse(self, q, v, a, drives, t)

    def forward(self, q: Array, v: Array, tau: Array | None = None, *, t: float = 0.0) -> Array:
        """Return the accelerations under given efforts.

        Args:
            q: Configurations, shape (..., nq): any leading axes, or none for one state.
            v: Velocities, shape (..., nv).
            tau: Efforts of the drives [N*m or N], shape (..., nv); none where it is left out.
            t: Instant at which forces that follow laws are taken [s].

        Returns:
            Accelerations of the joints, shape (..., nv).

        Raises:
            InputError: The shapes do not fit, a state tears a loop or a coupling, or a cable would have to push, or a
                cam to pull, which cannot.
            DynamicsError: Something without mass is free to move: its acceleration is undetermined.
        """
        from pinarm.engine.quantities import states

        return states.forward(self, q, v, tau, t)

    def configurations(self, positions: Mapping[str, ArrayLike]) -> Array:
        """Return configurations from joint coordinates by name.

        Args:
            positions: Joint -> coordinates [rad or m], arrays of one shape (...) or single numbers; 0 for all others.
                A ball joint J is given by ``J.roll``, ``J.pitch`` and ``J.yaw``, or by ``J.rotation.x`` and so on.

        Returns:
            q, shape (..., nq).

        Raises:
            InputError: A joint does not exist, or the shapes differ.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.configurations(self, positions)

    def rates(self, values: Mapping[str, ArrayLike]) -> Array:
        """Return velocities, accelerations or efforts from those of joints by name.

        Args:
            values: Joint -> velocities [rad/s or m/s], accelerations or efforts, arrays of one shape (...) or single
                numbers; what is not named is 0. Of a ball joint J they are ``J.angular_velocity.x`` and so on, in the
                axes of the link, whatever is given.

        Returns:
            v, a or tau, shape (..., nv).

        Raises:
            InputError: A joint does not exist, or the shapes differ.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.rates(self, values)

    @overload
    def close(
        self,
        positions: Mapping[str, ArrayLike],
        *,
        start: Mapping[str, float] | ArrayLike | None = None,
        unreached: Literal["refused", "nan"] = "refused",
    ) -> Array: ...

    @overload
    def close(
        self,
        positions: Mapping[str, ArrayLike],
        velocities: Mapping[str, ArrayLike],
        *,
        start: Mapping[str, float] | ArrayLike | None = None,
        unreached: Literal["refused", "nan"] = "refused",
    ) -> tuple[Array, Array]: ...

    @overload
    def close(
        self,
        positions: Mapping[str, ArrayLike],
        velocities: Mapping[str, ArrayLike],
        accelerations: Mapping[str, ArrayLike],
        *,
        start: Mapping[str, float] | ArrayLike | None = None,
        unreached: Literal["refused", "nan"] = "refused",
    ) -> tuple[Array, Array, Array]: ...

    def close(
        self,
        positions: Mapping[str, ArrayLike],
        velocities: Mapping[str, ArrayLike] | None = None,
        accelerations: Mapping[str, ArrayLike] | None = None,
        *,
        start: Mapping[str, float] | ArrayLike | None = None,
        unreached: Literal["refused", "nan"] = "refused",
    ) -> Array | tuple[Array, ...]:
        """Return closed states in which coordinates, points or frames have given values: inverse kinematics.

        ==============================  ============  ============================================================
        name                            position      velocity, and acceleration as its derivative
        ==============================  ============  ============================================================
        ``knee``, ``L.angle``           (...)         rate of a coordinate: of a joint, of a loop joint, or defined
        ``point.hand.position.x``       (...)         rate of one component of a link's origin [m/s]
        ``point.hand``                  (..., 3)      velocity of a link's origin [m/s], shape (..., 3)
        ``hand``, ``joint.knee``        (..., 4, 4)   of a link or a joint's frame: velocity of its origin, then
                                                      angular velocity, shape (..., 6), as ``jacobian`` has them
        ==============================  ============  ============================================================

        A placement is what ``frame`` returns, or a ``pin.SE3``; all axes are those of the world. Every state is reached
        from the start, while its coordinates go straight to their values and frames turn about one axis: the start
        chooses the branch, such as elbow up or down. Motions that the values leave free rest as far as they can. Loops
        are closed, and values met, to rounding.

        Args:
            positions: Name -> values [rad or m], arrays with the same leading axes (...), or those of one state.
            velocities: Name -> velocities, of names that have positions; 0 where one is left out.
            accelerations: Name -> accelerations, likewise.
            start: Rough joint coordinates near which the loops are closed first, as of a scenario, ``{"knee": 0.5}``,
                or a configuration, shape (nq,). The mechanism file's own where it is left out.
            unreached: ``nan`` returns NaN in states that are not reached straight from the start.

        Returns:
            q, shape (..., nq); with velocities q and v, with accelerations q, v and a, v and a of shape (..., nv).

        Raises:
            InputError: A name does not exist, shapes do not fit, a state is reached from other starts only, or rates do
                not go together or leave a motion open.
            AssemblyError: A state is out of reach, or rates are asked for in a singular position.
        """
        from pinarm.engine.quantities import closing

        if unreached not in ("refused", "nan"):
            raise InputError(f"unreached: {unreached!r}", expected="refused or nan")
        states = closing.close(self, positions, velocities, accelerations, start, partly=unreached == "nan")
        return states if len(states) > 1 else states[0]

    def at(
        self, q: Array, v: Array | None = None, a: Array | None = None, tau: Array | None = None, *,
        drives: Sequence[str] = (), t: float = 0.0,
    ) -> States:  # fmt: skip
        """Return the quantities of states by name: ``at(q, v)["point.A.position.x"].values`` and all others.

        Every one is a state of its own; values have the leading axes of the states. Forces that follow laws have their
        values just after the instant t.

        Args:
            q: Configurations, shape (..., nq): any leading axes, or none for one state.
            v: Velocities, shape (..., nv); 0 where they are left out.
            a: Accelerations, shape (..., nv); 0 where neither they nor efforts are given.
            tau: Efforts of the drives [N*m or N], shape (..., nv), in place of accelerations, which follow from them.
            drives: Coordinates that the drives act along where accelerations are given; every joint of an open chain
                where none is named. Without any a mechanism with loops tells no forces.
            t: Instant [s].

        Raises:
            InputError: Shapes do not fit, a state tears a loop, or under efforts a cable would have to push, or a cam
                to pull.
            DynamicsError: The drives do not determine their efforts.
        """
        from pinarm.engine.quantities import states

        return states.quantities(self, q, v, a, tau, drives, t)

    def jacobian(self, name: str, q: ArrayLike) -> Array:
        """Return the matrix J(q) of ``x' = J v``, x the motion of something that quantities can name.

        =================================  ===========  ==========================================================
        name                               shape        x'
        =================================  ===========  ==========================================================
        ``hand``, a link                   (..., 6, nv)  velocity of its origin, then its angular velocity
        ``point.hand``                     (..., 3, nv)  velocity of its origin [m/s]
        ``body.hand``                      (..., 3, nv)  its angular velocity [rad/s]
        ``knee``, ``coordinate.knee``      (..., nv)     rate of a coordinate, also of one defined by the mechanism file
        ``joint.hip``, a ball joint        (..., 3, nv)  angular velocity of its link, in the link's own axes
        =================================  ===========  ==========================================================

        Axes are those of the world, as of ``pin.LOCAL_WORLD_ALIGNED``; those of link B with ``.along.B`` at the end, so
        that ``hand.along.hand`` is ``pin.LOCAL``. Loops do not change J: v has all joints, and ``closure`` says which v
        the loops allow.

        Args:
            name: What moves.
            q: Configurations in pinarm's convention, as everywhere here, shape (..., nq); see ``from_pinocchio``.

        Raises:
            InputError: There is nothing of that name, it means several things, or the shape does not fit.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.jacobian(self, name, q)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the symmetric mass matrix M(q) of the tree, rotors and armatures included, loops not eliminated.

        Args:
            q: Configurations in pinarm's convention, shape (..., nq).

        Returns:
            M, shape (..., nv, nv) [kg*m^2, kg*m or kg], for v in pinarm's convention.

        Raises:
            InputError: The shape does not fit.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.mass_matrices(self, q)

    def derivatives(
        self, q: Array, v: Array, a: Array, tau: Array | None = None, *, t: float = 0.0
    ) -> EquationDerivatives:
        """Return the derivatives of the equation of motion ``M a + nle - loads - G^T lam = tau`` at one state.

        ``force_q`` and ``force_v`` are those of its left side by q and v, for open chains those of the efforts that
        ``inverse`` returns; ``mass`` is M. Derivatives by q are along unit velocities. With loops lam holds what the
        efforts do not, and ``rows``, ``rows_q``, ``acceleration_q`` and ``acceleration_v`` are those of ``G v`` and of
        ``G a + G' v``.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            a: Acceleration, shape (nv,).
            tau: Efforts of the drives [N*m or N], shape (nv,); 0 where they are left out. Needed where there are loops.
            t: Instant at which forces that follow laws are taken [s].

        Raises:
            InputError: The shapes do not fit, there is dry friction, or a load has a kink here.
        """
        from pinarm.engine.linear import linear_states

        return linear_states.derivatives(self, q, v, a, tau, t)

    def linearise(self, q: Array, v: Array | None = None, tau: Array | None = None, *, t: float = 0.0) -> Linearisation:
        """Return the motion linearised about a state: ``x' = A x + B u``, natural frequencies, modes.

        x are deviations of independent coordinates and their velocities, named in ``states``; u are efforts at the
        joints. Loops and couplings hold, and joints that dry friction holds. ``acceleration`` is 0 where the state is
        an equilibrium, or a steady motion.

        Args:
            q: Configuration, shape (nq,), at which loops are closed.
            v: Velocity, shape (nv,); 0 where it is left out.
            tau: Efforts of the drives [N*m or N], shape (nv,); 0 where they are left out.
            t: Instant at which forces that follow laws are taken [s].

        Raises:
            InputError: The shapes do not fit, a loop is open, or a load has a kink here.
            DynamicsError: The position is singular, something without mass is free, or a joint begins to slip.
        """
        from pinarm.engine.linear import linear_states

        return linear_states.linearise(self, q, v, tau, t)

    def frame(self, name: str, q: ArrayLike) -> Array:
        """Return the placement of a link, or of the frame of a joint J by ``joint.J``, in the world.

        Args:
            name: Of the link, or ``joint.J``.
            q: Configurations in pinarm's convention, shape (..., nq).

        Returns:
            Homogeneous matrices ``T = [[R, p], [0, 1]]``, shape (..., 4, 4): the columns of R are the frame's axes in
            those of the world, p is its origin [m]. ``pin.SE3(T)`` makes Pinocchio's type of a single one.

        Raises:
            InputError: There is no such link or joint, or the shape does not fit.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.placements(self, name, q)

    def pin_data(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> pin.Data:
        """Return Pinocchio's data of one state of ``model``, filled: a copy of one's own, to be read or changed.

        ``pin.computeAllTerms``, ``pin.rnea`` and ``pin.forwardKinematics`` with the accelerations have been called, and
        all frames are placed; M is whole. These know weights and inertias only: ``data.tau`` and ``data.nle`` lack
        springs, dampers, friction and loops, which ``inverse`` and ``forward`` have.

        Args:
            q: Configuration in pinarm's convention, which is that of ``model``, shape (nq,).
            v: Velocity, shape (nv,); 0 where it is left out.
            a: Acceleration, shape (nv,); 0 where it is left out.

        Raises:
            InputError: The shapes do not fit, or several states are given.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.pinocchio_data(self, q, v, a)

    def isolate(
        self, wanted: str, q: Array | None = None, v: Array | None = None, a: Array | None = None,
        tau: Array | None = None, *, drives: Sequence[str] = (), t: float = 0.0,
    ) -> Isolation:  # fmt: skip
        """Return the bodies to isolate, and the theorems to apply, for an effort, a reaction or a law of motion.

        The derivation holds in all configurations; see docs/method.md. It has numbers where a state is given.

        Args:
            wanted: A quantity such as ``joint.B.effort`` or ``loop.D.force.x``, a symbol or a formula of one, or a
                coordinate, whose law of motion is wanted.
            q: Configuration, shape (nq,); without numbers where it is left out.
            v: Velocity, shape (nv,); 0 where it is left out.
            a: Acceleration, shape (nv,); 0 where neither it nor efforts are given.
            tau: Efforts of the drives [N*m or N], shape (nv,), in place of accelerations.
            drives: Coordinates along which unknown efforts act; every joint of an open chain, and of other mechanisms
                the wanted one, where none is named.
            t: Instant at which forces that follow laws are taken [s].

        Raises:
            InputError: It is nothing that an equation can give, or the state does not fit; see ``at``.
        """
        from pinarm.use.method.derivation import isolation_of

        return isolation_of(self, wanted, (q, v, a, tau), drives, t)

    def quantities(self, like: str = "") -> QuantityCatalogue:
        """Return the quantities of a mechanism in motion: names, units, meanings.

        Args:
            like: Part of the name or of the meaning; all where it is empty.

        Raises:
            AssemblyError: The loops cannot be closed.
        """
        from pinarm.engine.quantities.catalogue import catalogue_of

        return catalogue_of(self, like)

    def result(
        self, t: ArrayLike, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None,
        tau: ArrayLike | None = None, **keys: Any,
    ) -> Result:  # fmt: skip
        """Return the result of a motion of one's own arrays, with quantities, plots, checks, tables and replays.

        It is ``pinarm.result(mechanism, t, q, v, a, tau, **keys)``, which tells more.

        Args:
            t: Instants [s], not descending, shape (n,).
            q: Configurations in pinarm's convention, shape (n, nq).
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv).
            tau: Efforts of the drives [N*m or N], shape (n, nv).
            keys: ``derivatives``, ``drives``, ``loads``, and keys of a scenario file such as ``outputs``.

        Raises:
            InputError: Shapes do not fit, a number is not finite, or instants descend.
            DynamicsError: The drives do not determine their efforts.
        """
        result: Result = import_module("pinarm").result(
            self, t, q, v, a, tau, **keys
        )  # by its public name, as users do
        return result

    def from_pinocchio(self, q: ArrayLike, v: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return q and v of this mechanism from those of ``pin.buildModelFromUrdf`` of the same URDF.

        Of a mechanism that was made of a ``pin.Model``, see ``of``, they are those of that model.

        They differ where the base floats, and in joints of the types ``continuous``, ``floating`` and ``planar``. Of a
        floating base Pinocchio's v has the velocity of the base's origin in the base's own axes, this mechanism's v in
        those of the world; the quaternion (x, y, z, w), and the angular velocity in the base's own axes, are the same.
        Of a ``continuous`` joint Pinocchio has (cos, sin), this mechanism the angle, here from -pi to pi.

        Args:
            q: Configurations of ``pin.buildModelFromUrdf(path)``, shape (..., nq of that model); of a floating base, of
                ``pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())``.
            v: Velocities, shape (..., nv of that model); 0 where they are left out.

        Returns:
            q, shape (..., nq), and v, shape (..., nv).

        Raises:
            InputError: The shapes do not fit, as of a model that was read with ``mimic=True``; the model is MJCF; a
                quaternion or (cos, sin) has not the length 1; or a planar joint has another axis than z, of which
                Pinocchio's reader takes no notice.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.from_pinocchio(self, q, v)

    def to_pinocchio(self, q: ArrayLike, v: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return q and v of ``pin.buildModelFromUrdf`` from those of this mechanism; see ``from_pinocchio``.

        Args:
            q: Configurations, shape (..., nq).
            v: Velocities, shape (..., nv); 0 where they are left out.

        Raises:
            InputError: As of ``from_pinocchio``.
        """
        from pinarm.engine.quantities import state_arrays

        return state_arrays.to_pinocchio(self, q, v)


def with_methods(parts: mechanism.Mechanism) -> Mechanism:
    """Return a mechanism of the engine with the methods for users."""
    if isinstance(parts, Mechanism):
        return parts
    return Mechanism(*(getattr(parts, name) for name in parts.__struct_fields__))
