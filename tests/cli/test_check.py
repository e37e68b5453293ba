"""Output of `asrsim check` and `asrsim actuators`."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from asrsim.cli.app import app
from support.paths import EXAMPLES

GOOD = """<robot name="p"><link name="world"/>
<joint name="elbow" type="revolute"><parent link="world"/><child link="l"/><axis xyz="0 1 0"/>
<limit effort="300" velocity="100" lower="-3" upper="3"/></joint>
<link name="l"><inertial><mass value="0.2"/><inertia ixx="1e-6" iyy="3.21e-4" izz="3.21e-4"/></inertial></link>
<gazebo><plugin name="a" filename="libsea_plugin.so"><joint>elbow</joint><operation_mode>3</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>
<spring_k>400</spring_k><sprang>1</sprang>
</plugin></gazebo></robot>"""


@pytest.fixture
def runner():
    return CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1"})


@pytest.fixture
def good(tmp_path):
    path = tmp_path / "good.urdf"
    path.write_text(GOOD)
    return path


def test_check_shows_metres_and_newtons_for_prismatic_joints(runner, good):
    turning = runner.invoke(app, ["check", str(good)]).stdout
    sliding = good.with_name("slide.urdf")
    sliding.write_text(GOOD.replace("revolute", "prismatic"))
    found = runner.invoke(app, ["check", str(sliding)]).stdout
    units = ("N m/rad", "N m s/rad", "kg m^2", "rad/s", "N m/(rad s)")
    assert all(f" {unit} " in turning for unit in units)
    assert not any(f" {unit} " in found for unit in units)
    for unit in ("N/m", "N s/m", "kg", "m/s", "N/(m s)"):
        assert f" {unit} " in found


def test_table_shows_values_units_and_origins(runner, good):
    result = runner.invoke(app, ["check", str(good)])
    assert result.exit_code == 0
    rows = {line.split()[0]: line for line in result.stdout.splitlines() if line.split()}
    assert "400" in rows["spring_stiffness"]
    assert "N m/rad" in rows["spring_stiffness"]
    assert "<spring_k>, line 7" in rows["spring_stiffness"]
    assert "default <max_def>" in rows["max_deflection"]
    assert f"{good}:7" in result.stdout
    assert "unknown tag <sprang>" in result.stdout
    assert "0 errors, 1 warning" in result.stdout


def test_check_prints_json(runner, good):
    result = runner.invoke(app, ["check", "--json", str(good)])
    data = json.loads(result.stdout, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    (entry,) = data["files"]
    assert data["ok"] is True
    parameters = {parameter["name"]: parameter for parameter in entry["actuators"][0]["parameters"]}
    assert parameters["spring_stiffness"] == {
        "name": "spring_stiffness",
        "value": 400.0,
        "unit": "N m/rad",
        "origin": "tag",
        "tag": "spring_k",
        "line": 7,
        "text": "400",
    }
    assert parameters["motor_1_max_position"]["value"] == "inf"
    assert entry["warnings"][0]["code"] == "unknown-tag"
    assert entry["warnings"][0]["line"] == 7


def test_a_coarser_step_takes_more_substeps(runner, good, tmp_path):
    substeps = []
    for step in ("1e-3", "1e-2"):
        (tmp_path / "s.yaml").write_text(f"robot: good.urdf\nduration: 1\nstep: {step}\n")
        report = json.loads(runner.invoke(app, ["check", "--json", str(tmp_path / "s.yaml")]).stdout)["files"][0]
        assert report["substeps"]["omega_h"] <= 0.2
        substeps.append(report["substeps"]["substeps"])
    assert substeps[0] < substeps[1]


def test_check_reports_errors_of_every_file(runner, good, tmp_path):
    bad = tmp_path / "bad.urdf"
    bad.write_text(GOOD.replace("<operation_mode>3", "<operation_mode>7"))
    result = runner.invoke(app, ["check", str(bad), str(tmp_path / "none.urdf"), str(good)])
    assert result.exit_code == 1
    assert f"{bad}:5" in result.stdout
    assert "no such file" in result.stdout
    assert "3 files: 2 errors, 2 warnings" in result.stdout
    assert json.loads(runner.invoke(app, ["check", "--json", str(bad)]).stdout)["ok"] is False


def test_xacro_arguments_and_packages(runner, tmp_path):
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg/body.xacro").write_text(GOOD.replace("400", "$(arg k)"))
    path = tmp_path / "robots/r.xacro"
    path.parent.mkdir()
    include = '<xacro:include filename="$(find parts)/body.xacro"/>'
    path.write_text(f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{include}</robot>')
    command = ["check", "--json", str(path), "--arg", "k:=123", "--package", f"parts={tmp_path / 'pkg'}"]
    result = runner.invoke(app, command)
    values = {entry["name"]: entry["value"] for entry in json.loads(result.stdout)["files"][0]["actuators"][0]["parameters"]}
    assert values["spring_stiffness"] == 123.0
    assert runner.invoke(app, ["check", str(path), "--arg", "k"]).exit_code == 2
    assert runner.invoke(app, ["check", str(path)]).exit_code == 1


def test_check_of_a_law(runner):
    plugin = str(EXAMPLES / "plugins/my_vsa.py")
    result = runner.invoke(app, ["check", "--actuator", "my_vsa", "--plugin", plugin])
    assert result.exit_code == 0
    assert "all checks passed" in result.stdout
    report = json.loads(runner.invoke(app, ["check", "--actuator", "bavs", "--json"]).stdout)
    assert report["passed"] is True
    assert {check["name"] for check in report["checks"]} >= {"stiffness", "finite", "passive"}


def test_list_of_actuators(runner):
    text = runner.invoke(app, ["actuators"]).stdout
    assert all(name in text for name in ("sea", "qbmove", "bavs", "awas_ii", "libawas_ii_plugin.so"))
    data = json.loads(runner.invoke(app, ["actuators", "bavs", "--json"]).stdout)
    parameter = next(entry for entry in data[0]["parameters"] if entry["tag"] == "spring_k_e")
    assert (parameter["default"], parameter["unit"]) == (8.71, "1/rad")
    shown = runner.invoke(app, ["actuators", "awas_ii"]).stdout
    assert "<spring_r_t>" in shown
    assert "Jafari" in shown


@pytest.mark.parametrize(
    "keys",
    [
        "expect: [{joint: elbow, quantity: link_position, measure: maximun, value: 1}]",
        "expect: [{joint: elbow, quantity: link_position, measure: maximum, value: 1, options: {stat: 1}}]",
        "expect: [{joint: elbow, quantity: link_position, measure: final, comparison: <, value: 1, tolerance: 0.1}]",
        "expect: [{joint: elbow, quantity: link_position, measure: rmse, value: 1, against: pendulum.urdf}]",
        "task: {link: arm, poses: [{time: 1, position: [9, 9, 9]}]}",
    ],
)
def test_check_names_the_line_of_what_run_would_refuse(tiny, asrsim_command, keys):
    tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 1\n{keys}\n")
    outcome = asrsim_command("check", "-q", tiny.scenario)
    assert outcome.code == 1
    assert "step.yaml:3: " in outcome.out or "pendulum.urdf:3: " in outcome.out
    assert asrsim_command("run", tiny.scenario, "--no-plot").code == 1


@pytest.mark.parametrize("name", ["scenario.JSON", "scenario"])
def test_scenarios_are_recognised_by_their_content(tiny, asrsim_command, name):
    keys = {"robot": "pendulum.urdf", "duration": 1.0, "references": {"elbow": {"equilibrium_position": 0.2}}}
    (tiny.folder / name).write_text(json.dumps(keys))
    assert asrsim_command("check", name).code == 0
    (tiny.folder / name).write_text(json.dumps({**keys, "duration": -1}))
    outcome = asrsim_command("check", name)
    assert outcome.code == 1
    assert "duration" in outcome.out + outcome.err
    robot = tiny.robot.rename(tiny.folder / f"robot_of_{Path(name).stem}")
    assert "elbow" in asrsim_command("check", robot.name).out


def test_strict_makes_errors_of_warnings(runner, good):
    assert runner.invoke(app, ["check", str(good)]).exit_code == 0
    result = runner.invoke(app, ["check", "--strict", str(good)])
    assert result.exit_code == 1
    assert "1 error, 0 warnings" in result.stdout
    good.write_text(GOOD.replace("<sprang>1</sprang>", ""))
    assert runner.invoke(app, ["check", "--strict", str(good)]).exit_code == 0


@pytest.mark.parametrize("modes", [(9, 9), (9, 11)])
def test_two_joints_with_one_mistake_keep_values_and_choices(runner, good, modes):
    second = "<joint " + GOOD.partition("<joint ")[2].partition("</robot>")[0]
    for old, new in (('"elbow"', '"wrist"'), (">elbow<", ">wrist<"), ('"l"', '"m"'), ('"world"', '"l"')):
        second = second.replace(old, new)
    text = GOOD.replace("</robot>", f"{second}</robot>")
    for mode in modes:
        text = text.replace("<operation_mode>3<", f"<operation_mode>{mode}<", 1)
    good.write_text(text)
    (line,) = [one for one in runner.invoke(app, ["check", str(good)]).stdout.splitlines() if "no such operation mode" in one]
    assert all(f"'{mode}'" in line for mode in modes)
    assert "choose from 0 (LinkTorque)" in line
