"""An actuator of three motors from a plugin: each command knows each motor."""

import json

import numpy as np
import pytest

import asrsim
from asrsim.log import open_log, read_log
from asrsim.log.topics import robot_topics
from asrsim.plots.panels import PANELS
from asrsim.plugins import load_plugin_file
from support.three_motors import THREE
from support.tiny import PENDULUM

CLAIMS = """\
expect:
  - {joint: elbow, quantity: motor_3_position, measure: steady_state, value: 0.4, tolerance: 0.01}
  - {joint: elbow, quantity: elastic_torque_3, measure: final, comparison: "<", value: 0}
"""


@pytest.fixture
def three(tmp_path, asrsim_command):
    """Folder with the plugin, the robot, a scenario, its log, and a recording of the same motion."""
    (tmp_path / "three.py").write_text(THREE)
    (tmp_path / "arm.urdf").write_text(PENDULUM.replace("libsea", "libthree").replace("<operation_mode>3", "<operation_mode>6"))
    step = "{equilibrium_position: {step: {at: 0.1, to: 0.5}}, stiffness_preset: 0.1}"
    (tmp_path / "s.yaml").write_text(f"robot: arm.urdf\nduration: 0.8\nreferences: {{elbow: {step}}}\n{CLAIMS}")
    outcome = asrsim_command("run", "s.yaml", "--plugin", "three.py", "--no-plot")
    assert outcome.code == 0, outcome.err
    samples = read_log(tmp_path / "out/s/default/log.mcap").samples
    names = ["link_position", *(f"motor_{i}_position" for i in (1, 2, 3)), "reference_1"]
    table = np.column_stack([samples.time, *(samples.values[name][:, 0] for name in names)])[::4]
    header = ",".join(["time", *(f"elbow.{name}" for name in names)])
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header=header, comments="")
    return tmp_path


def test_a_log_has_a_topic_and_a_panel_for_each_motor(three):
    (joint,) = open_log(three / "out/s/default/log.mcap").info.joints
    topics = [topic.name for topic in robot_topics([joint])]
    assert {f"/elbow/{name}_state" for i in (1, 2, 3) for name in (f"motor_{i}", f"torque_el{i}")} <= {*topics}
    assert len(topics) == len({*topics})
    assert {f"motor_{i}_position" for i in (1, 2, 3)} <= {*PANELS["position"].of(joint)}


def test_an_observation_has_each_motor(three):
    load_plugin_file(three / "three.py")
    with asrsim.Simulation(three / "s.yaml", compiled=False) as simulation:
        simulation.advance(700)
        found = simulation.observe()
        logged = simulation.read([f"motor_{i}_position" for i in (1, 2, 3)])
        assert found.motor_position.shape == found.motor_velocity.shape == (1, 3)
        assert found.motor_position[0] == pytest.approx([values[0] for values in logged.values()], abs=1e-3)
        assert found.motor_position[0] == pytest.approx([0.6, 0.5, 0.4], abs=0.02)


