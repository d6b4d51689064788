"""Imports go downwards only, and what is costly to import is not paid for by a run that does not need it."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import pinarm

pytestmark = pytest.mark.house

PACKAGE = Path(pinarm.__file__).parent

FLOOR_PLAN = {
    "records": "",
    "errors": "",
    "language": "",
    "arrays": "",
    "input": "units roots xml_text formulas yaml csv_tables xacro",
    "mechanics": "geometry joints laws limited_states motors coordinates control rotors ball_joints loops "
    "forces couplings loading friction points perturbation planar_drawing description",
    "engine": "series labelled_array kernel integration constraints dynamics mesh_inertias "
    "model_source kinematics statics friction control motion checks quantities linear mechanism mechanism_loading",
    "problems": "time_grid accuracy values laws loads drives control simplification events "
    "equilibria inverse linear recorded forward",
    "use": "progress result workers cases assessments scenario accuracy output show store method mechanism "
    "facade start letters study report",
    "cli": "options commands main",
}
"""Layers from low to high -> their rooms, folders or modules, from low to high: each may import those before it."""

EXCEPTIONS = {
    ("use.result.section", "use.show.text"): "sections in notebooks, by themselves",
}
"""Imports that go upwards, inside functions, and why. No circle runs over them either."""

COSTLY = {"matplotlib", "pandas", "meshcat", "scipy"}
LATE = {
    "use/show/picture.py": {"matplotlib"},
}
"""Modules that are imported by functions only, and what they need."""

FILES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))


def module_of(file: Path) -> str:
    """Return the name of a file's module within the package, such as ``engine.mechanism``."""
    return ".".join(file.with_suffix("").parts).removesuffix("__init__").rstrip(".")


MODULES = {module_of(file): PACKAGE / file for file in FILES if file.as_posix() not in ("__init__.py", "__main__.py")}


def is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield all nodes of a tree but those under ``if TYPE_CHECKING``."""
    rest = [tree]
    while rest:
        inner = [node for node in ast.iter_child_nodes(rest.pop()) if not is_for_types(node)]
        rest.extend(inner)
        yield from inner


def imports(tree: ast.AST) -> Iterator[str]:
    """Yield the modules that are imported anywhere in a tree, inside functions too; those for types alone are not.

    Modules that are imported by their name count as well: texts that are names of modules.
    """
    for node in nodes(tree):
        if isinstance(node, ast.Constant) and str(node.value).removeprefix("pinarm.") in MODULES:
            yield str(node.value)
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            of = str(node.module)
            for alias in node.names:
                full = f"{of}.{alias.name}"
                yield full if full.removeprefix("pinarm.") in MODULES else of


def module_level(tree: ast.Module) -> Iterator[str]:
    """Yield the modules that are imported as soon as the file is, outside functions and ``if TYPE_CHECKING``."""
    outer: list[ast.stmt] = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    return imports(ast.Module(body=outer, type_ignores=[]))


class Source(NamedTuple):
    """What a file imports anywhere and at its top, by module."""

    imports: set[str]
    top: set[str]


@cache
def sources() -> dict[Path, Source]:
    """Return what stands in every file of the package."""
    trees = ((file, ast.parse((PACKAGE / file).read_text(encoding="utf-8"))) for file in FILES)
    return {file: Source(set(imports(tree)), set(module_level(tree))) for file, tree in trees}


@cache
def imported() -> dict[str, set[str]]:
    """Return what every module imports of the package, inside functions too, but for annotations alone."""
    within = {
        module_of(file): {name.removeprefix("pinarm.") for name in source.imports if name.startswith("pinarm.")}
        for file, source in sources().items()
    }
    return {module: within[module] - {module} for module in MODULES}


def place(module: str) -> tuple[int, int]:
    """Return where a module stands in the floor plan: its layer, and its room in the layer."""
    layer, _, rest = module.partition(".")
    assert layer in FLOOR_PLAN, f"{module} belongs to no layer: give it one in this test"
    rooms, room = FLOOR_PLAN[layer].split(), rest.partition(".")[0]
    assert not room or room in rooms, f"{module} is in no room: give '{room}' a place among those of '{layer}'"
    return list(FLOOR_PLAN).index(layer), rooms.index(room) if room else -1


def test_imports_go_downwards_only() -> None:
    """Between layers, and between the rooms of a layer."""
    upwards = {(module, name) for module, names in imported().items() for name in names if place(name) > place(module)}
    assert upwards == EXCEPTIONS.keys()
    assert len(EXCEPTIONS) <= 5


def test_there_is_no_circle_between_modules() -> None:
    """Imports inside functions count."""
    try:
        TopologicalSorter(imported()).prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(error.args[1])}")


def named(tree: ast.AST) -> Iterator[str]:
    """Yield the modules that are imported by statements anywhere in a tree, for annotations too."""
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)):
        names = [f"{node.module}.{alias.name}".removeprefix("pinarm.") for alias in node.names]
        yield from (name if name in MODULES else str(node.module).removeprefix("pinarm.") for name in names)


def test_circles_that_annotations_close_have_three_modules_at_most() -> None:
    """Records stand below, facades above: `Mechanism`, `Scenario` and `Result` once tied 220 modules together."""
    from scipy.sparse.csgraph import connected_components

    numbers = {module: k for k, module in enumerate(MODULES)}
    edges = np.zeros((len(MODULES), len(MODULES)), bool)
    for module, path in MODULES.items():
        names = set(named(ast.parse(path.read_text(encoding="utf-8")))) & MODULES.keys()
        edges[numbers[module], [numbers[name] for name in names]] = True
    _, labels = connected_components(edges, connection="strong")
    largest = np.flatnonzero(labels == np.bincount(labels).argmax())
    assert len(largest) <= 3, [list(MODULES)[k] for k in largest]


def test_the_floor_plan_lists_what_there_is() -> None:
    rooms = {layer: set(order.split()) for layer, order in FLOOR_PLAN.items()}
    there = {module.split(".")[0]: set() for module in MODULES}
    for layer, *room in (module.split(".") for module in MODULES):
        there[layer] |= set(room[:1])
    assert there == rooms


def test_costly_modules_are_imported_where_they_are_used() -> None:
    for file, source in sources().items():
        allowed = LATE.get(file.as_posix(), set())
        assert not {name.partition(".")[0] for name in source.top} & (COSTLY - allowed), file


UNUSED = [
    "scipy", "matplotlib", "pandas", "meshcat", "html", "numpy.ma", "numpy.random", "numpy.ctypeslib",
    "dataclasses", "pinarm.mechanics.friction.contact", "pinarm.mechanics.couplings.cam",
    "pinarm.engine.motion.segmented.stick_slip",
]  # fmt: skip


@pytest.mark.parametrize("name", ["gen411_arm_static", "four_bar_equal_rods"])
def test_a_run_imports_nothing_costly(name: str, tmp_path: Path) -> None:
    scenario = PACKAGE.parent / "scenarios" / f"{name}.yaml"
    code = (
        "import sys; from pinarm.cli.main import main\n"
        f"assert main(['run', {str(scenario)!r}, '-o', {str(tmp_path / 'out')!r}, '--no-plots']) == 0\n"
        f"print('loaded:', [name for name in {UNUSED} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "loaded: []"
