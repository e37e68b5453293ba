"""Arms that share only a fixed base are robots of their own: what is said of one does not depend on what stands beside it.

The robot with all arms has another order of joints, and a joint without a motor. So a number that is taken from the wrong
joint, motor or row shows.
"""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

ARM = """
<joint name="{name}" type="revolute"><parent link="world"/><child link="{name}_link"/><origin xyz="0 {y} 1"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="{upper}" effort="{effort}" velocity="{velocity}"/>
  <dynamics damping="{damping}" friction="{friction}"/></joint>
<link name="{name}_link"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>
  <inertia ixx="1e-3" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="1e-3"/></inertial></link>
"""
DRIVE = """
<gazebo><plugin name="{name}_drive" filename="lib{actuator}_plugin.so"><joint>{name}</joint><operation_mode>6</operation_mode>
  <pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>{tags}</plugin></gazebo>
"""
ARMS = {
    "free": ARM.format(
        name="free", y=0, upper=3, effort=9, velocity=50, damping=0.01, friction=0, centre=-0.3, mass=0.2, iyy=1e-3
    ),
    "left": ARM.format(
        name="left", y=0.5, upper=2.5, effort=3, velocity=100, damping=0.2, friction=0.05, centre=-0.1, mass=0.5, iyy=1e-3
    )
    + DRIVE.format(name="left", actuator="sea", tags="<spring_k>10</spring_k><mot_tauMax>0.3</mot_tauMax>"),
    "right": ARM.format(
        name="right", y=-0.5, upper=0.9, effort=1.2, velocity=3, damping=0.1, friction=0.02, centre=0.12, mass=0.9, iyy=2e-3
    )
    + DRIVE.format(name="right", actuator="qbmove", tags="<max_def>0.6</max_def>"),
}
KEYS = {
    "references": {
        "left": {"equilibrium_position": {"step": {"at": 0.1, "to": 0.5}}},
        "right": {"equilibrium_position": {"sinusoid": {"amplitude": 1.0, "frequency": 2.0}}, "stiffness_preset": 0.3},
    },
    "external_torques": {"right": {"pulse_train": {"low": 0.0, "high": 0.3, "period": 0.5, "width": 0.1}}},
    "initial": {"left": 0.1, "right": -0.05},
    "sensors": {"left": {"delay": 0.003}, "right": {"delay": 0.0021}},
    "motion": {
        "left": {"minimum_jerk": {"duration": 0.3, "to": 0.4}},
        "right": {"minimum_jerk": {"duration": 0.2, "to": -0.1}},
    },
}
"""Keys of the scenario by joint."""


def write(folder, name, arms):
    """Write robot and scenario of some arms; return the scenario's path."""
    text = f'<robot name="{name}"><link name="world"/>{"".join(ARMS[arm] for arm in arms)}</robot>'
    (folder / f"{name}.urdf").write_text(text)
    own = {key: {arm: value for arm, value in values.items() if arm in arms} for key, values in KEYS.items()}
    scenario = {
        "robot": f"{name}.urdf",
        "duration": 0.5,
        "substeps": 8,
        **{key: own[key] for key in ("references", "external_torques", "initial")},
        "imperfections": {"sensors": own["sensors"]},
        "ilc": {"law": "paper", "tolerance": 0.02, "max_iterations": 2, "trajectory": own["motion"]},
        "expect": [
            {"joint": arm, "quantity": "link_position", "measure": "maximum", "comparison": "<", "value": 0.45}
            for arm in own["references"]
        ],
    }
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(scenario))
    return path


def about(data, joint):
    """Parts of plain data that are about a joint, by their own statement or by their key."""
    if isinstance(data, dict):
        if any(re.match(rf"(.*\.)?{joint}\b", str(data.get(key, ""))) for key in ("joint", "name", "key")):
            return [data]
        parts = [about(value, joint) for key, value in data.items() if not re.match(rf"{joint}(\.|$)", key)]
        own = {key: value for key, value in data.items() if re.match(rf"{joint}(\.|$)", key)}
        return [own] * bool(own) + [one for part in parts for one in part]
    return [one for value in data for one in about(value, joint)] if isinstance(data, list) else []


def near(given, place=""):
    """Plain data as texts and approximate numbers, by place, without places in files and hints about several joints."""
    if isinstance(given, dict | list):
        items = given.items() if isinstance(given, dict) else enumerate(given)
        return {key: one for name, value in items for key, one in near(value, f"{place}/{name}").items()}
    if place.endswith(("/line", "/file", "/hint")):
        return {}
    return {place: pytest.approx(given, rel=1e-6, abs=1e-8) if isinstance(given, float) else given}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arms")
    robots = {"left": ["left"], "right": ["right"], "both": ["free", "right", "left"]}
    return SimpleNamespace(path=folder, scenarios={name: write(folder, name, arms) for name, arms in robots.items()})


@pytest.fixture(scope="module")
def runs(folder):
    from asrsim import run

    return {name: run(path, out=folder.path / f"run_{name}") for name, path in folder.scenarios.items()}


@pytest.fixture(scope="module")
def recording(folder, runs):
    found, names = runs["both"], ("left", "right")
    columns = [found.time, *(1.1 * found[name].link_position for name in names), *(found[name].reference_1 for name in names)]
    head = ",".join(["time [s]", *(f"{name}.{one}" for one in ("link_position", "reference_1") for name in names)])
    np.savetxt(folder.path / "recording.csv", np.transpose(columns), delimiter=",", header=head, comments="")
    return folder.path / "recording.csv"


@pytest.mark.parametrize("joint", ["left", "right"])
def test_an_arm_moves_as_it_does_alone(runs, joint):
    both, alone = runs["both"][joint], runs[joint][joint]
    assert list(both) == list(alone)
    for name in alone:
        np.testing.assert_allclose(both[name], alone[name], rtol=1e-5, atol=1e-6, err_msg=name)


COMMANDS = {
    "check": "check {folder}/{name}.yaml",
    "plot": "plot {folder}/run_{name} -e {recording} --align off --out {folder}/plot_{name}",
    "twin": "twin {folder}/{name}.yaml -e {recording} --no-plot --out {folder}/twin_{name}",
    "export": "export {folder}/{name}.yaml --no-plot --out {folder}/export_{name}.xml",
    "ilc": "ilc {folder}/{name}.yaml --no-plot --out {folder}/ilc_{name}",
}


@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_says_of_an_arm_is_what_it_says_of_it_alone(folder, runs, recording, asrsim_command, command):
    said = {}
    for name in folder.scenarios:
        line = COMMANDS[command].format(folder=folder.path, name=name, recording=recording)
        said[name] = json.loads(asrsim_command(*line.split(), "--json").out)
    for joint in ("left", "right"):
        both, alone = (sorted(about(said[name], joint), key=str) for name in ("both", joint))
        assert alone
        assert near(both) == near(alone)
