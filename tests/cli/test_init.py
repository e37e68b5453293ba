"""`asrsim init`: starter scenarios load, fit their robot and run."""

import json
import re

import pytest
from typer.testing import CliRunner

import asrsim
from asrsim.cli.app import app
from asrsim.errors import OutputError, RobotError, ScenarioError
from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from asrsim.scenario import load_scenario
from asrsim.starter.robot import SCHEMA_FILE, write_starter
from support.examined import check_against_robot
from support.paths import ROOT

URDF = """<robot name="{name}">
  <link name="world"/>
  {joints}
</robot>"""
JOINT = """
  <link name="{name}_link"><inertial><mass value="0.2"/><origin xyz="0.04 0 0"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{name}" type="{kind}"><parent link="world"/><child link="{name}_link"/><axis xyz="0 1 0"/>
    <limit lower="{lower}" upper="{upper}" effort="100" velocity="100"/><dynamics damping="0.02"/></joint>
  <gazebo><plugin name="{name}" filename="lib{actuator}_plugin.so"><joint>{name}</joint>
    <operation_mode>{mode}</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state>
    <sub_ext_tau>true</sub_ext_tau></plugin></gazebo>"""


def write_robot(folder, *joints):
    texts = [
        JOINT.format(**{"kind": "revolute", "lower": -2, "upper": 2, "actuator": "qbmove", "mode": 6, **joint})
        for joint in joints
    ]
    path = folder / "arm.urdf"
    path.write_text(URDF.format(name="arm", joints="".join(texts)))
    return path


@pytest.mark.parametrize("mode", range(7))
def test_starters_of_every_actuator_and_mode_fit_their_robot(tmp_path, mode):
    names = ("sea", "qbmove", "bavs", "awas_ii")
    robot = write_robot(tmp_path, *({"name": f"j_{name}", "actuator": name} for name in names))
    out = tmp_path / "scenarios" / "start.yaml"
    write_starter(robot, out, mode=mode)
    scenarios = load_scenario(out)
    assert [scenario.variant for scenario in scenarios] == (["soft", "stiff"] if mode in (2, 3, 5, 6) else ["default"])
    for scenario in scenarios:
        assert check_against_robot(scenario, load_robot(scenario.robot)) == ([], [])


@pytest.mark.parametrize(
    ("name", "actuator"), [("dof5_arm", None), ("dof2_vertical", None), ("plain_arm", "qbmove"), ("plain_arm", "awas_ii")]
)
def test_check_has_no_warning_for_starter_variants(tmp_path, name, actuator):
    """With soft springs, the five-joint arm would sag by 0.36 rad under its own weight."""
    robot = ROOT / "examples" / "urdf" / f"{name}.urdf"
    write_starter(robot, tmp_path / "start.yaml", actuators={"*": actuator} if actuator else None)
    for scenario in load_scenario(tmp_path / "start.yaml"):
        errors, warnings = check_against_robot(scenario, load_robot(robot))
        assert not errors
        assert not [str(problem) for problem in warnings if problem.file == scenario.path]


@pytest.mark.parametrize(("name", "rests"), [("plain_arm", True), ("dof2_horizontal", False)])
def test_only_an_arm_that_sags_starts_at_its_equilibrium(tmp_path, name, rests):
    write_starter(ROOT / "examples" / "urdf" / f"{name}.urdf", tmp_path / "s.yaml", actuators={"*": "qbmove"})
    assert ("initial: equilibrium" in (tmp_path / "s.yaml").read_text()) == rests


def test_comments_of_a_starter_name_the_actuator_the_mode_and_the_units(tmp_path):
    elbow, slide = {"name": "elbow", "mode": 3}, {"name": "slide", "kind": "prismatic", "actuator": "sea", "mode": 2}
    write_starter(write_robot(tmp_path, elbow, slide), tmp_path / "s.yaml")
    text = (tmp_path / "s.yaml").read_text()
    mode = "mode 3 (SpringEqPres: ideal motors stand at the positions from the reference map)"
    assert f"  elbow:  # qbMove Advanced (agonistic-antagonistic VSA), {mode}\n    equilibrium_position:  # rad\n" in text
    mode = "mode 2 (SpringRefs: ideal motors stand at the references)"
    assert f"  slide:  # Series elastic actuator, {mode}\n    reference_1:  # m\n" in text


