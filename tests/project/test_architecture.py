"""Rules of docs/architecture.md, checked in the source and in new interpreters."""

import ast
import os
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec

import pytest

from support.imports import MODULES, PACKAGE, SOURCES, imported
from support.paths import ROOT

HEAVY = ("matplotlib", "scipy", "numba", "trimesh", "rosbags", "xacro", "rich", "pandas", "mcap_ros2")


def users_of(library):
    """Files that import a library anywhere."""
    return {
        path.relative_to(PACKAGE).as_posix()
        for path in SOURCES
        if any(name.split(".")[0] == library for name in imported(path, types=True))
    }


def cycle(graph):
    """A cycle in a graph, or an empty list."""
    done = set()

    def visit(node, way):
        if node in way:
            return [*way[way.index(node) :], node]
        if node in done:
            return []
        for follower in sorted(graph.get(node, ())):
            if found := visit(follower, [*way, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(graph) if (found := visit(node, []))), [])


def test_modules_are_imported_without_cycles():
    graph = {name: {used for used in imported(path, types=False) if used in MODULES} for name, path in MODULES.items()}
    assert cycle(graph) == []


def test_packages_are_imported_without_cycles():
    def home(name):
        return ".".join(name.split(".")[:2])

    graph = {}
    for name, path in MODULES.items():
        used = {home(other) for other in imported(path, types=False) if other in MODULES}
        graph.setdefault(home(name), set()).update(used - {home(name), "asrsim"})
    assert cycle(graph) == []


def test_only_its_engine_imports_pybullet():
    users = users_of("pybullet")
    assert users
    assert all(name.startswith("engines/bullet") for name in users), users


@pytest.mark.parametrize("folder", ["plots", "report", "metrics", "log", "recordings"])
def test_readers_of_logs_do_not_import_the_simulation(folder):
    for path in sorted((PACKAGE / folder).rglob("*.py")):
        known = {name for name in imported(path, types=True) if name.startswith(("asrsim.simulation", "asrsim.engines"))}
        assert not known, f"{path.relative_to(ROOT)} imports {known}"


INNER = {
    "arguments", "blocks", "bound_engine", "core", "divergence", "equilibrium", "fields", "imperfections", "inertia", "inputs",
    "joint", "kernel", "laws", "layout", "ledger", "native", "released", "rows", "sensing", "setups", "substeps",
}  # fmt: skip
"""Modules of asrsim.simulation that nothing outside it imports."""


def test_nothing_outside_imports_the_core_s_inner_files():
    inner = {f"asrsim.simulation.{name}" for name in INNER}
    for name, path in MODULES.items():
        if not name.startswith("asrsim.simulation"):
            assert not inner.intersection(imported(path, types=True)), name


def test_one_module_of_identification_imports_the_simulation():
    inner = ("asrsim.simulation", "asrsim.engines", "asrsim.actuators.vectorised", "asrsim.actuators.detailed_motor")
    users = {
        path.stem
        for path in (PACKAGE / "identification").glob("*.py")
        if any(name.startswith(inner) for name in imported(path, types=True))
    }
    assert users == {"door"}


def test_the_library_does_not_import_its_command_line():
    for name, path in MODULES.items():
        used = {other for other in imported(path, types=True) if other.startswith("asrsim.cli")}
        assert not used or name.startswith(("asrsim.cli", "asrsim.__main__")), f"{name} imports {used}"


def test_actuators_import_no_engine_and_no_robot():
    for path in sorted((PACKAGE / "actuators").glob("*.py")):
        used = {name for name in imported(path, types=True) if name.startswith("asrsim.")}
        allowed = (
            "asrsim.actuators",
            "asrsim.errors",
            "asrsim.quantities",
            "asrsim.compiled.rebind",
            "asrsim.records",
            "asrsim.registry",
        )
        strange = {name for name in used if not name.startswith(allowed)}
        assert not strange, f"{path.name} imports {strange}"


@pytest.mark.parametrize("arguments", [["--help"], ["run", "step.yaml", "--no-plot", "--set", "duration=1e-3"]], ids=" ".join)
def test_a_short_command_imports_nothing_heavy(arguments, tiny):
    code = f"""
import atexit, sys
atexit.register(lambda: print("heavy:", sorted(set({HEAVY!r}) & set(sys.modules)), file=sys.stderr))
sys.argv = ["asrsim", *{arguments!r}]
from asrsim.cli.app import main
main()
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tiny.folder, timeout=60, check=True, env=environment
    )
    assert done.stderr.splitlines()[-1] == "heavy: []"


def test_everything_public_is_documented():
    """Docstrings by ruff's rule D1, also in files that silence the linter."""
    ruff = [sys.executable, "-m", "ruff", "check", "--isolated", "--ignore-noqa", "--no-cache", "--select", "D1"]
    pytest.importorskip("ruff")
    done = subprocess.run(
        [*ruff, "--ignore", "D102,D105,D107", "--output-format", "concise", str(PACKAGE)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_imports_in_functions_of_scripts_exist():
    """Benchmarks, examples and documentation import inside functions, which tests seldom call."""
    root = ROOT
    missing = [
        f"{file.name}:{node.lineno}: {node.module}.{name.name}"
        for folder in ("benchmarks", "docs", "examples")
        for file in sorted((root / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "asrsim" and not node.level
        for name in node.names
        if not _gives(str(node.module), name.name)
    ]
    assert not missing


def _gives(module, name):
    found = import_module(module)
    return hasattr(found, name) or (hasattr(found, "__path__") and find_spec(f"{module}.{name}") is not None)
