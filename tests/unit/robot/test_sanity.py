"""Robots with unknown words and improbable numbers get warnings; `check` refuses what `run` refuses."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asrsim.errors import RobotError, ScenarioError
from asrsim.robot import load_robot, merge_fixed, with_overrides
from asrsim.robot.doubts import warnings_of
from asrsim.robot.meshes import usable_shapes
from asrsim.robot.poses import link_poses
from asrsim.robot.values import law_fault
from asrsim.robot.vary import names_of, physical
from asrsim.scenario import load_scenario
from support.examined import check_against_robot

MIMIC = '<mimic joint="elbow" multiplier="-2" offset="0.1"/>'


def changed(tiny, *changes):
    """The tiny robot with texts replaced."""
    text = tiny.robot.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    tiny.robot.write_text(text)
    return load_robot(tiny.robot)


def codes(problems):
    return {problem.code for problem in problems}


# -- words -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "close"),
    [
        ("<dynamics damping", "<dynamics dampening", "'damping'"),
        ("<dynamics ", "<dynamic ", "<dynamics>"),
        ('origin xyz="0 0 -0.1"', 'origin xzy="0 0 -0.1"', "'xyz'"),
        ("<axis ", "<axes ", "<axis>"),
        ("<mass value", '<mass unit="kg" value', None),
        ("</inertial>", "</inertial><colision/>", "<collision>"),
        ("<limit ", "<Limit ", "<limit>"),
        ("</robot>", "<jiont/></robot>", "<joint>"),
        ('ixy="0"', 'Ixy="0"', "'ixy'"),
    ],
)
def test_unknown_words_are_told_of_with_the_nearest(old, new, close, tiny):
    robot = changed(tiny, (old, new))
    (found,) = [problem for problem in warnings_of(robot) if problem.code.startswith("unknown-")]
    assert found.line == 1 + tiny.robot.read_text().split(new)[0].count("\n")
    assert found.hint == (f"Did you mean {close}?" if close else None)


def test_what_other_programs_add_is_no_slip(tiny):
    robot = changed(
        tiny,
        ("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" xmlns:drake="http://drake.mit.edu" '),
        ("</robot>", "<drake:collision_filter_group/><transmission><type/></transmission><ros2_control/></robot>"),
        ("</inertial>", "</inertial><contact/>"),
    )
    assert not [problem for problem in warnings_of(robot) if problem.code.startswith("unknown-")]
    assert "contact" in robot.contact_words


LEFT_OUT = {
    "series spring": ('<dynamics K="7000" damping', '<dynamics K="0" damping', "7000"),
    "coulomb friction": ('<dynamics mu_coulomb="0.4" damping', '<dynamics mu_coulomb="0.0" damping', "0.4"),
    # word with a value that acts; the same with a value that changes nothing; number in the warning
    "spring": ('<dynamics spring_stiffness="10" damping', '<dynamics spring_stiffness="0" damping', "10"),
    "soft limits": (
        '<safety_controller soft_lower_limit="-0.2" soft_upper_limit="0.2" k_velocity="1"/><dynamics damping',
        '<safety_controller soft_lower_limit="-3" soft_upper_limit="3" k_velocity="1"/><dynamics damping',
        "-0.2 to 0.2",
    ),
}


@pytest.mark.parametrize("case", LEFT_OUT)
def test_words_with_physics_are_left_out_with_a_number_unless_they_are_neutral(case, tiny):
    acting, neutral, number = LEFT_OUT[case]
    (found,) = [problem for problem in warnings_of(changed(tiny, ("<dynamics damping", acting))) if problem.code == "left-out"]
    assert number in found.message
    assert found.line == 1 + tiny.robot.read_text().split(acting)[0].count("\n")
    assert "left-out" not in codes(warnings_of(changed(tiny, (acting, neutral))))


def test_a_rotor_behind_a_gear_of_several_joints_is_left_out_with_its_number(tiny):
    """The motor's inertia counts with the square of the reduction; the file does not say which joint it turns with."""
    transmission = (
        '<transmission name="t"><joint name="elbow"/><joint name="wrist"/><actuator name="m">'
        "<mechanicalReduction>50</mechanicalReduction>{}</actuator></transmission></robot>"
    )
    inertia = "<motorInertia>1e-4</motorInertia>"
    (found,) = [one for one in warnings_of(changed(tiny, ("</robot>", transmission.format(inertia)))) if one.code == "left-out"]
    assert "0.25 kg m^2" in found.message
    assert "left-out" not in codes(warnings_of(changed(tiny, (inertia, ""))))


