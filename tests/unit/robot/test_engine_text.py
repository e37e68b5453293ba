"""What reaches an engine: the numbers that were read, all digits of them, and nothing else; fixed links merged exactly."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lxml import etree

from asrsim.errors import RobotError
from asrsim.robot import engine_urdf, load_robot, merge_fixed
from asrsim.robot.inertia import inertia_tensor, principal_axes
from asrsim.robot.model import Link
from asrsim.robot.numbers import plain_number, read_number
from asrsim.robot.poses import link_poses, roll_pitch_yaw, rotation_matrix
from support.random_robots import random_urdf

angle = st.floats(-7.0, 7.0)


def arm(*, axis="0 1 0", origin="0 0 0.2", mass="0.5", limit='lower="-3" upper="3"'):
    """Two joints, the second of them with what is to be read."""
    inertial = '<inertial><origin xyz="0 0 -0.1"/><mass value="{}"/><inertia ixx="1e-3" iyy="2e-3" izz="3e-3"/></inertial>'
    return (
        f'<robot name="r"><link name="b"/><link name="l">{inertial.format("0.3")}</link>'
        f'<link name="m">{inertial.format(mass)}</link>'
        '<joint name="j" type="revolute"><parent link="b"/><child link="l"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        f'<joint name="k" type="revolute"><parent link="l"/><child link="m"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
        f'<limit {limit} effort="1" velocity="1"/></joint></robot>'
    )


@pytest.fixture
def read(tmp_path):
    def reader(text):
        (tmp_path / "r.urdf").write_text(text)
        return load_robot(tmp_path / "r.urdf")

    return reader


# -- numbers -----------------------------------------------------------------------------------------------------------

NOT_NUMBERS = [
    "0_0.2", "1_0", "\u00a00.2", "0.2\u2003", "\u0660.\u0662", "\u096a", "\uff11", "\u00b2", "0x10", "1e", "1.2.3", "0,2",
]  # fmt: skip


@pytest.mark.parametrize("text", NOT_NUMBERS)
@pytest.mark.parametrize("place", ["origin", "scale", "block"])
def test_a_text_that_readers_differ_on_is_refused(text, place, read):
    """What Python takes for one number and an engine's `atof` for another is an error at every place."""
    whole = arm(origin=f"0 0 {text}" if place == "origin" else "0 0 0.2")
    if place == "scale":
        whole = whole.replace("</link>", f'<collision><geometry><box size="1 1 {text}"/></geometry></collision></link>', 1)
    if place == "block":
        block = '<plugin filename="libsea_plugin.so" name="p"><joint>j</joint><operation_mode>3</operation_mode>{}</plugin>'
        block = block.format(f"<spring_k>{text}</spring_k>")
        whole = whole.replace("</robot>", f"<gazebo>{block}</gazebo></robot>")
    with pytest.raises(RobotError):
        read(whole)


def test_blanks_of_xml_are_blanks_to_all(read):
    robot = read(arm(origin="0&#9;0\n&#13; 0.2 ", mass="&#9;0.5 "))
    assert robot.joint("k").origin == (0.0, 0.0, 0.2)
    assert 'xyz="0.0 0.0 0.2"' in engine_urdf(robot)[0]


@given(st.text(max_size=8) | st.from_regex(r"[+-]?[0-9_.eE \u00a0]{1,8}", fullmatch=True))
def test_a_number_is_what_c_reads_or_an_error(text):
    """Whatever is read is ASCII and the whole of it a C number: atof, which engines use, cannot read another."""
    for read_one in (plain_number, lambda text: read_number(text)[0]):
        try:
            value = read_one(text)
        except ValueError:
            continue
        body = text.partition("#")[0].strip(" \t\r\n") if read_one is not plain_number else text.strip(" \t\r\n")
        if re.fullmatch(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", body):
            assert value == float(body)
        else:
            assert body.isascii()
            assert "_" not in body


# -- axes --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "warned"),
    [
        ("0 2 0", True),
        ("0 1.0005 0", True),
        ("0 1e-9 0", True),
        ("0 1.0000001 0", False),
        ("0 0.707 0.707", False),
        ("1e-200 0 0", True),
    ],
)
def test_an_axis_reaches_the_engine_as_its_direction(axis, warned, read):
    robot = read(arm(axis=axis))
    assert ("axis-length" in {problem.code for problem in robot.warnings}) == warned
    written = [
        [float(word) for word in element.get("xyz").split()] for element in etree.fromstring(engine_urdf(robot)[0]).iter("axis")
    ]
    assert [math.hypot(*xyz) for xyz in written] == pytest.approx([1.0, 1.0], rel=1e-15)


