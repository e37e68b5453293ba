"""Exported models: motion in plain MuJoCo, compared with asrsim and with an independent solution; remarks on missing parts."""

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import yaml

import asrsim
from asrsim.actuators import ACTUATORS, Actuator
from asrsim.errors import ScenarioError, SimulationError
from asrsim.exports import export
from asrsim.exports.springs import spline_of
from asrsim.plugins import load_plugin_file
from support.coupled_ode import RODS, TWO_FREE, urdf
from support.independent_ode import solve
from support.paths import EXAMPLES
from support.random_runs import random_run

MOTION = {"sinusoid": {"amplitude": 0.6, "frequency": 0.7}}


def scenario(actuator, *, mode=6, preset=None, **keys):
    references = {"equilibrium_position": MOTION} | ({} if preset is None else {"stiffness_preset": preset})
    keys = {"duration": 2.0, "references": {"joint_1": references}, "modes": {"*": mode}} | keys
    return asrsim.make_scenario(EXAMPLES / "urdf" / f"dof1_{actuator}.urdf", engine="mujoco", **keys)


@pytest.fixture
def my_vsa(monkeypatch):
    monkeypatch.setattr(ACTUATORS, "_entries", dict(ACTUATORS._entries))
    load_plugin_file(EXAMPLES / "plugins" / "my_vsa.py")


@pytest.mark.usefixtures("my_vsa")
@pytest.mark.parametrize("actuator", ["sea", "qbmove", "bavs", "my_vsa"])
def test_soft_joints_move_within_a_milliradian_of_asrsim(tmp_path, actuator):
    keys = {}
    if actuator == "my_vsa":
        keys["actuators"] = {"joint_1": {"type": "my_vsa", "mode": 6}}
    preset = {"sea": None, "bavs": 0.1}.get(actuator, 0.2)
    robot = "qbmove" if actuator == "my_vsa" else actuator
    found = export(scenario(robot, preset=preset, **keys), tmp_path / "soft.xml", plot=actuator == "sea").replay
    np.testing.assert_array_equal(found.error, 1e3 * (found.theirs - found.ours))
    assert np.ptp(found.ours) > 0.6
    assert found.rms.max() < 1.0
    if actuator == "sea":
        assert (tmp_path / "soft.png").stat().st_size > 10_000


STEP, SINE = {"step": {"at": 0.1, "to": 0.8}}, {"sinusoid": {"amplitude": 0.6, "frequency": 1.0}}
PUSH = {"joint_1": {"sinusoid": {"amplitude": 0.5, "frequency": 1.0}}}
BRISTLES = {"spring_stiffness": 15.0, "hysteresis_torque": 0.2, "hysteresis_deflection": 0.02}
PARTS = {
    "integral action": {"parameters": {"joint_1": {"controller_1_integral": 50.0}}},
    "motor friction": {"parameters": {"joint_1": {"motor_1_friction_torque": 0.3, "motor_1_stribeck_friction": 0.3}}},
    "hysteresis": {"parameters": {"joint_1": BRISTLES}, "external_torques": PUSH},
    "delay": {"imperfections": {"commands": {"joint_1": {"delay": 0.0104}}}},
    "start": {"initial": {"joint_1": {"position": 0.3}}, "imperfections": {"commands": {"joint_1": {"delay": 0.01}}}},
}


@pytest.mark.parametrize("motion", [STEP, SINE], ids=["step", "sine"])
@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_a_drive_moves_in_mujoco_as_in_asrsim(tmp_path, part, motion):
    """A step reaches torque limit and speed limit of the motor. Each part changes its motion by more than 2 mrad."""
    given = scenario("sea", references={"joint_1": {"equilibrium_position": motion}}, **PARTS[part])
    found = export(given, tmp_path / "soft.xml", plot=False)
    assert found.remarks == ()
    assert np.abs(found.replay.error).max() < 2.0
    assert found.replay.rms.max() < 0.5


def test_a_delay_begins_with_the_first_command(tmp_path):
    """Until the first command arrives, the joint holds where the first command wants it."""
    late = {"initial": {"joint_1": {"position": 0.4}}, "imperfections": {"commands": {"joint_1": {"delay": 0.1}}}}
    given = scenario("sea", references={"joint_1": {"equilibrium_position": 0.4}}, duration=0.3, **late)
    found = export(given, tmp_path / "soft.xml", plot=False).replay
    assert np.abs(found.ours - 0.4).max() < 0.05
    assert np.abs(found.error).max() < 2.0


