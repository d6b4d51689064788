"""The virtual powers of what acts on a mechanism and of what its motion demands, and how large their terms can be."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.vectors import crossed, joined, lengths, moved


def virtual_powers(run: Trajectory) -> tuple[Array, Array, Array]:
    """Return the residual of virtual power for every unit velocity, the size of its terms, and a power.

    Two of shape (n, nv) [W per rad/s or m/s], and the most power that the links' wrenches could have at their speeds,
    shape (n,) [W].
    """
    loads = run.gather(lambda dynamics, part: dynamics.loads(run.grid.t[part], run.q[part], run.v[part]))
    wrenches, sizes, held = run.closure.acting(run.link_motion[0], run.q, run.lam.at(np.arange(len(run))))
    asked, terms, most = _asked(run, wrenches, sizes)
    supplied = run.tau, loads, run.friction_loads, held, -run.mechanism.model.armature * run.a
    return sum(supplied) - asked, sum(map(np.abs, supplied)) + terms, most


def _asked(run: Trajectory, wrenches: Array, sizes: Array) -> tuple[Array, Array, Array]:
    """Return the virtual power that the motion of the links asks for beside that of wrenches which act on them.

    With what wrenches of their sizes could do at most: ``|f| (|d| + l |w|) + |m| |w|`` for a joint whose unit velocity
    turns the links beyond with w and moves its own origin with d, l being the way along the links from there to the
    origin of the link. Forces that the motion demands have the distance of the centre of mass as an arm besides. So
    terms that vanish in a position, such as the moment of a weight about the joint above it, have a size to compare
    with.

    Args:
        run: The motion.
        wrenches: [f; m] at the origins of the links, world axes, shape (n, .., njoints, 6).
        sizes: Of the forces and moments that they are the sums of, shape (n, .., njoints, 2).

    Returns:
        Two of shape (n, .., nv) [W per rad/s or m/s], and ``|f| |v| + |m| |omega|`` of all links, shape (n, ..) [W],
        f and m being what their motion demands.
    """
    if isinstance(run.mechanism.model, pin.Model):
        from pinarm.engine.kernel.bodies import demanded_powers

        if (found := demanded_powers(run.link_motion, wrenches, sizes)) is not None:
            return found
    return in_arrays(run.link_motion, run.demands, wrenches, sizes)


def in_arrays(
    motion: tuple[LinkPlacements, Array, Array, Array], demands: Array, wrenches: Array, sizes: Array
) -> tuple[Array, Array, Array]:
    """Return the same by numpy: of variants, and where there is no compiled library.

    Args:
        motion: Placements of the links, their twists, the rates of these, and the columns of the world Jacobian.
        demands: What it demands of the links in their own frames, in parts, shape (3, n, .., njoints, 6).
        wrenches: [f; m] at the origins of the links, world axes, shape (n, .., njoints, 6).
        sizes: Of the forces and moments that they are the sums of, shape (n, .., njoints, 2).
    """
    links, twists, _, columns = motion
    tree, ways, own = LinkTree.of(links.model), columns.swapaxes(-2, -1), lengths(demands).sum(axis=0)
    demanded, bounds = links.outwards(demands.sum(axis=0)) - wrenches, sizes + own
    bounds[..., 1] += np.linalg.norm(tree.levers, axis=-1) * own[..., 0]
    forces, most = (each[..., tree.moved, :] for each in _carried(links, tree, demanded, bounds))
    turning = ways[..., 3:]
    speeds = joined(ways[..., :3] + crossed(turning, links.places[..., tree.moved, :]), turning)
    return np.vecdot(forces, speeds), np.vecdot(most, lengths(speeds)), np.vecdot(own, lengths(twists)).sum(axis=-1)


def _carried(links: LinkPlacements, tree: LinkTree, wrenches: Array, sizes: Array) -> tuple[Array, Array]:
    """Return the sums over every link and those beyond it about the link's origin, of wrenches and of their sizes.

    Args:
        links: Where they are.
        tree: What they are.
        wrenches: On every link, [f; m] at its origin, world axes, shape (n, .., njoints, 6).
        sizes: Of its forces and moments, shape (n, .., njoints, 2).

    Returns:
        The sums, of the same shapes; moments of a given size may add up to that much at most.
    """
    forces, bounds = wrenches.copy(order="K"), sizes.copy(order="K")
    arms = links.places - links.places[..., tree.parents, :]
    ways = np.sqrt(np.vecdot(arms, arms))
    for link in range(len(tree.parents) - 1, 0, -1):
        parent, force, bound = tree.parents[link], forces[..., link, :], bounds[..., link, :]
        forces[..., parent, :] += moved(force, arms[..., link, :])
        bounds[..., parent, :] += bound
        bounds[..., parent, 1] += ways[..., link] * bound[..., 0]
    return forces, bounds
