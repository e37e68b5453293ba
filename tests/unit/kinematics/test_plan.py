"""Plans on the example arm, with the engine's model of the robot."""

import numpy as np
import pytest

from asrsim.kinematics import plan_references, plan_task
from asrsim.robot import load_robot
from asrsim.robot.dynamics import robot_model
from asrsim.scenario import load_scenario, make_scenario
from support.paths import EXAMPLES


def box_push():
    scenario = load_scenario(EXAMPLES / "scenarios" / "box_push_5dof.yaml", variant="soft")[0]
    return scenario, load_robot(scenario.robot)


def test_the_planned_tip_stays_on_the_path():
    scenario, robot = box_push()
    path, _ = plan_task(scenario, robot)
    assert path.position_error.max() < 1e-4
    model = robot_model(scenario, robot)
    start, _ = model.pose(path.positions[0], "link_5", (0.094, 0.0, 0.0))
    goal, _ = model.pose(path.positions[-1], "link_5", (0.094, 0.0, 0.0))
    assert start == pytest.approx([0.30, -0.10, 0.1565], abs=1e-4)
    assert goal == pytest.approx([0.30, 0.10, 0.1565], abs=1e-6)


def test_only_joints_that_carry_weight_are_compensated():
    """Joints 1 and 4 turn about the vertical; 2 and 3 carry the arm."""
    path, planned = plan_task(*box_push())
    equilibria = np.column_stack([given["equilibrium_position"] for given in planned.values()])
    shift = np.abs(equilibria - path.positions).max(axis=0)
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
            "link": "link_5",
            "point": [0.094, 0.0, 0.0],
            "gravity_compensation": True,
            "poses": [{"time": 0.0, "position": [0.30, -0.10, 0.1565]}],
        },
    )
    references = plan_references(changed, robot).references["joint_2"]
    time = np.array([0.0, 8.0])
    assert references["stiffness_preset"].values(time) == pytest.approx([0.2, 0.6])
    lift = np.abs(references["equilibrium_position"].values(time))
    assert lift[1] < 0.1 * lift[0]
