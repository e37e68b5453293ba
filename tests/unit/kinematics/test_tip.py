"""The tip of a Cartesian task: logged, claimed, summarised, repeated bit for bit; in the right place."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import ScenarioError
from asrsim.samples import TIP, TIP_GOAL
from support.robots import write_plain_arm

LENGTHS = (0.25, 0.2)
GOAL = (0.25, 0.0, 0.4)


def arm_task(folder, **changes):
    """Two upright rods about y; the hand goes from its start to a goal in 0.5 s."""
    keys = {
        "duration": 1.0,
        "actuators": {"*": {"type": "sea", "mode": 3, "parameters": {"spring_k": 60.0}}},
        "initial": {"joint_1": 0.3, "joint_2": 0.8},
        "task": {
            "link": "link_2",
            "point": [0, 0, LENGTHS[1]],
            "gravity_compensation": True,
            "poses": [{"time": 0.5, "position": list(GOAL)}],
        },
    }
    return asrsim.make_scenario(write_plain_arm(folder, lengths=LENGTHS, masses=(0.3, 0.2)), **(keys | changes))


def closed_form(result):
    first = result["joint_1"].link_position
    both = first + result["joint_2"].link_position
    x = LENGTHS[0] * np.sin(first) + LENGTHS[1] * np.sin(both)
    z = 0.1 + LENGTHS[0] * np.cos(first) + LENGTHS[1] * np.cos(both)
    return np.stack([x, np.zeros_like(x), z], axis=1)


def test_tip_and_goal_are_those_of_chain_and_path(tmp_path):
    result = asrsim.run(arm_task(tmp_path))
    assert result.bodies[TIP][:, :3] == pytest.approx(closed_form(result), abs=1e-12)
    goal = result.bodies[TIP_GOAL]
    assert goal[0, :3] == pytest.approx(closed_form(result)[0], abs=1e-12)
    assert goal[result.time >= 0.5][:, :3] == pytest.approx(np.tile(GOAL, (int(sum(result.time >= 0.5)), 1)), abs=1e-12)
    errors = np.linalg.norm(closed_form(result) - goal[:, :3], axis=1)
    tip = result.summary.tip
    assert tip["largest"] == pytest.approx(errors.max(), rel=1e-12)
    assert tip["rms"] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-12)
    assert tip["last"] == pytest.approx(errors[-100:].mean(), rel=1e-2)


def test_a_turned_base_carries_the_tip_along(tmp_path):
    base = {"position": [1.0, -2.0, 0.5], "rpy": [0.0, 0.0, np.pi / 2]}
    task = dict(arm_task(tmp_path).resolved["task"], poses=[{"time": 0.5, "position": [1.0, -1.75, 0.9]}])
    result = asrsim.run(arm_task(tmp_path, base=base, task=task))
    plain = closed_form(result)
    turned = np.stack([1.0 - plain[:, 1], -2.0 + plain[:, 0], 0.5 + plain[:, 2]], axis=1)
    assert result.bodies[TIP][:, :3] == pytest.approx(turned, abs=1e-12)


def test_a_claim_about_the_tip_needs_a_task(tmp_path):
    claim = {"body": "tip", "quantity": "error", "measure": "maximum", "comparison": "<", "value": 1.0}
    with pytest.raises(ScenarioError, match="no object 'tip'"):
        arm_task(tmp_path, task=None, expect=[claim])
    ball = {"tip": {"shape": "sphere", "size": 0.1}}
    with pytest.raises(ScenarioError, match="cannot have the name 'tip'"):
        arm_task(tmp_path, world={"objects": ball})
