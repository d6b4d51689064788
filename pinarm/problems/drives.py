"""Sharing of a load by more drives than degrees of freedom: ``share`` in files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Self

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.statics.actuation import Actuation, SelectedDrives, SharedEfforts, actuation, everywhere
from pinarm.errors import InputError, Place, within
from pinarm.input.yaml.schema import (
    AnyQuantity,
    InputStruct,
    Measured,
    Positive,
    Readable,
    check_unit,
    convert,
    json_schema,
)
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.joints import effort_unit
from pinarm.problems.values import Weight, check_names, weights_of
from pinarm.records import replace


class EffortRange(Readable):
    """Least and largest effort of a drive: ``20 N*m`` either way, or ``[-100 N, -5 N]``; ``null`` is no limit.

    Attributes:
        bounds: The least and the largest effort.
    """

    __slots__ = ("bounds",)

    def __init__(self, *bounds: Measured | None) -> None:
        self.bounds = bounds

    @classmethod
    def read(cls, value: object) -> Self:
        if isinstance(value, cls):
            return value
        if not isinstance(value, list):
            largest = convert(Positive, value)
            return cls(-largest, largest)  # type: ignore[operator, arg-type]
        if len(value) != 2:
            raise InputError(f"{len(value)} efforts are no range", expected="[least, largest], null for no limit")
        low, high = (None if bound is None else convert(AnyQuantity, bound) for bound in value)
        if None not in (low, high) and not low < high:  # type: ignore[operator]
            raise InputError(f"{low:g} is not below {high:g}", expected="[least, largest], such as [-100 N, -5 N]")
        return cls(low, high)  # type: ignore[arg-type]

    @classmethod
    def schema(cls) -> dict[str, object]:
        bound = {"anyOf": [json_schema(AnyQuantity), {"type": "null"}]}
        return {"anyOf": [json_schema(Positive), {"type": "array", "items": bound, "minItems": 2, "maxItems": 2}]}

    def plain(self) -> object:
        return [*self.bounds]


class EffortSharing(InputStruct, frozen=True):
    """The efforts tau with the least ``sum_i (w_i tau_i)^2`` over the drives i, each within its limits.

    Attributes:
        weights: Drive -> w, of every drive, such as ``{left: 1, right: 2}``; the larger, the less it carries. Numbers
            without unit where all drives give torques, or all give forces; else in 1/N/m and 1/N: the reciprocals of
            the rated efforts, for example. 1 where left out.
        limits: Drive -> largest effort either way, such as ``{A: 20 N*m}``, or its range, such as
            ``{cable: [-100 N, -5 N]}``; ``null`` in a range is no limit. ``model`` takes the effort limits that the
            model gives its joints. No limits where left out.
    """

    weights: dict[str, Weight] = {}
    limits: Literal["model"] | dict[str, EffortRange] = {}

    def weighted(self, drives: Mapping[str, Coordinate]) -> Array:
        """Return w of the drives, shape (d,)."""
        units = {name: effort_unit(coordinate.unit) for name, coordinate in drives.items()}
        return weights_of(self.weights, units, DRIVE, "share", "torques and forces")

    def ranges(self, mechanism: Mechanism, drives: Mapping[str, Coordinate]) -> Array:
        """Return the least and the largest efforts of the drives, infinite where there is no limit, shape (2, d)."""
        limits = _model_limits(mechanism, drives) if isinstance(self.limits, str) else self.limits
        ranges = np.repeat([[-np.inf], [np.inf]], len(drives), axis=1)
        with within("limits"):
            check_names(limits, drives, DRIVE)
            for name, limit in limits.items():
                for side, bound in enumerate(limit.bounds):
                    if bound is not None:
                        with within(name):
                            check_unit(bound, effort_unit(drives[name].unit))
                        ranges[side, [*drives].index(name)] = bound
        return ranges


Share = Literal["least_squares", "bounded"] | EffortSharing
"""A choice of efforts, or the name of one."""

DRIVE = "drive of this run"
"""Meaning of the names in ``share``, for messages."""

SHARES = {"least_squares": EffortSharing(), "bounded": EffortSharing(limits="model")}
"""The choices that have a name."""


def drives_of(
    mechanism: Mechanism, names: Sequence[str], prescribed: Sequence[str], share: Share | None, place: Place
) -> Actuation:
    """Return the drives of a run, and how they share the load.

    Args:
        names: Of the coordinates that the drives act along; see ``actuation``.
        share: How they share the load; ``None`` where the load is to determine their efforts.
    """
    with place("drives"):
        acting = actuation(mechanism, names, prescribed)
    if share is None:
        return acting
    with place("share"):
        if not names:
            raise InputError(
                "no drives are named that share the load",
                hint="drives: [...], or share left out",
                expected="more drives than the mechanism has degrees of freedom",
            )
        if mechanism.frictions:
            rubbing = ", ".join(dict.fromkeys(friction.name for friction in mechanism.frictions))
            raise InputError(
                f"the friction of {rubbing} sticks: shared efforts at rest have no band that holds",
                expected="a mechanism without friction that sticks",
                hint="in its place a force regularised_friction",
            )
        return _sharing(mechanism, acting, share)


def _sharing(mechanism: Mechanism, acting: Actuation, share: Share) -> Actuation:
    assert isinstance(acting, SelectedDrives)  # as all drives that are named
    chosen = SHARES[share] if isinstance(share, str) else share
    efforts = SharedEfforts(chosen.weighted(acting.named), chosen.ranges(mechanism, acting.named))
    _require_told_apart(acting.joints, efforts)
    return replace(acting, sharing=efforts)


def _require_told_apart(joints: Mapping[str, LinearCoordinate], efforts: SharedEfforts) -> None:
    """Raise where the efforts at the joints do not tell those of the drives.

    ``Trajectory.effort_along`` takes the least efforts that give the joints theirs. Where drives act along dependent
    sums of joints these are the shared ones only if all weights are equal and nothing is limited.
    """
    sums = np.array([coordinate.weights for coordinate in joints.values()])
    if not joints or np.linalg.matrix_rank(sums) == len(sums):
        return
    if np.ptp(efforts.weights) or np.isfinite(efforts.limits).any():
        raise InputError(
            f"drives along {', '.join(joints)}, which depend on each other as sums of joints, share with "
            "equal weights and without limits only",
            expected="share: least_squares",
        )


def _model_limits(mechanism: Mechanism, drives: Mapping[str, Coordinate]) -> dict[str, EffortRange]:
    joints = {name: coordinate.joint for name, coordinate in drives.items() if isinstance(coordinate, LinearCoordinate)}
    limits = {name: float(mechanism.model.effortLimit[joint]) for name, joint in joints.items() if joint is not None}
    ranges = {name: EffortRange.read(limit) for name, limit in limits.items() if np.isfinite(limit)}
    if not ranges:
        raise InputError(
            f"the model gives none of the drives {', '.join(drives)} an effort limit",
            expected="an effort limit of their joints in the model",
            hint=f"share: {{limits: {{{next(iter(drives))}: ...}}}}",
        )
    return ranges


def omitted_drives_remarks(mechanism: Mechanism, drives: Sequence[str], prescribed: Sequence[str]) -> list[str]:
    """Return a note where no drives are named, and coordinates that no motor moves carry the load.

    These are coordinates of points and bodies and, where the mechanism file has drives, whatever has none.
    """
    motors = [drive.coordinate for drive in mechanism.drives.values()]
    carriers = [name for name in prescribed if name not in (motors or mechanism.joints)]
    if drives or not mechanism.constraints or not carriers or everywhere(mechanism) is not None:
        return []
    moved = f"'{carriers[0]}' carries" if len(carriers) == 1 else f"{', '.join(carriers)} carry"
    such = f", such as drives: [{', '.join(motors[: len(prescribed)])}]" if motors else ", by the key drives"
    return [
        f"no drives are named: {moved} the load, and efforts of joints without a law are 0. For efforts of motors say "
        f"which coordinates they act along{such}"
    ]
