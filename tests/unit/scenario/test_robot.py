"""A scenario laid upon its robot: what changes, and what does not fit."""

from pathlib import Path

import pytest

from asrsim.errors import ScenarioError
from asrsim.robot import Joint, Link, Robot, load_robot
from asrsim.robot.values import block_for
from asrsim.scenario import apply_to_robot, load_scenario, make_scenario
from asrsim.scenario.data import Scenario
from asrsim.signals import Constant
from support.examined import check_against_robot, checked_robot
from support.paths import ROOT


def arm(**modes):
    """A robot of three actuated joints and a free one."""
    joints = [
        Joint(name=name, kind="revolute", parent="base", child=f"{name}_link", lower=-1.0, upper=1.0)
        for name in ("vsa", "sea", "awas", "free")
    ]
    actuators = {"vsa": ("qbmove", 6), "sea": ("sea", 6), "awas": ("awas_ii", 3)}
    return Robot(
        name="arm",
        path=Path("arm.urdf"),
        text="",
        links=(
            Link(name="base", mass=None, inertia=None),
            *(Link(name=joint.child, mass=1.0, inertia=(1, 0, 0, 1, 0, 1)) for joint in joints),
        ),
        joints=tuple(joints),
        actuators=tuple(block_for(joint, name, modes.get(joint, mode), "old") for joint, (name, mode) in actuators.items()),
    )


