"""Warnings about scenarios that are probably mistakes, and errors about signals and presets that nobody can follow."""

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from asrsim.robot.dynamics import robot_model
from asrsim.scenario import apply_to_robot, load_scenario
from asrsim.scenario.signal_checks import undersampled
from asrsim.statics.sizing import weight_warnings
from support.examined import check_against_robot

STRONG = """modes: 5
stepping: toolbox
parameters: {elbow: {ctrl_D: 19, mot_D: 1, mot_J: 0.1}}
references: {elbow: {reference_1: 0}}"""
"""A controller that diverges at steps above 10 ms in the toolbox's order."""
SCENARIOS = {
    "gravity": "gravity: [0, 0, -9810]",
    "gravity upwards": "gravity: [0, 0, 9.81]",
    "long-delay": "imperfections: {sensors: {elbow: {delay: 20}}}",
    "late-reference": "references: {elbow: {equilibrium_position: {step: {at: 5, to: 0.5}}}}",
    "late-reference ramp": "references: {elbow: {equilibrium_position: {ramp: {start: 3, duration: 1, to: 1}}}}",
    "odd-step": "step: 0.06",
    "odd-step of less than a microsecond": "step: 0.75e-6",
    "ratio-without-inertia": "link_damping: {elbow: {ratio: 0.1}}",
    "rpy-in-degrees": "base: {rpy: [0, 0, 90]}",
    "rpy-in-degrees object": "world: {objects: {a: {shape: sphere, size: 0.1, rpy: [45, 0, 0], position: [5, 5, 5]}}}",
    "no-spring": "parameters: {elbow: {spring_k: 0}}",
    "reference-limits": "references: {elbow: {equilibrium_position: {step: {at: 1.2, to: 3.1}}}}",
    "reference-limits of a motor": "modes: 5\nreferences: {elbow: {reference_1: -3.1}}",
    "reference-limits desired": "desired: {elbow: {sinusoid: {amplitude: 3.1, frequency: 1}}}",
    "reference-limits desired of all": "desired: {'*': 4}",
    "reference-limits learned": "ilc: {trajectory: {elbow: {minimum_jerk: {duration: 1, to: 4}}}, tolerance: 1}",
    "sags": "parameters: {elbow: {spring_k: 1}}\nreferences: {elbow: {equilibrium_position: 1}}",
    "unusual-value": "parameters: {elbow: {spring_k: 1e6}}",
    "reference-limits of a torque": "modes: 0\nreferences: {elbow: {link_torque: -51}}",
    "reference-limits of a motor's torque": "modes: 4\nreferences: {elbow: {motor_1_torque: 6.1}}",
    "motor-gains": f"step: 0.0125\n{STRONG}",
    "unused-effect": "modes: 3\nimperfections: {sensors: {elbow: {noise: 0.01}}}",
    "released-model": "stepping: toolbox\nparameters: {elbow: {hyst_tau: 0.1}}",
    "released-model of a sensor": "stepping: toolbox\nimperfections: {sensors: {elbow: {delay: 0.02}}}",
    "released-model of substeps": "stepping: toolbox\nsubsteps: 4",
    "released-model of motor substeps": "stepping: toolbox\nmotor_substeps: 4",
    "motorless-start": "modes: 3\ninitial: {elbow: {position: 0, motor_positions: [0.3]}}",
    "motorless-start of all joints": "modes: 0\ninitial: {'*': {position: 0, motor_velocities: [1]}}\n"
    "references: {elbow: {link_torque: 0}}",
    "prescribed-start": "engine: bench\nmotion: {elbow: 0.3}\ninitial: {elbow: 0.1}",
    "prescribed-start in equilibrium": "engine: bench\ninitial: equilibrium",
    "planned-reference": "task: {link: arm, poses: [{time: 1, position: [0, 0, 0.1]}]}",
    "planned-reference of inverse dynamics": "task: {link: arm, poses: [{time: 1, position: [0, 0, 0.1]}]}\n"
    "references: {}\ninverse_dynamics: true",
    "negative-gain": "modes: 5\nparameters: {elbow: {ctrl_P: -5}}\nreferences: {elbow: {reference_1: 0.1}}",
}


def warned(tiny, more):
    """Codes of the warnings about the tiny scenario with more keys; warnings have the line of an entry in the file."""
    text = tiny.scenario.read_text()
    base = "" if "references:" in more else text.split("duration: 1.5\n")[1]
    tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 1.5\n{base}{more}\n")
    (scenario,) = load_scenario(tiny.scenario)
    given = yaml.safe_load(tiny.scenario.read_text())
    tiny.scenario.write_text(text)
    robot = load_robot(scenario.robot)
    errors, warnings = check_against_robot(scenario, robot)
    assert not errors
    changed = apply_to_robot(scenario, robot)
    warnings += map(scenario.placed, warnings_of(changed))
    warnings += weight_warnings(scenario, changed, robot_model(scenario, changed))
    for problem in warnings:
        assert problem.line or problem.key is None or problem.key.startswith("elbow")
        entry = given
        for part in problem.key.split(".")[:-1] if problem.line else ():
            entry = entry[int(part) if isinstance(entry, list) else part]
    return {problem.code for problem in warnings}


