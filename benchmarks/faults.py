"""Thirty faults in the mechanics, planted one by one in a copy of the tree: which tests catch each, or that none does.

Run with ``python benchmarks/faults.py``, or with numbers of faults; it takes some minutes. Every fault is a sign, a
factor, a frame or a term that is missing; its tests are run in the given order until one fails. A fault whose text is
not found exactly once is told, too: it is to be planted anew. The exit code is the number of faults that escape.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
COPIED = ("benchmarks", "docs", "examples", "models", "pinarm", "scenarios", "tests")
FLAGS = ("-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-m", "not slow", "--no-header", "--tb=no")


class Fault(NamedTuple):
    """A text of a file of the package, once in it, what is planted in its place, what is wrong then, and tests."""

    wrong: str
    file: str
    text: str
    planted: str
    tests: str


FAULTS = [
    Fault("links swept by their own turning in place of their parent's", "mechanics/geometry/link_placements.py",
          "swept = cross(before, arms)", "swept = cross(omega, arms)",
          "tests/mechanics/geometry tests/engine/checks"),
    Fault("energy of rotors twice", "engine/dynamics/dynamics.py",
          "kinetic + 0.5 * v**2 @ self.model.armature", "kinetic + v**2 @ self.model.armature",
          "tests/engine/dynamics/test_dynamics.py tests/mechanics/test_drives.py"),
    Fault("weights lift", "mechanics/geometry/link_placements.py",
          "-tree.masses * (centres @ self.model.gravity.linear)", "tree.masses * (centres @ self.model.gravity.linear)",
          "tests/engine/dynamics/test_dynamics.py tests/physics"),
    Fault("masses have no part in what is left to the free motion", "engine/dynamics/equation.py",
          "force - (mass @ a[..., None])[..., 0]", "force",
          "tests/engine/constraints/test_nullspace.py tests/engine/dynamics/test_equation.py"),
    Fault("drift of constraints with the wrong sign", "engine/dynamics/equation.py",
          "-closure.drifts(q, v)", "closure.drifts(q, v)", "tests/engine/dynamics/test_equation.py tests/loops"),
    Fault("units of rows forgotten in the null space", "engine/constraints/nullspace.py",
          "along = np.vecmat(self.scale * right, self.left) * self.inverse",
          "along = np.vecmat(right, self.left) * self.inverse", "tests/engine/constraints tests/loops"),
    Fault("half of the Coriolis term of relative motion", "mechanics/geometry/frame_pairs.py",
          "cross(before + beyond, along)", "cross(beyond, along)",
          "tests/mechanics/geometry/test_frame_pairs.py tests/loops/test_kinds.py"),
    Fault("left-handed threads of loops", "mechanics/loops/lower_pairs.py",
          "-pitch * axis", "pitch * axis", "tests/loops/test_screws.py tests/loops/test_kinds.py"),
    Fault("arm of a rolling disc that turns the wrong way", "mechanics/loops/rolling.py",
          "-self.radius * _rate(up, rising)", "self.radius * _rate(up, rising)", "tests/loops/test_rolling.py"),
    Fault("thrust of helical teeth to the other side", "mechanics/couplings/teeth.py",
          "tangential * (way - np.tan(beta) * line)", "tangential * (way + np.tan(beta) * line)",
          "tests/mechanics/couplings/test_gear.py tests/mechanics/couplings"),
    Fault("moment of a thread without the sense of its axes", "mechanics/couplings/kinds.py",
          "about = pair.sense * pair.inner_ratio(pitch)", "about = pair.inner_ratio(pitch)",
          "tests/mechanics/couplings/test_transmissions.py tests/mechanics/couplings"),
    Fault("both strands at the tension of one", "mechanics/couplings/kinds.py",
          "0.25 * abs(difference) * pull.sum(axis=0)", "0.5 * abs(difference) * pull.sum(axis=0)",
          "tests/mechanics/couplings/test_belt.py tests/mechanics/couplings"),
    Fault("turning of the cam left out of the curvature", "mechanics/couplings/cam.py",
          "ddp - 1j * dp, turned", "ddp, turned",
          "tests/mechanics/couplings/test_cam_contact.py tests/loops/test_cams.py"),
    Fault("moment of a force at a point", "mechanics/forces/points.py",
          "moment + crossed(points, force)", "moment - crossed(points, force)",
          "tests/mechanics/forces/test_force_element.py tests/mechanics/forces"),
    Fault("halfway axes of a bushing turned back", "mechanics/forces/bushing.py",
          "_sum(0.5, g, -0.5 * self._lag, _cross(g, self.axis))", "_sum(0.5, g, 0.5 * self._lag, _cross(g, self.axis))",
          "tests/mechanics/forces/test_bushing.py tests/mechanics/forces"),
    Fault("half of what dampers take", "mechanics/forces/joint_forces.py",
          "(self.damping * rates * rates).sum(axis=-1)", "(0.5 * self.damping * rates * rates).sum(axis=-1)",
          "tests/mechanics/forces/test_force_element.py tests/mechanics/forces"),
    Fault("bearings that share a moment without a couple", "mechanics/friction/contact.py",
          "[0.5 * forces + moments, 0.5 * forces - moments]", "[0.5 * forces + moments, 0.5 * forces + moments]",
          "tests/mechanics/friction/test_bearing.py"),
    Fault("transverse pressure angle of helical teeth", "mechanics/friction/coupling_friction.py",
          "np.tan(self.surfaces.pressure_angle) / np.cos(self.surfaces.helix_angle)",
          "np.tan(self.surfaces.pressure_angle) * np.cos(self.surfaces.helix_angle)",
          "tests/mechanics/friction/test_tooth.py"),
    Fault("flanks that pull", "engine/friction/slip_equation.py",
          "np.vecmat(np.abs(self.distances(f)), self.fold)", "np.vecmat(self.distances(f), self.fold)",
          "tests/engine/friction/test_slip_equation.py tests/physics/test_sides_of_teeth.py"),
    Fault("friction in coupling forces about the wrong point", "engine/quantities/reactions.py",
          "moved(contact.slip.wrenches(self.links, f)[coupling.known.second], -points)",
          "moved(contact.slip.wrenches(self.links, f)[coupling.known.second], points)",
          "tests/loops/test_cams.py tests/mechanics/couplings tests/physics/test_tooth_friction.py"),
    Fault("chain rule of profiles over a coordinate", "mechanics/laws/over_coordinate.py",
          "ddf * dw**2 + df * ddw", "ddf * dw + df * ddw", "tests/mechanics/laws/test_over_coordinate.py"),
    Fault("half of the deceleration of a trapezoid", "mechanics/laws/kinds.py",
          "0.0, 0.0), (rise, -a, 0.0))", "0.0, 0.0), (rise, -0.5 * a, 0.0))",
          "tests/mechanics/laws/test_motion_law.py"),
    Fault("inertia of rotors behind no gear", "mechanics/rotors.py",
          "gear * effort / self.ratio + self.rotor_inertia * self.ratio * a",
          "gear * effort / self.ratio + self.rotor_inertia * a", "tests/mechanics/test_drives.py"),
    Fault("motors without the voltage of their speed", "mechanics/control/motor_control.py",
          "self.motor.resistance * current + self.motor.constant * self.speed(given)",
          "self.motor.resistance * current", "tests/mechanics/test_motors.py"),
    Fault("stops that rebound into the stop", "engine/motion/segmented/end_stops.py",
          "rebound = -self.bounds[k].restitution", "rebound = self.bounds[k].restitution",
          "tests/engine/motion/segmented/test_end_stops.py"),
    Fault("slopes of multipliers added to those of the masses", "engine/linear/derivatives.py",
          'force_q -= np.einsum("kmj,m->jk", rows_q, lam)', 'force_q += np.einsum("kmj,m->jk", rows_q, lam)',
          "tests/engine/linear/test_linearisation.py tests/loops/test_derivatives.py"),
    Fault("joint damping that drives, in letters", "use/letters/projection.py",
          "-joint.damping * rate(", "joint.damping * rate(", "tests/use/letters"),
    Fault("compiled: springs between points see no turning links", "engine/kernel/c/tree.c",
          "add(b->velocity.linear, cross(b->velocity.angular, s->place[i]))", "b->velocity.linear",
          "tests/engine/kernel/test_tree.py"),
    Fault("compiled: joints without rotors", "engine/kernel/c/tree.c",
          "(power(&d->s, &e->u) + d->armature)", "power(&d->s, &e->u)", "tests/engine/kernel/test_tree.py"),
    Fault("compiled: drifts of rows with the wrong sign", "engine/kernel/c/constraints.c",
          "asked(c, r, l->support, l->own + r) - c->right[l->first + r]",
          "asked(c, r, l->support, l->own + r) + c->right[l->first + r]", "tests/loops/test_compiled.py"),
]  # fmt: skip


def compiled(tree: Path) -> None:
    """Compile the kernel of a tree."""
    subprocess.run([sys.executable, "hatch_build.py"], cwd=tree, check=True, capture_output=True)


def failing(tree: Path, tests: str) -> str:
    """Return the first test that fails, empty where none does."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    for part in tests.split():
        command = [sys.executable, "-m", "pytest", *FLAGS, part]
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 5):
            lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
            return lines[0].split(" - ")[0].partition(" ")[2] if lines else f"{part} (does not begin)"
    return ""