def test_a_word_of_many_joints_is_warned_of_once_with_its_largest_value(read):
    links = "".join(
        f'<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>' for i in range(4)
    )
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<dynamics spring_stiffness="{value}"/></joint>'
        for i, value in enumerate((0.01, 0.3, 0.02))
    )
    robot = read(f'<robot name="r">{links}{joints}</robot>')
    (found,) = [problem for problem in warnings_of(robot) if problem.code == "left-out"]
    assert (found.key, "0.3 N m/rad" in found.message, "2 other places" in found.message) == ("j1.dynamics", True, True)


@pytest.mark.parametrize("ground", [True, False])
def test_words_of_contacts_are_told_of_in_worlds_with_contacts_only(ground, tiny, asrsim_command):
    changed(tiny, ("</robot>", '<gazebo reference="arm"><mu1>0.2</mu1></gazebo></robot>'))
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}\nworld: {{ground: {str(ground).lower()}}}\n")
    assert ("mu1" in asrsim_command("check", tiny.scenario, "-q").out) == ground


# -- numbers -----------------------------------------------------------------------------------------------------------


INERTIA = 'ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"'
MODE = "<operation_mode>3</operation_mode>"
SPRING_K = "<spring_k>10<"
DOUBTED = {
    # code: (sound text, doubted text, text that is just not doubted)
    "heavy-link": ('mass value="0.5"', 'mass value="51"', 'mass value="49"'),
    "far-centre": ('xyz="0 0 -0.1"', 'xyz="0 0 -2.1"', 'xyz="0 0 -1.9"'),
    "limit-in-degrees": ('lower="-3" upper="3"', 'lower="-90" upper="0"', 'lower="-19" upper="19"'),
    "limit-in-degrees of two turns": ('lower="-3" upper="3"', 'lower="0" upper="719"', 'lower="0" upper="721"'),
    "rpy-in-degrees": ('xyz="0 0 -0.1"', 'xyz="0 0 -0.1" rpy="90 0 0"', 'xyz="0 0 -0.1" rpy="6.28 0 0"'),
    "repeated-element": ("<limit ", '<limit effort="1" velocity="1"/><limit ', "<limit "),
    "no-spring": (SPRING_K, "<spring_k>0<", SPRING_K),
    "negative-gain": (MODE, "<operation_mode>5</operation_mode><ctrl_P>-1</ctrl_P>", f"{MODE}<ctrl_P>-1</ctrl_P>"),
    "stuck-motor": (
        MODE,
        "<operation_mode>5</operation_mode><mot_tauFric>6</mot_tauFric>",
        "<operation_mode>5</operation_mode><mot_tauFric>5.9</mot_tauFric>",
    ),
    "zero-velocity-limit": ('velocity="100"', 'velocity="0"', 'velocity="0.01"'),
    "wide-robot": ("<axis ", '<origin xyz="0 0 101"/><axis ', '<origin xyz="0 0 99"/><axis '),
    "large-inertia": (
        'iyy="1e-3" iyz="0" izz="1e-3"',
        'iyy="2.1" iyz="0" izz="2.1"',
        'iyy="1.9" iyz="0" izz="1.9"',
    ),
    "unusual-value": (SPRING_K, "<spring_k>1.1e5<", "<spring_k>0.9e5<"),
    "unusual-value of a soft spring": (SPRING_K, "<spring_k>0.9e-3<", "<spring_k>1.1e-3<"),
    "triangle-inequality": ('iyz="0" izz="1e-3"', 'iyz="0" izz="2.1e-3"', 'iyz="0" izz="1.9e-3"'),
}


@pytest.mark.parametrize("case", DOUBTED)
def test_values_that_are_probably_mistakes_get_warnings(case, tiny):
    sound, doubted, fine = DOUBTED[case]
    code, text = case.split()[0], tiny.robot.read_text()
    assert code not in codes(warnings_of(changed(tiny, (sound, fine))))
    tiny.robot.write_text(text)
    (found,) = [problem for problem in warnings_of(changed(tiny, (sound, doubted))) if problem.code == code]
    assert found.line is not None


