"""The names that ``pinarm`` offers exist, once, and nothing else does."""

import subprocess
import sys
from importlib import import_module

import pytest

import pinarm


@pytest.mark.parametrize("name", pinarm.__all__)
def test_every_public_name_exists(name: str) -> None:
    assert getattr(pinarm, name) is getattr(import_module(pinarm._HOMES[name]), name)


def test_the_two_lists_of_names_agree() -> None:
    assert pinarm.__all__ == sorted(pinarm.__all__, key=lambda name: (name[0].islower(), name))
    assert set(pinarm.__all__) == set(pinarm._HOMES)
    assert len(pinarm.__all__) == len(set(pinarm.__all__)) > 0


def test_a_name_says_of_itself_where_it_lives() -> None:
    """One import path per name: what is listed is where it is defined, not a module that passes it on."""
    assert {name: getattr(pinarm, name).__module__ for name in pinarm.__all__} == pinarm._HOMES


def test_an_unknown_attribute_raises() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Mechanisms'"):
        _ = pinarm.Mechanisms


def test_importing_the_package_imports_nothing_else() -> None:
    code = "import sys, pinarm; print(sorted({'pinocchio', 'numpy', 'msgspec'} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
