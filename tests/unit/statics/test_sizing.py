"""Sag under the arm's own weight, compared with simulations; proposed parameters."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import asrsim
from asrsim.robot.model import Joint, Robot
from asrsim.scenario import apply_to_robot, make_scenario
from asrsim.starter.robot import write_starter
from asrsim.statics.sizing import Holding, Sizing, problems_of_weight, sizing
from support.examined import checked_robot
from support.random_robots import random_urdf
from support.robots import PLAIN_ARM, write_plain_arm


def scenario_of(robot, **keys):
    return make_scenario(robot, **{"duration": 4.0, **keys})


FURTHER_RESTS = (("sea", 0.45, 6), ("qbmove", 0.3, 3), ("qbmove", 0.45, 6), ("bavs", 0.3, 3))


def judged(scenario):
    robot, _ = checked_robot(scenario)
    return sizing(scenario, apply_to_robot(scenario, robot))


def warned(scenario):
    return problems_of_weight(judged(scenario), apply_to_robot(scenario, checked_robot(scenario)[0]))


@pytest.mark.parametrize(
    ("actuator", "preset", "mode", "most"),
    [
        ("sea", 0.3, 3, 6.8),
        ("bavs", 0.45, 6, 6.8),
        ("qbmove", 0.3, 6, 0.15),
        *(pytest.param(*case, 6.8, marks=pytest.mark.slow) for case in FURTHER_RESTS),
    ],
)
def test_the_expected_rest_is_that_of_the_simulation(tmp_path, actuator, preset, mode, most):
    """Ideal motors, or weak controllers with a steady-state error, some of which give their largest torque; a strongly damped
    run ends with the predicted sag.
    """
    weak = {"controller_{}_proportional": 6.0, "motor_{}_friction_torque": 0.0, "motor_{}_max_torque": most}
    motors = (1,) if actuator == "sea" else (1, 2)
    scenario = scenario_of(
        write_plain_arm(tmp_path, lengths=(0.2, 0.15), masses=(0.3, 0.2)),
        actuators={"*": {"type": actuator, "mode": mode}},
        parameters={"*": {name.format(i): value for name, value in weak.items() for i in motors}},
        references={"*": {"equilibrium_position": 0.5, **({} if actuator == "sea" else {"stiffness_preset": preset})}},
        link_damping={"*": {"constant": 0.05}},
        duration=12.0,
    )
    result = asrsim.run(scenario)
    joints = judged(scenario).joints
    assert any(one.limited for one in joints) == (most < 1.0)
    for one in joints:
        moved = result[one.joint].link_position
        assert abs(moved[-1] - moved[-200]) < 1e-4
        assert one.sag == pytest.approx(abs(moved[-1] - 0.5), abs=3e-3)


def test_the_end_of_a_run_is_among_many_instants(tmp_path):
    def sine(size, frequency, offset=0.0):
        return {"sinusoid": {"amplitude": size, "frequency": frequency, "offset": offset}}

    references = {
        # A quarter of a period: the arm leans out furthest at the end.
        "joint_1": {"equilibrium_position": sine(0.5, 1.0 / 16.0), "stiffness_preset": 0.3},
        "joint_2": {"equilibrium_position": sine(0.05, 0.3), "stiffness_preset": sine(0.05, 0.35, 0.4)},
        "joint_3": {"equilibrium_position": sine(0.05, 0.4), "stiffness_preset": sine(0.05, 0.45, 0.4)},
    }
    robot = write_plain_arm(tmp_path, lengths=(0.2, 0.15, 0.1), masses=(0.2, 0.1, 0.05))
    scenario = scenario_of(robot, actuators={"*": {"type": "qbmove", "mode": 3}}, references=references)
    assert judged(scenario).joints[0].time == 4.0


def test_a_long_hanging_arm_rests_where_its_torques_balance(tmp_path):
    """Upward gravity is far stiffer than the springs, and its torque on the first joint depends on all joints."""
    from scipy.optimize import fsolve

    lengths = (0.3, 0.3, 0.3, 0.3)
    goal, spring, masses = 0.4, 3.0, [0.2] * (len(lengths) - 1) + [1.5]
    scenario = scenario_of(
        write_plain_arm(tmp_path, lengths=lengths, masses=masses),
        gravity=[0.0, 0.0, 9.81],
        actuators={"*": {"type": "sea", "mode": 2, "parameters": {"spring_stiffness": spring, "max_deflection": 3.0}}},
        references={"*": {"reference_1": goal}},
    )

    def unbalanced(q):
        angles = np.cumsum(q)
        joints = np.concatenate([[0.0], np.cumsum(np.array(lengths) * np.sin(angles))])
        centres = joints[:-1] + 0.5 * np.array(lengths) * np.sin(angles)
        weights = [sum(9.81 * masses[j] * (centres[j] - joints[i]) for j in range(i, len(q))) for i in range(len(q))]
        return spring * (goal - q) - np.array(weights)

    rest = fsolve(unbalanced, np.full(len(lengths), 0.01), xtol=1e-10)
    found = [one.sag for one in judged(scenario).joints]
    assert found == pytest.approx(np.abs(rest - goal), abs=2e-3)


def test_a_falling_arm_gets_a_warning_and_a_sufficient_proposal(tmp_path):
    keys = {
        "actuators": "qbmove",
        "references": {"*": {"equilibrium_position": {"step": {"at": 0.1, "to": 0.5}}, "stiffness_preset": 0.3}},
    }
    robot = write_plain_arm(tmp_path)
    fallen = asrsim.run(scenario_of(robot, **keys))
    assert fallen["joint_1"].link_position.max() > PLAIN_ARM["upper"] - 1e-3
    falling = [warning for warning in fallen.summary.warnings if warning.code == "falls"]
    assert [warning.key for warning in falling] == ["joint_1"]
    proposal = judged(scenario_of(robot, **keys)).proposal
    damped = asrsim.run(scenario_of(robot, **keys, link_damping={"*": {"constant": 0.1}}))
    assert [warning.key for warning in damped.summary.warnings if warning.code == "on-stop"] == ["joint_1"]
    held = asrsim.run(scenario_of(robot, **keys, parameters=proposal))
    assert not [warning for warning in held.summary.warnings if warning.code in ("falls", "sags")]
    for joint in held.joints:
        assert abs(held[joint].link_position[-500:].mean() - 0.5) < 0.3


def test_a_warning_says_what_yields_and_why():
    weak = {"sag": 0.4, "scale": 1.0, "load": -1.5, "time": 2.0, "droop": 0.0}
    weak |= dict.fromkeys(("on_stop", "limited", "overloaded"), False)
    cases = {
        "turn_1": ({}, "sags by 0.4 rad", "1.5 N m at 2 s: its springs are too soft"),
        "turn_2": ({"droop": 0.3}, "sags by 0.4 rad", "1.5 N m at 2 s: the controllers of its motors are too soft"),
        "turn_3": ({"sag": 2.5}, "falls", "1.5 N m at 2 s: its springs are too soft"),
        "slide": ({"on_stop": True, "limited": True}, "falls onto its stop", "1.5 N at 2 s: its motors are too weak"),
        "slide_2": ({"overloaded": True}, "sags by 0.4 m", "1.5 N at 2 s: its effort limit of 7 N is too low"),
    }
    joints = tuple(
        Joint(name=name, kind="prismatic" if "slide" in name else "revolute", parent="a", child=name, effort=7.0)
        for name in cases
    )
    robot = Robot(name="arm", path=Path("arm.urdf"), text="", links=(), joints=joints, actuators=())
    holdings = tuple(Holding(joint=name, **{**weak, **own}) for name, (own, _, _) in cases.items())
    proposal = {"turn_1": {"spring_stiffness": 20.0, "motor_1_max_torque": 3.5}, "turn_3": {"spring_stiffness": 8.0}}
    said = problems_of_weight(Sizing(joints=holdings, proposal=proposal), robot, Path("arm.yaml"))
    assert [(one.key, one.message, one.code, one.file) for one in said] == [
        (name, f"{what} under the arm's own weight, {why}", "falls" if "falls" in what else "sags", Path("arm.yaml"))
        for name, (_, what, why) in cases.items()
    ]
    values = "{turn_1: {spring_stiffness: 20, motor_1_max_torque: 3.5}, turn_3: {spring_stiffness: 8}}"
    # One warning has the proposal for all joints; no parameter raises an effort limit.
    raised = "Raise `effort` in the <limit> of the robot's file"
    assert [one.hint for one in said] == [
        f"with parameters: {values} springs and motors hold the arm",
        None,
        None,
        None,
        raised,
    ]


def test_weak_motors_are_distinguished_from_soft_springs(tmp_path):
    robot = write_plain_arm(tmp_path)
    keys = {
        "actuators": {"*": {"type": "sea", "parameters": {"spring_k": 300.0, "motor_1_max_torque": 0.5}}},
        "references": {"*": {"equilibrium_position": -1.2}},
    }
    scenario = scenario_of(robot, **keys)
    problems = warned(scenario)
    assert problems
    assert all("motors are too weak" in problem.message for problem in problems)
    assert all("motor_1_max_torque" in values for values in judged(scenario).proposal.values())


@pytest.mark.parametrize("preset", [0.2, 0.75])
def test_springs_whose_torques_overflow_are_not_too_soft(tmp_path, preset):
    """sinh(1000 * 0.75) overflows at rest; sinh(1000 * 0.2) overflows only far from rest."""
    scenario = scenario_of(
        write_plain_arm(tmp_path, effort=1e6),
        actuators={"*": {"type": "qbmove", "mode": 3}},
        parameters={"*": {"spring_a_1": 1e3, "spring_a_2": 1e3}},
        references={"*": {"equilibrium_position": 0.5, "stiffness_preset": preset}},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not judged(scenario).weak


def test_joints_without_springs_are_not_judged(tmp_path):
    robot = write_plain_arm(tmp_path)
    lying = {"base": {"fixed": False}, "actuators": "sea", "references": {"*": {"equilibrium_position": 0.5}}}
    assert not judged(scenario_of(robot, **lying)).joints
    weightless = {"gravity": [0, 0, 0], "actuators": "sea", "references": {"*": {"equilibrium_position": 0.5}}}
    assert not judged(scenario_of(robot, **weightless)).joints
    driven = {"motor_1_torque_constant": 0.1, "motor_1_resistance": 1.0}
    for mode, reference in ((4, "motor_1_torque"), (7, "motor_1_voltage"), (8, "motor_1_current")):
        actuator = {"type": "sea", "mode": mode, "parameters": driven}
        assert not judged(scenario_of(robot, actuators={"*": actuator}, references={"*": {reference: 0.1}})).joints


@pytest.mark.parametrize("travel", [0.31, 0.6])
def test_a_slider_on_its_stop_is_lifted(tmp_path, travel):
    """PR2's torso: 1200 N on springs of 10 N/m, 0.05 m above the stop, which hides how far the springs would sag."""
    robot = write_plain_arm(tmp_path, lengths=(0.2,), masses=(120.0,), effort=10000.0)
    lift = robot.read_text().replace('type="revolute"', 'type="prismatic"').replace('xyz="0 1 0"', 'xyz="0 0 1"')
    robot.write_text(lift.replace('lower="-2.0"', 'lower="0"').replace('upper="2.0"', f'upper="{travel}"'))
    keys = {"actuators": "sea", "references": {"*": {"equilibrium_position": {"step": {"at": 0.1, "to": 0.05}}}}}
    found = judged(scenario_of(robot, **keys))
    assert found.weak
    proposal = found.proposal
    assert proposal
    assert not judged(scenario_of(robot, **keys, parameters=proposal)).weak


