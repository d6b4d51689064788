"""Imports go downwards only, and what is costly to import is not paid for by a run that does not need it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import pinarm

PACKAGE = Path(pinarm.__file__).parent
LAYERS = {
    "errors": 0, "arrays": 0, "input": 0, "mechanics": 1, "engine": 2, "problems": 3, "use": 4, "cli": 5,
}  # fmt: skip
EXEMPT = {"__init__", "__main__"}
COSTLY = {"matplotlib", "pandas", "meshcat", "scipy"}
FILES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))


def imports(tree: ast.AST) -> list[str]:
    """All modules that are imported anywhere in a tree; ``from pinarm import use`` counts as ``pinarm.use``."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            packages = [f"pinarm.{a.name}" for a in node.names if a.name in LAYERS]
            found += packages if node.module == "pinarm" and packages else [str(node.module)]
    return found


def module_level(tree: ast.Module) -> list[str]:
    """Modules that are imported as soon as the file is, outside functions and ``if TYPE_CHECKING``."""
    outer = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    return imports(ast.Module(body=outer, type_ignores=[]))


def layer(name: str) -> int:
    part = name.split(".")[1]
    assert part in LAYERS, f"{name} belongs to no layer: give it one in this test"
    return LAYERS[part]


@pytest.mark.parametrize("file", [f for f in FILES if not (len(f.parts) == 1 and f.stem in EXEMPT)], ids=str)
def test_imports_go_downwards_only(file: Path) -> None:
    tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
    own = layer(f"pinarm.{file.parts[0].removesuffix('.py')}")
    upwards = [n for n in imports(tree) if n.startswith("pinarm.") and layer(n) > own]
    assert not upwards


@pytest.mark.parametrize("file", FILES, ids=str)
def test_costly_modules_are_imported_where_they_are_used(file: Path) -> None:
    tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
    allowed = {"matplotlib"} if file.as_posix() in ("use/show/plot.py", "use/show/sketch.py") else set()
    assert not {name.partition(".")[0] for name in module_level(tree)} & (COSTLY - allowed)


def test_a_run_without_plots_imports_nothing_costly(tmp_path: Path) -> None:
    scenario = PACKAGE.parent / "scenarios" / "gen411_arm_static.yaml"
    code = (
        "import sys; from pinarm.cli.main import main\n"
        f"assert main(['run', {str(scenario)!r}, '-o', {str(tmp_path / 'out')!r}, '--no-plots']) == 0\n"
        "print('loaded:', sorted({m.partition('.')[0] for m in sys.modules}.union(sys.modules)"
        " & {'scipy', 'matplotlib', 'pandas', 'meshcat', 'rich', 'numpy.ma', 'numpy.random'}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "loaded: []"
