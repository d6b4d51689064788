"""Steps and durations, long chains, and many chains of no special kind."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from catalogue import four_bar
from extreme import WRONG, Case, G, hinge, integrated, largest, pendulum, quarter, solved, swing
from extreme_loops import NEWTON, against_newton
from linkage import GROUND, Body, Joint, Linkage, random_body, random_turn
from motions import driven, energy, poses
from random_chains import closed_chain

from pinarm.mechanics.laws import ConstantSpeed


def fixed(step: float, end: float, folder: Path, note: str = "") -> float:
    """A pendulum by steps of one length; where a note has to be in the stamp, without it the answer is wrong."""
    outcome = integrated(pendulum().build(folder), end, 11, position={"arm": 1.0}, method="rk4", step=step)
    run = outcome.rows
    found = largest(run.q[:, 0] - swing(run.grid.t, 1.0, np.sqrt(G)))
    told = any(one.startswith(note) for one in outcome.notes) if note else not outcome.notes
    return (0.0 if note else found) if told else WRONG


def straight(step: float, folder: Path) -> float:
    """A wheel that nothing brakes, by steps of 10 s."""
    wheel = Linkage({"wheel": Body(1.0, np.zeros(3), np.eye(3))}, {"arm": hinge(GROUND, "wheel")}, 0.0)
    run = solved(wheel.build(folder), 100.0, 11, velocity={"arm": 7.0}, method="rk4", step=step)
    return largest(run.q[:, 0] - 7.0 * run.grid.t) / 700.0


def brief(end: float, folder: Path) -> float:
    """What a pendulum has gained of speed in no time."""
    run = solved(pendulum().build(folder), end, 3, position={"arm": 1.0})
    gained = -G * np.sin(1.0) * run.grid.t[1:]
    return max(largest(run.v[1:, 0] / gained - 1.0), largest(run.q[:, 0] - 1.0 - gained[-1] * end / 2.0))


def many(periods: int, tolerance: float, folder: Path) -> float:
    """A pendulum over many periods, at the end of which it stands still at its amplitude: error of its phase."""
    period = 4.0 * quarter(1.0, np.sqrt(G))
    run = solved(pendulum().build(folder), (periods + 0.25) * period, 2, position={"arm": 1.0}, tolerance=tolerance,
                 max_steps=400 * periods)  # fmt: skip
    return abs(run.q[-1, 0] / run.v[-1, 0]) / (periods * period)


def kept(
    linkage: Linkage, cut: str | None, start: dict, speed: dict, end: float, tolerance: float, folder: Path
) -> float:
    """What a long free motion has gained of energy, by that of its bodies, relative to the largest kinetic one."""
    mechanism = linkage.build(folder, [cut]) if cut else linkage.build(folder)
    run = solved(mechanism, end, 201, position=start, velocity=speed, tolerance=tolerance,
                 max_steps=int(200 * end))  # fmt: skip
    total = np.array([energy(linkage, pose) for pose in poses(linkage, run)])
    return largest(total - total[0]) / max(energy(linkage, pose, weight=0.0) for pose in poses(linkage, run))


def rods() -> Linkage:
    """Two uniform rods of 1 m and 1 kg that hang down at 0."""
    rod = Body(1.0, np.array([0.0, 0.0, -0.5]), np.diag([1.0, 1.0, 1e-6]) / 12.0)
    return Linkage({"one": rod, "two": rod}, {"A": hinge(GROUND, "one"), "B": hinge("one", "two", z=-1.0)}, G)


def turned(revolutions: float, folder: Path) -> float:
    """The torque of a weight on an arm that turns at constant speed, over many revolutions."""
    run = driven(pendulum().build(folder), {"arm": ConstantSpeed(speed=2.0 * np.pi)}, revolutions, 1001)
    return largest(run.tau[:, 0] - G * np.sin(2.0 * np.pi * np.fmod(run.grid.t, 1.0))) / G


def hanging(links: int, folder: Path) -> float:
    """Points on rods of 1 m without mass, thrown about: angular accelerations by the tensions of the rods.

    Rod k with the direction e pulls its point back with T_k; rods keep their length,
    ``e_k . (a_k - a_(k-1)) = -w_k^2``, which is tridiagonal in the tensions.
    """
    bodies = {f"bob_{k}": Body(1.0, np.array([0.0, 0.0, -k - 1.0])) for k in range(links)}
    joints = {f"joint_{k}": hinge(f"bob_{k - 1}" if k else GROUND, f"bob_{k}", z=-float(k)) for k in range(links)}
    angle, rate = np.random.default_rng(0).uniform(-1.0, 1.0, (2, links))
    position = {f"joint_{k}": float(x) for k, x in enumerate(np.diff(angle, prepend=0.0))}
    velocity = {f"joint_{k}": float(x) for k, x in enumerate(np.diff(rate, prepend=0.0))}
    run = solved(Linkage(bodies, joints).build(folder), 1e-9, 2, position=position, velocity=velocity)
    e, across = np.array([-np.sin(angle), -np.cos(angle)]).T, np.array([-np.cos(angle), np.sin(angle)]).T
    weight, meet = np.array([0.0, -G]), (e[1:] * e[:-1]).sum(axis=1)
    matrix = np.diag(meet, 1) + np.diag(meet, -1) - np.diag([1.0, *[2.0] * (links - 1)])
    right = -(rate**2)
    right[0] -= e[0] @ weight
    tension = np.linalg.solve(matrix, right)[:, None] * e
    pull = weight - tension
    pull[:-1] += tension[1:]
    exact = (np.diff(pull, axis=0, prepend=0.0) * across).sum(axis=1)
    exact[0] = pull[0] @ across[0]
    return largest(np.cumsum(run.a[0]) - exact) / largest(exact)


def open_chains(count: int, folder: Path) -> float:
    """Two to six bodies on revolutes and slides, masses and lengths over four and three orders."""
    worst = 0.0
    for seed in range(count):
        generator = np.random.default_rng([11, seed])
        size, bodies, joints, parent = 10.0 ** generator.uniform(-3.0, 3.0), {}, {}, GROUND
        for k in range(int(generator.integers(2, 7))):
            one = random_body(generator, 10.0 ** generator.uniform(-2.0, 2.0))
            bodies[f"body{k}"] = Body(one.mass, size * one.com, size**2 * one.inertia)
            kind = "revolute" if k == 0 or generator.random() < 0.8 else "prismatic"
            place = size * generator.uniform(-0.6, 0.6, 3)
            joints[f"joint{k}"] = Joint(kind, parent, f"body{k}", place, random_turn(generator))
            parent = str(generator.choice([*bodies]))
        chain = Linkage(bodies, joints)
        unit = {name: size if one.kind == "prismatic" else 1.0 for name, one in joints.items()}
        mechanism, pace = chain.build(folder), size**-0.5
        position = {name: unit[name] * generator.normal() for name in joints}
        velocity = {name: unit[name] * pace * generator.normal() for name in joints}
        run = integrated(mechanism, 1e-3 / pace, 2, position=position, velocity=velocity, tolerance=1e-9)
        worst = max(worst, against_newton(chain, run.rows, 0.0), run.measures()["energy"])
    return worst


def closed_chains(count: int, folder: Path) -> float:
    """Planar loops of four and five bars and spatial ones, one body 1e4 times lighter or heavier, of 1 mm to 1 km."""
    worst = 0.0
    for seed in range(count):
        generator = np.random.default_rng([12, seed])
        chain, size = closed_chain(generator), 10.0 ** generator.uniform(-3.0, 3.0)
        odd, ratio = str(generator.choice([*chain.bodies])), 10.0 ** generator.uniform(-4.0, 4.0)
        masses = {name: ratio if name == odd else 1.0 for name in chain.bodies}
        bodies = {name: Body(masses[name] * one.mass, size * one.com, masses[name] * size**2 * one.inertia)
                  for name, one in chain.bodies.items()}  # fmt: skip
        joints = {name: Joint(one.kind, one.first, one.second, size * one.place, one.turn)
                  for name, one in chain.joints.items()}  # fmt: skip
        whole, pace = Linkage(bodies, joints), size**-0.5
        mechanism = whole.build(folder, [[*joints][-1]])
        run = integrated(mechanism, 0.02 / pace, 3, velocity={"joint0": pace * generator.normal()}, tolerance=1e-10)
        worst = max(worst, against_newton(whole, run.rows), run.measures()["energy"])
    return worst


TENSIONS = "tensions of the rods, a tridiagonal system"
ADDED = "tolerance 1e-10, whose errors of the energy add up"
Entry = tuple[str, str, str, Callable[[Path], float], float, str, str]
ENTRIES: list[Entry] = [
    ("steps", "rk4 by steps of 1e-12 s over 1e-9 s", "Jacobi's functions",
     partial(fixed, 1e-12, 1e-9), 1e-14, "rounding", "fast"),
    ("steps", "rk4 by steps of 1e-3 s", "Jacobi's functions", partial(fixed, 1e-3, 3.0), 1e-10, "order 4", "fast"),
    ("steps", "rk4 by steps of 1 s on a pendulum of 2.1 s: called too large in the stamp", "what the stamp says",
     partial(fixed, 1.0, 100.0, note="step too large"), 0.0, "it has to be said", "fast"),
    ("steps", "rk4 by steps of 10 s on a wheel that nothing brakes", "constant speed",
     partial(straight, 10.0), 1e-14, "rounding", "fast"),
    *[("durations", f"speed of a pendulum after {end:g} s", "constant acceleration",
       partial(brief, end), 1e-11, "the acceleration changes by so much", "fast") for end in (1e-9,)],
    ("durations", "arm turned 1e5 times at constant speed: torque", "sine of the part of the last turn",
     partial(turned, 1e5), 1e-9, "6e5 rad end at 1e-10", "fast"),
    *[("durations", f"pendulum over {periods:.0e} periods: phase", "complete elliptic integral",
       partial(many, periods, 1e-10), 1e-14 * periods**1.5, ADDED, when)
      for periods, when in ((100, "fast"), (10_000, "command"))],
    *[("durations", f"double pendulum from 2.2 and 1 rad over {end / 2:.0e} periods of 2 s: energy",
       "energy of its bodies", partial(kept, rods(), None, {"A": 2.2, "B": 1.0}, {}, end, 1e-10), 1e-9 * end, ADDED,
       when)
      for end, when in ((2e2, "slow"), (2e4, "command"))],
    *[("durations", f"four-bar over {end:.0e} turns of 1 s: energy", "energy of its bodies",
       partial(kept, four_bar(), "B", {}, {"O": 6.0}, end, 1e-10), 1e-10 * end, ADDED, when)
      for end, when in ((1e2, "slow"), (1e4, "command"))],
    ("chains", "chain of 20 links", TENSIONS, partial(hanging, 20), 1e-11, "condition", "fast"),
    ("chains", "chain of 251 links", TENSIONS, partial(hanging, 251), 1e-10, "condition", "slow"),
    *[("many chains", f"{count} random open chains, 1e±2 in masses, 1e±3 in sizes", NEWTON,
       partial(open_chains, count), 1e-8, "energy of one step at a tolerance of 1e-9", when)
      for count, when in ((20, "slow"), (1000, "command"))],
    *[("many chains", f"{count} random closed chains, 1e±4 in masses, 1e±3 in sizes", NEWTON,
       partial(closed_chains, count), 1e-8, "energy of some steps at a tolerance of 1e-10", when)
      for count, when in ((5, "fast"), (300, "slow"))],
]  # fmt: skip
CASES = [Case(*entry) for entry in ENTRIES]
