"""Plugin blocks: values, origins, warnings and errors."""

import math

import pytest

from asrsim.actuators import ACTUATORS
from asrsim.errors import InputError
from asrsim.robot import load_robot, with_overrides
from asrsim.robot.doubts import warnings_of
from asrsim.robot.numbers import read_number
from asrsim.robot.tags import parameter_tags

REQUIRED = "<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>"
LINK = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'

ONE, ZERO = 'mass value="1"', 'mass value="0"'


def block(tags="", *, actuator="qbmove", joint="elbow", mode="5", required=REQUIRED):
    return (
        f'<gazebo><plugin name="act" filename="lib{actuator}_plugin.so">\n'
        f"<joint>{joint}</joint>\n<operation_mode>{mode}</operation_mode>{required}\n{tags}\n</plugin></gazebo>"
    )


def urdf(blocks):
    return f"""<robot name="arm">
<link name="world"/>
<joint name="elbow" type="revolute"><parent link="world"/><child link="forearm"/><axis xyz="0 1 0"/>
<limit effort="100" velocity="10" lower="-1" upper="1"/></joint>
<link name="forearm">{LINK}</link>
<joint name="wrist" type="revolute"><parent link="forearm"/><child link="hand"/><axis xyz="0 0 1"/>
<limit effort="100" velocity="10" lower="-1" upper="1"/></joint>
<link name="hand">{LINK}</link>
<joint name="glued" type="fixed"><parent link="hand"/><child link="tip"/></joint>
<link name="tip">{LINK}</link>
{blocks}
</robot>"""


@pytest.fixture
def read_arm(read):
    return lambda blocks: read(urdf(blocks))


def codes(robot):
    return {problem.code for problem in warnings_of(robot)}


def errors(read_arm, blocks):
    with pytest.raises(InputError) as caught:
        with_overrides(read_arm(blocks))
    return {problem.code: problem for problem in caught.value.problems}


@pytest.mark.parametrize("name", ["sea", "qbmove", "bavs", "awas_ii"])
def test_every_tag_reaches_its_parameter(name, read_arm):
    tags = parameter_tags(ACTUATORS.get(name))
    assert len(set(tags.values())) == len(tags)
    # Each gets its own value, so that no two can be mixed up.
    given = {parameter: 0.01 + 0.001 * i for i, parameter in enumerate(tags)}
    text = "".join(f"<{tags[parameter]}>{value}</{tags[parameter]}>" for parameter, value in given.items())
    robot = read_arm(block(text, actuator=name))
    assert robot.actuators[0].values() == pytest.approx(given)
    assert all(value.origin == "tag" and value.line == 14 for value in robot.actuators[0].parameters.values())


def test_defaults_are_the_released_codes(read_arm):
    values = read_arm(block()).actuators[0].parameters
    assert (values["motor_1_damping"].value, values["motor_2_friction_torque"].value) == (0.2698, 0.02)
    assert (values["controller_2_proportional"].value, values["controller_1_derivative"].value) == (125.0, 4.5)
    assert values["spring_a_1"].origin == "default"
    assert values["spring_a_1"].tag == "spring_a1"


def test_free_text_comments_blanks_and_infinity(read_arm):
    robot = read_arm(
        block(
            "# free text\n<spring_a1>11 </spring_a1> # more <!-- and a comment -->\n<max_def> 0.5<!-- rad --> </max_def>"
            "<mot_1_minPos>-inf</mot_1_minPos><mot_1_maxPos>inf</mot_1_maxPos>"
        )
    )
    values = robot.actuators[0].values()
    assert (values["spring_a_1"], values["max_deflection"]) == (11.0, 0.5)
    assert (values["motor_1_min_position"], values["motor_1_max_position"]) == (-math.inf, math.inf)


def test_later_dialect(read_arm):
    entry = read_arm(block("<namespace>alter/right</namespace><t_sample>0.01</t_sample>")).actuators[0]
    assert entry.namespace == "alter/right"