# -- the text is the data ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_the_text_says_what_was_read(seed, tmp_path):
    """Written and read again it is the same robot, every number by its bits, inertias by their tensor."""
    (tmp_path / "r.urdf").write_text(random_urdf(seed))
    robot = load_robot(tmp_path / "r.urdf")
    (tmp_path / "again.urdf").write_text(engine_urdf(robot)[0])
    again = load_robot(tmp_path / "again.urdf")
    plain = [replace(joint, line=None) for joint in robot.joints]
    assert [replace(joint, line=None) for joint in again.joints] == plain
    for one, other in zip(robot.links, again.links, strict=True):
        assert (one.name, one.mass or 0.0, one.centre_of_mass) == (other.name, other.mass or 0.0, other.centre_of_mass)
        largest = np.abs(inertia_tensor(one)).max() or 1.0
        assert np.abs(inertia_tensor(one) - inertia_tensor(other)).max() <= 4e-15 * largest


def test_nothing_but_the_data_gets_through(read):
    robot = read(
        arm().replace(
            "</link>",
            '<contact><rolling_friction value="9"/></contact><visual><geometry><sphere radius="1"/></geometry></visual>'
            '<self_collision/><collision concave="yes" group="3"><geometry><capsule radius="1" length="2"/></geometry>'
            "</collision></link>",
            1,
        ).replace("</joint>", '<dynamics damping="7" friction="7"/><safety_controller soft_lower_limit="1"/></joint>', 1)
    )  # fmt: skip
    root = etree.fromstring(engine_urdf(robot)[0])
    assert {element.tag for element in root.iter()} == {
        "robot", "link", "inertial", "origin", "mass", "inertia", "collision", "geometry", "capsule", "joint", "parent",
        "child", "axis", "limit",
    }  # fmt: skip
    attributes = {key for element in root.iter() for key in element.attrib}
    assert not attributes & {"concave", "group", "damping", "friction", "soft_lower_limit"}


def test_colours_by_name_and_of_their_own(read):
    visual = '<visual><geometry><sphere radius="1"/></geometry><material name="{}">{}</material></visual>'
    shapes = visual.format("red", "") + visual.format("own", '<color rgba="0 1 0 1"/>') + visual.format("none", "")
    text = arm().replace("</link>", shapes + "</link>", 1)
    robot = read(text.replace("<link", '<material name="red"><color rgba="1 0 0 0.5"/></material><link', 1))
    assert [shape.colour for shape in robot.links[1].visuals] == [(1.0, 0.0, 0.0, 0.5), (0.0, 1.0, 0.0, 1.0), None]


@pytest.mark.parametrize(
    ("geometry", "words"),
    [
        ("<mesh/>", "l.collision.mesh: attribute 'filename' is missing"),
        ('<ellipsoid radius="1"/>', "l.collision.ellipsoid: this shape is unknown; choose from box"),
        ('<spere radius="1"/>', "Did you mean 'sphere'?"),
        ('<sphere radius="0"/>', "l.collision.sphere: 'radius' must be larger than 0"),
        ('<box size="1 1 0"/>', "l.collision.box: 'size' must be larger than 0"),
        ('<mesh filename="a.stl" scale="1 0 1"/>', "'scale' must not be 0"),
        ('<mesh filename="a.stl" scale="x"/>', "is not a number"),
    ],
)
def test_shapes_that_cannot_be_made(geometry, words, read):
    text = arm().replace("</link>", f"<collision><geometry>{geometry}</geometry></collision></link>", 1)
    with pytest.raises(RobotError, match=re.escape(words)):
        read(text)
    robot = read(text.replace("collision>", "visual>"))
    (warning,) = [problem for problem in robot.warnings if problem.code == "visual-shape"]
    assert words.partition(";")[0].replace("collision", "visual") in str(warning)
    assert robot.links[1].visuals == ()