def test_mode_is_that_of_mounted_actuators_and_of_others(tmp_path):
    robot = write_robot(tmp_path, {"name": "driven"}, {"name": "bare"})
    head, _, tail = robot.read_text().rpartition("<gazebo>")
    robot.write_text(head + tail.partition("</gazebo>")[2])
    write_starter(robot, tmp_path / "s.yaml", mode=5, actuators={"bare": "sea"})
    for scenario in load_scenario(tmp_path / "s.yaml"):
        assert check_against_robot(scenario, load_robot(robot)) == ([], [])
        assert all("reference_1" in references for references in scenario.references.values())


def test_a_robot_without_a_moving_joint_gets_no_starter(tmp_path):
    robot = write_robot(tmp_path, {"name": "weld", "kind": "fixed"})
    robot.write_text(re.sub("<gazebo>.*</gazebo>", "", robot.read_text(), flags=re.DOTALL))
    assert [problem.code for problem in warnings_of(load_robot(robot))] == []
    with pytest.raises(RobotError, match="no moving joint"):
        write_starter(robot, tmp_path / "start.yaml", actuators={"*": "qbmove"})
    assert not (tmp_path / "start.yaml").exists()


ARM_WITH_FINGER = """
  <link name="hip_link"><inertial><origin xyz="0.4 0 0"/><mass value="10"/><inertia ixx="0.5" iyy="0.5" izz="0.5"/>
  </inertial></link>
  <joint name="hip" type="revolute"><parent link="world"/><child link="hip_link"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="500" velocity="5"/></joint>
  <link name="tip"><inertial><mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}"/></inertial></link>
  <joint name="finger" type="revolute"><parent link="hip_link"/><child link="tip"/><axis xyz="0 1 0"/><origin xyz="0.5 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="5"/></joint>"""


@pytest.mark.parametrize("actuator", ["sea", "qbmove", "bavs", "awas_ii"])
@pytest.mark.parametrize("inertia", ["1.1e-9", "3e-13"])
def test_springs_of_light_fingers_are_soft_enough_for_a_run(tmp_path, actuator, inertia):
    """The default spring of 10 N m/rad on 1.1e-9 kg m^2 (15 kHz) would need 477 substeps."""
    robot, out = tmp_path / "arm.urdf", tmp_path / "s.yaml"
    robot.write_text(URDF.format(name="arm", joints=ARM_WITH_FINGER.format(mass=2e-6, inertia=inertia)))
    write_starter(robot, out, actuators={"*": actuator})
    for scenario in load_scenario(out, overrides=["duration=0.05"]):
        assert asrsim.run(scenario).status == "complete"


def test_springs_are_soft_enough_where_the_rotor_moves_to_the_motor(tmp_path):
    """A rotor of 4e-4 kg m^2 at a finger of 1e-9 kg m^2: behind a spring it no longer moves with the finger."""
    robot, out = tmp_path / "arm.urdf", tmp_path / "s.yaml"
    rotor = ARM_WITH_FINGER.replace('effort="1" velocity="5"/>', 'effort="1" velocity="5"/><dynamics armature="4e-4"/>')
    robot.write_text(URDF.format(name="arm", joints=rotor.format(mass=2e-6, inertia="1.1e-9")))
    write_starter(robot, out, actuators={"*": "qbmove"})
    for scenario in load_scenario(out, overrides=["duration=0.2"]):
        assert asrsim.run(scenario).status == "complete"