def test_plot_compares_each_motor_with_a_recording(three, asrsim_command):
    log = "out/s/default/log.mcap"
    outcome = asrsim_command("plot", log, "--experiment", "lab.csv", "--plugin", "three.py", "--out", "p", "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads((three / "p/recorded.json").read_text())["curves"]
    assert {f"motor_{i}_position" for i in (1, 2, 3)} <= {curve["quantity"] for curve in found}
    chosen = ["--quantity", "motor_3_torque", "--quantity", "friction_torque_3"]
    assert asrsim_command("plot", log, *chosen, "--plugin", "three.py", "--out", "q").code == 0
    assert [path.name for path in (three / "q").iterdir()] == ["quantities.png"]


def test_init_plays_the_recording_and_identify_compares_each_motor(three, asrsim_command):
    outcome = asrsim_command("init", "arm.urdf", "--experiment", "lab.csv", "--out", "i.yaml", "--plugin", "three.py")
    assert outcome.code == 0, outcome.err
    (three / "i.yaml").write_text((three / "i.yaml").read_text().replace("stiffness_preset: 0.0", "stiffness_preset: 0.1"))
    options = ["--free", "elbow.k=6", "--free", "elbow.damping", "--plugin", "three.py", "--out", "fit", "--no-plot"]
    outcome = asrsim_command("identify", "i.yaml", "--experiment", "lab.csv", *options)
    assert outcome.code == 0, outcome.err
    (path,) = three.rglob("fit.json")
    fit = json.loads(path.read_text())
    assert {one["key"]: one["value"] for one in fit["estimates"]}["elbow.k"] == pytest.approx(5.0, rel=1e-3)
    assert "elbow.motor_3_position" in [one["key"] for one in fit["channels"]]


def test_an_environment_observes_each_motor(three):
    pytest.importorskip("gymnasium")
    load_plugin_file(three / "three.py")
    names = ("link_position", "motor_3_position", "motor_3_velocity", "motor_3_torque", "elastic_torque_3")
    env = asrsim.make_env(three / "s.yaml", observe=names)
    env.reset(seed=0)
    for _ in range(3):
        seen, *_ = env.step(env.action_space.sample())
    assert seen.shape == (5,)
    assert np.isfinite(seen).all()
    assert seen[1] != 0.0


@pytest.mark.parametrize(("mode", "file_mode", "names"), [(5, 6, "reference_{}"), (4, 4, "motor_{}_torque")])
def test_init_plays_the_command_of_each_motor(three, asrsim_command, mode, file_mode, names):
    """Three references are those of motors, also if the robot file states equilibrium and preset."""
    moves = {names.format(i): f"{{sinusoid: {{amplitude: {0.1 * i}, frequency: {i}}}}}" for i in (1, 2, 3)}
    commands = ", ".join(f"{name}: {signal}" for name, signal in moves.items())
    (three / "c.yaml").write_text(f"robot: arm.urdf\nmodes: {mode}\nduration: 0.4\nreferences: {{elbow: {{{commands}}}}}\n")
    assert asrsim_command("run", "c.yaml", "--plugin", "three.py", "--out", "c", "--no-plot").code == 0
    samples = read_log(three / "c/log.mcap").samples
    recorded = {names.format(i): samples.values[f"reference_{i}"][:, 0] for i in (1, 2, 3)}
    recorded["link_position"] = samples.values["link_position"][:, 0]
    header = ",".join(["time", *(f"elbow.{name}" for name in recorded)])
    table = np.column_stack([samples.time, *recorded.values()])
    np.savetxt(three / "played.csv", table, delimiter=",", header=header, comments="")
    text = (three / "arm.urdf").read_text().replace("<operation_mode>6", f"<operation_mode>{file_mode}")
    (three / "arm.urdf").write_text(text)
    outcome = asrsim_command("init", "arm.urdf", "--experiment", "played.csv", "--out", "p.yaml", "--plugin", "three.py")
    assert outcome.code == 0, outcome.err
    assert asrsim_command("run", "p.yaml", "--plugin", "three.py", "--out", "again", "--no-plot").code == 0
    again = read_log(three / "again/log.mcap").samples
    rows = len(again.time)
    moved = np.ptp(recorded["link_position"])
    np.testing.assert_allclose(again.values["link_position"][:, 0], recorded["link_position"][:rows], atol=1e-3 * moved)


def test_learning_moves_each_motor(three, asrsim_command):
    """The inverse model's first guess is already near the motion, with a gain of its own for each motor."""
    gains = ", ".join(f"controller_{i}_proportional: {30 * i}" for i in (1, 2, 3))
    (three / "l.yaml").write_text(
        f"robot: arm.urdf\nduration: 1\nparameters: {{elbow: {{{gains}}}}}\n"
        "references: {elbow: {stiffness_preset: 0.15}}\nilc:\n"
        "  trajectory: {elbow: {minimum_jerk: {duration: 0.6, to: 0.4}}}\n  tolerance: 0.001\n  max_iterations: 3\n"
    )
    outcome = asrsim_command("ilc", "l.yaml", "--plugin", "three.py", "--out", "learned", "--no-plot")
    assert outcome.code == 0, outcome.err
    trials = json.loads((three / "learned/ilc.json").read_text())["trials"]
    assert trials[0]["largest_error"]["elbow"] < 0.03


@pytest.mark.slow
def test_design_proposes_a_motion_of_three_motors(three, asrsim_command):
    (three / "limits.yaml").write_text("limits: {elbow: {link_position: [-1, 1], motor_torque: 30}}\n")
    options = ["--limits", "limits.yaml", "--free", "elbow.k", "--duration", "0.5", "--plugin", "three.py", "--no-plot"]
    assert asrsim_command("design", "s.yaml", *options, "--out", "d.csv").code == 0
    assert asrsim_command("run", "d.yaml", "--plugin", "three.py", "--out", "designed", "--no-plot").code == 0
