"""Engines of other installed packages: `engine:` takes them."""

import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from asrsim.engines import EngineEntry
from asrsim.errors import InputError
from asrsim.registry import Registry, all_or_none, plugin_file
from support.paths import ROOT

MODULE = """
from dataclasses import replace
from asrsim.engines import EngineEntry

def make(scenario, robot):
    from asrsim.engines.mujoco import make
    return make(replace(scenario, gravity=(0.0, 0.0, 0.0)), robot)

weightless = EngineEntry(make=make, doc="MuJoCo without gravity", module="mujoco")
missing = EngineEntry(make=make, doc="needs what is not there", module="no_such_library")
nothing = 3
"""
POINTS = """[asrsim.engines]
weightless = elsewhere:weightless
missing = elsewhere:missing
nothing = elsewhere:nothing
"""
URDF = """<robot name="r"><link name="w"/><joint name="j" type="continuous"><parent link="w"/><child link="l"/><axis
xyz="0 1 0"/></joint><link name="l"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@pytest.fixture
def installed(tmp_path):
    """A folder on the path with an installed package that registers two engines, and one that is none."""
    (tmp_path / "elsewhere.py").write_text(MODULE)
    info = tmp_path / "elsewhere-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: elsewhere\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    (tmp_path / "r.urdf").write_text(URDF)
    return tmp_path


SCRIPT = """
import json
import asrsim
from asrsim.errors import AsrsimError
from asrsim.runs.rerun import rerun

def outcome(**keys):
    try:
        result = asrsim.run(asrsim.make_scenario("r.urdf", duration=0.2, **keys), out="out", overwrite=True)
    except AsrsimError as error:
        return str(error)
    return [float(result["j"].link_position[-1]), rerun("out/log.mcap").identical]

engines = {name: outcome(engine=name) for name in ("weightless", "missing", "nothing")}
print(json.dumps(engines))
"""


def test_engines_of_other_packages_run_or_are_named(installed):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(installed)])}
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=installed, env=environment, capture_output=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["weightless"] == [0.0, True]
    assert "needs 'no_such_library', which is not installed" in found["missing"]
    assert "nothing" in found["nothing"]
    assert "weightless" in found["nothing"], "the choices name the other engines"


def test_the_first_question_finds_what_is_installed(installed, monkeypatch):
    """Whichever it is: entry, membership, names."""
    monkeypatch.syspath_prepend(installed)
    points = [EntryPoint(name, f"elsewhere:{name}", "asrsim.engines") for name in ("weightless", "missing", "nothing")]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points if group == "asrsim.engines" else [])

    def fresh():
        return Registry("engine", "asrsim.engines", instance=EngineEntry)

    assert fresh().get("weightless").doc == "MuJoCo without gravity"
    assert "weightless" in fresh()
    assert fresh().names() == ("weightless", "missing")
    registry = fresh()
    own = EngineEntry(make=lambda scenario, robot: None, doc="ours", module="json")
    registry.add("weightless", own)
    assert registry.names()[0] == "weightless"
    assert registry.get("weightless") is own
    with pytest.raises(InputError, match="registered already"):
        registry.add("weightless", own)
    registry.add("weightless", registry.get("missing"), replace=True)
    assert registry.get("weightless") is not own
    with pytest.raises(InputError, match=r"'nothing' of an installed package cannot be used: .* is not an instance of "):
        registry.get("nothing")
    with pytest.raises(InputError, match=r"no engine is called 'mising'.*missing.*Did you mean 'missing'"):
        registry.get("mising")
    with pytest.raises(InputError, match=r"Your own engines need --plugin FILE"):
        registry.get("my_own")
    assert Registry("sampler").remedy == ""


def test_entries_of_asrsim_are_its_own_also_if_a_plugin_file_is_the_first_to_import_them():
    registry = Registry("sampler")
    before = Registry.added
    with plugin_file("mine.py"):
        registry.own("lhs", 1)
        assert Registry.added == before, "the file itself has added nothing"
        with pytest.raises(InputError, match="sampler 'lhs' is registered already"):
            registry.add("lhs", 2)
    assert registry.file_of("lhs") == ""
    assert registry.get("lhs") == 1


def test_of_a_failed_file_nothing_stays_in_registries_that_it_was_the_first_to_import():
    made = []

    def run():
        with all_or_none(), plugin_file("mine.py"):
            made.append(Registry("sampler"))
            made[0].own("lhs", 1)
            made[0].add("mine", 2)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    assert made[0].names() == ("lhs",)
