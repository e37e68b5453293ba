"""`check` reports all faults of a scenario and its robot at once, but no consequences of another fault."""

import json
import random

import numpy as np
import pytest
from typer.testing import CliRunner

import asrsim
from asrsim.cli.app import app
from asrsim.errors import InputError
from asrsim.identification import identify
from asrsim.plots.job import PlotJob, plot
from asrsim.simulation.start import Start

LINK = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
REQUIRED = "<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>"
MOTORS = "<mot_1_kt>0.02</mot_1_kt><mot_1_R>1</mot_1_R><mot_2_R>1</mot_2_R><mot_2_kt>0.02</mot_2_kt>"
JOINTS = ("hip", "knee", "ankle", "toe")
LINKS = ("base", "thigh", "shank", "foot", "sole")
URDF = "\n".join(
    [
        '<robot name="leg">',
        *(f'<link name="{link}">{LINK}</link>' for link in LINKS),
        *(
            f'<joint name="{joint}" type="revolute"><parent link="{LINKS[i]}"/><child link="{LINKS[i + 1]}"/>'
            f'<axis xyz="0 {i % 2} {1 - i % 2}"/><limit effort="50" velocity="9" lower="-{i + 1}" upper="{i + 1}"/></joint>'
            for i, joint in enumerate(JOINTS)
        ),
        *(
            f'<gazebo><plugin name="{joint}_drive" filename="libqbmove_plugin.so"><joint>{joint}</joint>'
            f"<operation_mode>6</operation_mode>{REQUIRED}<spring_k1>0.0{i + 1}</spring_k1><mot_1_J>0.00{i + 1}</mot_1_J>"
            f"<mot_1_minPos>-{i + 2}</mot_1_minPos></plugin></gazebo>"
            for i, joint in enumerate(JOINTS)
        ),
        "</robot>",
    ]
).replace("<joint>toe</joint><operation_mode>6<", f"<joint>toe</joint>{MOTORS}<operation_mode>7<")
SCENARIO = """robot: leg.urdf
duration: 0.1
gravity: [0, 0, -9.81]
initial: {hip: 0.1}
parameters:
  hip: {mot_2_J: 0.001}
  knee: {mot_2_J: 0.002}
  ankle: {mot_2_minPos: -3}
references:
  hip: {equilibrium_position: 0.1, stiffness_preset: 0.1}
  knee: {equilibrium_position: 0.2, stiffness_preset: 0.2}
  ankle: {equilibrium_position: 0.3, stiffness_preset: 0.3}
  toe: {motor_1_voltage: 0.4, motor_2_voltage: 0.4}
external_torques: {knee: 0.5}
expect:
- {joint: hip, quantity: link_position, measure: maximum, comparison: "<", value: 3}
"""
FAULTS = {
    # name: (file, sound text, faulty text, words of the message)
    "negative mass": ("leg.urdf", 'name="foot"><inertial><mass value="1"', 'name="foot"><inertial><mass value="-1"', "-1"),
    "inertia that is no number": ("leg.urdf", 'ixx="0.1"', 'ixx="heavy"', "heavy"),
    "tag out of range": ("leg.urdf", "<mot_1_J>0.002<", "<mot_1_J>-2<", "larger than 0"),
    "unknown mode": ("leg.urdf", "<joint>ankle</joint><operation_mode>6<", "<joint>ankle</joint><operation_mode>66<", "66"),
    "crossed motor stops": ("leg.urdf", "<mot_1_minPos>-3<", "<mot_1_maxPos>-9</mot_1_maxPos><mot_1_minPos>-3<", "-3 > -9"),
    "plugin of no actuator": (
        "leg.urdf",
        'name="hip_drive" filename="libqbmove',
        'name="hip_drive" filename="libqbmoove',
        "no actuator belongs",
    ),
    "unknown key": ("s.yaml", "duration: 0.1", "duration: 0.1\nduratoin: 3", "duratoin"),
    "start beyond a limit": ("s.yaml", "initial: {hip: 0.1", "initial: {toe: 4.5, hip: 0.1", "initial.toe"),
    "parameter out of range": ("s.yaml", "mot_2_J: 0.002", "mot_2_J: -0.002", "parameters.knee.mot_2_J"),
    "parameter that is no number": ("s.yaml", "mot_2_minPos: -3", "mot_2_minPos: low", "low"),
    "unknown reference": ("s.yaml", "{equilibrium_position: 0.2,", "{equilibrium_positon: 0.2,", "equilibrium_positon"),
    "unknown kind of signal": ("s.yaml", "motor_1_voltage: 0.4", "motor_1_voltage: {sinn: {}}", "sinn"),
    "list in the place of a table": ("s.yaml", "external_torques: {knee: 0.5}", "external_torques: [1, 2]", "external_torques"),
    "claim about no joint": ("s.yaml", "{joint: hip, quantity", "{joint: hop, quantity", "'hop'"),
}
DRAWN = [random.Random(seed).sample(sorted(FAULTS), 3 + seed) for seed in range(8)]


def told(folder, faults):
    texts = {"leg.urdf": URDF, "s.yaml": SCENARIO}
    for fault in faults:
        file, sound, faulty, _ = FAULTS[fault]
        assert sound in texts[file], fault
        texts[file] = texts[file].replace(sound, faulty, 1)
    for name, text in texts.items():
        (folder / name).write_text(text)
    report = json.loads(CliRunner().invoke(app, ["check", "--json", str(folder / "s.yaml")]).stdout)
    return [json.dumps(error, ensure_ascii=False) for error in report["files"][0]["errors"]]