def test_an_unusual_parameter_is_named_by_its_plugin_and_tag(tiny):
    warnings = warnings_of(changed(tiny, (SPRING_K, "<spring_k>1.1e5<")))
    assert [problem.key for problem in warnings if problem.code == "unusual-value"] == ["elbow_drive.spring_k"]


QBMOVE = """<gazebo><plugin name="drive" filename="libqbmove_plugin.so"><joint>elbow</joint><operation_mode>3</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>{}</plugin></gazebo></robot>"""


def with_qbmove(tiny, tags):
    text = tiny.robot.read_text()
    tiny.robot.write_text(text[: text.index("  <gazebo>")] + QBMOVE.format(tags))
    return load_robot(tiny.robot)


@pytest.mark.parametrize(
    ("a", "k", "doubted"), [(0.019, 9, True), (0.002, 6.7, True), (9, 0.019, False), (22.9, 0.02, False), (0.5, 0.5, False)]
)
def test_exchanged_values_of_a_spring_are_doubted(a, k, doubted, tiny):
    tags = f"<spring_a1>{a}</spring_a1><spring_k1>{k}</spring_k1><spring_a2>{a}</spring_a2><spring_k2>{k}</spring_k2>"
    found = [problem for problem in warnings_of(with_qbmove(tiny, tags)) if problem.code == "exchanged-values"]
    assert [one.key for one in found] == (["drive.spring_a1, spring_k1, spring_a2, spring_k2"] if doubted else [])


def test_a_tag_that_the_block_has_is_not_suggested(tiny):
    text = tiny.robot.read_text()
    tags = "<spring_k1>0.02</spring_k1><spring_k3>0.02</spring_k3>"
    (found,) = [one for one in warnings_of(with_qbmove(tiny, tags)) if one.code == "unknown-tag"]
    assert found.hint == "Did you mean <spring_k2>?"
    tiny.robot.write_text(text)
    (found,) = [
        one for one in warnings_of(with_qbmove(tiny, f"<spring_k2>0.02</spring_k2>{tags}")) if one.code == "unknown-tag"
    ]
    assert "spring_k" not in (found.hint or "")


def test_a_tag_with_a_space_gets_its_name(tiny):
    with pytest.raises(RobotError, match="have no spaces: write <spring_a1>"):
        with_qbmove(tiny, "<spring a1>9</spring a1>")


@pytest.mark.parametrize("moment", ["ixx", "iyy", "izz"])
def test_a_raised_moment_of_inertia_raises_the_others(moment, tiny):
    """No principal moment exceeds the sum of the others. Those of the arm are 1e-3 kg m^2."""
    found = physical(load_robot(tiny.robot), {"arm": {moment: 0.05}})["arm"]
    assert found == {name: pytest.approx(0.05 if name == moment else 0.025) for name in ("ixx", "iyy", "izz")}


def test_a_link_and_a_joint_may_share_a_name():
    assert {"mass", "damping"} <= set(names_of("arm", {}, {"arm": None}, {"arm": None}))


def test_a_slider_has_no_usual_stiffness(tiny):
    """What lifts a carriage is no stiffness of a joint that turns."""
    robot = changed(tiny, ('type="revolute"', 'type="prismatic"'), ("<spring_k>10<", "<spring_k>1.1e5<"))
    assert "unusual-value" not in codes(warnings_of(robot))


def test_an_inertia_that_is_rounding_is_zero(tiny):
    """iCub's links have moments of -5e-20 kg m^2, as CAD wrote them; -1e-3 is a mistake (tests of bad input)."""
    robot = changed(tiny, (INERTIA, 'ixx="-5.4e-20" ixy="0" ixz="0" iyy="1e-18" iyz="0" izz="0"'))
    assert (0.0,) * 6 in [link.inertia for link in robot.links]
    assert "zero-inertia" in codes(warnings_of(robot))


