"""Robots as their packages ship them, with actuators added: driven and drawn; and their bodies in every engine."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from asrsim.engines import ENGINES
from asrsim.robot import load_robot
from asrsim.robot.meshes import usable_shapes
from asrsim.scenario import make_scenario
from asrsim.simulation.run import simulate
from support.pinocchio_model import PinocchioModel, differences, without_stops
from support.random_robots import random_urdf

BLOCK = (
    '<gazebo><plugin name="{0}" filename="libsea_plugin.so"><joint>{0}</joint><operation_mode>3</operation_mode>'
    "<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau><spring_k>500</spring_k>"
    "</plugin></gazebo>"
)
SHIPPED = {
    "franka_panda/panda.urdf": True,
    "a1/a1.urdf": False,
}
"""Robot of pybullet_data -> whether its base is fixed."""


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_robot_is_driven_and_drawn(name, tmp_path):
    data = Path(pytest.importorskip("pybullet_data").getDataPath())
    shutil.copytree((data / name).parent, tmp_path / "robot")
    path = tmp_path / "robot" / Path(name).name
    blocks = "".join(BLOCK.format(joint.name) for joint in load_robot(path).moving_joints)
    path.write_text(path.read_text().replace("</robot>", blocks + "</robot>"))
    robot = load_robot(path)
    assert len(robot.actuators) == len(robot.moving_joints)
    drawn, warnings = usable_shapes(robot, visuals=True)
    assert not [problem for problem in warnings if problem.code.startswith("missing")]
    assert [len(link.visuals) for link in drawn.links] == [len(link.visuals) for link in robot.links]
    run = simulate(make_scenario(path, duration=0.02, base={"fixed": SHIPPED[name], "position": [0, 0, 1]}))
    assert run.samples is not None
    assert np.isfinite(run.samples.values["link_position"]).all()


# -- engines -----------------------------------------------------------------------------------------------------------


def same_bodies(name, robot, text):
    """Accelerations of the engine's robot are those of the URDF text."""
    joints = [joint.name for joint in robot.moving_joints]
    q, v = np.random.default_rng(0).uniform(-2.0, 2.0, (2, len(joints)))
    engine, _ = ENGINES.get(name).make(make_scenario(robot.path, duration=0.01, engine=name), without_stops(robot))
    try:
        assert differences(engine, PinocchioModel(text, joints), q, v).max() < 1e-12
    finally:
        engine.close()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_engines_have_the_bodies_of_the_file(engine, seed, tmp_path):
    (tmp_path / "r.urdf").write_text(random_urdf(seed, moving=1 + seed % 7, fixed=seed, massless_root=seed % 2 == 0))
    robot = load_robot(tmp_path / "r.urdf")
    same_bodies(engine, robot, robot.text)


@pytest.mark.parametrize("version", ["v2", "v3"])
@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_engines_have_the_bodies_of_alterego(engine, version, shared):
    robot = load_robot(shared / f"robots/alterego/alterego_{version}_fixedbase-true_fixedhands-true.urdf")
    same_bodies(engine, robot, robot.text)


@pytest.mark.parametrize("inertia", [(0.0, 0, 0, 1e-2, 0, 1e-2), (1e-3, 0, 0, 1e-3, 0, 1.0), (0.0, 0, 0, 0.0, 0, 0.0)])
@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_bodies_that_are_none_are_simulated_as_they_are(engine, inertia, tmp_path):
    """A rod, a body against the triangle inequality, a point: warnings to us, which some engines refuse to build."""
    xx, xy, xz, yy, yz, zz = inertia
    tensor = f'<inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>'
    root, link, *others = re.split("(?=<link )", random_urdf(1, moving=2, fixed=0))[1:]
    (tmp_path / "r.urdf").write_text("".join(['<robot name="r">', root, re.sub("<inertia .*?/>", tensor, link), *others]))
    robot = load_robot(tmp_path / "r.urdf")
    assert robot.links[1].inertia == inertia
    same_bodies(engine, robot, robot.text)
