"""The names that ``pinarm`` offers exist, once, and nothing else does."""

import inspect
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import pytest

import pinarm

pytestmark = pytest.mark.house


def test_every_public_name_exists() -> None:
    for name in pinarm.__all__:
        assert getattr(pinarm, name) is getattr(import_module(pinarm._HOMES[name]), name)


def test_a_name_says_of_itself_where_it_lives() -> None:
    """One import path per name: what is listed is where it is defined, not a module that passes it on."""
    assert {name: getattr(pinarm, name).__module__ for name in pinarm.__all__} == pinarm._HOMES


PLAIN = {
    "str", "int", "float", "bool", "object", "None", "Any", "Path", "Mapping", "Sequence", "Callable", "Iterator",
    "Literal", "Array", "ArrayLike", "Values", "Given", "Subject", "Unit", "pin", "Model", "ControlFunction",
    "Executor", "ResultFunction",
}  # fmt: skip
"""What parameters of public functions are made of, beside public types: plain ones, values, scenarios, units of
quantities, Pinocchio's models, functions ``u(t, state)`` and of results, executors of the standard library."""


def public_calls() -> Iterator[tuple[str, Any]]:
    """Functions, and the methods of a mechanism and of what is asked for quantities."""
    offered = {name: getattr(pinarm, name) for name in pinarm.__all__}
    yield from ((name, call) for name, call in offered.items() if not isinstance(call, type))
    for owner in (pinarm.Mechanism, pinarm.Batch, pinarm.Sweep, pinarm.Tradeoff, pinarm.Result, pinarm.Series):
        for name, member in vars(owner).items():
            member = member.__func__ if isinstance(member, classmethod) else member
            if inspect.isfunction(member) and not name.startswith("_"):
                yield f"{owner.__name__}.{name}", member


def test_public_calls_take_plain_things() -> None:
    """No documents, places or buffers of the inside, and no private parameters."""
    parameters = [
        (name, given) for name, call in public_calls() for given in inspect.signature(call).parameters.values()
    ]
    for name, parameter in parameters:
        assert not parameter.name.startswith("_"), name
        words = re.sub(r"Literal\[.*?\]", "Literal", str(parameter.annotation))
        types = set(re.findall(r"[A-Za-z_]\w*", words)) - {"inspect", "_empty", "class"}
        assert types <= PLAIN | set(pinarm.__all__) | {"tuple", "list", "dict"}, f"{name}({parameter})"


def test_other_values_have_one_spelling() -> None:
    for name in ("load", "run", "check", "validate", "explain", "tradeoff", "sweep", "batch"):
        parameter = inspect.signature(getattr(pinarm, name)).parameters["values"]
        assert (parameter.annotation, parameter.default) == ("Values | None", None), name


def test_docstrings_explain_what_is_given() -> None:
    """Functions and methods with several parameters name them all, or refer to where they are explained."""
    for name, call in public_calls():
        text = inspect.getdoc(call) or ""
        parameters = [one for one in inspect.signature(call).parameters if one not in ("self", "cls", "options")]
        assert text, name
        unsaid = [one for one in parameters if not re.search(rf"\b{one}\b", text)]
        assert len(parameters) < 2 or not unsaid or "see ``" in text, f"{name}: {unsaid}"


def no_openmp() -> dict[str, str]:
    """Return the environment without what it says to OpenMP and OpenBLAS."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_", "OPENBLAS_"))}


def test_importing_the_package_imports_nothing_else_and_leaves_the_environment_as_it_is() -> None:
    code = (
        "import os, sys; before = dict(os.environ)\nimport pinarm\n"
        "assert not {'pinocchio', 'numpy', 'msgspec'} & sys.modules.keys()\n"
        "for name in pinarm.__all__: assert getattr(pinarm, name) and dict(os.environ) == before, name\n"
        "print('pinocchio' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=no_openmp())
    assert done.stdout.strip() == "True"


@pytest.mark.skipif(sys.platform != "linux", reason="another OpenMP, which shows its settings otherwise")
@pytest.mark.parametrize(("first", "said", "policy"), [
    ("pinarm.Mechanism", {}, "PASSIVE"), ("main(['run', 'none.yaml'])", {"OMP_WAIT_POLICY": "active"}, "ACTIVE"),
])  # fmt: skip
def test_threads_sleep_between_calls_unless_the_user_says_otherwise(
    first: str, said: dict[str, str], policy: str
) -> None:
    """OpenMP shows what it has read when it is loaded; OpenBLAS reads the environment when it is, with numpy."""
    environment = {**no_openmp(), "OMP_DISPLAY_ENV": "verbose", **said}
    code = (
        "import os, sys\nclass Watch:\n  def find_spec(name, *more):\n"
        "    if name == 'numpy': print('numpy:', os.environ.get('OPENBLAS_THREAD_TIMEOUT'), file=sys.stderr)\n"
        f"sys.meta_path.insert(0, Watch)\nimport pinarm; from pinarm.cli.main import main\n{first}"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert f"OMP_WAIT_POLICY = '{policy}'" in done.stderr
    assert ("GOMP_SPINCOUNT = '20000'" in done.stderr) == (not said)
    assert f"numpy: {None if said else 18}" in done.stderr
