"""Parts of installed packages: their engines run, and what asrsim cannot use is named."""

import json
import os
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint

import pytest

from asrsim.engines import EngineEntry
from asrsim.errors import InputError, RecordingError
from asrsim.metrics.expect import check_expectation
from asrsim.recordings import Reader, read_recording
from asrsim.recordings.text import read_text
from asrsim.registry import Registry, all_or_none, plugin_file
from asrsim.registry.groups import GROUPS, registry_of
from asrsim.scenario.data import Expectation
from asrsim.sweeps import make_study
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
    assert "the engine 'nothing' of elsewhere cannot be used: elsewhere:nothing is not an instance of" in found["nothing"]


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
    with plugin_file("theirs.py"):
        registry.add("light", own)
    with pytest.raises(InputError, match=r"engine 'light' is registered already by theirs\.py"):
        registry.add("light", own)
    registry.add("weightless", registry.get("missing"), replace=True)
    assert registry.get("weightless") is not own
    with pytest.raises(InputError, match=r"'nothing' of an installed package cannot be used: .* is not an instance of "):
        registry.get("nothing")
    assert [one.code for one in fresh().broken()] == ["broken-entry"]
    with pytest.raises(InputError, match=r"is called 'mising'.*Did you mean 'missing'\? Your own engines need --plugin"):
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


@pytest.fixture
def broken(monkeypatch):
    """Function that makes the registry of a module anew, with the entry `oops` of a package whose object is a number."""

    def make(module, name):
        import asrsim.registry.groups as groups

        group = next(group for group, (_, own) in groups.GROUPS.items() if own == name)
        old = groups.registry_of(group)
        fresh = type(old)(old.noun, group, base=old.base, instance=old.instance, label=old.label)
        monkeypatch.setattr(f"{module}.{name}", fresh)
        points = [EntryPoint("oops", "json:decoder", group)]
        monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points if group == fresh.entry_point_group else [])
        return fresh

    return make


def test_a_claim_names_the_broken_measure_of_a_package(broken):
    broken("asrsim.metrics.expect", "MEASURES")
    with pytest.raises(InputError, match="the measure 'oops' of an installed package cannot be used: json:decoder is not an"):
        check_expectation(Expectation(measure="oops", joint="j", quantity="link_position", value=0.0))


def test_a_study_names_the_broken_sampler_of_a_package(broken, tiny):
    broken("asrsim.sweeps.study", "SAMPLERS")
    with pytest.raises(InputError, match="sampler: the sampler 'oops' of an installed package cannot be used"):
        make_study(tiny.scenario, {"arm.mass": "uniform(0.2, 0.6)"}, sampler="oops")


def test_a_recording_is_read_with_a_warning_about_a_broken_reader(broken, tmp_path, monkeypatch):
    fresh = broken("asrsim.recordings.formats", "READERS")
    monkeypatch.setattr("asrsim.recordings.read.READERS", fresh)
    fresh.own("text", Reader(suffixes=(".csv",), read=read_text, confined=False))
    (tmp_path / "a.csv").write_text("time [s],j.link_position [rad]\n" + "".join(f"{0.1 * i},{i}\n" for i in range(9)))
    said = read_recording(tmp_path / "a.csv").findings
    assert "file format 'oops' of an installed package cannot be used" in str(said[0])
    (tmp_path / "a.oops").write_bytes(b"OOPS\0\0\0")
    with pytest.raises(RecordingError, match="file format 'oops' of an installed package cannot be used"):
        read_recording(tmp_path / "a.oops")


def test_check_lists_what_packages_add_in_vain(installed, tiny):
    """Also a stage, whose parameters are then unknown, and a group that asrsim does not have."""
    (installed / "elsewhere-1.0.dist-info" / "entry_points.txt").write_text(
        "[asrsim.stages]\noil = elsewhere:gone\n[asrsim.causes]\noil = elsewhere:make\n[asrsim.sampler]\nmine = json:x\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(installed)])}
    command = [sys.executable, "-m", "asrsim", "check", str(tiny.scenario), "--json"]
    done = subprocess.run(command, env=environment, capture_output=True, check=True)
    found = json.loads(done.stdout)
    said = " ".join(one["message"] for one in found["packages"])
    assert "the stage 'oil' of elsewhere cannot be used: elsewhere:gone raised AttributeError" in said
    assert "the cause 'oil' of elsewhere cannot be used: elsewhere:make is not an instance of" in said
    assert "asrsim has no entry point group 'asrsim.sampler'" in said
    assert "the stage 'oil' of elsewhere" in found["files"][0]["warnings"][0]["message"]
    assert subprocess.run([*command, "--strict"], env=environment, capture_output=True, check=False).returncode == 1


def test_every_registry_with_an_entry_point_group_is_among_those_that_check_examines():
    for group in GROUPS:
        assert registry_of(group).entry_point_group == group
    ours = {one.entry_point_group for one in Registry.everyone if (one.entry_point_group or "").startswith("asrsim.")}
    assert ours == set(GROUPS)


def test_the_page_states_the_kind_of_object_for_every_group():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    code = page.partition("### Entry points of a package")[2].partition("```toml\n")[2].partition("```")[0]
    assert set(tomllib.loads(code)["project"]["entry-points"]) == set(GROUPS)
    for line, group in zip(code.splitlines()[1::2], GROUPS, strict=True):
        registry = registry_of(group)
        assert (registry.base or registry.instance).__name__ in line
        assert ("class derived from" in line and "instance" not in line) == (registry.base is not None)
