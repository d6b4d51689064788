"""Time and memory of a run as mechanisms grow: four-bars side by side, scissors, chains.

``python -m benchmarks.growth`` runs each in a process of its own and prints the table of ``docs/speed.md``; with
``--quick`` a few small ones. ``python -m benchmarks.growth FAMILY COUNT`` runs a single one.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from time import process_time

Parts = tuple[list[str], list[str], str]
"""Elements of a URDF, lines of its loops, and the name of a joint that is given a velocity."""

MASS = '<mass value="1"/><inertia ixx="0.08" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/>'
COUNTS = {"fourbars": (10, 40, 100, 400, 1000), "scissor": (10, 40, 100, 250, 500), "chain": (10, 100, 1000, 5000)}
QUICK = {"fourbars": (10, 60), "scissor": (10, 60), "chain": (10, 200)}


def link(name: str, centre: str) -> str:
    """Return a link of 1 kg and 1 m."""
    return f'<link name="{name}"><inertial><origin xyz="{centre}"/>{MASS}</inertial></link>'


def hinge(name: str, parent: str, child: str, place: str) -> str:
    """Return a revolute joint about z."""
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="0 0 1"/></joint>'
    )


def point(name: str, parent: str, place: str) -> str:
    """Return a frame on a link."""
    return (
        f'<link name="{name}"/><joint name="{name} fixed" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{place}"/></joint>'
    )


def fourbars(count: int) -> Parts:
    """Return four-bars of equal rods side by side: uprights, and couplers that tie each to the next; 1 free motion."""
    parts, loops = ['<link name="base"/>'], []
    for k in range(count + 1):
        parts += [
            link(f"up{k}", "0 0.5 0"),
            hinge(f"u{k}", "base", f"up{k}", f"{k} 0 0"),
            point(f"ue{k}", f"up{k}", "0 1 0"),
        ]
        if k < count:
            parts += [
                link(f"cp{k}", "0.5 0 0"),
                hinge(f"c{k}", f"up{k}", f"cp{k}", "0 1 0"),
                point(f"ce{k}", f"cp{k}", "1 0 0"),
            ]
            loops.append(f"  top{k}: {{kind: revolute, between: [ce{k}, ue{k + 1}], axis: z}}")
    return parts, loops, "u0"


def scissor(count: int) -> Parts:
    """Return a row of crosses of two equal bars, 1 m square, on one hinge; 2 free motions.

    The falling bar of a cross carries the rising bar of the next at its lower end and is carried at its middle by its
    own rising bar, whose upper end a loop ties to the falling bar of the next.
    """
    parts, loops = ['<link name="base"/>'], []
    before = "base"
    for k in range(count):
        place = "0 0 0" if not k else "0.5 -0.5 0"
        parts += [link(f"r{k}", "0.5 0.5 0"), hinge(f"a{k}", before, f"r{k}", place)]
        parts += [link(f"f{k}", "0 0 0"), hinge(f"m{k}", f"r{k}", f"f{k}", "0.5 0.5 0")]
        if k:
            parts += [point(f"e{k - 1}", f"r{k - 1}", "1 1 0"), point(f"s{k}", f"f{k}", "-0.5 0.5 0")]
            loops.append(f"  tie{k}: {{kind: revolute, between: [e{k - 1}, s{k}], axis: z}}")
        before = f"f{k}"
    return parts, loops, "m0"


def chain(count: int) -> Parts:
    """Return links in a row, hanging from the ground."""
    parts, before = ['<link name="base"/>'], "base"
    for k in range(count):
        parts += [link(f"l{k}", "0.5 0 0"), hinge(f"j{k}", before, f"l{k}", "1 0 0" if k else "0 0 0")]
        before = f"l{k}"
    return parts, [], "j0"


ENDS = {"fourbars": 0.5, "scissor": 0.5, "chain": 0.02}
"""How long each moves [s]: a chain of 5,000 m needs shorter steps the longer it is."""

GUIDED = {"fourbars": ("u0",), "scissor": ("a0", "m0")}
"""Joints whose laws determine the motion, where they are few."""

FAMILIES: dict[str, Callable[[int], Parts]] = {"fourbars": fourbars, "scissor": scissor, "chain": chain}


def written(folder: Path, family: str, count: int) -> Path:
    """Write model, mechanism and scenario into a folder; return the scenario's path."""
    parts, loops, moved = FAMILIES[family](count)
    (folder / "model.urdf").write_text(f'<robot name="{family}">' + "\n".join(parts) + "</robot>")
    tied = "loops:\n" + "\n".join(loops) + "\n" if loops else ""
    gravity = "gravity: {direction: -y, magnitude: 9.81 m/s^2}\n"
    (folder / "mechanism.yaml").write_text(f"pinarm: 1\nrobot: model.urdf\n{gravity}{tied}")
    (folder / "scenario.yaml").write_text(
        f"pinarm: 1\ntitle: {family} {count}\nmechanism: mechanism.yaml\nproblem:\n  kind: forward\n"
        f"  time: {{end: {ENDS[family]} s, samples: 6}}\n  initial: {{velocity: {{{moved}: 1 rad/s}}}}\n"
        f"outputs: [joint.{moved}.position]\naccuracy: {{tolerance: 1e-6}}\n"
    )
    return folder / "scenario.yaml"


