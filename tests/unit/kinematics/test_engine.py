"""The engine's model of a robot against differences of its own poses, and plans on the example arm."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.kinematics import model_of, plan_references, plan_task
from asrsim.robot import load_robot
from asrsim.scenario import load_scenario, make_scenario
from support.paths import EXAMPLES

ARM = EXAMPLES / "urdf" / "dof5_arm.urdf"
TIP = (0.094, 0.02, 0.03)


@pytest.fixture
def turned_arm(tmp_path):
    """The arm with centres of mass off its axes and inertias turned: Bullet's frames then differ from the URDF's."""
    text = ARM.read_text()
    text = text.replace('<origin xyz="0.0543 0 0"/>', '<origin xyz="0.0543 0.01 0.02" rpy="0.5 0.3 1.0"/>')
    text = text.replace('<origin xyz="0.0793 0 0"/>', '<origin xyz="0.0793 0.02 0" rpy="1 0 0.3"/>')
    path = tmp_path / "turned.urdf"
    path.write_text(text)
    return path


@pytest.mark.parametrize("base", [{}, {"position": [1.0, 2.0, 3.0], "rpy": [0.3, 0.5, 1.0]}])
def test_jacobian_is_the_slope_of_the_pose(turned_arm, base):
    scenario = make_scenario(turned_arm, duration=1.0, base=base)
    q = np.array([0.3, 0.2, -0.4, 0.7, 0.5])
    nudge = 1e-3
    with model_of(scenario, load_robot(turned_arm)) as model:
        jacobian = model.jacobian(q, "link_5", TIP)
        for joint in range(5):
            step = nudge * np.eye(5)[joint]
            (ahead, turned), (behind, before) = model.pose(q + step, "link_5", TIP), model.pose(q - step, "link_5", TIP)
            spin = (turned - before) @ model.pose(q, "link_5", TIP)[1].T / (2 * nudge)
            assert jacobian[:3, joint] == pytest.approx((ahead - behind) / (2 * nudge), abs=3e-4)
            assert jacobian[3:, joint] == pytest.approx([spin[2, 1], spin[0, 2], spin[1, 0]], abs=3e-4)


def test_gravity_torques_are_the_slope_of_the_potential(turned_arm):
    """The potential from the poses of the centres of mass, on a base that is turned."""
    scenario = make_scenario(turned_arm, duration=1.0, base={"rpy": [0.3, 0.5, 1.0]})
    robot = load_robot(turned_arm)
    q = np.array([0.3, 0.2, -0.4, 0.7, 0.5])
    with model_of(scenario, robot) as model:

        def potential(positions):
            return sum(
                9.81 * link.mass * model.pose(positions, link.name, link.centre_of_mass)[0][2]
                for link in robot.links
                if link.mass
            )

        slope = [(potential(q + step) - potential(q - step)) / 2e-3 for step in 1e-3 * np.eye(5)]
        assert model.gravity_torques(q) == pytest.approx(slope, abs=2e-3)


def box_push():
    scenario = load_scenario(EXAMPLES / "scenarios" / "box_push_5dof.yaml", variant="soft")[0]
    return scenario, load_robot(scenario.robot)


def test_the_planned_tip_stays_on_the_path():
    scenario, robot = box_push()
    planned = plan_task(scenario, robot)
    assert planned.path.position_error.max() < 1e-4
    with model_of(scenario, robot) as model:
        start, _ = model.pose(planned.path.positions[0], "link_5", (0.094, 0.0, 0.0))
        goal, _ = model.pose(planned.path.positions[-1], "link_5", (0.094, 0.0, 0.0))
    assert start == pytest.approx([0.30, -0.10, 0.1565], abs=1e-4)
    assert goal == pytest.approx([0.30, 0.10, 0.1565], abs=1e-6)


def test_only_joints_that_carry_weight_are_compensated():
    """Joints 1 and 4 turn about the vertical; 2 and 3 carry the arm."""
    planned = plan_task(*box_push())
    equilibria = np.column_stack([given["equilibrium_position"] for given in planned.references.values()])
    shift = np.abs(equilibria - planned.path.positions).max(axis=0)
    assert shift[[0, 3]] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert shift[1] > 0.2
    assert shift[2] > 0.1


def test_a_changing_preset_of_the_references_is_kept_and_compensated():
    scenario, robot = box_push()
    preset = {"waypoints": [[0.0, 0.2], [8.0, 0.6]]}
    changed = make_scenario(
        robot.path,
        duration=8.0,
        initial=dict(scenario.initial_positions),
        references={joint.name: {"stiffness_preset": preset} for joint in robot.moving_joints},
        task={
            "link": "link_5", "point": [0.094, 0.0, 0.0], "gravity_compensation": True,
            "poses": [{"time": 0.0, "position": [0.30, -0.10, 0.1565]}],
        },
    )  # fmt: skip
    references = plan_references(changed, robot).references["joint_2"]
    time = np.array([0.0, 8.0])
    assert references["stiffness_preset"].values(time) == pytest.approx([0.2, 0.6])
    lift = np.abs(references["equilibrium_position"].values(time))
    assert lift[1] < 0.1 * lift[0]