@pytest.mark.parametrize("value", ["1e308", "1e13", "-1e300", "1e-308", "5e-324"])
@pytest.mark.parametrize("tag", ["spring_k", "max_def", "mot_J", "mot_D", "ctrl_P", "mot_tauMax"])
def test_parameters_that_cannot_be_calculated_with_are_refused(tag, value, tiny):
    text = tiny.robot.read_text().replace("<spring_k>10</spring_k>", f"<{tag}>{value}</{tag}>")
    tiny.robot.write_text(text)
    with pytest.raises(RobotError, match=tag):
        load_robot(tiny.robot)
    robot = changed(tiny, (f"<{tag}>{value}</{tag}>", ""))
    with pytest.raises(ScenarioError, match="elbow"):
        with_overrides(robot, parameters={"elbow": {tag: float(value)}})


@pytest.mark.parametrize(
    ("actuator", "tag", "value"),
    [
        ("qbmove", "spring_a1", 0.0),
        ("qbmove", "spring_a2", 0.0),
        ("bavs", "spring_k_e", 0.0),
        ("qbmove", "spring_a1", 2e6),
        ("awas_ii", "spring_L", 0.01),
    ],
)
def test_a_law_that_divides_by_zero_or_overflows_is_an_error(actuator, tag, value, tiny):
    block = f"<{tag}>{value}</{tag}>"
    text = tiny.robot.read_text().replace("libsea", f"lib{actuator}").replace("<spring_k>10</spring_k>", block)
    tiny.robot.write_text(text)
    with pytest.raises(ScenarioError, match=r"pendulum\.urdf.*cannot be computed"):
        with_overrides(load_robot(tiny.robot))
    robot = changed(tiny, (block, ""))
    assert all(law_fault(block) is None for block in robot.actuators)
    with pytest.raises(ScenarioError, match=r"parameters\.elbow.*cannot be computed"):
        with_overrides(robot, parameters={"*": {tag: value}})


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('<axis xyz="0 1 0"/>', "<axis/>", "missing-attribute"),
        ('mass value="0.5"', 'mass value="1e-300"', "out-of-range"),
        ('ixx="1e-3"', 'ixx="1e-300"', "out-of-range"),
    ],
)
def test_what_no_engine_can_use_is_an_error(old, new, code, tiny):
    with pytest.raises(RobotError) as caught:
        changed(tiny, (old, new))
    assert codes(caught.value.problems) == {code}


@pytest.mark.parametrize("encoding", ["UTF-7", "big5", "rot13", "undefined", "idna", "punycode", "nothing", "hex", "cp037"])
def test_encodings_that_no_parser_knows_are_errors(encoding, tiny):
    text = tiny.robot.read_text().replace('version="1.0"', f'version="1.0" encoding="{encoding}"')
    tiny.robot.write_text(text)
    with pytest.raises(RobotError, match="encoding"):
        load_robot(tiny.robot)


# -- passive springs and mimic -----------------------------------------------------------------------------------------


def gazebo(*tags, joint="elbow"):
    return f'<gazebo reference="{joint}">{"".join(tags)}</gazebo></robot>'


SPRING = "<springStiffness>200</springStiffness>", "<springReference> -0.26 </springReference>"


def test_a_passive_spring_is_read(tiny):
    text = tiny.robot.read_text()
    plain = text[: text.index("  <gazebo>")] + "</robot>"
    tiny.robot.write_text(plain.replace("</robot>", gazebo(*SPRING)))
    robot = load_robot(tiny.robot)
    joint = robot.joint("elbow")
    assert (joint.spring_stiffness, joint.spring_reference) == (200.0, -0.26)
    assert codes(warnings_of(robot)) == {"no-actuators"}
    assert merge_fixed(robot).robot.joint("elbow").spring_stiffness == 200.0


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (gazebo(*SPRING), "two-springs"),
        (gazebo("<springStiffness>-1</springStiffness>"), "negative-spring"),
        (gazebo("<springReference>1</springReference>"), "no-spring"),
        (gazebo(*SPRING, joint="elbwo"), "misplaced-tag"),
        (gazebo(*SPRING, joint="arm"), "misplaced-tag"),
    ],
)
def test_a_misused_spring_is_told_of(end, code, tiny):
    robot = changed(tiny, ("</robot>", end))
    assert code in codes(warnings_of(robot))


@pytest.mark.parametrize("text", ["", "x", "1_0", "nan", "inf", "1e300", "\u0661"])
def test_a_spring_that_is_no_number_is_an_error(text, tiny):
    with pytest.raises(RobotError, match="springStiffness"):
        changed(tiny, ("</robot>", gazebo(f"<springStiffness>{text}</springStiffness>")))


