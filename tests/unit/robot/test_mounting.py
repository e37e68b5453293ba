"""Actuators without editing the URDF: by the scenario, by `asrsim init --actuator`, and as a block to paste."""

import numpy as np
import pytest
from typer.testing import CliRunner

import asrsim
from asrsim.actuators import ACTUATORS
from asrsim.cli.app import app
from asrsim.errors import ScenarioError
from asrsim.scenario import apply_to_robot, load_scenario, make_scenario
from support.examined import checked_robot
from support.robots import write_plain_arm

REFERENCES = {"*": {"equilibrium_position": {"step": {"at": 0.05, "to": 0.2}}}}


def run_command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def with_block(robot, *names, actuator, mode=6):
    """The robot with the blocks that `asrsim actuators --urdf` prints pasted in."""
    asked = [argument for name in names for argument in ("--urdf", name)]
    printed = run_command("actuators", actuator, *asked, "--mode", mode)
    assert printed.exit_code == 0, printed.output
    path = robot.with_name("pasted.urdf")
    path.write_text(robot.read_text().replace("</robot>", f"{printed.stdout}</robot>"), encoding="utf-8")
    return path


@pytest.mark.parametrize("actuator", list(ACTUATORS))
def test_the_scenarios_actuators_are_the_pasted_blocks(tmp_path, actuator):
    """Same parameters, same bits in every quantity."""
    robot = write_plain_arm(tmp_path, lengths=(0.2, 0.1), masses=(0.2, 0.1))
    pasted = with_block(robot, "joint_1", "joint_2", actuator=actuator)
    options = {"duration": 0.2, "references": REFERENCES}
    given = asrsim.run(make_scenario(robot, actuators=actuator, **options))
    blocks = asrsim.run(make_scenario(pasted, **options))
    assert given.joints == blocks.joints
    for name, values in blocks.samples.values.items():
        assert np.array_equal(values, given.samples.values[name], equal_nan=True), name
    applied = apply_to_robot(given.run.scenario, checked_robot(given.run.scenario)[0])
    here, there = applied.actuators, checked_robot(blocks.run.scenario)[0].actuators
    assert [block.values() for block in here] == [block.values() for block in there]


def test_one_joint_all_joints_and_what_the_robot_has(tmp_path):
    """A joint's own entry wins over that for all, and both take the place of the file's."""
    robot = with_block(write_plain_arm(tmp_path), "joint_2", actuator="bavs", mode=3)
    kept = apply_to_robot(make_scenario(robot, duration=1.0, actuators={"joint_1": "sea"}), checked(robot))
    assert [(block.joint, block.actuator, block.mode) for block in kept.actuators] == [
        ("joint_1", "sea", 6),
        ("joint_2", "bavs", 3),
    ]
    own = {"*": "qbmove", "joint_1": {"type": "sea", "mode": 5, "parameters": {"spring_k": 33.0}}}
    replaced = apply_to_robot(make_scenario(robot, duration=1.0, actuators=own, modes={"joint_2": 4}), checked(robot))
    first, second = replaced.actuators
    assert (first.actuator, first.mode, first.values()["spring_stiffness"]) == ("sea", 5, 33.0)
    assert (second.actuator, second.mode) == ("qbmove", 4)
    assert first.parameters["spring_stiffness"].origin == "scenario"


def checked(robot):
    return checked_robot(make_scenario(robot, duration=1.0))[0]


def test_every_fault_of_an_actuator_is_told_at_its_key(tmp_path):
    robot = write_plain_arm(tmp_path)
    path = tmp_path / "s.yaml"
    path.write_text("robot: arm.urdf\nduration: 1\nactuators:\n  joint_1: qbmov\n  joint_2: {type: sea, mode: 9}\n")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert [(problem.key, problem.line) for problem in caught.value.problems] == [
        ("actuators.joint_1.type", 4),
        ("actuators.joint_2.mode", 5),
    ]
    assert "qbmove" in str(caught.value.problems[0])
    scenario = make_scenario(robot, duration=1.0, actuators={"joint_3": "sea"})
    with pytest.raises(ScenarioError, match="joint_1, joint_2"):
        checked_robot(scenario)
    wrong = {"joint_1": {"type": "sea", "parameters": {"spring_k": -1.0, "springk": 3.0}}}
    with pytest.raises(ScenarioError) as caught:
        checked_robot(make_scenario(robot, duration=1.0, actuators=wrong))
    assert [problem.key for problem in caught.value.problems] == [
        "actuators.joint_1.parameters.spring_k",
        "actuators.joint_1.parameters.springk",
    ]


def test_init_takes_an_actuator_per_joint_and_refuses_unknown_names(tmp_path):
    robot, out = write_plain_arm(tmp_path), tmp_path / "s.yaml"
    assert run_command("init", robot, "-a", "joint_1=sea", "-a", "joint_2=awas_ii", "-o", out, "--mode", 5).exit_code == 0
    (scenario, *_) = load_scenario(out)
    assert {joint: (one.type, one.mode) for joint, one in scenario.actuators.items()} == {
        "joint_1": ("sea", 5),
        "joint_2": ("awas_ii", 5),
    }
    again = run_command("init", robot, "-a", "sea", "-o", out)
    assert again.exit_code != 0
    assert "--overwrite" in str(again.exception)
    assert run_command("init", robot, "-a", "sea", "-o", out, "--overwrite").exit_code == 0
    wrong = run_command("init", robot, "-a", "shoulder=sea", "-a", "joint_2=see", "-o", tmp_path / "t.yaml")
    assert wrong.exit_code != 0
    assert "shoulder" in str(wrong.exception)
    assert "'see'" in str(wrong.exception)
    assert not (tmp_path / "t.yaml").exists()


def test_a_block_needs_its_actuator_and_names_are_escaped():
    assert run_command("actuators", "--urdf", "joint_1").exit_code == 2
    assert run_command("actuators", "qbmov", "--urdf", "joint_1").exit_code != 0
    printed = run_command("actuators", "sea", "--urdf", 'a<b"&')
    assert '<joint>a&lt;b"&amp;</joint>' in printed.stdout
