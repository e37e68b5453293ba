"""Meshes, overrides and inertia."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asrsim.robot import with_overrides
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.meshes import usable_shapes


def pendulum(*, block="", body=""):
    """A mass of 0.2 kg at 0.04 m below the joint."""
    return f"""<robot name="p"><link name="world"/>
<joint name="j" type="revolute"><parent link="world"/><child link="l"/><axis xyz="0 1 0"/>
<limit effort="300" velocity="100" lower="-3" upper="3"/></joint>
<link name="l"><inertial><origin xyz="0 0 -0.04"/><mass value="0.2"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6"/></inertial>{body}</link>{block}</robot>"""


def plugin(actuator, mode, tags=""):
    return (
        f'<gazebo><plugin name="a" filename="lib{actuator}_plugin.so"><joint>j</joint><operation_mode>{mode}</operation_mode>'
        f"{tags}</plugin></gazebo>"
    )


# -- meshes ------------------------------------------------------------------------------------------------------------

TRIANGLE = bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
"""A binary STL file."""


def mesh(name):
    return f'<geometry><mesh filename="{name}" scale="1 1 1"/></geometry>'


def test_meshes_are_resolved_only_inside_the_folder_and_named_packages(read, tmp_path_factory, tmp_path):
    outside, package = tmp_path_factory.mktemp("outside"), tmp_path_factory.mktemp("package")
    (tmp_path / "near").mkdir()
    for folder in (outside, package, tmp_path, tmp_path / "near"):
        (folder / "m.stl").write_bytes(TRIANGLE)
    (tmp_path / "link.stl").symlink_to(outside / "m.stl")
    names = [
        "m.stl", str(tmp_path / "m.stl"), "file://" + str(tmp_path / "m.stl"), "package://pkg/m.stl",
        "package://near/m.stl", str(outside / "m.stl"), f"../{outside.name}/m.stl", "link.stl", "package://pkg/../m.stl", "package://other/m.stl",
        "http://host/m.stl", "none.stl", "m.txt",
    ]  # fmt: skip
    robot = read(pendulum(body="".join(f"<collision>{mesh(name)}</collision>" for name in names)))
    usable, warnings = usable_shapes(robot, package_paths={"pkg": package})
    found = [Path(shape.mesh) for shape in usable.links[1].collisions]
    assert found == [
        *[(tmp_path / "m.stl").resolve()] * 3,
        *((one / "m.stl").resolve() for one in (package, tmp_path / "near")),
    ]
    assert [problem.value for problem in warnings] == names[5:]
    assert {problem.key for problem in warnings} == {"l"}


def test_missing_visuals_share_one_warning(read):
    robot = read(pendulum(body=f"<visual>{mesh('a.dae')}</visual><visual>{mesh('b.dae')}</visual>"))
    drawn, warnings = usable_shapes(robot, visuals=True)
    assert not any(link.visuals for link in drawn.links)
    assert [problem.code for problem in warnings] == ["missing-visual-mesh"]
    assert usable_shapes(robot)[1] == ()


def test_packages_of_the_environment_are_found(read, tmp_path_factory, monkeypatch):
    prefix = tmp_path_factory.mktemp("prefix")
    (prefix / "share/pkg").mkdir(parents=True)
    (prefix / "share/pkg/m.stl").write_bytes(TRIANGLE)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    robot = read(pendulum(body=f"<collision>{mesh('package://pkg/m.stl')}</collision>"))
    assert usable_shapes(robot)[1] == ()


# -- inertia -----------------------------------------------------------------------------------------------------------


def test_a_link_without_inertia_is_a_point_mass(read):
    robot = read(pendulum())
    points = replace(robot, links=tuple(replace(link, inertia=None) for link in robot.links))
    assert RobotModel(points).mass_matrix(np.zeros(1)) == pytest.approx(np.array([[0.2 * 0.04**2]]))


# -- overrides ---------------------------------------------------------------------------------------------------------


def test_controller_defaults_follow_the_mode(read):
    robot = read(pendulum(block=plugin("sea", 5, "<ctrl_P>99</ctrl_P>")))
    values = with_overrides(robot, modes={"*": 1}).actuators[0].values()
    assert (values["controller_1_proportional"], values["controller_1_derivative"]) == (99.0, 0.2)
    back = with_overrides(with_overrides(robot, modes={"*": 1}), modes={"*": 5})
    assert back == robot
