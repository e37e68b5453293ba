"""Bad input on the command line ends with an exit code and a line that names the fault, without a traceback."""

import json
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from asrsim.cli.console import json_errors
from asrsim.errors import OutputError, Problem, RobotError
from asrsim.robot import load_robot
from asrsim.robot.meshes import mesh_fault
from asrsim.robot.reader import MAX_MOVING
from support.paths import ROOT

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
REFUSED = ("Traceback", "unexpected error")


def chain(count, *, kind="revolute", name="j"):
    """URDF of a chain of `count` joints."""
    links = "".join(f'<link name="l{i}">{INERTIAL}</link>' for i in range(count))
    joints = "".join(
        f'<joint name="{name}{i}" type="{kind}"><parent link="{f"l{i - 1}" if i else "base"}"/><child link="l{i}"/>'
        '<axis xyz="0 0 1"/><limit effort="1" velocity="1" lower="-1" upper="1"/></joint>'
        for i in range(count)
    )
    return f'<robot name="chain"><link name="base"/>{links}{joints}</robot>'


def collision(geometry):
    """Replacement in the tiny robot's text that adds a collision element to its link."""
    return "</inertial>", f"</inertial><collision><geometry>{geometry}</geometry></collision>"


def test_a_robot_with_too_many_joints_is_refused(tmp_path):
    (tmp_path / "chain.urdf").write_text(chain(MAX_MOVING + 1))
    with pytest.raises(RobotError, match=f"at most {MAX_MOVING}"):
        load_robot(tmp_path / "chain.urdf")


def test_largest_robot_of_pybullet_stays_at_its_start(tiny, asrsim_command):
    """Larger robots make PyBullet confuse the states of the last joints. Each joint must stay at its start position."""
    tiny.robot.write_text(chain(MAX_MOVING))
    tiny.scenario.write_text("robot: pendulum.urdf\nduration: 0.002\ngravity: [0, 0, 0]\ninitial: {'*': 0.01}\n")
    assert asrsim_command("run", tiny.scenario, "--no-plot", "--json").code == 0
    joints = json.loads((tiny.folder / "out/step/default/summary.json").read_text())["joints"]
    assert [round(joint["steady_state"], 9) for joint in joints] == [0.01] * MAX_MOVING


def test_long_lists_of_problems_are_shortened(tiny, asrsim_command):
    tiny.scenario.write_text(tiny.scenario.read_text() + "".join(f"k{i}: 1\n" for i in range(300)))
    assert "... and 260 more" in asrsim_command("run", tiny.scenario).err
    assert len(json.loads(asrsim_command("run", tiny.scenario, "--json").out)["errors"][0]["problems"]) == 300


def test_long_values_are_shortened_in_messages():
    assert len(str(Problem(message="is wrong", value="9" * 1_000_000))) < 300


# -- meshes -----------------------------------------------------------------------------------------------------------


def stl(*points, count=1):
    """Binary STL file with one triangle whose header states `count` triangles."""
    return bytes(80) + struct.pack("<I12fH", count, 0, 0, 1, *(points or (0, 0, 0, 1, 0, 0, 0, 1, 0)), 0)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("m.stl", stl(), None),
        ("m.stl", b"", "empty"),
        ("m.stl", stl(count=10**9), "no triangle"),
        ("m.stl", stl(*[float("nan")] * 9), "finite"),
        ("m.stl", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "git lfs pull"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -1\n", None),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "cannot be read"),
        ("m.obj", b"v 0 0 0\nf a b c\n", "cannot be read"),
        ("m.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("m.obj", b"v 0 0 0\nv 0 0 1\nv 0 0 3\nf 1 2 3\n", "no area"),
        ("m.dae", b"<COLLADA/>", "cannot be read"),
        ("m.png", b"x", "none of"),
    ],
)
def test_meshes(name, data, words, tmp_path):
    (tmp_path / name).write_bytes(data)
    fault = mesh_fault(tmp_path / name)
    assert fault is None if words is None else words in str(fault)


def test_a_broken_mesh_is_a_warning_that_names_the_link(tiny, asrsim_command):
    (tiny.folder / "bad.obj").write_text("v 0 0 0\n")
    old, new = collision('<mesh filename="bad.obj"/>')
    tiny.robot.write_text(tiny.robot.read_text().replace(old, new))
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--set", "world={ground: {height: -9}}")
    assert outcome.code == 0
    assert "arm: collision mesh has no triangle" in outcome.err


def test_a_robot_without_name_or_with_blanks_in_names_runs(tiny, asrsim_command):
    text = tiny.robot.read_text().replace(' name="pendulum"', "").replace('name="elbow"', 'name=" elbow "')
    tiny.robot.write_text(text.replace('link="arm"', 'link=" arm"'))
    assert asrsim_command("run", tiny.scenario, "--no-plot").code == 0


# -- streams and JSON -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command", [("actuators", "nope"), ("check", "--actuator", "nope"), ("check", "--plugin", "nope.py", "x")]
)
def test_errors_are_json_with_the_json_option(command, asrsim_command):
    outcome = asrsim_command(*command, "--json")
    assert outcome.code == 1
    assert json.loads(outcome.out)["ok"] is False


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("redirection", "code", "told"),
    [(">&-", 0, ""), (">/dev/full", 1, "asrsim: cannot write the output: No space left on device\n")],
)
def test_closed_or_full_output_streams_end_the_command(redirection, code, told, tiny, monkeypatch):
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)  # the text is written when the command ends
    command = f'"{sys.executable}" -m asrsim.cli.app actuators {redirection}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (code, told)


# -- plugins ----------------------------------------------------------------------------------------------------------

