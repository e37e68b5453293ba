"""Scenario files: what they mean, and every fault with its place."""

import contextlib
import json
import os
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asrsim.document.yaml_reader import parse_yaml, plain_scalar
from asrsim.errors import InputError, ScenarioError
from asrsim.samples import JointInfo
from asrsim.scenario import load_scenario, make_scenario, scenario_from_data
from asrsim.scenario.carried import unknown_actuators
from asrsim.scenario.data import KEYS, Imperfections, LinkDamping
from asrsim.signals import Constant, Step

BASE = "robot: arm.urdf\nduration: 2\n"


@pytest.fixture
def load(tmp_path):
    """Load a scenario from text beside an (empty) robot file; keyword arguments go to load_scenario."""
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")

    def read(text, **arguments):
        path = tmp_path / "move.yaml"
        path.write_text(text)
        return load_scenario(path, **arguments)

    return read


def faults(load, text, **arguments):
    with pytest.raises(ScenarioError) as caught:
        load(text, **arguments)
    return caught.value.problems


def test_the_smallest_scenario(load, tmp_path):
    (scenario,) = load(BASE)
    assert (scenario.name, scenario.variant, scenario.robot) == ("move", "default", tmp_path / "arm.urdf")
    assert (scenario.duration, scenario.step, scenario.log_every, scenario.seed) == (2.0, 1e-3, 1, 0)
    assert scenario.gravity == (0.0, 0.0, -9.81)
    assert scenario.fixed_base
    assert scenario.stepping == "leapfrog"
    assert scenario.substeps is None
    assert scenario.world.empty
    assert scenario.text == BASE


@pytest.mark.parametrize("name", ["x" * 5000, "a/" * 3000, "no such file"])
def test_a_name_that_no_file_can_have_is_no_file(tmp_path, name):
    path = tmp_path / "s.yaml"
    path.write_text(f"robot: {name}.urdf\nduration: 1\n")
    with pytest.raises(ScenarioError) as error:
        load_scenario(path)
    assert [(problem.code, problem.line) for problem in error.value.problems] == [("no-file", 1)]