def test_init_proposes_damping_with_which_an_arm_settles(tmp_path):
    """Joints with vertical axes carry no weight, but the default springs would be too soft for their inertia."""
    robot = write_plain_arm(tmp_path, lengths=(0.4, 0.3, 0.1), masses=(3.0, 2.0, 1.0), effort=500.0)
    lying = re.sub(r'xyz="0 0 ([\d.]+)"', r'xyz="\1 0 0"', robot.read_text())
    robot.write_text(lying.replace('xyz="0 1 0"', 'xyz="0 0 1"'))
    (file, _), notes = write_starter(robot, tmp_path / "arm.yaml", actuators={"*": "qbmove"})
    for scenario in asrsim.load_scenario(file):
        assert set(scenario.link_damping) == {"joint_1", "joint_2", "joint_3"}
        for joint in asrsim.run(scenario).summary.joints:
            assert 0.0 < joint.measures.settling < 2.9
            assert joint.measures.overshoot < 100.0
    assert [note.code for note in notes] == ["swings-on"]


def test_an_effort_limit_below_the_weight_is_warned_of(tmp_path):
    """An effort limit of 20 N m under a load of 40 N m: no spring or motor helps, so no parameters are proposed."""
    robot = write_plain_arm(tmp_path, lengths=(0.8, 0.6), masses=(12.0, 4.0), effort=20.0)
    (file, _), notes = write_starter(robot, tmp_path / "arm.yaml", actuators={"*": "sea"})
    told = [(note.key, "effort limit of 20 N m" in note.message) for note in notes if note.code != "swings-on"]
    assert told == [("joint_1", True)]
    (scenario,) = asrsim.load_scenario(file)
    (told,) = warned(scenario)
    assert "effort limit of 20 N m" in told.message
    assert "parameters" not in told.hint


@pytest.mark.parametrize("seed", [40, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (55, 56))])
def test_a_starter_scenario_starts_at_rest_and_reaches_its_goal(tmp_path, seed):
    """Sliders under their weight, without damping: nothing moves before the step, and the mean error afterwards is below
    0.06 m."""
    source = np.random.default_rng([seed, 17])
    moving, fixed = int(source.integers(1, 5)), int(source.integers(0, 5))
    robot, out = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    robot.write_text(random_urdf(seed, moving=moving, fixed=fixed, massless_root=True), encoding="utf-8")
    write_starter(robot, out, actuators={"*": str(source.choice(["sea", "qbmove", "bavs", "awas_ii"]))})
    for scenario in asrsim.load_scenario(out, overrides=["engine=mujoco", "duration=8"]):
        found = asrsim.run(scenario)
        assert np.abs(found.run.samples.values["link_velocity"][:100]).max() < 1e-6
        for joint in found.summary.joints:
            assert abs(joint.measures.steady_state_error) < (0.06 if joint.prismatic else 0.3)