def test_correct_files_have_no_fault(tmp_path):
    assert told(tmp_path, []) == []


@pytest.mark.parametrize("faults", DRAWN, ids=lambda faults: str(len(faults)))
def test_check_reports_exactly_the_faults_of_both_files(faults, tmp_path):
    errors = told(tmp_path, faults)
    missing = [fault for fault in faults if not any(FAULTS[fault][3] in error for error in errors)]
    assert missing == []
    assert len(errors) == len(faults), errors


def test_scenario_may_supply_the_motor_constants_of_a_mode(tmp_path):
    (tmp_path / "leg.urdf").write_text(URDF.replace(MOTORS, ""))
    constants = "{mot_1_kt: 0.02, mot_2_kt: 0.02, mot_1_R: 1, mot_2_R: 1}"
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("parameters:", f"parameters:\n  toe: {constants}"))
    outcome = CliRunner().invoke(app, ["check", str(tmp_path / "s.yaml")])
    assert outcome.exit_code == 0, outcome.stdout


CALLS = {
    # Each call has three faults, which its error names by these words.
    "sweep": (
        lambda tiny: asrsim.sweep(tiny.scenario, over={f"parameters.elbow.{name}": [1.0] for name in ("springg", "k", "R")}),
        ("springg", "elbow.k", "elbow.R"),
    ),
    "values of a sweep": (
        lambda tiny: asrsim.sweep(
            tiny.scenario, over={"duration": [], "step": {"uniform": [2, 1]}, "gravity": {"normal": [0]}}
        ),
        ("duration", "step", "gravity"),
    ),
    "options of a sweep": (
        lambda tiny: asrsim.sweep(tiny.scenario, over={"duration": [1], "duration & step": [1]}, samples=0, sampler="dice"),
        ("duration", "samples", "sampler"),
    ),
    "free parameters": (
        lambda tiny: identify(tiny.scenario, [table(tiny)], free=["elbow.springg", "elbow.damping=-1", "arm.weight"]),
        ("elbow.springg", "elbow.damping", "arm.weight"),
    ),
    "recordings of a fit": (
        lambda tiny: identify(tiny.scenario, [tiny.folder / f"{k}.csv" for k in "abc"], free=["elbow.damping"]),
        ("a.csv", "b.csv", "c.csv"),
    ),
    "recordings of a plot": (
        lambda tiny: plotted(tiny, experiments=tuple(str(tiny.folder / f"{k}.csv") for k in "abc")),
        ("a.csv", "b.csv", "c.csv"),
    ),
    "measures of a plot": (
        lambda tiny: plotted(tiny, experiments=(str(table(tiny)),), measures=("rmss", "peek", "displacement")),
        ("rmss", "peek", "displacement"),
    ),
    "start of worlds": (
        lambda tiny: rolled(tiny, positions={"elbo": 0.1, "elbow": np.inf}, velocities={"elbow": np.nan}),
        ("initial.elbo", "initial.elbow", "velocities.elbow"),
    ),
    "series of worlds": (lambda tiny: rolled(tiny, names=["a", "link_position", "b", "c"]), ("'a'", "'b'", "'c'")),
    "options of an environment": (
        lambda tiny: asrsim.make_env(tiny.scenario, control_rat=10.0, tip=3, pixels="many"),
        ("control_rat", "tip", "pixels"),
    ),
    "observations": (
        lambda tiny: asrsim.make_env(tiny.scenario, observe=["a", "link_position", "b"], tip=("hand", (0, 0, 0))),
        ("'a'", "'b'", "'hand'"),
    ),
    "random values": (
        lambda tiny: asrsim.make_env(tiny.scenario, randomise={"duration": [1.0], "step": [1e-3], "seed": [1]}),
        ("duration", "step", "seed"),
    ),
    "laws of random values": (
        lambda tiny: asrsim.make_env(
            tiny.scenario,
            randomise={f"parameters.elbow.{name}": [np.nan] for name in ("spring_stiffness", "damping", "friction")},
        ),
        ("spring_stiffness", "damping", "friction"),
    ),
    "parameters of a scenario": (
        lambda tiny: asrsim.prepare(
            asrsim.make_scenario(tiny.robot, duration=1.0, parameters={"elbow": {"k": 1, "spring_k": -1, "R": 2}})
        ),
        ("elbow.k", "elbow.spring_k", "elbow.R"),
    ),
}


def table(tiny):
    time = np.linspace(0.0, 1.0, 101)
    path = tiny.folder / "table.csv"
    columns = np.column_stack([time, 0.1 * np.sin(6.0 * time)])
    np.savetxt(path, columns, delimiter=",", header="time [s],elbow.link_position [rad]", comments="")
    return path


def plotted(tiny, **options):
    asrsim.run(tiny.scenario, overrides=["duration=0.1", "compiled=false"], out=tiny.folder / "out")
    plot(PlotJob(logs=(tiny.folder / "out" / "log.mcap",), folder=tiny.folder / "plots", **options))


def rolled(tiny, names=("link_position",), **start):
    with asrsim.Worlds(asrsim.load_scenario(tiny.scenario)[0], 1) as worlds:
        worlds.rollout(names, start=[Start(**start)])


@pytest.mark.parametrize("call", CALLS)
def test_a_function_of_the_library_names_all_faults_of_its_arguments(call, tiny):
    function, words = CALLS[call]
    with pytest.raises(InputError) as caught:
        function(tiny)
    told = [str(problem) for problem in caught.value.problems]
    assert [word for word in words if not any(word in text for text in told)] == []
    assert len(told) == len(words), told