def test_foreign_plugins_and_references_are_left_alone(read_arm):
    robot = read_arm(
        '<gazebo><plugin name="ros_control" filename="libgazebo_ros_control.so"><joint>nothing</joint></plugin></gazebo>'
        '<gazebo reference="hand"><mu1>3</mu1><sensor name="s"><plugin name="i" filename="libimu.so"/></sensor></gazebo>'
        + block()
    )
    assert [entry.joint for entry in robot.actuators] == ["elbow"]
    assert warnings_of(robot) == ()


def test_arithmetic_is_evaluated_and_said_to_be_misread(read_arm):
    robot = read_arm(block("<spring_a>1.21*pow(10,-6)</spring_a>", actuator="bavs"))
    value = robot.actuators[0].parameters["spring_a"]
    assert value.value == pytest.approx(1.21e-6, rel=1e-12)
    assert value.text == "1.21*pow(10,-6)"
    (warning,) = warnings_of(robot)
    assert warning.line == 14
    assert "leading number 1.21" in warning.message


@pytest.mark.parametrize(
    ("text", "value"),
    [("1.5", 1.5), (" -2e-3 ", -2e-3), (".5", 0.5), ("3.", 3.0), ("2*(3+4)/7", 2.0), ("-pow(2, 3)*-1", 8.0), ("1-2-3", -4.0),
     ("8/2/2", 2.0), ("10 # note", 10.0), ("+inf", math.inf)],
)  # fmt: skip
def test_numbers(text, value):
    assert read_number(text)[0] == pytest.approx(value)


@pytest.mark.parametrize(
    "text",
    ["", "abc", "1,5", "0.5 Nm", "1/0", "pow(10,400)", "pow(-1,0.5)", "__import__('os')", "2**3", "1e999*2", "(((1)", "pow(1)",
     "(" * 100 + "1" + ")" * 100, "1+" * 200 + "1", "1e5e5", "os.system"],
)  # fmt: skip
def test_bad_numbers_are_refused(text):
    with pytest.raises(ValueError, match=r"\w"):
        read_number(text)


@pytest.mark.parametrize(
    ("blocks", "code", "line", "says"),
    [
        (block(joint="elbwo"), "unknown-joint", 12, "elbow"),
        (block(joint="glued"), "joint-type", 12, "fixed"),
        (block(mode="9"), "operation-mode", 13, "8 (MotorCurrents)"),
        (block(mode="five"), "operation-mode", 13, "five"),
        (block("<spring_a1>stiff</spring_a1>"), "not-a-number", 14, "stiff"),
        (block("<spring_a1>nan</spring_a1>"), "out-of-range", 14, "must be a number"),
        (block("<mot_1_J>inf</mot_1_J>"), "out-of-range", 14, "finite"),
        (block("<mot_1_J>0</mot_1_J>"), "out-of-range", 14, "larger than 0"),
        (block("<mot_1_D>-1</mot_1_D>"), "out-of-range", 14, "at least 0"),
        (block("<mot_1_minPos>2</mot_1_minPos><mot_1_maxPos>1</mot_1_maxPos>"), "limits-crossed", 14, "above"),
        (block("<spring_a1>1</spring_a1><spring_a1>2</spring_a1>"), "duplicate-tag", 14, "twice"),
        (block(required=REQUIRED.replace("true</pub_state>", "maybe</pub_state>")), "not-a-boolean", 13, "maybe"),
        (block() + block(), "two-actuators", 16, "elbow"),
        (block(actuator="my_spring"), "unknown-actuator", 11, "--plugin"),
        (block(actuator="qbmoves"), "unknown-actuator", 11, "libqbmove_plugin.so"),
    ],
)
def test_bad_blocks(read_arm, blocks, code, line, says):
    found = errors(read_arm, blocks)
    assert set(found) == {code}
    assert found[code].line == line
    assert says in str(found[code])