def guided(path: Path, family: str) -> Path:
    """Write a scenario of inverse dynamics beside another one; return its path."""
    laws = ", ".join(f"{joint}: {{law: harmonic, amplitude: 0.2 rad, pulsation: 3 rad/s}}" for joint in GUIDED[family])
    text = (
        f"pinarm: 1\ntitle: {family}\nmechanism: mechanism.yaml\nproblem:\n  kind: inverse\n"
        f"  time: {{end: 0.5 s, samples: 11}}\n  motion: {{{laws}}}\noutputs: [joint.{GUIDED[family][0]}.effort]\n"
    )
    path.with_name("inverse.yaml").write_text(text)
    return path.with_name("inverse.yaml")


def measured(family: str, count: int) -> dict[str, float]:
    """Return processor times [s] and the largest memory [GB] of this process.

    ``first`` to load and run, ``again`` to run again, ``force`` to ask for the force of a joint; ``explain`` to say
    how it can move, what rigid bodies do not determine and what could be loosened; ``inverse`` to load and run a motion
    by laws where few determine it, 0 elsewhere.
    """
    import pinarm

    with tempfile.TemporaryDirectory() as name:
        path = written(Path(name), family, count)
        times = [process_time()]
        scenario = pinarm.Scenario.load(path)
        result = scenario.run()
        times.append(process_time())
        scenario.run()
        times.append(process_time())
        _ = result[f"joint.{FAMILIES[family](count)[2]}.force.y"]
        times.append(process_time())
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
        str(pinarm.explain(path))
        times.append(process_time())
        if family in GUIDED:
            pinarm.Scenario.load(guided(path, family)).run()
        times.append(process_time())
    names = ("first", "again", "force", "explain", "inverse")
    return {**dict(zip(names, (end - start for start, end in pairwise(times)), strict=True)), "memory": memory}


def main() -> None:
    """Measure one mechanism, or all of them."""
    arguments = sys.argv[1:]
    if len(arguments) == 2:
        print(json.dumps(measured(arguments[0], int(arguments[1]))))
        return
    print("| | N | load and run [s] | again [s] | memory [GB] | a force [s] | explain [s] | inverse [s] |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for family, counts in (QUICK if "--quick" in arguments else COUNTS).items():
        for count in counts:
            command = [sys.executable, "-m", "benchmarks.growth", family, str(count)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found = json.loads(done.stdout.splitlines()[-1])
            numbers = [found[key] for key in ("first", "again", "memory", "force", "explain", "inverse")]
            print(f"| {family} | {count} | {' | '.join(f'{x:.2f}' for x in numbers)} |", flush=True)


if __name__ == "__main__":
    main()
