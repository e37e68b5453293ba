"""Kinematics and dynamics of robots, compared with Pinocchio."""

import numpy as np
import pinocchio
import pytest

from asrsim.robot import load_robot
from asrsim.robot.chain_masses import find_masses
from asrsim.robot.dynamics import RobotModel
from support.paths import ROOT
from support.pinocchio_model import PinocchioModel
from support.random_robots import random_urdf

POINT = (0.1, -0.2, 0.3)


@pytest.fixture(params=["dof5_arm", 0, 3, 9])
def pair(request, tmp_path):
    """Model of a robot on a turned base, and Pinocchio's model of the robot in the frame of the base."""
    path = ROOT / "examples" / "urdf" / f"{request.param}.urdf"
    if isinstance(request.param, int):
        path = tmp_path / "robot.urdf"
        path.write_text(random_urdf(request.param, moving=6, fixed=3))
    robot, gravity = load_robot(path), np.array([1.0, 2.0, -9.0])
    model = RobotModel(robot, base_position=(0.1, -0.2, 0.3), base_rpy=(0.4, -0.3, 0.7), gravity=tuple(gravity))
    base = model.pose(np.zeros(len(model.joints)), robot.root.name, (0.0, 0.0, 0.0))
    return model, PinocchioModel(robot.text, model.joints, base[1].T @ gravity), base


def test_many_postures_have_the_dynamics_of_pinocchio(pair):
    model, truth, _ = pair
    q, v, a = np.random.default_rng(1).normal(size=(3, 4, len(model.joints)))
    masses, torques, energies = model.mass_matrix(q), model.inverse_dynamics(q, v, a), model.energy(q, v)
    for row in range(4):
        mass = truth.mass_matrix(q[row])
        assert masses[row] == pytest.approx(mass, abs=1e-12)
        assert torques[row] == pytest.approx(mass @ a[row] + truth.bias(q[row], v[row]), abs=1e-11)
        assert energies[row] - energies[0] == pytest.approx(truth.energy(q[row], v[row]) - truth.energy(q[0], v[0]), abs=1e-11)


def test_the_stiffness_of_gravity_is_the_slope_of_its_torques(pair):
    model, _, _ = pair
    q = np.random.default_rng(2).normal(size=(4, len(model.joints)))
    steps = 1e-5 * np.eye(len(model.joints))
    torques, stiffness = model.gravity_stiffness(q)
    slopes = (model.gravity_torques(q[:, None] + steps) - model.gravity_torques(q[:, None] - steps)) / 2e-5
    assert torques == pytest.approx(model.gravity_torques(q), abs=1e-12)
    assert stiffness == pytest.approx(slopes, abs=1e-8)


def test_one_posture_has_the_mass_matrix_of_pinocchio(pair):
    model, truth, _ = pair
    q = np.random.default_rng(3).normal(size=len(model.joints))
    matrix = np.full((len(q), len(q)), np.nan)
    find_masses(model.chain(), q, matrix)
    assert matrix == pytest.approx(truth.mass_matrix(q), abs=1e-12)


def test_all_links_have_the_poses_and_jacobians_of_pinocchio(pair):
    """Links behind fixed joints are included."""
    model, truth, (origin, turn) = pair
    q = np.random.default_rng(2).normal(size=len(model.joints))
    pinocchio.computeJointJacobians(truth.model, truth.data, truth.configuration(q))
    pinocchio.updateFramePlacements(truth.model, truth.data)
    for link in model.links:
        frame = truth.model.getFrameId(link)
        pose = truth.data.oMf[frame]
        at, rotation = model.pose(q, link, POINT)
        assert at == pytest.approx(origin + turn @ (pose.translation + pose.rotation @ POINT), abs=1e-9)
        assert rotation == pytest.approx(turn @ pose.rotation, abs=1e-9)
        jacobian = pinocchio.getFrameJacobian(truth.model, truth.data, frame, pinocchio.LOCAL_WORLD_ALIGNED)[:, truth.order]
        jacobian[:3] += np.cross(jacobian[3:].T, pose.rotation @ POINT).T
        assert model.jacobian(q, link, POINT) == pytest.approx(np.vstack([turn @ jacobian[:3], turn @ jacobian[3:]]), abs=1e-9)


def test_a_floating_base_lightens_the_joints(tmp_path):
    """Mass matrix of the joints with a free base, by the equations of motion of the whole robot."""
    path = tmp_path / "robot.urdf"
    path.write_text(random_urdf(4, moving=4, fixed=2))
    model = RobotModel(load_robot(path), floating=True)
    truth = pinocchio.buildModelFromUrdf(str(path), pinocchio.JointModelFreeFlyer())
    q = np.random.default_rng(3).normal(size=len(model.joints))
    order = [truth.joints[truth.getJointId(joint)].idx_v for joint in model.joints]
    turn = np.zeros(truth.nv)
    turn[order] = q
    configuration = pinocchio.integrate(truth, pinocchio.neutral(truth), turn)
    inverse = np.linalg.inv(pinocchio.crba(truth, truth.createData(), configuration))
    assert model.mass_matrix(q) == pytest.approx(np.linalg.inv(inverse[np.ix_(order, order)]), rel=1e-9, abs=1e-12)