def test_every_key_arrives(load, tmp_path):
    (tmp_path / "manager.yaml").write_text("namespace: /left/arm/\njoints_name: [b, a]\njoints_number: 2\n")
    (tmp_path / "hand.stl").write_bytes(bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0))
    (scenario,) = load(
        """
name: everything
robot: {file: arm.urdf, arguments: {side: left, length: 2, fixed: true}, packages: {arm_description: meshes}}
base: {position: [0, 0, 1], rpy: [0, 0, 3.14], fixed: false}
gravity: [0, 0, 0]
initial: {"*": 0.1, a: 0.2}
duration: 1e0
step: 2.5e-4
log_rate: 1000
seed: 7
stepping: toolbox
substeps: 2
motor_substeps: auto
max_substeps: 50
engine: bench
motion: {a: {sinusoid: {amplitude: 1, frequency: 1}}}
compiled: false
modes: 6
parameters: {"*": {spring_k1: 1e-3, motor_1_max_position: inf}, a: {max_def: 0.5}}
manager: manager.yaml
references: {"*": {stiffness_preset: 0.2}, a: {equilibrium_position: {step: {to: 1}}}}
external_torques: {a: 0.1}
wrenches: [{link: tip, force: [1, null, {step: {to: 2}}], point: [0, 0, 0.1], frame: link}]
imperfections: {commands: {"*": {delay: 0.01, rate: 100}}, sensors: {a: {quantum: 0.001, noise: 1e-4}}}
link_damping: {a: {ratio: 0.1, inertia: 0.01}}
world:
  ground: {friction: 0.8, height: -0.1}
  objects:
    box: {shape: box, size: [0.1, 0.2, 0.3], mass: 2, friction: 0.23}
    ball: {shape: sphere, size: 0.03}
    hand: {shape: mesh, mesh: hand.stl}
task: {link: tip, poses: [{time: 0, position: [0,0,1], rpy: [0,0,0]}, {time: 1, position: [0,1,1], rpy: [0,0,0]}], preset: 0.3}
ilc: {trajectory: {a: {minimum_jerk: {to: 0.8, duration: 1}}}, tolerance: 0.08, gain: 0.4, joint_gains: {a: 0.3}}
expect:
  - {joint: a, quantity: link_position, measure: steady_state, value: 1, tolerance: 0.1}
  - {body: box, quantity: displacement, measure: maximum, comparison: "<", value: 0.001}
"""
    )
    assert scenario.name == "everything"
    assert scenario.xacro_arguments == {"side": "left", "length": "2", "fixed": "true"}
    assert scenario.package_paths == {"arm_description": tmp_path / "meshes"}
    assert not scenario.fixed_base
    assert scenario.log_every == 4
    assert scenario.modes == {"*": 6}
    assert scenario.parameters["*"]["motor_1_max_position"] == float("inf")
    assert scenario.joint_order == ("b", "a")
    assert scenario.namespace == "left/arm"
    assert scenario.references["*"]["stiffness_preset"] == Constant(value=0.2)
    assert scenario.references["a"]["equilibrium_position"] == Step(after=1.0)
    assert scenario.wrenches[0].force == (Constant(value=1.0), None, Step(after=2.0))
    assert scenario.sensor_imperfections["a"] == Imperfections(quantum=0.001, noise=1e-4)
    assert scenario.link_damping["a"] == LinkDamping(ratio=0.1, inertia=0.01)
    assert (scenario.world.ground_friction, scenario.world.ground_height) == (0.8, -0.1)
    assert [(o.name, o.size) for o in scenario.world.objects][:2] == [("box", (0.1, 0.2, 0.3)), ("ball", (0.03,))]
    assert scenario.world.objects[2].mesh == tmp_path / "hand.stl"
    assert scenario.task is not None
    assert scenario.task.preset == {"*": 0.3}
    assert scenario.learning is not None
    assert scenario.learning.trajectory["a"].kind == "minimum_jerk"
    assert [claim.line for claim in scenario.expect] == [35, 36]
    assert set(scenario.attachments) == {"manager.yaml", "hand.stl"}


@pytest.mark.parametrize("key", ["name", "variant", "variants"])
def test_forbidden_key_of_a_variant_is_one_fault(load, key):
    (problem,) = faults(load, BASE + f"variants: {{a: {{{key}: x}}}}\n")
    assert problem.key == f"variants.a.{key}"


