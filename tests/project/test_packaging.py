"""Declared requirements, contents of the distributions, and the installed wheel."""

import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from support.imports import SOURCES, imported
from support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
REQUIREMENTS = [
    Requirement(text)
    for text in (*PROJECT["dependencies"], *(text for extra in PROJECT["optional-dependencies"].values() for text in extra))
    if not text.startswith("asrsim")
]
LOCKED = {
    canonicalize_name(pin.name): str(pin.specifier).removeprefix("==")
    for pin in map(Requirement, (line for line in LOCK if line and not line.startswith("#")))
}
"""Locked version of each library."""


def test_requirements_without_wheels_everywhere_have_markers():
    assert PROJECT["requires-python"] == ">=3.11"
    for name in ("pybullet", "numba"):
        (text,) = (text for text in PROJECT["dependencies"] if text.startswith(name))
        assert "; " in text
        assert any(line.startswith(f"{name}==") and " ; " in line for line in LOCK)


def test_every_requirement_has_a_lower_bound_that_the_lock_meets():
    for requirement in REQUIREMENTS:
        assert any(bound.operator == ">=" for bound in requirement.specifier), requirement
        assert requirement.specifier.contains(LOCKED[canonicalize_name(requirement.name)]), requirement


def test_the_versions_agree():
    import asrsim

    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert PROJECT["version"] == asrsim.__version__
    assert f"version: {asrsim.__version__}\n" in citation
    assert f"## {asrsim.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_imports_are_declared():
    """Every library that the package imports is its own requirement, not only one of another requirement."""
    names = {
        "yaml": "pyyaml",
        "imageio_ffmpeg": "imageio-ffmpeg",
        "PIL": "pillow",
        "mujoco": "mujoco-core",
        "warp": "warp-lang",
        # Numba does not go without.
        "llvmlite": "numba",
        "pinocchio": "pin",
        "mcap_ros2": "mcap-ros2-support",
        "foxglove": "foxglove-sdk",
        "rclpy": "ros-rclpy",
        "rcl_interfaces": "ros-rclpy",
        "std_srvs": "ros-common-interfaces",
    }
    used = {name.split(".")[0] for path in SOURCES for name in imported(path, types=True)}
    libraries = {canonicalize_name(names.get(name, name)) for name in used - sys.stdlib_module_names - {"asrsim"}}
    assert libraries <= {canonicalize_name(requirement.name) for requirement in REQUIREMENTS}


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """Folder with a source distribution, and a wheel built from it by the backend in pyproject.toml."""
    pytest.importorskip("hatchling.build")
    folder = tmp_path_factory.mktemp("dist")
    build = "import sys; from hatchling.build import build_sdist, build_wheel; globals()[sys.argv[1]](sys.argv[2])"
    subprocess.run([sys.executable, "-c", build, "build_sdist", str(folder)], cwd=ROOT, check=True, timeout=60)
    (archive,) = folder.glob("*.tar.gz")
    subprocess.run(["tar", "-xf", str(archive), "-C", str(folder)], check=True, timeout=60)
    source = folder / archive.name.removesuffix(".tar.gz")
    subprocess.run([sys.executable, "-c", build, "build_wheel", str(folder)], cwd=source, check=True, timeout=60)
    return folder


def files_below(folder):
    """Files of the project, without caches of Python and Numba."""
    found = (path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return [path for path in found if path.suffix not in (".nbi", ".nbc")]


def test_the_wheel_holds_the_package_and_its_data(distributions):
    (wheel,) = distributions.glob("*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    ours = {path.relative_to(ROOT).as_posix() for path in files_below("asrsim")}
    examples = {f"asrsim/{path.relative_to(ROOT).as_posix()}" for path in files_below("examples")}
    assert held == ours | examples
    assert "asrsim/py.typed" in held


def test_the_source_distribution_can_be_tested(distributions):
    source = next(path for path in distributions.iterdir() if path.is_dir())
    for name in ("README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "requirements.lock", ".ci/run", "docs/index.md"):
        assert (source / name).is_file(), name
    assert (source / "examples/scenarios/step_2dof.yaml").is_file()
    assert (source / "tests/project/test_packaging.py").is_file()


def test_the_wheel_works_without_the_repository(distributions, tmp_path):
    """The environment contains the wheel and its requirements only."""
    (wheel,) = distributions.glob("*.whl")
    venv.create(tmp_path / "venv", with_pip=False)
    site = next((tmp_path / "venv").glob("lib/python*/site-packages"))
    zipfile.ZipFile(wheel).extractall(site)
    ours = [path for path in sys.path if path.endswith("site-packages")]
    (site / "zz_requirements.pth").write_text("\n".join(ours) + "\n")
    work = tmp_path / "work"
    work.mkdir()
    (work / "arm.urdf").write_text((ROOT / "examples/urdf/dof1_qbmove.urdf").read_text())
    python = tmp_path / "venv/bin/python"

    def asrsim(*arguments):
        code = "import sys; from asrsim.cli.app import main; sys.argv[0] = 'asrsim'; main()"
        done = subprocess.run(
            [python, "-I", "-c", code, *arguments], cwd=work, capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    home = subprocess.run(
        [python, "-I", "-c", "import asrsim; print(asrsim.__file__)"], capture_output=True, text=True, check=True
    )
    assert Path(home.stdout.strip()).is_relative_to(tmp_path)
    asrsim("init", "arm.urdf")
    asrsim("run", "scenario.yaml", "--variant", "soft", "--report", "--no-plot", "--set", "duration=0.2")
    assert [path.name for path in work.glob("out/scenario/soft/log.mcap")] == ["log.mcap"]
    assert list(work.glob("out/scenario/soft/report.html"))