def test_springs_and_mimics_are_shown(tiny, asrsim_command):
    second = (
        '<link name="tip"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>'
        f'<joint name="wrist" type="revolute"><parent link="arm"/><child link="tip"/><axis xyz="0 1 0"/>{MIMIC}'
        '<limit effort="1" velocity="1" lower="-1" upper="1"/></joint>'
    )
    robot = changed(tiny, ("</robot>", second + gazebo(*SPRING, joint="wrist")))
    (problem,) = [one for one in warnings_of(robot) if one.code == "mimic-limits"]
    assert problem.key == "wrist"
    told = asrsim_command("check", tiny.robot).out
    assert "passive spring, 200 N m/rad to -0.26 rad: wrist" in told
    assert "follows elbow" in told
    assert '"wrist": {' in asrsim_command("check", tiny.robot, "--json").out


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_that_mimics_a_fixed_joint_is_fixed_at_its_offset(tiny, kind):
    """The axis is oblique, and so is the frame of the joint."""
    second = (
        '<link name="tip"/><link name="post"/>'
        '<joint name="still" type="fixed"><parent link="world"/><child link="post"/></joint>'
        f'<joint name="wrist" type="{kind}"><parent link="world"/><child link="tip"/><axis xyz="0 0.6 0.8"/>'
        '<origin xyz="0.1 0.2 0.3" rpy="0.3 -0.4 0.5"/><mimic joint="still" multiplier="2" offset="0.7"/>'
        '<limit effort="1" velocity="1" lower="-1" upper="1"/></joint></robot>'
    )
    robot = changed(tiny, ("</robot>", second))
    frame, way = Rotation.from_euler("xyz", (0.3, -0.4, 0.5)), np.array([0.0, 0.42, 0.56])
    found = link_poses(robot)["tip"]
    turned = frame * Rotation.from_rotvec(way) if kind == "revolute" else frame
    np.testing.assert_allclose(found.rotation, turned.as_matrix(), atol=1e-12)
    moved = frame.apply(way) if kind == "prismatic" else 0.0
    np.testing.assert_allclose(found.position, np.array([0.1, 0.2, 0.3]) + moved, atol=1e-12)
    assert "mimic-fixed" in codes(warnings_of(robot))


def test_a_chain_of_mimics_follows_its_first_joint(tiny):
    """wrist = -2 elbow + 0.1, hand = 3 wrist + 0.5, finger = 0.5 hand - 1: hand = -6 elbow + 0.8, finger = -3 elbow - 0.6."""

    def follower(name, parent, mimic):
        return (
            f'<link name="{name}_link"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>'
            f'</link><joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
            f'<axis xyz="0 1 0"/>{mimic}<limit effort="1" velocity="1" lower="-30" upper="30"/></joint>'
        )

    chain = (
        follower("wrist", "arm", '<mimic joint="elbow" multiplier="-2" offset="0.1"/>')
        + follower("hand", "wrist_link", '<mimic joint="wrist" multiplier="3" offset="0.5"/>')
        + follower("finger", "hand_link", '<mimic joint="hand" multiplier="0.5" offset="-1"/>')
    )
    robot = changed(tiny, ("</robot>", chain + "</robot>"))
    found = {joint.name: (joint.mimic, joint.multiplier, joint.offset) for joint in robot.joints if joint.mimic}
    assert found == {
        "wrist": ("elbow", -2.0, pytest.approx(0.1)),
        "hand": ("elbow", -6.0, pytest.approx(0.8)),
        "finger": ("elbow", -3.0, pytest.approx(-0.6)),
    }
    assert robot.couplings.expand([0.3, 0.0, 0.0, 0.0]) == pytest.approx([0.3, -0.5, -1.0, -1.5])


# -- check knows what run refuses --------------------------------------------------------------------------------------