@pytest.mark.parametrize(
    ("text", "line", "key", "message"),
    [
        ("duratoin: 2", 3, "duratoin", "Did you mean 'duration'?"),
        ("step: 1e-3\nstep: 1e-3", 4, "step", "duplicate of the key in line 3"),
        ("step: on", 3, "step", "must be a number > 0 (got 'on')"),
        ("step: -1", 3, "step", "must be a number > 0"),
        ("step: .nan", 3, "step", "finite"),
        ("step: 0.0003", 2, "duration", "2 s / 0.0003 s = 6666.66667"),
        ("substeps: 3000000\nmotor_substeps: 2", 2, "duration", "makes 1.2e+10 steps, counting substeps"),
        ("log_rate: 300", 3, "log_rate", "1000 Hz / 300 Hz = 3.33333333"),
        ("gravity: 9.81", 3, "gravity", "must be a list [x, y, z]"),
        ("compiled: 1", 3, "compiled", "must be true or false"),
        ("modes: {a: 9}", 3, "modes.a", "whole number >= 0 and <= 8"),
        ("modes: 9", 3, "modes", "must be a whole number >= 0 and <= 8"),
        ("modes: [1]", 3, "modes", "must be a whole number >= 0 and <= 8, or mapping from joint"),
        ("actuators: [1]", 3, "actuators", "or mapping from joint"),
        ("inverse_dynamics: [1]", 3, "inverse_dynamics", "must be true or false, or mapping from joint"),
        ("initial: equilibrum", 3, "initial", "Did you mean 'equilibrium'?"),
        ("initial: foo", 3, "initial", "choose from equilibrium. A mapping from joint to state"),
        ("motion: {a: 1}", 3, "motion", "needs 'engine: bench'"),
        ("references:\n  a:\n    x: {stp: 1}", 5, "references.a.x.stp", "Did you mean 'step'?"),
        ("references: {a: {'*': 1}}", 3, "references.a.*", "cannot stand for a reference"),
        ("wrenches: [{force: [0, 0, 0]}]", 3, "wrenches.0", "'link' is missing"),
        ("wrenches: [{link: arm}]", 3, "wrenches.0.force", "a force or a torque"),
        ("reference_ranges: {a: {b: [1, -1]}}", 3, "reference_ranges.a.b", "must not exceed the second"),
        ("variant: a\nvariants: {a: {}}", 3, "variant", "not allowed in a file"),
        ("world: {objects: {b: {shape: box, size: 1}}}", 3, "world.objects.b.size", "[x, y, z]"),
        ("world: {objects: {b: {shape: mesh}}}", 3, "world.objects.b.mesh", "needs the key 'mesh'"),
        ("world: {objects: {robot: {shape: sphere, size: 1}}}", 3, "world.objects.robot", "cannot have the name"),
        ("world: {objects: {ground: {shape: sphere, size: 1}}}", 3, "world.objects.ground", "cannot have the name"),
        (
            "task: {link: a, poses: [{time: 1, position: [0, 0, 0]}, {time: 1, position: [0, 0, 0]}]}",
            3,
            "task.poses",
            "must ascend",
        ),
        (
            "task: {link: a, poses: [{time: 0, position: [0, 0, 0], rpy: [0, 0, 0]}, {time: 1, position: [0, 0, 0]}]}",
            3,
            "task.poses",
            "all poses must have an orientation",
        ),
        ("task: {link: a, poses: []}", 3, "task.poses", "of at least 1 value, but has 0 entries"),
        ("ilc: {trajectory: {a: 1}}", 3, "ilc", "'tolerance' is missing"),
        ("expect: [{quantity: link_position, measure: x, value: 1}]", 3, "expect.0", "joint or body"),
        ("expect: [{joint: a, quantity: link_positon, measure: x, value: 1}]", 3, "expect.0.quantity", "'link_position'"),
        ("expect: [{body: box, quantity: x, measure: x, value: 1}]", 3, "expect.0.body", "no object 'box'"),
        (
            "expect: [{joint: a, quantity: deflection, measure: x, value: 1, variant: soft}]",
            3,
            "expect.0.variant",
            "no variant 'soft'",
        ),
        ("manager: nothing.yaml", 3, "manager", "there is no manager YAML"),
        ("manager: arm.urdf", None, None, "joints_name"),
        ("variants: {a/b: {}}", 3, "variants.a/b", "name of a folder"),
        ("variants: {a: 3}", 3, "variants.a", "mapping"),
        ("variants:\n  a:\n    seed: x", 5, "seed", "whole number"),
        (
            "references: {a: {b: {playback: {file: no.csv, column: q}}}}",
            3,
            "references.a.b.playback.file",
            "there is no recording",
        ),
        ("? [a, b]\n: 1", 3, None, "a key must be plain text"),
        ("seed: !!python/object:os.system 1", 3, None, "not supported"),
        ("\tseed: 1", 3, None, "not valid YAML"),
        ("seed: *nothing", 3, None, "undefined alias"),
        ("---\nrobot: b", None, None, "not valid YAML"),
    ],
)
def test_faults_have_file_line_key_and_the_right_choice(load, tmp_path, text, line, key, message):
    problems = faults(load, BASE + text + "\n")
    assert any(
        message in str(problem) and (line is None or problem.line == line) and (key is None or problem.key == key)
        for problem in problems
    ), problems
    assert all(problem.file is not None and problem.file.parent == tmp_path for problem in problems)
    assert len(problems) <= 2


