"""Files for certain programs: what they may contain, what is refused, and how the programs step them."""

import ast
import json
import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError, ScenarioError, SimulationError
from asrsim.exports import PROGRAMS, export
from support.paths import EXAMPLES, ROOT

STEP, SINE = {"step": {"at": 0.1, "to": 0.8}}, {"sinusoid": {"amplitude": 0.6, "frequency": 1.0}}


def scenario(actuator, motion=STEP, **keys):
    references = {"equilibrium_position": motion} | ({} if actuator == "sea" else {"stiffness_preset": 0.1})
    keys = {"duration": 1.0, "modes": {"*": 6}, "references": {"joint_1": references}} | keys
    return asrsim.make_scenario(EXAMPLES / "urdf" / f"dof1_{actuator}.urdf", engine="mujoco", **keys)


def installed(name):
    missing = PROGRAMS.get(name)().missing()
    return pytest.mark.skipif(bool(missing), reason=missing)


@pytest.mark.parametrize("motion", [STEP, SINE], ids=["step", "sine"])
@pytest.mark.parametrize("actuator", ["sea", "qbmove", "bavs"])
def test_affine_motors_and_linear_pieces_follow_asrsim_too(tmp_path, actuator, motion):
    """A step reaches torque limit and speed limit. Without MuJoCo XLA, MuJoCo steps the file."""
    found = export(scenario(actuator, motion), tmp_path / "soft.xml", program="mjx", plot=False)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "soft.xml"))
    assert not model.tendon_stiffnesspoly.any()
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert found.replay.rms.max() < 0.7
    assert np.abs(found.replay.error).max() < 3.2
    assert found.good


def test_what_a_program_would_step_wrong_is_refused_at_once(tmp_path):
    given = scenario(
        "sea", imperfections={"commands": {"joint_1": {"delay": 0.01}}}, world={"ground": True},
        parameters={"joint_1": {"controller_1_integral": 5.0, "hysteresis_torque": 0.3, "hysteresis_deflection": 0.02,
                                "motor_1_stribeck_friction": 0.1}},
    )  # fmt: skip
    with pytest.raises(ScenarioError) as caught:
        export(given, tmp_path / "soft.xml", program="mjx")
    for part in ("delay", "integral action", "hysteresis", "Stribeck", "contacts"):
        assert part in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_moving_adjuster_is_refused_for_mjlab(tmp_path):
    preset = {"sinusoid": {"amplitude": 0.005, "offset": 0.02, "frequency": 0.7}}
    given = scenario("awas_ii", references={"joint_1": {"equilibrium_position": SINE, "stiffness_preset": preset}})
    with pytest.raises(ScenarioError, match="control of a tendon"):
        export(given, tmp_path / "soft.xml", program="mjlab")


def test_an_unknown_program_is_told_with_the_known_ones(tmp_path):
    with pytest.raises(InputError, match="mujoco, warp, mjx, mjlab"):
        export(scenario("sea"), tmp_path / "soft.xml", program="isaac")


def test_a_program_that_is_not_installed_is_said_not_to_be_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(PROGRAMS.get("mjx"), "modules", ("no_such_module",))
    found = export(scenario("sea", duration=0.1), tmp_path / "soft.xml", program="mjx", plot=False)
    assert found.as_dict()["not_tried"] == "no_such_module is not installed here"
    assert found.replay.program.startswith("MuJoCo (")


def fit_at(path):
    keys = ["joint_1.motor_1_friction_torque", "joint_1.spring_k_1", "link_1.mass"]
    covariance = np.diag(np.square([0.01, 0.05, 0.1])).tolist()
    mean = [0.05, float(np.log(0.002)), float(np.log(0.3))]
    path.write_text(json.dumps({"keys": keys, "mean": mean, "covariance": covariance, "logarithmic": [False, True, True]}))
    return path


def test_an_older_mujoco_is_named_with_what_to_do(tmp_path, monkeypatch):
    """mjlab brings MuJoCo 3."""
    monkeypatch.delattr(mujoco, "mjtCtrlInput")
    with pytest.raises(SimulationError, match=r"need MuJoCo 4, but MuJoCo .* is imported here.*for mjx or mjlab"):
        export(scenario("sea", duration=0.1), tmp_path / "soft.xml", plot=False)


