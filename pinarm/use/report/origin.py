"""Where the numbers of a report come from: versions, digest of the input, kind of host, date."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from pinarm.use.result.result import Result


@dataclass(frozen=True)
class Origin:
    """What computed a result.

    Attributes:
        scenario: Name of the scenario.
        versions: Of the packages that solved it.
        digest: Hash of what determines the numbers: see ``Result.digest``.
        rows: Number of rows of its table.
    """

    scenario: str
    versions: Mapping[str, str]
    digest: str
    rows: int

    @classmethod
    def of(cls, result: Result, folder: Path | None) -> Origin:
        """Return the origin of a result; of one that was read, what its folder says, and not what reads it now."""
        summary = msgspec.json.decode((folder / "summary.json").read_bytes()) if folder else result.summary()
        versions = {str(name): str(version) for name, version in dict(summary.get("versions", {})).items()}
        return cls(result.name, versions, str(summary.get("input", "")), len(result))


def host_kind() -> str:
    """Return what kind of machine this is: system, processor and Python; not its name."""
    return f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