@pytest.mark.parametrize("actuator", ["qbmove", "bavs"])
def test_variable_stiffness_actuators_follow_a_step_at_their_limits(tmp_path, actuator):
    references = {"equilibrium_position": STEP, "stiffness_preset": 0.1}
    found = export(scenario(actuator, references={"joint_1": references}), tmp_path / "soft.xml", plot=False).replay
    assert np.abs(found.error).max() < 3.0
    assert found.rms.max() < 0.5


def test_the_stiffness_of_an_adjustable_spring_is_a_control(tmp_path):
    preset = {"sinusoid": {"amplitude": 0.005, "offset": 0.02, "frequency": 0.7}}
    references = {"equilibrium_position": SINE, "stiffness_preset": preset}
    found = export(scenario("awas_ii", references={"joint_1": references}), tmp_path / "soft.xml", plot=False)
    assert found.replay.rms.max() < 0.5
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "soft.xml"))
    assert [model.actuator(i).name for i in range(model.nu)] == ["joint_1.motor_1", "joint_1.stiffness"]


def test_names_contain_no_slash(tmp_path):
    """Programs that attach models to each other cut names at a slash."""
    export(scenario("qbmove", preset=0.2), tmp_path / "soft.xml", plot=False)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "soft.xml"))
    assert b"/" not in model.names


@pytest.mark.parametrize("ground", [False, True])
def test_cones_are_elliptic_only_where_contacts_are(tmp_path, ground):
    """MuJoCo XLA and mjlab take pyramidal cones."""
    export(scenario("sea", world={"ground": ground}), tmp_path / "soft.xml", plot=False)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "soft.xml"))
    assert (model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC) is ground


def plain(run):
    """The run without the effort limit, which MuJoCo applies to motors only, and with adjusters at rest."""
    joints = []
    for joint in run.joints:
        references = joint.references
        if joint.actuator == "awas_ii" and joint.mode > 1:
            references = (references[0], replace(references[1], amplitude=0.0, jump=0.0, at=np.inf))
        joints.append(replace(joint, effort=np.inf, references=references))
    return replace(run, joints=tuple(joints))


@pytest.mark.parametrize("seed", [1, 5, 9, 15, 19])
def test_exported_random_robots_follow_the_equations_of_the_paper(tmp_path, seed):
    """Modes 0, 1, 4, 5 and 6, all actuators, fixed and floating bases, revolute and prismatic joints."""
    run = plain(random_run(seed, moving=3, fixed=seed % 3 > 0, jumps=False, duration=1.0))
    run.write(tmp_path)
    path = tmp_path / "random.yaml"
    path.write_text(yaml.safe_dump({"robot": "robot.urdf", "engine": "mujoco", **run.keys()}))
    found = export(path, tmp_path / "random.xml", plot=False).replay
    truth = solve(run, found.time, tolerance=1e-8)["positions"]
    error = 1e3 * np.sqrt(np.mean((found.theirs - truth) ** 2, axis=0))
    assert (error < 1.5).all(), error


@pytest.mark.parametrize(("mode", "reference"), [(7, "motor_1_voltage"), (8, "motor_1_current")])
def test_electric_motors_take_volts_or_amperes(tmp_path, mode, reference):
    electric = {"motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 40.0, "motor_1_resistance": 2.0}
    wave = {"sinusoid": {"amplitude": 0.4, "frequency": 0.5}}
    given = scenario("sea", mode=mode, references={"joint_1": {reference: wave}}, parameters={"joint_1": electric})
    found = export(given, tmp_path / "soft.xml", plot=False).replay
    assert found.rms.max() < 2e-3 * 1e3 * np.ptp(found.ours)


@pytest.mark.parametrize("law", [lambda x: np.sinh(9.0 * x), lambda x: np.exp(8.0 * x) - 0.5 * np.exp(-8.0 * x)])
def test_splines_follow_a_law_and_stay_flat_beyond_its_limit(law):
    limit = 0.6
    spline = spline_of(lambda x: float(law(np.clip(x, -limit, limit))), reach=2.0, limit=limit)
    inside, outside = np.linspace(-limit, limit, 999), np.array([-3.0, -limit, limit, 3.0])
    stiffness = np.gradient(law(inside), inside)
    assert np.abs((spline.torque(inside) - law(inside)) / stiffness).max() == pytest.approx(spline.error, rel=0.1)
    assert spline.error < 1e-4
    np.testing.assert_allclose(np.diff(spline.torque(outside))[[0, 2]], 0.0, atol=1e-6 * law(limit))
    few, many = (spline_of(lambda x: float(law(x)), reach=limit, limit=2.0, knots=knots).error for knots in (2, 8))
    assert many < 0.1 * few


def test_ideal_motors_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match="mode 3"):
        export(scenario("sea", mode=3), tmp_path / "soft.xml")
    assert not (tmp_path / "soft.xml").exists()