def outcome(tree: Path, fault: Fault) -> str:
    """Plant a fault, run its tests, take it out again; return what catches it, empty where nothing does."""
    path = tree / "pinarm" / fault.file
    sound = path.read_text()
    if sound.count(fault.text) != 1:
        return f"not planted: its text is {sound.count(fault.text)} times in {fault.file}"
    try:
        path.write_text(sound.replace(fault.text, fault.planted))
        if path.suffix == ".c":
            compiled(tree)
        return failing(tree, fault.tests)
    finally:
        path.write_text(sound)
        if path.suffix == ".c":
            compiled(tree)


def main() -> int:
    """Print one line a fault; return how many escape or are not planted."""
    numbers, missed = [int(word) for word in sys.argv[1:]] or range(len(FAULTS)), 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        for name in COPIED:
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
        for name in (*(path.name for path in ROOT.glob("*.md")), "pyproject.toml", "hatch_build.py", "mkdocs.yml"):
            shutil.copy(ROOT / name, tree / name)
        for number in numbers:
            begin, caught = time.perf_counter(), outcome(tree, FAULTS[number])
            missed += not caught or caught.startswith("not planted")
            told = f"caught by {caught}" if caught and "not planted" not in caught else caught or "ESCAPED"
            print(f"{number:2} {FAULTS[number].wrong}: {told} ({time.perf_counter() - begin:.0f} s)", flush=True)
    return missed


if __name__ == "__main__":
    raise SystemExit(main())
