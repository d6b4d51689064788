"""The build hook of the compiled kernel: with a compiler, with one that fails, with none, and switched off."""

import shutil
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WITH_COMPILER = pytest.mark.skipif(not shutil.which("cc"), reason="there is no C compiler")


@pytest.fixture
def hook(monkeypatch):
    """The module, as in an environment that says nothing of compilers."""
    for name in ("CC", "CFLAGS", "PINARM_KERNEL"):
        monkeypatch.delenv(name, raising=False)
    spec = spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def checkout(tmp_path):
    """A checkout with the sources of the kernel alone."""
    room = Path("pinarm/engine/kernel/c")
    shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("kernel.so", "kernel.dylib"))
    return tmp_path


def files(checkout):
    return {path.relative_to(checkout) for path in checkout.rglob("*") if path.is_file()}


@WITH_COMPILER
def test_the_library_is_compiled_and_nothing_else_is_left(hook, checkout):
    before = files(checkout)
    assert hook.compile_library(checkout) == ""
    assert files(checkout) - before == {hook.LIBRARY}


def test_the_switch_leaves_it_out_and_takes_an_older_one_away(hook, checkout, monkeypatch):
    monkeypatch.setenv("PINARM_KERNEL", "off")
    (checkout / hook.LIBRARY).write_bytes(b"older")
    assert hook.compile_library(checkout) == "PINARM_KERNEL=off"
    assert not (checkout / hook.LIBRARY).exists()


def test_without_a_compiler_it_is_left_out(hook, checkout, monkeypatch):
    monkeypatch.setattr(hook.shutil, "which", lambda name: None)
    monkeypatch.setattr(hook, "find_spec", lambda name: None)
    assert hook.compile_library(checkout) == "there is no C compiler"
    assert not (checkout / hook.LIBRARY).exists()


@WITH_COMPILER
def test_what_the_compiler_says_is_told(hook, checkout):
    before = files(checkout)
    (checkout / hook.ROOM / "c" / "tree.c").write_text("no program")
    assert "error" in hook.compile_library(checkout)
    assert files(checkout) == before


class TestDependencies:
    """A compiler is required where there is none, and where there is a wheel of one."""

    @pytest.fixture
    def required(self, hook, monkeypatch):
        def of(compiler, system="Linux", machine="x86_64", **environment):
            monkeypatch.setattr(hook.shutil, "which", lambda name: compiler)
            monkeypatch.setattr(hook.platform, "system", lambda: system)
            monkeypatch.setattr(hook.platform, "machine", lambda: machine)
            for name, value in environment.items():
                monkeypatch.setenv(name, value)
            return hook.KernelBuildHook.dependencies(None)

        return of

    def test_of_machines_and_builds(self, required):
        assert required("/usr/bin/cc") == []
        assert required(None) == ["ziglang>=0.13"]
        assert required(None, machine="riscv64") == []
        assert required(None, CC="clang") == []
        assert required(None, PINARM_KERNEL="off") == []