def test_springs_that_couple_their_motors_are_refused(tmp_path, monkeypatch):
    class Coupled(Actuator):
        name, title, source = "coupled", "Coupled", "a test"

        @staticmethod
        def elastic_torques(q, theta_1, theta_2, parameters):
            pull = (theta_1 - q) * (theta_2 - q) + theta_1 - q
            return pull, theta_2 - q

        @staticmethod
        def stiffness(q, theta_1, theta_2, parameters):
            return 2.0 + theta_1 + theta_2 - 2.0 * q

    monkeypatch.setattr(ACTUATORS, "_entries", dict(ACTUATORS._entries))
    ACTUATORS.add("coupled", Coupled)
    with pytest.raises(ScenarioError, match="deflection between motor and link"):
        export(scenario("sea", actuators={"joint_1": {"type": "coupled", "mode": 6}}), tmp_path / "soft.xml")


def test_what_mjcf_does_not_have_is_listed(tmp_path):
    step = {"joint_1": {"equilibrium_position": {"step": {"to": 0.8}}, "stiffness_preset": 0.01}}
    both = {"commands": {"joint_1": {"quantum": 0.01}}, "sensors": {"joint_1": {"delay": 0.01}}}
    given = scenario("awas_ii", references=step, parameters={"joint_1": {"motor_1_load_friction": 0.1}}, imperfections=both)
    text = "\n".join(export(given, tmp_path / "soft.xml", plot=False).remarks)
    for words in ("adjuster stays at 0.01 m", "depend on load", "steps of commands", "delays of sensors"):
        assert words in text


@pytest.mark.parametrize("effort", [1.9, 2.1])
def test_an_effort_limit_below_the_springs_is_listed(tmp_path, effort):
    text = (EXAMPLES / "urdf" / "dof1_sea.urdf").read_text()
    (tmp_path / "robot.urdf").write_text(re.sub('effort="[^"]*"', f'effort="{effort}"', text))
    springs = {"joint_1": {"spring_stiffness": 4.0, "max_deflection": 0.5}}
    given = asrsim.make_scenario(tmp_path / "robot.urdf", engine="mujoco", duration=0.1, modes={"*": 6}, parameters=springs)
    remarks = "".join(export(given, tmp_path / "soft.xml", plot=False).remarks)
    assert ("does not limit its springs, which reach 2" in remarks) is (effort < 2.0)


def test_intervals_of_a_fit_become_ranges_of_model_fields(tmp_path):
    fit = tmp_path / "fit.json"
    keys = ["joint_1.motor_1_friction_torque", "joint_1.spring_k_1", "link_1.mass"]
    mean, deviations = [0.05, np.log(0.002), np.log(0.3)], [0.01, 0.05, 0.1]
    fit.write_text(json.dumps({
        "keys": keys, "mean": mean, "covariance": np.diag(np.square(deviations)).tolist(), "logarithmic": [False, True, True],
        "ties": [{"key": "joint_1.spring_k_2", "to": "joint_1.spring_k_1", "factor": 1.0}],
    }))  # fmt: skip
    export(scenario("qbmove", preset=0.2), tmp_path / "soft.xml", fit=fit, plot=False)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "soft.xml"))
    assert model.actuator("joint_1.motor_1").biasprm[3:5] == pytest.approx(0.05)
    ranges = yaml.safe_load((tmp_path / "soft.ranges.yaml").read_text())
    friction = ranges[keys[0]]["fields"]
    assert np.array(friction["actuator_biasprm"]["joint_1.motor_1"])[:, 3] == pytest.approx([0.05 - 0.0196, 0.05 + 0.0196])
    spring = ranges[keys[1]]
    assert [spring["low"], spring["high"]] == pytest.approx([0.002 * np.exp(-0.098), 0.002 * np.exp(0.098)])
    low, high = spring["fields"]["tendon_stiffness"]["joint_1.spring_2.1"]
    assert high / low == pytest.approx(np.exp(2 * 0.098))
    assert ranges[keys[2]]["fields"]["body_mass"]["link_1"] == pytest.approx([0.3 * np.exp(-0.196), 0.3 * np.exp(0.196)])


