"""What a result says of its global error: of all scenarios against tight solutions and closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.cli import main
from pinarm.errors import NumericsError
from pinarm.use.check import check
from pinarm.use.worth import differences, estimated, scales, varied

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "scenarios").glob("*.yaml"))


def kind(path):
    return pinarm.load(path).problem.kind


FORWARD = [path for path in FILES if kind(path) == "forward"]


def reference(scenario):
    """The tightest solution that gets to the end."""
    for tolerance in (1e-13, 1e-12, 1e-11):
        try:
            return varied(scenario, {"tolerance": tolerance}, 20_000).solve()
        except NumericsError:
            continue
    raise AssertionError("no reference")


def table(path):
    """Estimate and true error of every output at a loose and at a fair tolerance."""
    scenario = pinarm.load(path)
    exact = reference(scenario)
    pairs = []
    for tolerance in (1e-5, 1e-8):
        loose = varied(scenario, {"tolerance": tolerance})
        result = loose.solve()
        errors, true = estimated(loose, result)[0], differences(result, exact)
        pairs += [(path.stem, tolerance, name, errors[name], true[name]) for name in true]
    return pairs