# -- the same bodies to all --------------------------------------------------------------------------------------------


@given(angle, st.one_of(angle, st.sampled_from([math.pi / 2, -math.pi / 2, 1.5708, -1.5708, 1.5707963])), angle)
def test_angles_give_their_rotation_back(roll, pitch, yaw):
    rotation = rotation_matrix((roll, pitch, yaw))
    assert np.abs(rotation_matrix(roll_pitch_yaw(rotation)) - rotation).max() < 4e-16 * 3


@given(hnp.arrays(float, (3, 3), elements=st.floats(-1.0, 1.0)), st.tuples(angle, angle, angle))
def test_principal_axes_give_the_tensor_back(root, rpy):
    tensor = root @ root.T
    xx, xy, xz, yy, yz, zz = tensor[np.triu_indices(3)].tolist()
    link = Link(name="l", mass=1.0, inertia=(xx, xy, xz, yy, yz, zz), inertial_rpy=rpy)
    moments, axes = principal_axes(link)
    turned = rotation_matrix(axes)
    assert min(moments) >= 0.0
    difference = turned @ np.diag(moments) @ turned.T - inertia_tensor(link)
    assert np.abs(difference).max() <= 1e-14 * max(np.abs(tensor).max(), 1e-300)


@pytest.mark.parametrize("seed", range(4))
def test_links_of_the_file_are_found_in_the_merged_robot(seed, tmp_path):
    (tmp_path / "r.urdf").write_text(random_urdf(seed, moving=3, fixed=8))
    robot = load_robot(tmp_path / "r.urdf")
    merged = merge_fixed(robot)
    assert merged.places.keys() == {link.name for link in robot.links}
    before, bodies = link_poses(robot), link_poses(merged.robot)
    for name, place in merged.places.items():
        body = bodies[place.body]
        assert np.abs(body.position + body.rotation @ place.pose.position - before[name].position).max() < 1e-14
        assert np.abs(body.rotation @ place.pose.rotation - before[name].rotation).max() < 1e-14
    for body in merged.robot.links:
        assert merged.places[body.name].body == body.name
        assert merged.places[body.name].pose.is_identity


def test_shapes_move_with_their_link(read):
    text = arm().replace(
        "</robot>",
        '<link name="hand"><collision><origin xyz="0 0 1" rpy="0 1.5708 0"/><geometry><sphere radius="1"/></geometry>'
        '</collision></link><joint name="f" type="fixed"><parent link="m"/><child link="hand"/>'
        '<origin xyz="1 0 0" rpy="0 1.5708 0"/></joint></robot>',
    )
    (shape,) = merge_fixed(read(text)).robot.links[2].collisions
    assert shape.origin == pytest.approx((2.0, 0.0, 0.0), abs=1e-5)
    assert np.abs(rotation_matrix(shape.rpy) - rotation_matrix((0, 3.1416, 0))).max() < 1e-8


# -- engines -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "limit", "expected"),
    [
        ("revolute", 'lower="-inf" upper="inf"', None),
        ("prismatic", 'lower="-inf" upper="inf"', None),
        ("revolute", 'lower="-1" upper="inf"', (-1.0, 1e9)),
        ("prismatic", 'lower="-1" upper="2"', (-1.0, 2.0)),
        ("continuous", 'lower="-1" upper="2"', None),
    ],
)
def test_limits_of_a_joint_reach_the_engine(kind, limit, expected, read):
    p = pytest.importorskip("pybullet")

    text = arm(limit=limit)
    place = text.index('name="k" type="revolute"')
    robot = read(text[:place] + text[place:].replace("revolute", kind, 1))
    path = robot.path.with_name("e.urdf")
    path.write_text(engine_urdf(robot)[0])
    client = p.connect(p.DIRECT)
    try:
        body = p.loadURDF(str(path), physicsClientId=client)
        info = p.getJointInfo(body, 1, client)
    finally:
        p.disconnect(client)
    assert info[2] == (p.JOINT_PRISMATIC if kind == "prismatic" else p.JOINT_REVOLUTE)
    if expected is None:
        assert info[8] > info[9]
    else:
        assert info[8:10] == expected