def test_meshes_stand_beside_the_file(tmp_path):
    triangles = np.zeros(4, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    triangles["corners"] = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    (tmp_path / "part.stl").write_bytes(b" " * 80 + (4).to_bytes(4, "little") + triangles.tobytes())
    text = (EXAMPLES / "urdf" / "dof1_sea.urdf").read_text()
    shape = '<visual><geometry><mesh filename="part.stl" scale="0.1 0.1 0.1"/></geometry></visual>'
    (tmp_path / "robot.urdf").write_text(text.replace('<link name="link_1">', f'<link name="link_1">{shape}'))
    given = asrsim.make_scenario(tmp_path / "robot.urdf", engine="mujoco", duration=0.1, modes={"*": 6})
    found = export(given, tmp_path / "out" / "soft.xml", plot=False)
    assert (tmp_path / "out" / "soft_meshes" / "mesh_0.stl") in found.files
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "soft.xml"))
    assert model.nmesh == 1
    assert np.ptp(model.mesh_vert, axis=0).max() == pytest.approx(0.1 * np.sqrt(2), rel=0.5)


def test_a_box_is_pushed_as_in_asrsim(tmp_path):
    """The joint turns about z above the ground, and meets the box after 0.15 rad."""
    box = {"shape": "box", "size": [0.03] * 3, "mass": 0.05, "friction": 0.2, "position": [-0.035, 0.036, 0.015]}
    base = {"position": [0.0, 0.25, 0.03], "rpy": [0.5 * np.pi, 0.0, 0.0]}
    given = scenario("qbmove", preset=0.3, world={"ground": True, "objects": {"box": box}}, base=base, duration=0.7)
    found = export(given, tmp_path / "soft.xml", plot=False)
    assert np.ptp(asrsim.run(given).bodies["box"][:, 0]) > 0.01
    assert found.replay.rms.max() < 5.0


def test_moments_of_a_lamina_survive_the_file(tmp_path):
    """In a flat body A + B = C: rounded moments could break A + B >= C, and MuJoCo would refuse the file."""
    text = (EXAMPLES / "urdf" / "dof1_sea.urdf").read_text()
    flat = 'ixx="0.0001333333333333" ixy="0" ixz="0" iyy="0.0002666666666666" iyz="0" izz="0.0003999999999999"'
    (tmp_path / "robot.urdf").write_text(re.sub(r'ixx="[^/]*', flat, text))
    given = asrsim.make_scenario(tmp_path / "robot.urdf", engine="mujoco", duration=0.1, modes={"*": 6})
    export(given, tmp_path / "soft.xml", plot=False)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "soft.xml"))
    assert model.body("link_1").inertia[2] == 0.0003999999999999


def test_a_step_that_is_too_long_is_reported(tmp_path):
    stiff = {"spring_stiffness": 5000.0, "max_deflection": 1e3}
    found = export(scenario("sea", parameters={"joint_1": stiff}), tmp_path / "soft.xml", step=1e-3, plot=False)
    assert found.replay.diverged_at is not None
    assert any("diverges" in text for text in found.remarks)


def test_a_model_that_mujoco_refuses_is_one_error(tmp_path, monkeypatch):
    monkeypatch.setattr("asrsim.exports.motors.TINY", 0.0)
    with pytest.raises(SimulationError, match=r"MuJoCo cannot load the model: .*mjMINVAL"):
        export(scenario("sea"), tmp_path / "soft.xml", plot=False)


@pytest.mark.parametrize("rods", [RODS, TWO_FREE], ids=["one freedom", "a weightless link"])
def test_couplings_rotors_and_weightless_links_move_in_mujoco_as_in_asrsim(tmp_path, rods):
    """MuJoCo's own step is of first order; its equality constraints are soft, but hold within 0.02 mrad."""
    path = tmp_path / "rods.urdf"
    path.write_text(urdf(rods))
    keys = {"duration": 1.0, "initial": {"j1": 0.6}, "external_torques": {"j2": 0.5}, "engine": "mujoco"}
    found = export(asrsim.make_scenario(path, **keys), tmp_path / "rods.xml", plot=False).replay
    assert np.ptp(found.ours) > 0.6
    assert np.abs(found.error).max() < 2.0
    np.testing.assert_allclose(found.theirs[:, 1], -0.7 * found.theirs[:, 0] + 0.3, rtol=0.0, atol=2e-5)