@pytest.fixture
def load(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")

    def read(text):
        (tmp_path / "s.yaml").write_text("robot: arm.urdf\nduration: 2\n" + text)
        return load_scenario(tmp_path / "s.yaml")[0]

    return read


GOOD = """references:
  vsa: {equilibrium_position: {step: {to: 0.5}}, stiffness_preset: 0.2}
  sea: {equilibrium_position: 0.1}
  awas: {equilibrium_position: 0.1, stiffness_preset: 0.01}
"""


def test_a_fitting_scenario_has_no_problems(load):
    assert check_against_robot(load(GOOD), arm()) == ([], [])


@pytest.mark.parametrize(
    ("text", "line", "key", "message"),
    [
        ("initial: {vssa: 0}", 7, "initial.vssa", "Did you mean 'vsa'?"),
        ("initial: {vsa: 2}", 7, "initial.vsa", "-1 to 1"),
        ("initial: {'*': 2}", 7, "initial.*", "outside the limits"),
        ("initial: {vsa: {motor_positions: [0.1]}}", 7, "initial.vsa.motor_positions", "has 1 value, but 'vsa' has 2 motors"),
        ("initial: {'*': {motor_velocities: [0, 0, 0]}}", 7, "initial.*.motor_velocities", "'vsa' has 2 motors"),
        ("initial: {free: {motor_positions: [0.1]}}", 7, "initial.free.motor_positions", "'free' has 0 motors"),
        ("initial: {vsa: {velocity: 1e200}}", 7, "initial.vsa.velocity", "larger than 1e+12"),
        ("base: {position: [0, -1e300, 0]}", 7, "base.position.1", "larger than 1e+12"),
        ("modes: {free: 6}", 7, "modes.free", "vsa, sea, awas"),
        ("modes: {vsa: 5}", 4, "references.vsa.equilibrium_position", "choose from reference_1, reference_2"),
        ("parameters: {vsa: {spring_kk1: 1}}", 7, "parameters.vsa.spring_kk1", "spring_k1"),
        ("parameters:\n  vsa:\n    mot_1_tauMax: -1", 9, "parameters.vsa.mot_1_tauMax", "at least 0"),
        ("parameters: {sea: {spring_k: 1, spring_stiffness: 2}}", 7, "parameters.sea.spring_stiffness", "same parameter"),
        ("parameters: {sea: {spring_a1: 1}}", 7, "parameters.sea.spring_a1", "no such parameter"),
        ("external_torques: {no: 1}", 7, "external_torques.no", "vsa, sea, awas, free"),
        ("wrenches: [{link: tip, force: [1, 0, 0]}]", 7, "wrenches.0.link", "vsa_link"),
        ("imperfections: {commands: {free: {delay: 1}}}", 7, "imperfections.commands.free", "no actuated joint"),
        ("imperfections: {sensors: {vsa: {delay: 2.5e11}}}", 7, "imperfections.sensors.vsa.delay", "longer than 1000000 steps"),
        ("imperfections: {commands: {vsa: {delay: 1e4}}}", 7, "imperfections.commands.vsa.delay", "longer than 1000000 steps"),
        ("desired: {x: 1}", 7, "desired.x", "no moving joint"),
        ("task: {link: tip, poses: [{time: 1, position: [0, 0, 0]}]}", 7, "task.link", "no link"),
        ("task: {link: vsa_link, joints: [x, x], poses: [{time: 1, position: [0, 0, 0]}]}", 7, "task.joints", "no actuated"),
        (
            "task: {link: vsa_link, poses: [{time: 1, position: [0, 0, 0]}, {time: 2.001, position: [0, 0, 0]}]}",
            7,
            "task.poses.1.time",
            "later than the end of the run at 2 s",
        ),
        (
            "task: {link: vsa_link, poses: [{time: 1, position: [0, 0, 0]}]}\nmodes: {vsa: 4}",
            8,
            "modes.vsa",
            "which mode 4 does not take (got 4); choose from 1, 2, 3, 5, 6",
        ),
        ("ilc: {trajectory: {x: 1}, tolerance: 1}", 7, "ilc.trajectory.x", "no actuated joint"),
        ("expect:\n- {joint: x, quantity: deflection, measure: maximum, value: 1}", 8, "expect.0.joint", "no moving joint"),
    ],
)
def test_entries_for_unknown_parts_are_errors_with_lines(load, text, line, key, message):
    errors, _ = check_against_robot(load(GOOD + text + "\n"), arm())
    assert any((e.line, e.key) == (line, key) and message in str(e) and e.file is not None for e in errors), errors
    assert "*" in key or len({error.key for error in errors}) == len(errors), "one error for an entry"


@pytest.mark.parametrize(
    ("references", "message"),
    [
        ("{x: {link_torque: 1}}", "no actuated joint 'x'"),
        ("{free: {link_torque: 1}}", "no actuated joint 'free'"),
        ("{vsa: {equilibrum_position: 1}}", "mode 6 (PIDEqPres) has no such reference"),
        ("{'*': {link_torque: 1}}", "the mode of every joint has no such reference"),
        ("{awas: {stiffness_preset: 0.05}}", "reaches the lever length L = 0.05 m at 0 s"),
        ("{awas: {stiffness_preset: {step: {at: 0.12345, to: 0.06}}}}", "at 0.12345 s"),
        ("{'*': {stiffness_preset: 0.2}}", "sigma of 'awas'"),
        ("{vsa: {equilibrium_position: {step: {to: -1e300}}}}", "is larger than 1e+12, too large for a robot"),
    ],
)
def test_references_that_cannot_be(load, references, message):
    errors, _ = check_against_robot(load(f"references: {references}\n"), arm())
    assert any(message in str(error) and error.line == 3 for error in errors), errors


@pytest.mark.parametrize("keys", ["ilc: {trajectory: {vsa: 1e8}, tolerance: 1}", "desired: {vsa: {step: {to: -1e300}}}"])
def test_a_wanted_position_beyond_all_joints_is_an_error(load, keys):
    errors, _ = check_against_robot(load(GOOD + keys + "\n"), arm())
    assert any("is larger than 1e+06, too far for a joint" in str(error) and error.line == 7 for error in errors), errors


def test_references_that_are_missing_or_do_nothing_are_warnings(load):
    text = "references: {vsa: {equilibrium_position: {step: {to: 1.5}}}, sea: {equilibrium_position: 0, stiffness_preset: 1}}\n"
    errors, warnings = check_against_robot(load(text), arm())
    assert errors == []
    assert [(problem.code, problem.key) for problem in warnings] == [
        ("reference-limits", "references.vsa.equilibrium_position"),
        ("missing-reference", "references.vsa"),
        ("unused-reference", "references.sea.stiffness_preset"),
        ("missing-reference", "references.awas"),
        ("missing-reference", "references.awas"),
    ]


def test_a_longer_lever_allows_a_larger_sigma(load):
    text = "parameters: {awas: {spring_L: 0.1}}\nreferences: {awas: {stiffness_preset: 0.06, equilibrium_position: 0}}\n"
    assert check_against_robot(load(text), arm())[0] == []


def test_parameters_and_namespace_are_replaced(load, tmp_path):
    (tmp_path / "m.yaml").write_text("namespace: lab\njoints_name: [sea, vsa]\n")
    scenario = load('manager: m.yaml\nparameters: {"*": {spring_k1: 0.02}, vsa: {max_def: 0.5}, sea: {spring_k: 200}}\n')
    assert scenario.joint_order == ("sea", "vsa")
    robot = apply_to_robot(scenario, arm())
    vsa, sea, awas = robot.actuators
    assert vsa.values()["spring_k_1"] == 0.02
    assert (vsa.parameters["max_deflection"].value, vsa.parameters["max_deflection"].origin) == (0.5, "scenario")
    assert vsa.parameters["spring_a_1"].origin == "default"
    assert sea.values()["spring_stiffness"] == 200.0
    assert {b.namespace for b in (vsa, sea, awas)} == {"lab"}
    assert check_against_robot(scenario, arm())[0] == []


def test_a_joints_own_references_go_before_those_for_all():
    for_all, own = Constant(value=0.1), Constant(value=0.2)
    references = {"*": {"equilibrium_position": for_all, "stiffness_preset": for_all}, "vsa": {"stiffness_preset": own}}
    scenario = Scenario(name="s", robot=Path("arm.urdf"), references=references)
    assert scenario.references_of("vsa") == {"equilibrium_position": for_all, "stiffness_preset": own}
    assert scenario.references_of("sea") == references["*"]


def test_a_checked_robot_collects_all_misfits_in_one_error():
    robot = arm()
    fits = Scenario(name="s", robot=robot.path, modes={"vsa": 3}, references={"vsa": {"stiffness_preset": Constant(value=0.1)}})
    found, warnings = checked_robot(fits, robot)
    assert found == robot
    assert {*check_against_robot(fits, robot)[1]} <= {*warnings}
    start = {"vsa": 2.0, "nobody": 0.0}
    wrong = Scenario(name="s", robot=robot.path, initial_positions=start, resolved={"initial": start})
    with pytest.raises(ScenarioError) as error:
        checked_robot(wrong, robot)
    assert {problem.code for problem in error.value.problems} == {"initial-limits", "unknown-joint"}


STARTS = [({}, True), ({"arm": -1.5}, False), ({"*": -1.5}, False)]


@pytest.mark.parametrize(("initial", "told"), STARTS)
def test_a_start_at_0_beyond_the_limits_is_told_of(tmp_path, initial, told):
    text = (
        '<robot name="r"><link name="l"/><joint name="arm" type="revolute"><parent link="l"/><child link="m"/>'
        '<limit lower="-2" upper="-1" effort="9" velocity="9"/></joint><link name="m"><inertial><mass value="1"/>'
        '<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    (tmp_path / "r.urdf").write_text(text, encoding="utf-8")
    keys = {"initial": initial} if initial else {}
    warnings = checked_robot(make_scenario(tmp_path / "r.urdf", duration=1.0, **keys))[1]
    assert any(problem.code == "default-start" for problem in warnings) == told


TWO_JOINTS = ROOT / "examples" / "urdf" / "dof2_horizontal.urdf"


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"references": {"*": {"stiffness_preset": 0.1}, "joint_1": {"stiffness_preset": 0.2}}}, False),
        ({"references": {name: {"stiffness_preset": 0.1} for name in ("*", "joint_1", "joint_2")}}, True),
        ({"parameters": {name: {"max_deflection": 0.7} for name in ("*", "joint_1", "joint_2")}}, True),
        (
            {"parameters": {"*": {"max_deflection": 0.7}, "joint_1": {"spring_k_1": 0.03}, "joint_2": {"spring_k_1": 0.03}}},
            False,
        ),
        ({"initial": {"*": 0.1, "joint_1": 0.2, "joint_2": 0.3}}, True),
    ],
)
def test_an_entry_for_all_without_effect_gets_a_warning(keys, told):
    """`--set references.*...` beside entries of each joint would otherwise change nothing, without a word."""
    warnings = checked_robot(make_scenario(TWO_JOINTS, duration=1.0, **keys))[1]
    assert any(problem.code == "unused-entry" for problem in warnings) == told


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="the system has no devices")
def test_a_device_is_no_file_to_compare_with(load):
    claim = "{joint: vsa, quantity: link_position, measure: rmse, comparison: '<', value: 1, against: /dev/zero}"
    with pytest.raises(ScenarioError, match="there is no recording /dev/zero"):
        load(GOOD + f"expect: [{claim}]\n")


@pytest.mark.parametrize(
    ("given", "modes"),
    [
        ("{type: sea, mode: 5}", [5]),
        ("{type: sea}", [6]),
        ("{elbow: {type: sea, mode: 5}}", [5]),
        ("{'*': {type: sea, mode: 3}}\nvariants: {a: {actuators: {type: sea, mode: 5}}, b: {actuators: {elbow: sea}}}", [5, 6]),
        ("{type: sea, mode: 3}\nvariants: {a: {actuators: {mode: 5, type: sea}}, b: {actuators: sea}}", [5, 6]),
    ],
)
def test_an_actuator_with_its_mode_stands_for_all_joints(tiny, given, modes):
    tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 1\nactuators: {given}\n")
    found = [apply_to_robot(one, load_robot(one.robot)).actuators for one in load_scenario(tiny.scenario)]
    assert [[block.mode for block in blocks] for blocks in found] == [[mode] for mode in modes]