def test_missing_required_tags(read_arm):
    found = errors(read_arm, '<gazebo><plugin name="a" filename="libsea_plugin.so"><joint>elbow</joint></plugin></gazebo>')
    assert "operation_mode" in found["missing-tag"].message
    robot = read_arm(block(required=""))
    assert [problem.code for problem in warnings_of(robot)] == ["missing-tag"] * 3


@pytest.mark.parametrize(
    ("tags", "code", "says"),
    [
        ("<spring_k3>1</spring_k3>", "unknown-tag", "spring_k"),
        ("<ctrl_1_P>99</ctrl_1_P>", "one-controller-set", "motor 2 keeps"),
    ],
)
def test_warnings_of_a_block(read_arm, tags, code, says):
    (warning,) = warnings_of(read_arm(block(tags)))
    assert warning.code == code
    assert says in str(warning)


@pytest.mark.parametrize(
    ("code", "old", "new"),
    [
        ("plugin-in-reference", "<gazebo>", '<gazebo reference="hand">'),
        ("misread-value", "</joint>\n<operation_mode>", "</joint>\n<spring_k1>2*0.01</spring_k1><operation_mode>"),
        ("prismatic-joint", 'name="elbow" type="revolute"', 'name="elbow" type="prismatic"'),
        ("no-effort-limit", '<limit effort="100" velocity="10" lower="-1" upper="1"/>', ""),
        ("no-effect", "</joint>\n<operation_mode>", "</joint>\n<hyst_def>0.1</hyst_def><operation_mode>"),
        ("idle-stage", "<operation_mode>5", "<hyst_tau>0.1</hyst_tau><operation_mode>0"),
        ("mimic-joint", '<joint name="wrist" type="revolute">', '<joint name="wrist" type="revolute"><mimic joint="ankle"/>'),
        ("massless-link", f'<link name="tip">{LINK}', f'<link name="tip">{LINK.replace(ONE, ZERO)}'),
        ("value-attribute", "<gazebo>", '<gazebo reference="wrist"><springStiffness value="200"/></gazebo><gazebo>'),
    ],
)
def test_what_acts_otherwise_than_written_is_told(read, code, old, new):
    """Each text is in the file once too often, in the wrong place, or in a form that Gazebo reads otherwise."""
    text = urdf(block())
    assert code not in codes(read(text))
    assert old in text
    assert code in codes(read(text.replace(old, new, 1)))


def test_effort_limits_that_matter_to_an_actuator(read):
    assert codes(read(urdf(block()).replace('effort="100"', 'effort="0"', 1))) == {"zero-effort-limit"}


@pytest.mark.parametrize(
    ("name", "actuators", "kind"),
    [
        ("toolbox/nmmi_sea_template", 1, "sea"),
        ("toolbox/nmmi_qbmove_template", 1, "qbmove"),
        ("toolbox/nmmi_bavs_template", 1, "bavs"),
        ("toolbox/nmmi_awas_ii_template", 1, "awas_ii"),
        ("toolbox/nmmi_template_description", 1, "qbmove"),
        ("alterego/alterego_v2_fixedbase-true_fixedhands-true", 12, "qbmove"),
        ("alterego/alterego_v3_fixedbase-true_fixedhands-true", 14, "qbmove"),
    ],
)
def test_real_robots_load_unmodified(name, actuators, kind, shared):
    robot = load_robot(shared / "robots" / f"{name}.urdf")
    assert [entry.actuator for entry in robot.actuators] == [kind] * actuators


def test_alterego_values(shared):
    robot = load_robot(shared / "robots/alterego/alterego_v3_fixedbase-true_fixedhands-true.urdf")
    shoulder = next(entry for entry in robot.actuators if entry.joint == "base_link_to_left_shoulder_flange")
    assert (shoulder.mode, shoulder.namespace) == (1, "robot_alterego_sim/left")
    assert shoulder.values()["controller_1_proportional"] == 500.0
    assert sum(entry.mode == 1 for entry in robot.actuators) == 2