def test_a_joint_whose_limits_are_equal_gets_a_starter_that_runs(tmp_path):
    """As exporters write them: lower = upper = 0."""
    robot = write_robot(tmp_path, {"name": "knee", "lower": 0, "upper": 0})
    robot.write_text(re.sub("<gazebo>.*</gazebo>", "", robot.read_text(), flags=re.DOTALL))
    _, notes = write_starter(robot, tmp_path / "s.yaml", actuators={"*": "sea"})
    assert "locked-joint" in [note.code for note in notes]
    result = asrsim.run(tmp_path / "s.yaml", overrides=["duration=0.2"])
    assert abs(result["knee"].link_position).max() == 0.0


@pytest.mark.parametrize(("lower", "upper", "inside"), [("20", "inf", 20.3), ("-inf", "-0.5", -0.8), ("0.5", "0.5", 0.5)])
def test_a_starter_begins_within_limits_on_one_side(tmp_path, lower, upper, inside):
    robot = write_robot(tmp_path, {"name": "knee", "lower": lower, "upper": upper})
    write_starter(robot, tmp_path / "s.yaml")
    assert all(scenario.initial_positions["knee"] == inside for scenario in load_scenario(tmp_path / "s.yaml"))


@pytest.mark.parametrize(("damping", "said"), [("0", "without end"), ("1e-5", "for minutes"), ("1e-8", "for hours")])
def test_a_long_oscillation_is_told_in_words(tmp_path, damping, said):
    robot = write_robot(tmp_path, {"name": "knee"})
    robot.write_text(robot.read_text().replace('damping="0.02"', f'damping="{damping}"'))
    _, notes = write_starter(robot, tmp_path / "s.yaml")
    assert f"would oscillate {said} after" in " ".join(note.message for note in notes)


def test_a_spring_that_overflows_at_rest_is_an_error(tmp_path):
    """At the typical preset, sinh(a 0.2) overflows for a = 5000, but not for a = 2000."""
    robot = write_robot(tmp_path, {"name": "j"})
    plain = robot.read_text()
    robot.write_text(plain.replace("<pub_eltau>", "<spring_a1>2000</spring_a1><pub_eltau>"))
    write_starter(robot, tmp_path / "s.yaml")
    robot.write_text(plain.replace("<pub_eltau>", "<spring_a1>5000</spring_a1><pub_eltau>"))
    with pytest.raises(ScenarioError, match=r"arm\.urdf:.*cannot be computed"):
        write_starter(robot, tmp_path / "t.yaml")


@pytest.mark.parametrize("mode", [5, 6])
def test_stiff_variant_leaves_motor_torque_for_the_motion(tmp_path, mode):
    """At a preset of 0.6 rad, the springs of AlterEgo's shoulder would need far more torque than the motors have."""
    robot = write_robot(tmp_path, {"name": "shoulder", "mode": mode})
    law = "<spring_a1>22.9</spring_a1><spring_k1>0.02</spring_k1><spring_a2>22.9</spring_a2><spring_k2>0.02</spring_k2>"
    robot.write_text(robot.read_text().replace("</plugin>", f"{law}</plugin>"))
    write_starter(robot, tmp_path / "s.yaml")
    result = asrsim.run(tmp_path / "s.yaml", variant="stiff")
    assert abs(result["shoulder"].motor_1_torque[-1]) < 0.3 * 6.0
    assert result["shoulder"].link_position[-1] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("actuator", ["qbmove", "bavs", "awas_ii"])
def test_the_stiff_variant_is_stiffer_than_the_soft_one(tmp_path, actuator):
    """In mode 3 the motors are where the references put them."""
    robot = write_robot(tmp_path, {"name": "a", "actuator": actuator, "mode": 3})
    write_starter(robot, tmp_path / "s.yaml")
    found = asrsim.run_variants(tmp_path / "s.yaml", overrides=["duration=0.02"])
    assert list(found) == ["soft", "stiff"]
    soft, stiff = (one["a"].stiffness[-1] for one in found.values())
    assert stiff > 1.05 * soft > 0.0


