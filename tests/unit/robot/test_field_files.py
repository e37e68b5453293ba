"""Files as the field writes them: what ROS, Gazebo and Drake read is read with a warning, and means the same."""

import re

import pytest

import asrsim
from asrsim.errors import RobotError
from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from asrsim.robot.mounting import with_rotors
from support.tiny import PENDULUM

SPRING = '<gazebo reference="elbow"><springStiffness value="200"/><springReference value="0.1"/></gazebo></robot>'
COMMENT = "<!-- a -- dash and a long line ------>"
AS_WRITTEN = {
    # what: (text of the pendulum, replacement, code of the warning)
    "blank line before the declaration": ("<?xml", "\n \n<?xml", "mended-xml"),
    "comment before the declaration": ("<?xml", "<!-- made by a tool -->\n<?xml", "mended-xml"),
    "another version of XML": ('version="1.0"', 'version="1"', "mended-xml"),
    "dashes in a comment": ("<axis", f"{COMMENT}<axis", "mended-xml"),
    "dashes in the comment before the declaration": ("<?xml", f"{COMMENT}\n<?xml", "mended-xml"),
    "undeclared name space": ("</robot>", "<drake:collision_filter_group/></robot>", "mended-xml"),
    "undeclared name space of an attribute": ("<limit ", '<limit drake:acceleration="1" ', "mended-xml"),
    "text after the end": ("</robot>", "</robot>\n</robot>", "mended-xml"),
    "default name space": ("<robot ", '<robot xmlns="http://www.ros.org/wiki/urdf" ', "default-xmlns"),
    "undeclared world": ('<link name="world"/>', "", "undeclared-world"),
    "velocity of -1": ('velocity="100"', 'velocity="-1"', "negative-limit"),
    "effort of -1": ('effort="50"', 'effort="-1"', "negative-limit"),
    "collision without size": (
        "</inertial>", '</inertial><collision><geometry><sphere radius="0"/></geometry></collision>', "empty-shape",
    ),
    "collision without height": (
        "</inertial>", '</inertial><collision><geometry><box size="1 1 0"/></geometry></collision>', "empty-shape",
    ),
    "collision scaled to nothing": (
        "</inertial>",
        '</inertial><collision><geometry><mesh filename="a.stl" scale="1 0 1"/></geometry></collision>', "empty-shape",
    ),
    "collision without shape": ("</inertial>", "</inertial><collision><geometry/></collision>", "empty-shape"),
    "collision with another program's word": (
        "</inertial>",
        '</inertial><collision><geometry><sphere radius="0"/><drake:declare_convex/></geometry></collision>',
        "mended-xml empty-shape",
    ),
    "collision with two shapes": (
        "</inertial>",
        '</inertial><collision><geometry><sphere radius="0"/><sphere radius="1"/></geometry></collision>',
        "shape empty-shape repeated-element",
    ),
    "collision scaled by four numbers": (
        "</inertial>",
        '</inertial><collision><geometry><mesh filename="" scale="1 1 1 1"/></geometry></collision>',
        "empty-shape too-many-numbers",
    ),
    "two inertials": ("</inertial>", '</inertial><inertial><mass value="9"/></inertial>', "duplicate-tag"),
    "four angles": ("<axis", '<origin rpy="0 0 0 0"/><axis', "too-many-numbers"),
    "mesh without name": (
        "</inertial>", '</inertial><collision><geometry><mesh filename=""/></geometry></collision>', "empty-shape",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", AS_WRITTEN)
def test_files_of_the_field_mean_what_the_plain_file_means(case, tiny):
    plain = load_robot(tiny.robot)
    old, new, code = AS_WRITTEN[case]
    assert old in PENDULUM
    tiny.robot.write_text(PENDULUM.replace(old, new, 1))
    robot = load_robot(tiny.robot)
    assert {problem.code for problem in robot.findings} == set(code.split())
    assert [joint.name for joint in robot.joints] == [joint.name for joint in plain.joints]
    assert [(link.name, link.mass, link.inertia) for link in sorted(robot.links, key=lambda link: link.name)] == [
        (link.name, link.mass, link.inertia) for link in sorted(plain.links, key=lambda link: link.name)
    ]
    assert robot.actuators[0].values() == plain.actuators[0].values()
    # The text in the log is well-formed and stands alone.
    tiny.robot.write_text(robot.text)
    assert load_robot(tiny.robot).joints[0].stops == robot.joints[0].stops


@pytest.mark.parametrize("case", ["blank line before the declaration", "default name space", "undeclared world"])
def test_runs_of_such_files_are_repeated_from_their_logs(case, tiny):
    from asrsim.runs.rerun import rerun

    old, new, _ = AS_WRITTEN[case]
    tiny.robot.write_text(PENDULUM.replace(old, new, 1))
    asrsim.run(tiny.scenario, out=tiny.folder / "out")
    (log,) = (tiny.folder / "out").rglob("log.mcap")
    assert rerun(log).identical


def test_negative_limits_are_none(tiny):
    tiny.robot.write_text(PENDULUM.replace('effort="50" velocity="100"', 'effort="-1" velocity="-1"'))
    joint = load_robot(tiny.robot).joint("elbow")
    assert (joint.effort, joint.velocity) == (None, None)


def test_crossed_limits_are_none(tiny):
    tiny.robot.write_text(PENDULUM.replace('lower="-', 'lower="9'))
    robot = load_robot(tiny.robot)
    assert "limits-crossed" in {problem.code for problem in robot.findings}
    assert robot.joint("elbow").lower is None is robot.joint("elbow").upper


def test_a_reduction_without_inertia_may_be_a_text(tiny):
    words = '<joint name="elbow"/><actuator name="m"><mechanicalReduction>reduction</mechanicalReduction></actuator>'
    tiny.robot.write_text(PENDULUM.replace("</robot>", f'<transmission name="t">{words}</transmission></robot>'))
    assert load_robot(tiny.robot).joint("elbow").armature == 0.0


def test_a_spring_may_state_its_number_as_an_attribute(tiny):
    tiny.robot.write_text(PENDULUM.replace("</robot>", SPRING))
    joint = load_robot(tiny.robot).joint("elbow")
    assert (joint.spring_stiffness, joint.spring_reference) == (200.0, 0.1)


def test_bytes_that_are_not_utf_8_are_no_obstacle(tiny):
    tiny.robot.write_bytes(PENDULUM.replace("<axis", "<!-- Größe --><axis").encode("latin-1"))
    assert [problem.code for problem in load_robot(tiny.robot).findings] == ["mended-xml"]


@pytest.mark.parametrize("end", ["<link name='a'", "<a></b></robot>", "&bad;</robot>"])
def test_other_faults_of_xml_stay_errors_with_their_line(end, tiny):
    tiny.robot.write_text("\n" + PENDULUM.replace("</robot>", end))
    with pytest.raises(RobotError) as caught:
        load_robot(tiny.robot)
    assert caught.value.problems[0].code == "malformed-xml"


@pytest.mark.parametrize("prolog", ["\n", "<!-- -- -->"])
def test_mended_files_declare_no_entities(prolog, tiny):
    bomb = '<!DOCTYPE robot [<!ENTITY a "aaaa">]>'
    tiny.robot.write_text(prolog + PENDULUM.replace("<robot", f"{bomb}<robot"))
    with pytest.raises(RobotError, match="entities"):
        load_robot(tiny.robot)


GRIPPER = """
<link name="palm"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>
<joint name="wrist" type="revolute"><parent link="arm"/><child link="palm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="left"/><link name="right"/>
<joint name="finger_left" type="{kind}"><parent link="palm"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="{lower}" upper="1" effort="1" velocity="1"/></joint>
<joint name="finger_right" type="{kind}"><parent link="palm"/><child link="right"/><axis xyz="0 1 0"/>
<limit lower="{lower}" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(("kind", "lower"), [("screw", "0"), ("floating", "0"), ("revolute", "zero")])
def test_a_robot_with_an_impossible_gripper_runs_with_locked_joints(kind, lower, tiny, asrsim_command):
    tiny.robot.write_text(PENDULUM.replace("</robot>", GRIPPER.format(kind=kind, lower=lower)))
    with pytest.raises(RobotError):
        load_robot(tiny.robot)
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}locked: [finger_*]\n")
    result = asrsim.run(tiny.scenario, out=tiny.folder / "out")
    assert set(result.joints) == {"elbow", "wrist"}
    (log,) = (tiny.folder / "out").rglob("log.mcap")
    assert asrsim_command("rerun", log).code == 0
    tiny.scenario.write_text(tiny.scenario.read_text().replace("finger_*", "fingr_left"))
    assert "Did you mean 'finger_left'?" in asrsim_command("check", tiny.scenario).out


def test_a_locked_joint_has_no_actuator_and_its_links_keep_their_mass(tiny):
    tiny.robot.write_text(PENDULUM.replace("</robot>", GRIPPER.format(kind="revolute", lower="-1")))
    robot = load_robot(tiny.robot, locked=["elbow"])
    assert [joint.name for joint in robot.moving_joints] == ["wrist"]
    assert not robot.actuators
    assert robot.joint("elbow").child == "arm"


def test_a_joint_that_moves_no_mass_is_fixed_with_a_warning(tiny):
    tiny.robot.write_text(PENDULUM.replace("</robot>", GRIPPER.format(kind="revolute", lower="-1")))
    robot = load_robot(tiny.robot)
    assert [joint.name for joint in robot.moving_joints] == ["elbow", "wrist"]
    told = [problem.key for problem in warnings_of(robot) if problem.code == "massless-joint"]
    assert told == ["finger_left", "finger_right"]


def test_an_actuator_on_a_joint_that_the_file_left_without_mass_is_refused_with_the_reason(tiny, asrsim_command):
    tiny.robot.write_text(PENDULUM.replace("</robot>", GRIPPER.format(kind="revolute", lower="-1")))
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}actuators: {{finger_left: sea}}\n")
    told = asrsim_command("check", tiny.scenario).out
    assert "actuators.finger_left: this joint does not move: no link behind this joint has mass" in " ".join(told.split())


def test_a_driven_joint_that_moves_no_mass_is_an_error(tiny):
    text = PENDULUM.replace("<joint>elbow<", "<joint>finger_left<")
    tiny.robot.write_text(text.replace("</robot>", GRIPPER.format(kind="revolute", lower="-1")))
    with pytest.raises(RobotError, match="finger_left: no link behind this joint"):
        load_robot(tiny.robot)


def test_a_robot_whose_joints_all_lack_mass_is_refused_for_that(tiny):
    """A finger that mimics another one does not count as a joint that moves."""
    text = PENDULUM.replace("</robot>", GRIPPER.format(kind="revolute", lower="-1"))
    text = text.replace("</joint></robot>", '<mimic joint="finger_left"/></joint></robot>')
    tiny.robot.write_text(re.sub("<(inertial|gazebo)>.*?</\\1>", "", text, flags=re.DOTALL))
    with pytest.raises(RobotError, match="wrist: no link behind this joint has mass"):
        load_robot(tiny.robot)


@pytest.mark.parametrize(
    "joint", ["", '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint><link name="b"/>']
)
def test_a_body_without_moving_joints_is_refused_for_that(joint, tmp_path, asrsim_command):
    (tmp_path / "cube.urdf").write_text(f'<robot name="cube"><link name="a"/>{joint}</robot>')
    assert "the robot has no moving joint" in asrsim_command("check", tmp_path / "cube.urdf").out


def test_expressions_of_xacro_in_a_urdf_are_evaluated(tiny):
    tiny.robot.write_text(PENDULUM.replace("<axis", '<origin xyz="${0.05 + 0.02} 0 $(optenv NO_SUCH_VALUE 0.1)"/><axis'))
    assert load_robot(tiny.robot).moving_joints[0].origin == (0.07, 0.0, 0.1)


@pytest.mark.parametrize(("text", "tool"), [("<mujoco model='a'/>", "mjcf_urdf"), ("<sdf version='1.7'/>", "sdf2urdf")])
def test_other_formats_are_told_how_to_convert(text, tool, tmp_path, asrsim_command):
    path = tmp_path / "robot.xml"
    path.write_text(text)
    assert tool in asrsim_command("check", path).out


@pytest.mark.parametrize("space", ["http://www.ros.org/wiki/xacro", "http://ros.org/wiki/xacro"])
def test_elements_of_xacro_that_a_urdf_keeps_have_no_effect(space, tiny):
    """As in ROS, which expands files called .xacro only; a macro that is defined is expanded all the same."""
    kept = PENDULUM.replace("<robot ", f'<robot xmlns:xacro="{space}" ').replace("</robot>", "<xacro:away/></robot>")
    tiny.robot.write_text(kept)
    robot = load_robot(tiny.robot)
    assert [problem.code for problem in robot.findings] == ["xacro-left"]
    assert robot.joint("elbow").damping == 0.2
    tiny.robot.write_text(
        kept.replace(
            "<xacro:away/>",
            '<xacro:property name="x" value="1"/><link name="a${x}"/>'
            '<joint name="b" type="fixed"><parent link="arm"/><child link="a1"/></joint>',
        )
    )
    assert "a1" in [link.name for link in load_robot(tiny.robot).links]


STARTING = (
    '<ros2_control><joint name="elbow"><state_interface name="velocity"><param name="initial_value">2</param>'
    "</state_interface></joint></ros2_control>"
)


def controlled(words, attribute=""):
    """Block of ros2_control about the joint."""
    return f'<ros2_control name="c" type="system"><joint name="elbow" {attribute}>{words}</joint></ros2_control>'


WORDS = {
    # what: (words in <robot>, part of the warning)
    "gravity of no link": ('<gazebo reference="wrist"><turnGravityOff>true</turnGravityOff></gazebo>', "no such link"),
    "gravity as a vector": ('<gazebo reference="arm"><gravity>0 0 -1.6</gravity></gazebo>', "neither true nor false"),
    "pose of the robot": ("<gazebo><pose>0 0 1 1.57 0 0</pose></gazebo>", "turns the robot by rpy [1.57, 0, 0]"),
    "start velocity": (
        STARTING,
        "initial velocity",
    ),
    "masses of a compiler": ('<mujoco><compiler boundmass="0.5" meshdir="m"/></mujoco>', "changes masses"),
    "plugin of the newer Gazebo": (
        '<gazebo><plugin name="p" filename="gz-sim-lift-drag-system"/></gazebo>',
        "acts on the robot",
    ),
    "plugin of a laboratory": (
        '<gazebo><plugin name="a" filename="libtendon_drive.so"/><plugin name="b" filename="libmuscle.so"/></gazebo>',
        "'libtendon_drive.so' is unknown: its effect in Gazebo does not exist in asrsim (and at 1 other place)",
    ),
    "coupling of no master": (controlled("", 'mimic="true"'), "has no <mimic>; in asrsim it moves freely"),
    "coupling that is a parameter": (
        controlled('<param name="mimic">true</param>'),
        "has no <mimic>; in asrsim it moves freely",
    ),
    "range of commands": (
        controlled('<command_interface name="position"><param name="min">-0.5</param></command_interface>'),
        "-0.5 to ...",
    ),
    "range of efforts": (
        controlled('<command_interface name="effort"><param name="max">1</param></command_interface>'),
        "commands of the effort are not limited to ... to 1",
    ),
    "limits that are off": (controlled('<limits enable="false"/>'), "in asrsim the joint stops at its <limit>"),
    "gearbox": (
        '<gazebo><joint name="g" type="gearbox"><parent>world</parent><child>arm</child></joint></gazebo>',
        "close a loop",
    ),
    "loop of one joint": (
        '<loop_joint name="l" type="spherical"><link1 link="world"/><link2 link="arm"/></loop_joint>',
        "stays open",
    ),
    "loop of no link": (
        '<loop_joint name="l" type="spherical"><link1 link="world"/><link2 link="x"/></loop_joint>',
        "no link 'x'",
    ),
}


@pytest.mark.parametrize("case", WORDS)
def test_words_with_physics_that_are_left_out_are_told(case, tiny):
    words, told = WORDS[case]
    tiny.robot.write_text(PENDULUM.replace("</robot>", f"{words}</robot>"))
    (problem,) = load_robot(tiny.robot).findings
    assert told in problem.message


def plugin(name):
    """Plugin of Gazebo."""
    return f'<gazebo><plugin name="p" filename="{name}"/></gazebo>'


SILENT = (
    plugin("libgazebo_ros_control.so"),
    plugin("libhector_gazebo_ros_imu.so"),
    plugin("libgazebo_yarp_forcetorque.so"),
    plugin("gz-sim-joint-state-publisher-system"),
    controlled('<command_interface name="velocity"/><param name="p">5</param><limits enable="true"/>', 'mimic="false"'),
    controlled('<command_interface name="position"><param name="max">9</param></command_interface>'),
)


@pytest.mark.parametrize("words", SILENT)
def test_words_without_physics_are_not_mentioned(words, tiny):
    tiny.robot.write_text(PENDULUM.replace("</robot>", f"{words}</robot>"))
    assert not load_robot(tiny.robot).findings


def test_a_coupling_that_ros2_control_switches_off_is_told(tiny):
    text = PENDULUM.replace("</robot>", controlled("", 'mimic="false"') + "</robot>")
    second = '<link name="b"/><joint name="elbow" type="revolute">'.replace("elbow", "wrist")
    parts = '<parent link="world"/><child link="b"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
    text = text.replace("</robot>", f"{second}{parts}</robot>").replace(
        '<child link="arm"/>', '<child link="arm"/><mimic joint="wrist"/>'
    )
    tiny.robot.write_text(text)
    assert "ros2_control does not couple this joint" in str([one.message for one in load_robot(tiny.robot).findings])


@pytest.mark.parametrize(("text", "hint"), [("50:1", "a reduction of 50:1 is 50"), ("3,5", "decimal point"), ("5 kg", "unit")])
def test_a_text_that_is_no_number_gets_a_hint(text, hint, tiny):
    motor = f'<transmission name="t"><joint name="elbow"/><actuator name="m"><mechanicalReduction>{text}</mechanicalReduction>'
    tiny.robot.write_text(
        PENDULUM.replace("</robot>", f"{motor}<motorInertia>1e-4</motorInertia></actuator></transmission></robot>")
    )
    with pytest.raises(RobotError, match=f"elbow.mechanicalReduction: is not a number.*{hint}"):
        load_robot(tiny.robot)


SPELLINGS = {
    "ROS 1": ("mechanicalReduction", "motorInertia"),
    "ros2_control": ("mechanical_reduction", "motor_inertia"),
    "Drake": ("drake:gear_ratio", "drake:rotor_inertia"),
}


@pytest.mark.parametrize("block", ["{}", '<ros2_control name="c" type="system">{}</ros2_control>'])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_the_rotor_of_a_transmission_is_read_wherever_its_words_stand(spelling, block, tiny):
    """3e-4 kg m^2 times 40 squared, in the actuator, the joint, or the transmission itself."""
    ratio, inertia = (f"<{word}>{value}</{word}>" for word, value in zip(SPELLINGS[spelling], ("40", "3e-4"), strict=True))
    for actuator, joint, outer in (
        (ratio + inertia, "", ""),
        ("", "", ratio + inertia),
        (inertia, ratio, ""),
        (ratio, "", inertia),
    ):
        words = f'<joint name="elbow">{joint}</joint><actuator name="m">{actuator}</actuator>{outer}'
        words = block.format(f'<transmission name="t">{words}</transmission>')
        text = PENDULUM.replace("</robot>", f"{words}</robot>").replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ')
        tiny.robot.write_text(text)
        robot = load_robot(tiny.robot)
        assert robot.joint("elbow").rotor_inertia == pytest.approx(0.48)
        assert not robot.findings


@pytest.mark.parametrize(
    "words",
    [
        '<param name="initial_position">0.7</param>',
        '<state_interface name="position"><param name="initial_value">0.7</param></state_interface>',
    ],
)
def test_both_spellings_of_a_start_in_ros2_control_are_read(words, tiny):
    control = f'<ros2_control name="c" type="system"><joint name="elbow">{words}</joint></ros2_control></robot>'
    tiny.robot.write_text(PENDULUM.replace("</robot>", control))
    assert load_robot(tiny.robot).joint("elbow").start == 0.7


@pytest.mark.parametrize(("mode", "told"), [(0, []), (2, ["two-rotors"]), (3, ["two-rotors"]), (4, ["two-rotors"])])
def test_a_rotor_that_is_left_out_behind_a_spring_is_told(mode, told, tiny):
    text = PENDULUM.replace('friction="0"', 'friction="0" armature="0.02"').replace(
        "<operation_mode>3", f"<operation_mode>{mode}"
    )
    tiny.robot.write_text(text)
    robot = load_robot(tiny.robot)
    assert [one.code for one in warnings_of(robot) if one.code == "two-rotors"] == told
    assert warnings_of(with_rotors(robot, {"elbow": 0.02})) == tuple(one for one in warnings_of(robot) if one.code not in told)