LIMIT = '<limit effort="50" velocity="100" lower="-3" upper="3"/>'
REFUSED = {
    "no text": None,
    "no real value": [("<spring_k>10<", "<spring_k>pow(-1, 0.5)<")],
    "wrong joint": [("<joint>elbow<", "<joint>ellbow<")],
    "no inertia about the axis": [
        ('ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"', 'ixx="0" iyy="0" izz="0"'),
        ("0 0 -0.1", "0 0.1 0"),
    ],
    "too stiff": [("<spring_k>10<", "<spring_k>1e11<")],
}
TAKEN = {
    "no limit": [(LIMIT, "")],
    "no limit of a slide": [('type="revolute"', 'type="prismatic"'), (LIMIT, "")],
    "half a limit": [('lower="-3" upper="3"', 'lower="-3" upper="inf"')],
    "limit of a wheel": [('type="revolute"', 'type="continuous"')],
    "no numbers of the limit": [(LIMIT, "<limit/>")],
    "a rod without thickness": [('izz="1e-3"', 'izz="0"')],
    "a body that is none": [('izz="1e-3"', 'izz="1"')],
}


@pytest.mark.parametrize("case", REFUSED)
def test_check_refuses_what_run_refuses(case, tiny, asrsim_command):
    text = tiny.robot.read_text() if REFUSED[case] else ""
    for old, new in REFUSED[case] or ():
        assert old in text
        text = text.replace(old, new)
    tiny.robot.write_text(text)
    said = []
    for arguments in (("check", tiny.robot, "-q"), ("check", tiny.scenario, "-q"), ("run", tiny.scenario, "--no-plot")):
        outcome = asrsim_command(*arguments)
        assert outcome.code == 1, arguments
        assert "unexpected error" not in outcome.err
        said.append(outcome.out + outcome.err)
    assert "error" in said[0]
    assert "error" in said[1]


@pytest.mark.parametrize("case", TAKEN)
def test_check_passes_what_run_takes(case, tiny, asrsim_command):
    text = tiny.robot.read_text()
    for old, new in TAKEN[case]:
        assert old in text
        text = text.replace(old, new)
    tiny.robot.write_text(text)
    for arguments in (("check", tiny.robot), ("check", tiny.scenario), ("run", tiny.scenario, "--no-plot")):
        assert asrsim_command(*arguments).code == 0, arguments


def test_mass_of_a_floating_base_may_be_in_fixed_links(tiny):
    """The root link of many packages is an empty frame; the body hangs on it by a fixed joint."""
    body = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>'
    joint = '<joint name="f" type="fixed"><parent link="world"/><child link="hull"/></joint>'
    changed(tiny, ("</robot>", f'<link name="hull">{body}</link>{joint}</robot>'))
    floating = load_scenario(tiny.scenario, overrides=["base.fixed=false"])[0]
    assert check_against_robot(floating, load_robot(tiny.robot)) == ([], [])
    merged = merge_fixed(load_robot(tiny.robot)).robot
    assert (merged.root.name, merged.root.mass) == ("world", 2.0)
    assert len(merged.links) == 2


def test_an_unknown_package_gives_a_hint(tiny):
    shape = '<collision><geometry><mesh filename="package://arm_description/a.stl"/></geometry></collision>'
    robot = changed(tiny, ("</inertial>", f"</inertial>{shape}"))
    (problem,) = usable_shapes(robot)[1]
    assert "--package arm_description=FOLDER" in str(problem.hint)
    folder = tiny.folder / "arm_description"
    folder.mkdir()
    (folder / "a.stl").write_bytes(b"")
    (problem,) = usable_shapes(robot)[1]  # a folder beside the file, called a package
    assert "is empty" in problem.message
    assert math.isfinite(robot.joint("elbow").damping)


def test_a_log_finds_the_meshes_of_its_package(tiny, asrsim_command):
    """The folder of a package is where it was, also where the robot itself lies in it."""
    (tiny.folder / "meshes").mkdir()
    (tiny.folder / "meshes" / "a.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    changed(
        tiny,
        (
            "</inertial>",
            '</inertial><visual><geometry><mesh filename="package://arm/meshes/a.obj"/></geometry></visual>',
        ),
    )
    robot = f"{{file: {tiny.robot}, packages: {{arm: {tiny.folder}}}}}"
    tiny.scenario.write_text(tiny.scenario.read_text().replace("pendulum.urdf", robot))
    assert asrsim_command("run", tiny.scenario, "--no-plot").code == 0
    outcome = asrsim_command("render", tiny.folder / "out/step/default/log.mcap", "--frames", "2", "--size", "60")
    assert outcome.code == 0
    assert "rods" not in outcome.out + outcome.err
