"""What reaches an engine: the numbers that were read, all digits of them, and nothing else; fixed links merged exactly."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from asrsim.errors import RobotError
from asrsim.robot import load_robot, merge_fixed
from asrsim.robot.doubts import warnings_of
from asrsim.robot.inertia import inertia_tensor, principal_axes
from asrsim.robot.model import Link
from asrsim.robot.numbers import plain_number, read_number
from asrsim.robot.poses import link_poses, roll_pitch_yaw, rotation_matrix
from support.random_robots import random_urdf

angle = st.floats(-7.0, 7.0)


def arm(*, axis="0 1 0", origin="0 0 0.2", mass="0.5"):
    """Two joints, the second of them with what is to be read."""
    inertial = '<inertial><origin xyz="0 0 -0.1"/><mass value="{}"/><inertia ixx="1e-3" iyy="2e-3" izz="3e-3"/></inertial>'
    return (
        f'<robot name="r"><link name="b"/><link name="l">{inertial.format("0.3")}</link>'
        f'<link name="m">{inertial.format(mass)}</link>'
        '<joint name="j" type="revolute"><parent link="b"/><child link="l"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        f'<joint name="k" type="revolute"><parent link="l"/><child link="m"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )


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
def test_an_axis_is_read_as_its_direction(axis, warned, read):
    robot = read(arm(axis=axis))
    assert ("axis-length" in {problem.code for problem in warnings_of(robot)}) == warned
    assert [math.hypot(*joint.axis) for joint in robot.joints] == pytest.approx([1.0, 1.0], rel=1e-15)


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
        ('<sphere radius="-1"/>', "l.collision.sphere: 'radius' must be larger than 0"),
        ('<box size="1 1 -1"/>', "l.collision.box: 'size' must be larger than 0"),
        ('<mesh filename="a.stl" scale="x"/>', "is not a number"),
    ],
)
def test_shapes_that_cannot_be_made(geometry, words, read):
    text = arm().replace("</link>", f"<collision><geometry>{geometry}</geometry></collision></link>", 1)
    with pytest.raises(RobotError, match=re.escape(words)):
        read(text)
    robot = read(text.replace("collision>", "visual>"))
    (warning,) = [problem for problem in warnings_of(robot) if problem.code == "visual-shape"]
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
