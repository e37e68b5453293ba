"""Which MuJoCo runs: beside its own package `mujoco`, and where two versions overwrite each other."""

import re

import mujoco
import pytest

from asrsim.engines import mujoco_library
from asrsim.engines.libraries import numeric_versions
from asrsim.errors import Problem
from asrsim.scenario import load_scenario
from asrsim.simulation.run import simulate


def installed(folder, *names):
    """Warnings of a folder with these packages, as `mujoco-3.17.0`."""
    for name in names:
        (folder / f"{name}.dist-info").mkdir()
    return mujoco_library.overlaps(folder)


def test_two_versions_of_mujoco_in_one_folder_give_a_warning(tmp_path):
    (warning,) = installed(tmp_path, "mujoco-3.17.0", "mujoco_core-4.0.1")
    assert "mujoco 3.17.0 and mujoco-core 4.0.1" in str(warning)
    assert "pip install --no-deps mujoco==3.17.0" in str(warning.hint)


@pytest.mark.parametrize("names", [(), ("mujoco_core-4.0.1",), ("mujoco-3.17.0",), ("mujoco-4.0.0", "mujoco_core-4.0.0")])
def test_one_version_of_mujoco_in_a_folder_is_right(tmp_path, names):
    assert installed(tmp_path, *names, "mujoco_warp-3.11.0") == ()


def test_every_run_in_mujoco_warns_of_overlapping_packages(tiny, monkeypatch):
    warning = Problem("two versions")
    monkeypatch.setattr("asrsim.engines.mujoco.overlaps", lambda: (warning,))
    (scenario,) = load_scenario(tiny.scenario, overrides=["engine=mujoco", "duration=0.01"])
    assert warning in simulate(scenario).warnings


def test_a_log_names_the_loaded_library_and_not_the_metadata(tiny, monkeypatch):
    monkeypatch.setattr(mujoco, "__version__", "9.9.9")
    (scenario,) = load_scenario(tiny.scenario, overrides=["engine=mujoco", "duration=0.01"])
    loaded = simulate(scenario).info.metadata["engine_version"]
    major, minor, patch = (int(number) for number in re.findall(r"\d+", loaded))
    assert mujoco.mj_version() == 1_000_000 * major + 1000 * minor + patch
    assert loaded == f"mujoco {numeric_versions()['mujoco']}"