@pytest.mark.parametrize("text", ["", "[1, 2]", "just text", "null"])
def test_what_is_no_mapping_is_no_scenario(load, text):
    assert "is not a scenario" in str(faults(load, text)[0])


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(tmp_path / "no.yaml")
    with pytest.raises(ScenarioError, match="cannot be read: Is a directory"):
        load_scenario(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ScenarioError, match="UTF-8"):
        load_scenario(tmp_path / "binary.yaml")
    (tmp_path / "large.yaml").write_bytes(b"#" * 3_000_000)
    with pytest.raises(ScenarioError, match="limit of 2000000 bytes"):
        load_scenario(tmp_path / "large.yaml")


def test_bombs_and_depth_are_refused():
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 9)
    )
    with pytest.raises(InputError, match="aliases"):
        parse_yaml(bomb)
    with pytest.raises(InputError, match="deep"):
        parse_yaml("[" * 10_000)
    with pytest.raises(InputError, match="deep"):
        parse_yaml("a: &a [*a]")


@pytest.mark.parametrize("text", ['{"a\\ud800": 1}', '{"a": {"b": ["x\\udfff"]}}', '{"\\ud83d": {"c": 1}}'])
def test_half_a_character_is_no_text(text):
    with pytest.raises(InputError, match=r"\\ud\w{3} in line 1 is half a character"):
        parse_yaml(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3), ("1E5", 1e5), ("-1", -1), (".5", 0.5), ("5.", 5.0), ("+3", 3), ("0x1F", "0x1F"), (".inf", float("inf")),
        ("on", "on"), ("yes", "yes"), ("No", "No"), ("12:30:00", "12:30:00"), ("1_000", "1_000"), ("010", 10),
        ("true", True), ("False", False), ("~", None), ("", None), ("2024-01-01", "2024-01-01"), ("e5", "e5"),
    ],
)  # fmt: skip
def test_plain_scalars_are_those_of_yaml_1_2(text, value):
    found = plain_scalar(text)
    assert found == value
    assert type(found) is type(value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_that_python_writes_is_read_back(value):
    assert plain_scalar(repr(value)) == value


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused_with_our_error(text):
    with contextlib.suppress(InputError):
        parse_yaml(text).plain()


@pytest.mark.parametrize(("duration", "step"), [(0.3, 0.1), (20.0, 1e-3), (0.7, 0.007), (3.0, 0.003), (10.0, 1 / 3000)])
def test_whole_numbers_of_steps_survive_rounding(load, duration, step):
    (scenario,) = load(f"robot: arm.urdf\nduration: {duration!r}\nstep: {step!r}\n")
    assert round(scenario.duration / scenario.step) == round(duration / step)


def test_manager_of_the_toolbox(load, tmp_path):
    (tmp_path / "m.yaml").write_text("/**:\n  ros__parameters:\n    joints_name: [a]\n    T_sample: 0.01\n")
    (scenario,) = load(BASE + "manager: m.yaml\n")
    assert scenario.joint_order == ("a",)
    assert scenario.namespace is None
    (tmp_path / "m.yaml").write_text("joints_name: [a, a]\n")
    assert "twice" in str(faults(load, BASE + "manager: m.yaml\n")[0])


def test_real_manager_files_of_the_toolbox(load, shared):
    folder = shared / "robots" / "toolbox"
    for name, joint in (("advanced_config.yaml", "joint1"), ("compliant_config.yaml", "joint")):
        (scenario,) = load(BASE + f"manager: {folder / name}\n")
        assert (scenario.joint_order, scenario.namespace) == ((joint,), "template_robot")


_JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["*", "step", "locked", "inf", "box"]),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=5), inner, max_size=3)
        | st.fixed_dictionaries({"step": st.fixed_dictionaries({"to": inner})})
        | st.fixed_dictionaries({"shape": inner, "size": inner})
        | st.fixed_dictionaries({"sum": inner})
        | st.fixed_dictionaries({"a": inner})
    ),
    max_leaves=12,
)


@given(st.dictionaries(st.sampled_from([key.name for key in KEYS if key.name != "robot"]), _JSON, max_size=4))
def test_any_data_is_a_scenario_or_a_scenario_error(data):
    with contextlib.suppress(ScenarioError):
        scenario_from_data({"duration": 1, **data}, robot=__file__)