PLUGIN = """
from asrsim.actuators import Actuator, Parameter, max_deflection

print("loaded")

class Mine(Actuator):
    name = "mine_{name}"
    title = "Mine"
    source = "mine"
    motors = 1
    parameters = (Parameter(name="k", default=10.0, unit="N m/rad", doc="k"), max_deflection(1.0))

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        {line}
        return parameters[0] * (theta_1 - q), 0.0

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return parameters[0]
"""


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("raise ValueError('no')", "raised ValueError: no"),
        ("return None", "must give 2 numbers"),
        ("return 1.0, 2.0, 3.0", "must give 2 numbers"),
        ("raise SystemExit(7)", "raised SystemExit: 7"),
        ("if theta_1 > 0.4: raise ValueError('late')", "elastic_torques: the plugin raised ValueError: late"),
    ],
)
def test_faulty_plugin_laws_give_an_error(line, words, tiny, asrsim_command):
    name = f"n{abs(hash(line))}"
    plugin = tiny.folder / "mine.py"
    plugin.write_text(PLUGIN.format(name=name, line=line))
    text = tiny.robot.read_text().replace("libsea_plugin.so", f"libmine_{name}_plugin.so")
    tiny.robot.write_text(text.replace("<spring_k>10</spring_k>", ""))
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--plugin", plugin)
    assert outcome.code == 1
    assert words in outcome.err
    assert "mine.py:" in outcome.err
    assert not any(word in outcome.out + outcome.err for word in REFUSED)


def test_plugin_output_does_not_enter_the_json(tiny, asrsim_command):
    plugin = tiny.folder / "mine.py"
    plugin.write_text(PLUGIN.format(name="printing", line="pass"))
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--plugin", plugin, "--json")
    assert json.loads(outcome.out)["ok"] is True
    assert "loaded" in outcome.err


# -- what cannot be drawn ---------------------------------------------------------------------------------------------


def test_failed_plots_do_not_hide_the_results(tiny, asrsim_command, monkeypatch):
    def fail(*_arguments, **_keys):
        raise OutputError("joints.png: cannot be written: No space left on device")

    monkeypatch.setattr("asrsim.plots.draw_run", fail)
    outcome = asrsim_command("run", tiny.scenario)
    assert outcome.code == 1
    assert "elbow" in outcome.out
    assert "No space left" in outcome.err
    document = json.loads(asrsim_command("run", tiny.scenario, "--json").out)
    assert [run["variant"] for run in document["runs"]] == ["default"]
    assert not document["ok"]
    assert asrsim_command("rerun", tiny.folder / "out/step/default/log.mcap").code == 0


@pytest.mark.parametrize(
    ("command", "wanted"),
    [
        (("run", "scenaro.yaml"), "Did you mean 'scenario.yaml'?"),
        (("check", "robt.urdf"), "Did you mean 'robot.urdf'?"),
        (("init", "robot.urdff"), "Did you mean 'robot.urdf'?"),
    ],
)
def test_misspelt_file_names_get_a_suggestion(tmp_path, monkeypatch, asrsim_command, command, wanted):
    (tmp_path / "robot.urdf").write_text(chain(1))
    (tmp_path / "scenario.yaml").write_text("robot: robot.urdf\nduration: 1\n")
    monkeypatch.chdir(tmp_path)
    outcome = asrsim_command(*command)
    assert outcome.code == 1
    assert wanted in outcome.err + outcome.out
    assert not any(word in outcome.err for word in REFUSED)


def test_inverse_dynamics_under_references_names_its_new_key(asrsim_command, tmp_path):
    robot = ROOT / "examples" / "urdf" / "dof1_sea.urdf"
    (tmp_path / "s.yaml").write_text(f"robot: {robot}\nduration: 1\nreferences: {{joint_1: {{inverse_dynamics: true}}}}\n")
    assert "s.yaml:3: references.joint_1.inverse_dynamics" in (said := asrsim_command("run", "s.yaml").err)
    assert "`inverse_dynamics: {JOINT: true}`" in said
    (tmp_path / "s.yaml").write_text(f"robot: {robot}\nduration: 1\ninverse_dynamics: true\n")
    assert "s.yaml: references.joint_1: needs the desired motion" in asrsim_command("run", "s.yaml").err


@pytest.mark.parametrize(
    "arguments",
    [
        "twin step.yaml -e step.yaml --clock-offset nan",
        "plot out --start=-inf",
        "plot out --bode --band 1 inf",
        "check --actuator sea --stage damper",
        "check step.yaml --stage damper",
        "check step.yaml --arg side=left",
        "check step.yaml --package arm=folder",
    ],
)
def test_options_that_could_not_be_used_are_wrong_usage(tiny, asrsim_command, arguments):
    assert asrsim_command(*arguments.split()).code == 2


def test_an_interrupted_command_still_prints_one_json_document(capsys):
    with pytest.raises(KeyboardInterrupt), json_errors(True):
        raise KeyboardInterrupt
    assert json.loads(capsys.readouterr().out)["ok"] is False


@pytest.mark.parametrize("command", ["render", "plot", "rerun"])
def test_a_log_that_is_left_out_is_warned_of_beside_the_json(tiny, asrsim_command, command):
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants: {a: {}, b: {}}\n")
    asrsim_command("run", tiny.scenario, "--no-plot", "--set", "duration=0.01", "--set", "compiled=false", "-o", "out")
    broken = Path("out") / "b" / "log.mcap"
    broken.write_bytes(broken.read_bytes()[:40])
    done = asrsim_command(command, "out", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)
    assert str(broken) in done.err
    assert "warning" in done.err