def test_units_of_a_prismatic_joint_are_metres(tmp_path):
    robot = write_robot(tmp_path, {"name": "rail", "kind": "prismatic"})
    write_starter(robot, tmp_path / "s.yaml")
    text = (tmp_path / "s.yaml").read_text()
    assert re.search(r"equilibrium_position:  # m\n *step: .*to: 0.05", text)
    assert re.search(r"stiffness_preset: .*# m$", text, re.M)


def test_step_stays_within_the_limits(tmp_path):
    robot = write_robot(
        tmp_path,
        {"name": "up", "lower": 0.5, "upper": 2},
        {"name": "down", "lower": -2, "upper": 0.1},
        {"name": "narrow", "lower": 0, "upper": 0.1},
        {"name": "below", "lower": -2, "upper": -0.5},
        {"name": "centred", "lower": -0.2, "upper": 0.2},
    )
    write_starter(robot, tmp_path / "s.yaml")
    (scenario, _) = load_scenario(tmp_path / "s.yaml")
    assert scenario.initial_positions == {"up": 0.8, "down": -0.2, "narrow": 0.025, "below": -0.8}
    steps = {joint: references["equilibrium_position"] for joint, references in scenario.references.items()}
    assert [(steps[j].before, steps[j].after) for j in ("up", "down", "narrow", "below", "centred")] == [
        (0.8, 1.1),
        (-0.2, -0.5),
        (0.025, 0.055),
        (-0.8, -1.1),
        (0.0, 0.08),
    ]
    # Without damping, a joint overshoots to twice its step.
    for joint in load_robot(robot).joints:
        swing = 2 * steps[joint.name].after - steps[joint.name].before
        assert joint.lower < swing < joint.upper


def test_names_that_yaml_would_misread_are_quoted(tmp_path):
    robot = write_robot(tmp_path, {"name": "1"}, {"name": "true"}, {"name": "joint: 2"})
    write_starter(robot, tmp_path / "s.yaml")
    assert set(load_scenario(tmp_path / "s.yaml")[0].references) == {"1", "true", "joint: 2"}


def test_foreign_schema_files_are_not_replaced(tmp_path):
    robot = write_robot(tmp_path, {"name": "j"})
    (tmp_path / SCHEMA_FILE).write_text("{}")
    with pytest.raises(OutputError, match="not written by asrsim"):
        write_starter(robot, tmp_path / "s.yaml")
    assert (tmp_path / SCHEMA_FILE).read_text() == "{}"


def test_xacro_arguments_are_kept(tmp_path):
    robot = write_robot(tmp_path, {"name": "j"})
    write_starter(robot, tmp_path / "s.yaml", arguments={"side": "left", "length": "2"}, packages={"d": tmp_path / "meshes"})
    scenario = load_scenario(tmp_path / "s.yaml")[0]
    assert scenario.xacro_arguments == {"side": "left", "length": "2"}
    assert scenario.package_paths["d"].resolve() == tmp_path / "meshes"


@pytest.mark.parametrize(
    "name",
    [
        "toolbox/nmmi_qbmove_template",
        "toolbox/nmmi_template_description",
        "alterego/alterego_v3_fixedbase-true_fixedhands-true",
    ],
)
def test_starters_of_real_robots_fit(tmp_path, shared, name):
    file = shared / "robots" / f"{name}.urdf"
    write_starter(file, tmp_path / "s.yaml")
    robot = load_robot(file)
    for scenario in load_scenario(tmp_path / "s.yaml"):
        assert check_against_robot(scenario, robot) == ([], [])
        assert set(scenario.references) == {block.joint for block in robot.actuators}


def test_json_names_files_and_findings(tmp_path):
    arm = write_robot(tmp_path, {"name": "joint_1"})
    made = CliRunner().invoke(app, ["init", str(arm), "--mode", "5", "--out", str(tmp_path / "arm.yaml"), "--json"])
    assert made.exit_code == 0
    said = json.loads(made.output)
    assert (said["ok"], said["files"][0]) == (True, str(tmp_path / "arm.yaml"))
    assert isinstance(said["findings"], list)
    assert load_scenario(tmp_path / "arm.yaml")[0].modes == {"*": 5}