@pytest.mark.parametrize(("to", "told"), [(90, True), (6, False)])
def test_a_jump_by_more_than_a_turn_of_a_joint_without_stops_gets_a_warning(to, told, tiny):
    text = tiny.robot.read_text().replace('type="revolute"', 'type="continuous"').replace('lower="-3" upper="3"', "")
    tiny.robot.write_text(text)
    step = f"references: {{elbow: {{equilibrium_position: {{step: {{at: 0.1, to: {to}}}}}}}}}"
    assert ("reference-turns" in warned(tiny, step)) == told


@pytest.mark.parametrize("case", SCENARIOS)
def test_probable_mistakes_get_a_warning(case, tiny):
    assert case.split()[0] in warned(tiny, SCENARIOS[case])


@pytest.mark.parametrize(
    "more",
    [
        "", "gravity: [0, 0, 0]", "gravity: [9.81, 0, 0]", "imperfections: {commands: {elbow: {delay: 0.05, noise: 0.01}}}",
        "link_damping: {elbow: {ratio: 0.1, inertia: 0.01}}", "references: {elbow: {equilibrium_position: 0.3}}",
        "base: {rpy: [0, -3.15, 6.28]}", "log_rate: 10",
        "external_torques: {elbow: {pulse_train: {high: 20, period: 0.5, width: 0.001}}}", "desired: {elbow: -2.9}",
        "expect: [{joint: elbow, quantity: link_position, measure: final, value: 0, tolerance: 1}]",
        "modes: 6\ninitial: {elbow: {position: 0.2, velocity: 5, motor_positions: [0.3], motor_velocities: [5]}}",
        "link_damping: {elbow: {constant: 20, ratio: 5, inertia: 0.01}}",
        "wrenches: [{link: arm, force: [1, 0, 0], point: [0, 0, -1.9]}]", f"step: 0.009375\n{STRONG}",
        "modes: 4\nreferences: {elbow: {motor_1_torque: -6}}\nreference_ranges: {elbow: {motor_1_torque: [-6, 6]}}",
        "modes: 0\nreferences: {elbow: {link_torque: 49}}\nreference_ranges: {elbow: {link_torque: [-50, 50]}}",
    ],
)  # fmt: skip
def test_usual_values_get_no_warning(more, tiny):
    assert not warned(tiny, more)


@pytest.mark.parametrize(
    "signal",
    [
        "{sinusoid: {amplitude: 0.1, frequency: %g}}",
        "{chirp: {amplitude: 0.1, from: 1, to: %g, duration: 1.5}}",
        "{sum: [{ramp: {duration: 1, to: 1}}, {scale: {by: 2, of: {sinusoid: {amplitude: 0.1, frequency: %g}}}}]}",
        "{delay: {by: 0.1, of: {multisine: {amplitude: 0.1, frequencies: [1, %g]}}}}",
    ],
)
def test_signals_above_half_the_rate_of_the_substeps_get_a_warning(signal, tiny):
    for substeps in (1, 3):
        for share, warnings in ((0.9, 0), (1.05, 1), (1.9, 1), (2.0, 1)):
            text = signal % (share * 500.0 * substeps)
            references = f"references: {{elbow: {{equilibrium_position: {text}}}}}"
            tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 1.5\n{references}\n")
            assert len(list(undersampled(load_scenario(tiny.scenario)[0], substeps))) == warnings, share


@pytest.mark.parametrize(
    "signal",
    [
        "{sum: [1e308, 1e308]}",
        "{pulse_train: {high: 1, period: 1e-10, width: 5e-11}}",
        "{pulse_train: {high: 1, period: 1e-5, width: 5e-6}}",
    ],
)
@pytest.mark.parametrize(
    "place",
    [
        "external_torques: {elbow: %s}",
        "wrenches: [{link: arm, force: [0, %s, 0]}]",
        "desired: {elbow: %s}",
        "engine: bench\nmotion: {elbow: %s}",
        "references: {elbow: {equilibrium_position: %s}}",
        "ilc: {trajectory: {elbow: %s}, tolerance: 1}",
    ],
)
def test_a_signal_beyond_all_limits_is_an_error(place, signal, tiny):
    base = "" if "references:" in place else tiny.scenario.read_text().split("duration: 1.5\n")[1]
    tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 1.5\n{base}{place % signal}\n")
    (scenario,) = load_scenario(tiny.scenario)
    errors, _ = check_against_robot(scenario, load_robot(scenario.robot))
    assert [problem.code for problem in errors] == ["signal"]
    assert errors[0].line


