"""What runs without ``drives`` say where their efforts are not those of motors: loads act along the laws themselves."""

from __future__ import annotations

from collections.abc import Sequence

from pinarm.engine.mechanism import Mechanism


def omitted_drives_remarks(mechanism: Mechanism, drives: Sequence[str], prescribed: Sequence[str]) -> list[str]:
    """Return a note that names the joints one would drive, where coordinates that no motor moves carry the load.

    These are coordinates of points, bodies and such; joints that move no mass of their own, as the slides by which a
    model lets a platform move; and, where the mechanism file has drives, whatever has none.

    Args:
        mechanism: The mechanism.
        drives: Names of the coordinates that drives act along, as the problem has them.
        prescribed: Names of the coordinates that follow laws, which carry the load where ``drives`` is empty.
    """
    if drives or not mechanism.constraints:
        return []
    driven = [drive.coordinate for drive in mechanism.drives.values()]
    carriers = [name for name in prescribed if _is_no_drive(mechanism, name, driven)]
    joints = driven or [name for name in _on_ground(mechanism) if name not in prescribed]
    if not carriers or not joints:
        return []
    from pinarm.engine.statics.actuation import everywhere

    if everywhere(mechanism) is not None:
        return []
    moved = f"'{carriers[0]}' carries" if len(carriers) == 1 else f"{', '.join(carriers)} carry"
    return [
        f"no drives are named: {moved} the load, and efforts of joints without a law are 0. For efforts of motors say "
        f"which coordinates they act along, such as drives: [{', '.join(joints[: len(prescribed)])}]"
    ]


def _is_no_drive(mechanism: Mechanism, name: str, driven: Sequence[str]) -> bool:
    """Return whether a coordinate is one that no motor moves, as far as that is known."""
    if driven:
        return name not in driven
    joint = mechanism.joints.get(name)
    return joint is None or mechanism.model.inertias[joint.index].mass == 0.0


def _on_ground(mechanism: Mechanism) -> list[str]:
    """Return the joints between a link that has a mass and the ground."""
    model = mechanism.model
    return [name for name, joint in mechanism.joints.items()
            if model.parents[joint.index] == 0 and model.inertias[joint.index].mass > 0.0]  # fmt: skip
