"""Variants, overrides, and the resolved scenario that repeats a run."""

import dataclasses
import json
import struct

import pytest

from asrsim.errors import ScenarioError
from asrsim.scenario import load_scenario, scenario_from_data
from asrsim.scenario.relocate import relocated
from asrsim.signals import Constant, Ramp, Step
from support.bags import ramp_bag

TEXT = """
robot: arm.urdf
duration: 2
references:
  "*": {stiffness_preset: 0.2}
  a: {equilibrium_position: {step: {at: 0.1, to: 0.8}}}
parameters: {a: {max_def: 0.5}}
world: {objects: {box: {shape: sphere, size: 0.1}}}
expect:
  - {joint: a, quantity: link_position, measure: maximum, value: 1}
  - {joint: a, quantity: link_position, measure: maximum, value: 2, variant: stiff}
variants:
  soft: {}
  stiff:
    references: {"*": {stiffness_preset: 0.6}, a: {equilibrium_position: {step: {to: 0.5}}}}
    parameters: null
    gravity: [0, 0, 0]
  ramped:
    duration: 3
    references: {a: {equilibrium_position: {ramp: {duration: 1, to: 0.5}}}}
    world: {objects: {box: null, ball: {shape: sphere, size: 0.2}}}
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    path = tmp_path / "move.yaml"
    path.write_text(TEXT)
    return path


def test_variants_are_merged_into_the_rest(path):
    soft, stiff, ramped = load_scenario(path)
    assert [s.variant for s in (soft, stiff, ramped)] == ["soft", "stiff", "ramped"]
    assert soft.references["a"]["equilibrium_position"] == Step(at=0.1, after=0.8)
    assert stiff.references["a"]["equilibrium_position"] == Step(at=0.1, after=0.5)  # `at` stays
    assert ramped.references["a"]["equilibrium_position"] == Ramp(duration=1.0, final=0.5)  # another kind replaces
    assert [s.references["*"]["stiffness_preset"].value for s in (soft, stiff, ramped)] == [0.2, 0.6, 0.2]
    assert stiff.parameters == {}
    assert soft.parameters == {"a": {"max_def": 0.5}}
    assert [o.name for o in ramped.world.objects] == ["ball"]
    assert [s.duration for s in (soft, stiff, ramped)] == [2.0, 2.0, 3.0]


def test_claims_go_to_their_variant(path):
    assert [len(scenario.expect) for scenario in load_scenario(path)] == [1, 2, 1]


def test_faults_that_variants_share_are_told_once(path):
    path.write_text(TEXT.replace("duration: 2", "duration: -2"))
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert len([problem for problem in caught.value.problems if problem.key == "duration"]) == 1


def test_overrides_come_after_the_variant(path):
    overrides = [
        "duration=1",
        'references."*".stiffness_preset=0.4',
        "references.a.equilibrium_position=0.3",
        "gravity=[0, 0, -1.62]",
        "gravity.2=-1e-3",
        "expect.0.value=7",
        "name=other",
    ]
    for scenario in load_scenario(path, overrides=overrides):
        assert scenario.duration == 1.0
        assert scenario.references["*"]["stiffness_preset"] == Constant(value=0.4)
        assert scenario.references["a"]["equilibrium_position"] == Constant(value=0.3)
        assert scenario.gravity == (0.0, 0.0, -1e-3)
        assert scenario.expect[0].value == 7.0
        assert scenario.name == "other"


def test_an_empty_override_takes_the_key_away(path):
    (scenario, *_) = load_scenario(path, overrides=["references.a=", "seed="])
    assert "a" not in scenario.references


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("duration", "is not key=value"),
        ("=1", "is not key=value"),
        ("duratoin=1", "Did you mean 'duration'?"),
        ("elbow.spring_k_1=1", "A joint's parameter is parameters.elbow.spring_k_1"),
        ("forearm.mass=1", "Numbers of the URDF are changed there, by `asrsim sweep --over forearm.mass=...`"),
        ("elbow.damping=1", "Numbers of the URDF are changed there, by `asrsim sweep --over elbow.damping=...`"),
        ("robt.file=x", "Did you mean 'robot'?"),
        ("duration=[1", "not valid YAML"),
        ("duration=x", "must be a number > 0 (got 'x')"),
        ("duration.x=1", "cannot be set inside the value 2"),
        ("expect.9.value=1", "not an index of a list of 2"),
        ("expect.first.value=1", "not an index of a list"),
        ("a..b=1", "not a dotted key"),
        ("step=0.3", "2 s / 0.3 s"),
    ],
)
def test_faults_of_overrides(path, override, message):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path, variant="soft", overrides=[override])
    assert message in str(caught.value)


def test_another_robot(path, tmp_path):
    (tmp_path / "leg.urdf").write_text("<robot name='leg'/>")
    path.write_text(TEXT.replace("robot: arm.urdf", "robot: gone.urdf"))
    assert load_scenario(path, robot=tmp_path / "leg.urdf")[0].robot == tmp_path / "leg.urdf"


def test_resolved_gives_the_same_scenario(path, tmp_path):
    for scenario in load_scenario(path, overrides=["duration=1"]):
        data = json.loads(json.dumps(scenario.resolved, allow_nan=False))
        again = scenario_from_data(data, base_dir=tmp_path)
        assert dataclasses.replace(again, path=scenario.path, text=scenario.text) == scenario
        assert again.resolved == scenario.resolved


def test_resolved_names_files_as_the_log_attaches_them(path, tmp_path):
    """Two recordings of one name in two folders are told apart, and found again from a folder of attachments."""
    for name, value in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "ref.csv").write_text(f"time,q\n0,{value}\n1,{value}\n")
    plays = "".join(
        f"  {j}: {{reference_1: {{playback: {{file: {f}/ref.csv, column: q}}}}}}\n" for j, f in (("a", "one"), ("b", "two"))
    )
    path.write_text(f"robot: arm.urdf\nduration: 1\nparameters: {{a: {{motor_1_max_position: .inf}}}}\nreferences:\n{plays}")
    (scenario,) = load_scenario(path)
    assert set(scenario.attachments) == {"ref.csv", "ref-2.csv"}
    data = json.loads(json.dumps(scenario.resolved, allow_nan=False))
    known = scenario_from_data(data, base_dir=tmp_path, files=scenario.attachments)
    assert known.references == scenario.references
    assert known.parameters == scenario.parameters
    folder = tmp_path / "attachments"
    folder.mkdir()
    for name, file in scenario.attachments.items():
        (folder / name).write_bytes(file.read_bytes())
    moved = scenario_from_data(data, base_dir=folder, robot=tmp_path / "arm.urdf")
    assert moved.references["b"]["reference_1"].samples[1].tolist() == [2.0, 2.0]


def test_a_folder_bag_is_attached_file_by_file(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    (tmp_path / "lab").mkdir()
    ramp_bag(tmp_path / "lab" / "run", "mcap")
    play = {"playback": {"file": "lab/run", "column": "/q"}}
    (tmp_path / "s.yaml").write_text(
        json.dumps({"robot": "arm.urdf", "duration": 1, "references": {"a": {"reference_1": play, "reference_2": play}}})
    )
    (scenario,) = load_scenario(tmp_path / "s.yaml")
    assert set(scenario.attachments) == {"run/metadata.yaml", "run/run.mcap"}
    assert scenario.resolved["references"]["a"]["reference_2"]["playback"]["file"] == "run"
    again = scenario_from_data(scenario.resolved, base_dir=tmp_path, files=scenario.attachments)
    assert again.references == scenario.references


def test_a_relocated_scenario_finds_every_file(tmp_path):
    lab, other = tmp_path / "lab", tmp_path / "other"
    for folder in (lab / "data", lab / "ros", other):
        folder.mkdir(parents=True)
    (lab / "arm.urdf").write_text("<robot name='arm'/>")
    (lab / "data" / "ref.csv").write_text("time,q\n0,1\n1,1\n")
    (lab / "data" / "hand.stl").write_bytes(bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0))
    ramp_bag(lab / "data" / "run", "mcap")
    files = {"reference_1": {"file": "data/run", "column": "/q"}, "reference_2": {"file": "data/ref.csv", "column": "q"}}
    given = {
        "robot": {"file": "arm.urdf", "packages": {"arm_description": "ros"}},
        "duration": 1,
        "manager": None,
        "references": {"a": {name: {"playback": play} for name, play in files.items()}},
        "world": {"objects": {"hand": {"shape": "mesh", "mesh": "data/hand.stl"}}},
    }
    (lab / "s.yaml").write_text(json.dumps(given))
    (scenario,) = load_scenario(lab / "s.yaml")
    (other / "s.yaml").write_text(json.dumps(relocated(scenario, other)))
    (found,) = load_scenario(other / "s.yaml")
    assert found.robot.samefile(scenario.robot)
    assert found.package_paths["arm_description"].samefile(lab / "ros")
    assert found.world.objects[0].mesh.samefile(lab / "data" / "hand.stl")
    for name, play in files.items():
        assert found.references["a"][name].file.samefile(lab / play["file"])


@pytest.mark.parametrize("key", ["gravity", "base.position", "base.rpy"])
def test_a_default_entry_of_a_list_can_be_overridden(key, tmp_path):
    """Each other entry stays what it is without the key."""
    (tmp_path / "arm.urdf").write_text("<robot/>", encoding="utf-8")
    given = {"robot": str(tmp_path / "arm.urdf"), "duration": 1}
    usual = scenario_from_data(given)
    for entry in range(3):
        changed = scenario_from_data(given, overrides={f"{key}.{entry}": 0.25})
        name = key.replace(".", "_")
        expected = [0.25 if place == entry else value for place, value in enumerate(getattr(usual, name))]
        assert list(getattr(changed, name)) == expected
        with pytest.raises(ScenarioError, match="is not an index of a list of 3"):
            scenario_from_data(given, overrides={f"{key}.3": 0.25})