@given(_JSON)
def test_any_variant_is_merged_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    scenario = {"robot": __file__, "duration": 1, "references": {"a": {"b": {"step": {"to": 1}}}}}
    path.write_text(json.dumps({**scenario, "variants": {"x": data, "y": {"references": data}, "z": {"world": data}}}))
    with contextlib.suppress(ScenarioError):
        load_scenario(path, overrides=["references.a.b.step.at=1"])


def test_the_start_may_be_states_or_the_equilibrium(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot/>")
    states = {"a": 0.3, "b": {"velocity": -1, "motor_positions": [0.6, 0.4], "motor_velocities": [0, 1]}, "*": 0.1}
    given = make_scenario(tmp_path / "arm.urdf", duration=1.0, initial=states)
    assert given.initial_positions == {"a": 0.3, "*": 0.1}
    assert given.initial_velocities == {"b": -1.0}
    assert given.initial_motor_positions == {"b": (0.6, 0.4)}
    assert given.initial_motor_velocities == {"b": (0.0, 1.0)}
    assert not given.initial_equilibrium
    resting = make_scenario(tmp_path / "arm.urdf", duration=1.0, initial="equilibrium")
    assert resting.initial_equilibrium
    assert resting.initial_positions == {}
    for wrong in ({"a": {"speed": 1}}, {"a": {"motor_positions": []}}, {"a": "fast"}):
        with pytest.raises(ScenarioError):
            make_scenario(tmp_path / "arm.urdf", duration=1.0, initial=wrong)


@pytest.mark.parametrize(
    "text",
    [
        "world: {objects: {'*': {shape: sphere, size: 1}}}",
        "parameters: {a: {'*': 1}}",
        "reference_ranges: {a: {'*': [0, 1]}}",
        "ilc: {trajectory: {a: 1}, tolerance: 1, joint_gains: {'*': 0.1}}",
        "expect: [{joint: a, quantity: link_position, measure: final, value: 0, options: {'*': 1}}]",
    ],
)
def test_a_star_stands_for_joints_only(load, text):
    """Tables by joint take `*` for all; tables of other names would keep it as a name that nobody looks up."""
    assert any("'*'" in str(problem) or problem.key.endswith("*") for problem in faults(load, BASE + text + "\n"))


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\nb: [1, 2\n",
        "a: 'x\n",
        "a: *b\n",
        'a: "\\ud800"\n',
        "a: 1\n\tb: 2\n",
        "a: 1\nb:\n  - {x: 1.5, y: on}\n  - |\n    text\na: 2\n",
    ],
)
def test_a_document_reads_the_same_with_and_without_libyaml(text, monkeypatch):
    def reading():
        faults = []
        try:
            node = parse_yaml(text, faults=faults)
        except InputError as error:
            return str(error)
        return node.plain(), node.key_lines, faults

    first = reading()
    monkeypatch.setattr("yaml.__with_libyaml__", False)
    assert reading() == first


def test_file_names_that_are_not_utf_8_are_refused(tmp_path):
    path = tmp_path / os.fsdecode(b"n\xe9.yaml")
    try:
        path.write_text("robot: arm.urdf\nduration: 1\n")
    except OSError:
        pytest.skip("this file system has no such names")
    with pytest.raises(ScenarioError, match=r"must be UTF-8.* Rename it"):
        load_scenario(path)


def test_each_actuator_that_is_not_here_is_named_with_its_joints():
    kinds = {"a": "torn", "b": "sea", "c": "lost", "d": "rigid", "e": "torn"}
    joints = [JointInfo(name=name, actuator=kind, mode=6) for name, kind in kinds.items()]
    said = unknown_actuators(joints, ["plugins/lost.py", "arm.urdf"])
    told = [one.message.partition(" is not known here")[0] for one in said]
    assert told == ["the actuator 'torn' of a, e", "the actuator 'lost' of c"]
    assert {one.hint for one in said} == {"The run used lost.py: name your copy with --plugin"}