HAND = """<link name="palm"><inertial><mass value="0.1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3"/></inertial></link>
<joint name="wrist" type="continuous"><parent link="arm"/><child link="palm"/><axis xyz="0 1 0"/>{}</joint></robot>"""


@pytest.mark.parametrize(
    ("start", "told"), [("{wrist: 0.4}", True), ("{elbow: 0.1, wrist: 0.3}", False), ("{elbow: 0.1}", False)]
)
def test_an_initial_position_that_a_coupled_joint_cannot_have_gets_a_warning(start, told, tiny):
    hand = HAND.format('<mimic joint="elbow" multiplier="2" offset="0.1"/>')
    tiny.robot.write_text(tiny.robot.read_text().replace("</robot>", hand))
    assert ("coupled-start" in warned(tiny, f"initial: {start}")) == told


@pytest.mark.parametrize(("more", "told"), [("</robot>", False), (HAND.format(""), True)])
def test_link_damping_of_all_joints_that_leaves_out_passive_joints_gets_a_warning(more, told, tiny):
    tiny.robot.write_text(tiny.robot.read_text().replace("</robot>", more))
    assert ("passive-damping" in warned(tiny, "link_damping: {'*': {constant: 0.1}}")) == told


def test_a_preset_beyond_the_springs_gets_a_warning(tiny):
    text = tiny.robot.read_text().replace("libsea", "libqbmove").replace("<spring_k>10</spring_k>", "")
    tiny.robot.write_text(text)
    own = "references: {elbow: {equilibrium_position: 0, stiffness_preset: %s}}"
    assert "large-preset" in warned(tiny, own % 50)
    assert not warned(tiny, own % 0.6)


@pytest.mark.parametrize(("first", "told"), [(50587.0, True), (-3.0, True), (0.5, False), (-0.5, False)])
@pytest.mark.parametrize("form", ["{}", "{{sum: [{}, 0.1]}}"])
def test_a_recording_whose_times_lie_outside_the_run_gets_a_warning(first, told, form, tiny):
    """A time of day in seconds is such a time. The robot would stand still at the first or last sample."""
    rows = "".join(f"{first + 0.1 * i},{0.01 * i}\n" for i in range(10))
    (tiny.folder / "day.csv").write_text(f"time [s],goal [rad]\n{rows}")
    played = form.format("{playback: {file: day.csv, column: goal}}")
    more = f"references: {{elbow: {{equilibrium_position: {played}}}}}"
    assert ("playback-outside" in warned(tiny, more)) == told
    assert "playback-outside" not in warned(tiny, more.replace("column: goal", "column: goal, start: 0"))


@pytest.mark.parametrize(
    ("header", "told"),
    [
        ("goal", False), ("goal [deg]", False), ("q1", False), ("goal [mm]", True), ("goal [mNm]", True), ("dq1", True),
        ("goal [%]", True), ("goal [cdeg]", True),
    ],
)  # fmt: skip
def test_a_played_column_of_another_unit_gets_a_warning(header, told, tiny):
    rows = "".join(f"{0.1 * i},{0.01 * i}\n" for i in range(10))
    (tiny.folder / "lab.csv").write_text(f"time [s],{header}\n{rows}")
    played = "references: {elbow: {equilibrium_position: {playback: {file: lab.csv, column: 2}}}}"
    assert ("played-unit" in warned(tiny, played)) == told
    assert "played-unit" not in warned(tiny, played.replace("file:", "scale: 0.5, file:"))


def test_the_advised_start_lets_a_column_play_that_begins_after_the_run(tiny):
    """The other table of the file begins 100 s earlier, so that `start: 0` does not suffice."""
    time = np.linspace(0.0, 1.0, 10)
    savemat(tiny.folder / "lab.mat", {"a": {"time": time, "x": time}, "b": {"time": time + 100.0, "goal": time}})
    keys = "file: lab.mat, column: b.goal"

    def hints():
        played = f"{{playback: {{{keys}}}}}"
        text = f"robot: pendulum.urdf\nduration: 1.5\nreferences: {{elbow: {{equilibrium_position: {played}}}}}\n"
        tiny.scenario.write_text(text)
        (scenario,) = load_scenario(tiny.scenario)
        _, warnings = check_against_robot(scenario, load_robot(scenario.robot))
        return [one.hint for one in warnings if one.code == "playback-outside"]

    (hint,) = hints()
    advised = hint.split("`")[1]
    assert advised == "start: -100"
    keys += f", {advised}"
    assert not hints()