def test_the_package_for_mjlab_has_the_rule_of_the_motors_and_the_ranges_of_a_fit(tmp_path):
    fit = fit_at(tmp_path / "fit.json")
    given = scenario("qbmove", duration=0.1, initial={"joint_1": {"position": 0.2}})
    found = export(given, tmp_path / "my-arm.xml", program="mjlab", fit=fit, plot=False)
    folder = tmp_path / "my_arm_mjlab"
    assert {path.name for path in found.files if path.parent == folder} == {
        path.name for path in folder.iterdir() if path.is_file()
    }
    for path in folder.glob("*.py"):
        ast.parse(path.read_text())
    data = json.loads((folder / "robot.json").read_text())
    (joint,) = data["joints"]
    np.testing.assert_allclose(np.array(joint["matrix"]) @ [0.7, 0.1] + joint["offset"], [0.8, 0.6])
    model = mujoco.MjModel.from_xml_path(str(tmp_path / data["model"]))
    assert {*joint["motors"], "joint_1"} == set(data["start"])
    assert data["start"]["joint_1"][0] == 0.2
    assert data["timestep"] == model.opt.timestep
    fields = data["ranges"]["link_1.mass"]["fields"]
    assert fields["body_mass"]["link_1"] == pytest.approx([0.3 * np.exp(-0.196), 0.3 * np.exp(0.196)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "bound"),
    [
        pytest.param("warp", 2e-3, marks=installed("warp")),
        pytest.param("mjx", 0.02, marks=installed("mjx")),
        pytest.param("mjlab", 0.01, marks=installed("mjlab")),
    ],
)
@pytest.mark.parametrize("actuator", ["sea", "qbmove"])
def test_a_program_steps_its_file_as_mujoco_does(tmp_path, program, bound, actuator):
    """The table of docs/export.md. The programs calculate in single precision."""
    found = export(scenario(actuator, duration=0.5), tmp_path / "soft.xml", program=program, plot=False)
    print(found.replay.program, found.replay.apart, np.abs(found.replay.error).max())
    assert not found.replay.untried
    assert 0.0 < found.replay.apart < bound
    assert np.abs(found.replay.error).max() < 3.2


@pytest.mark.slow
@installed("mjlab")
def test_the_reach_task_trains_in_mjlab_on_a_cpu(tmp_path):
    """One update of the policy, with parameters drawn from a fit."""
    export(scenario("qbmove", duration=0.1), tmp_path / "arm.xml", program="mjlab", fit=fit_at(tmp_path / "fit.json"))
    command = [sys.executable, "-m", "arm_mjlab.train", "--device", "cpu", "--worlds", "8", "--iterations", "1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert re.search(r"mean reward of the last step: -?\d", done.stdout)
    assert (tmp_path / "logs" / "policy.pt").stat().st_size > 1000


def test_the_program_of_the_page_is_written_for_and_said_not_to_be_tried(tiny, asrsim_command):
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    code = page.partition("## A program of your own")[2].partition("```python\n")[2].partition("```")[0]
    (tiny.folder / "my_program.py").write_text(code)
    words = ("--set", "duration=0.1", "--set", "modes.elbow=6", "--no-plot", "--plugin", "my_program.py")
    done = asrsim_command("export", tiny.scenario, *words, "--for", "brax", "--out", "soft.xml")
    assert done.code == 0, done.err
    assert "not in brax: asrsim has no replay in Brax" in " ".join(done.out.split())
    assert "dcmotor" not in (tiny.folder / "soft.xml").read_text()
    assert "brax" in asrsim_command("export", tiny.scenario, *words, "--for", "bracks").err


def test_the_library_loads_the_plugin_of_a_program_which_a_refusal_names(tiny):
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    code = page.partition("## A program of your own")[2].partition("```python\n")[2].partition("```")[0]
    (tiny.folder / "my_program.py").write_text(code.replace('"brax"', '"breeze"').replace('"Brax"', '"Breeze"'))
    delayed = {"modes.elbow": 6, "imperfections.commands.elbow.delay": 0.01}
    with pytest.raises(ScenarioError, match="joint 'elbow': Breeze does not simulate the delay"):
        export(
            tiny.scenario, tiny.folder / "a.xml", overrides=delayed, program="breeze", plugins=[tiny.folder / "my_program.py"]
        )
    assert not (tiny.folder / "a.xml").exists()


def test_the_package_of_a_model_whose_name_begins_with_a_digit_can_be_imported(tmp_path):
    found = export(scenario("sea", duration=0.05), tmp_path / "2-arms.xml", program="mjlab", plot=False)
    folders = {path.parent.name for path in found.files if path.suffix == ".py"}
    assert folders == {"_2_arms_mjlab"}
    for file in (tmp_path / "_2_arms_mjlab").glob("*.py"):
        ast.parse(file.read_text())
