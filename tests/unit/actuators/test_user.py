"""Users' own actuators: loading the file, finding it from a URDF, checking its laws."""

import re
import shutil
import sys
import textwrap
from itertools import count

import numpy as np
import pytest

import asrsim
from asrsim.actuators import ACTUATORS, Antagonistic, Parameter
from asrsim.actuators.checker import check_actuator
from asrsim.errors import ActuatorError
from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.plugins import load_plugin_file
from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from support.paths import ROOT
from support.three_motors import THREE
from validation.models import Body, chain, column, run

EXAMPLE = ROOT / "examples/plugins/my_vsa.py"
CALLS = count()
DOCS = ROOT / "docs/actuators.md"
LAWS = """
    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        return parameters[0] * (theta_1 - q), 0.0

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return parameters[0]
"""
FIT = "scenario: run.yaml\nexperiments: [a.csv]\nplugins: [code.py]\nfree: {joint_1.spring_stiffness: null}\n"
STUDY = "scenario: run.yaml\nplugins: [code.py]\nover: {duration: [0.1, 0.2]}\n"
DECLARATION = """
from asrsim.actuators import Actuator, Parameter

class Mine(Actuator):
    name = "mine"
    title = "Mine"
    source = "me"
    motors = 1
    parameters = (Parameter(name="k", default=3.0, unit="N m/rad", doc="stiffness"),)
"""


def write(tmp_path, text, name="mine.py"):
    path = tmp_path / name
    path.write_text(textwrap.dedent(text))
    return path


def failure(path):
    with pytest.raises(ActuatorError) as caught:
        load_plugin_file(path)
    return caught.value


def test_example_is_registered_and_its_urdf_finds_it(tmp_path):
    (actuator,) = load_plugin_file(EXAMPLE)
    assert ACTUATORS.get("my_vsa") is actuator
    urdf = write(
        tmp_path,
        """<robot name="r"><link name="w"/><joint name="j" type="revolute"><parent link="w"/><child link="l"/>
        <limit effort="9" velocity="9" lower="-1" upper="1"/></joint>
        <link name="l"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
        <gazebo><plugin name="p" filename="libmy_vsa_plugin.so"><joint>j</joint><operation_mode>6</operation_mode>
        <cubic>25</cubic><max_def>0.5</max_def><mot_2_J>0.1</mot_2_J><liner>2</liner></plugin></gazebo></robot>""",
        "r.urdf",
    )
    robot = load_robot(urdf)
    values = robot.actuators[0].values()
    assert (values["linear"], values["cubic"], values["max_deflection"], values["motor_2_inertia"]) == (2.0, 25.0, 0.5, 0.1)
    assert any(problem.code == "unknown-tag" and "<linear>" in str(problem) for problem in warnings_of(robot))


def test_the_documented_example_passes_the_checker(tmp_path):
    (example,) = load_plugin_file(EXAMPLE)
    assert check_actuator(example).passed
    shown = DOCS.read_text().split("```python\n")[1].split("```")[0]
    path = tmp_path / "my_vsa.py"
    path.write_text(shown)
    ACTUATORS._entries.pop("my_vsa")
    (documented,) = load_plugin_file(path)
    arguments = (0.1, 0.4, -0.3, (2.0, 30.0, 0.6))
    assert documented.elastic_torques(*arguments) == example.elastic_torques(*arguments)
    assert documented.stiffness(*arguments) == example.stiffness(*arguments)


def test_a_plugin_may_be_loaded_again_under_its_own_name(tmp_path):
    path = write(tmp_path, DECLARATION + LAWS)
    load_plugin_file(path)
    assert load_plugin_file(path) == (ACTUATORS.get("mine"),)
    other = tmp_path / "other.py"
    shutil.copy(path, other)
    assert failure(other).problems[0].code == "name-taken"
    ours = write(tmp_path, (DECLARATION + LAWS).replace('"mine"', '"sea"'), "sea.py")
    assert failure(ours).problems[0].code == "name-taken"


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("x = 1\nraise RuntimeError('oh')\n", "plugin-raised", 2),
        ("x = 1\nimport sys\nsys.exit(3)\n", "plugin-raised", 3),
        ("def f():\n    return 1 / 0\n\nf()\n", "plugin-raised", 2),
        ("x = (\n", "plugin-raised", 1),
        ("import no_such_module\n", "plugin-raised", 1),
        ("x = 1\n", "empty-plugin", None),
        (DECLARATION, "missing-law", 4),
        (DECLARATION + LAWS.replace("    @staticmethod\n", ""), "bad-law", 4),
        (DECLARATION + LAWS.replace("(q, theta_1, theta_2, parameters)", "(q)"), "law-raised", 4),
        (DECLARATION + LAWS + DECLARATION.replace("Mine", "Other") + LAWS, "name-taken", 21),
        (DECLARATION.replace('"mine"', '"My VSA"') + LAWS, "bad-declaration", 4),
        (DECLARATION.replace("motors = 1", "motors = 9") + LAWS, "bad-declaration", 4),
        (DECLARATION.replace("default=3.0", 'default="3"') + LAWS, "plugin-raised", 9),
        (DECLARATION.replace("default=3.0", "default=float('inf')") + LAWS, "plugin-raised", 9),
        (DECLARATION.replace('name="k"', 'name="motor_1_inertia"') + LAWS, "bad-parameter", 4),
        (DECLARATION.replace('name="k"', 'name="k 1"') + LAWS, "plugin-raised", 9),
        (DECLARATION.replace("(Parameter", "[Parameter").replace("),)", ")]") + LAWS, "bad-declaration", 4),
    ],
)
def test_bad_plugin_files(tmp_path, text, code, line):
    path = write(tmp_path, text)
    problems = failure(path).problems
    assert {problem.code for problem in problems} == {code}
    assert problems[0].file is not None
    assert problems[0].file.resolve() == path.resolve()
    assert problems[0].line == line
    assert "mine" not in ACTUATORS


def test_missing_plugin_file(tmp_path):
    assert failure(tmp_path / "none.py").problems[0].code == "missing-file"


# -- the checker -------------------------------------------------------------------------------------------------------


class Linear(Antagonistic):
    name, title, source = "linear", "Linear", "test"
    motors = 2
    typical_preset = 0.1
    parameters = (Parameter(name="k", default=3.0, unit="N m/rad", doc="stiffness"),)

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        return parameters[0] * (theta_1 - q), parameters[0] * (theta_2 - q)

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return 2.0 * parameters[0]


class Deadband(Linear):
    """Legitimate: flat around zero, with corners."""

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        d = 0.5 * (theta_1 + theta_2) - q
        torque = parameters[0] * (max(d - 0.1, 0.0) + min(d + 0.1, 0.0))
        return torque, torque

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return 2.0 * parameters[0] if abs(0.5 * (theta_1 + theta_2) - q) > 0.1 else 0.0


@pytest.mark.parametrize(
    "actuator", [ACTUATORS.get(name) for name in ("sea", "qbmove", "bavs", "awas_ii")] + [Linear, Deadband, THREE]
)
def test_good_laws_pass(actuator, tmp_path):
    if isinstance(actuator, str):
        (actuator,) = load_plugin_file(write(tmp_path, actuator))
    report = check_actuator(actuator)
    assert [check.name for check in report.checks if not check.passed] == []
    assert len(report.checks) == 8


@pytest.mark.parametrize(
    ("failed", "laws"),
    [
        ("pure", {"stiffness": lambda q, x, y, p: 2.0 * p[0] + 1e-9 * next(CALLS)}),
        # The sign alternates over the calls of both laws, so that a second pass in the same order gives the same numbers.
        ("pure", {
            "elastic_torques": lambda q, x, y, p: (p[0] * (x - q) + 1e-9 * (-1) ** next(CALLS), p[0] * (y - q)),
            "stiffness": lambda q, x, y, p: 2.0 * p[0] + 1e-9 * (-1) ** next(CALLS),
        }),
        ("stiffness", {"stiffness": lambda q, x, y, p: 2.001 * p[0]}),
        ("restoring", {
            "elastic_torques": lambda q, x, y, p: (p[0] * (q - x), p[0] * (q - y)), "stiffness": lambda q, x, y, p: -2.0 * p[0],
        }),
        # Motor 2 pulls on motor 1, but not the other way round: a loop makes work.
        ("passive", {
            "elastic_torques": lambda q, x, y, p: (p[0] * (x - q) + 0.5 * (y - q), p[0] * (y - q)),
            "stiffness": lambda q, x, y, p: 2.0 * p[0] + 0.5,
        }),
        ("finite", {"elastic_torques": lambda q, x, y, p: ((x - q) ** 0.5, 0.0)}),
        ("finite", {"elastic_torques": lambda q, x, y, p: (p[0] * (x - q) / (abs(y - q - 0.3) > 0.02), 0.0)}),
        ("finite", {"stiffness": lambda q, x, y, p: sys.exit(3) if q > 1.0 else 2.0 * p[0]}),
        ("reference map", {"equilibrium_position": lambda x, y: x}),
        ("reference map", {"elastic_torques": lambda q, x, y, p: (p[0] * (x - q) + 0.1, p[0] * (y - q))}),
        ("energy", {"elastic_energy": lambda q, x, y, p: p[0] * ((x - q) ** 2 + (y - q) ** 2)}),
    ],
)  # fmt: skip
def test_each_fault_is_found_by_its_check(failed, laws):
    report = check_actuator(type("Faulty", (Linear,), {name: staticmethod(law) for name, law in laws.items()}))
    assert not report.passed
    check = next(check for check in report.checks if check.name == failed)
    assert not check.passed
    assert check.detail


def test_an_exception_fails_only_the_checks_of_its_law():
    law = staticmethod(lambda q, x, y, p: {0.0: 0.0}[q])
    (check,) = (
        check for check in check_actuator(type("Faulty", (Linear,), {"elastic_energy": law})).checks if not check.passed
    )
    assert (check.name, check.detail[:15]) == ("energy", "raised KeyError")


def test_the_command_printed_by_init_for_a_plugin_runs(tmp_path, asrsim_command):
    law = shutil.copy(EXAMPLE, tmp_path)
    robot = shutil.copy(EXAMPLE.parents[1] / "urdf/plain_arm.urdf", tmp_path)
    said = asrsim_command("init", robot, "--actuator", "my_vsa", "--plugin", law, "--out", "arm.yaml").out
    command = said.split("run it: asrsim ")[1].split()
    assert command == ["run", "arm.yaml", "--plugin", str(law)]
    assert asrsim_command(*command, "--set", "duration=0.01", "--no-plot").code == 0
    ACTUATORS._entries.pop("my_vsa")  # as another process begins
    refused = asrsim_command(*command[:2])
    assert refused.code == 1
    assert "Your own actuators need --plugin FILE" in refused.err


@pytest.mark.parametrize(("command", "file"), [("identify", FIT), ("sweep", STUDY)])
def test_no_file_runs_code_by_itself(tmp_path, asrsim_command, command, file):
    """A fit file or a study of somebody else may name any file of Python: it runs where its user names it too."""
    (tmp_path / "code.py").write_text("from pathlib import Path\nPath('ran').touch()\n")
    shutil.copy(EXAMPLE.parents[1] / "urdf/dof1_sea.urdf", tmp_path)
    (tmp_path / "run.yaml").write_text("robot: dof1_sea.urdf\nduration: 0.1\n")
    (tmp_path / "a.csv").write_text("time,joint_1.link_position\n0,0\n1,0.1\n")
    (tmp_path / "file.yaml").write_text(file)
    outcome = asrsim_command(command, "file.yaml")
    assert outcome.code == 1
    assert "file.yaml: plugins: is Python code, which runs only if you name it" in outcome.err
    assert "PosixPath" not in outcome.err
    assert "--plugin code.py" in outcome.err.replace(f"{tmp_path}/", "")
    assert not (tmp_path / "ran").exists()
    asrsim_command(command, "file.yaml", "--plugin", "code.py")
    assert (tmp_path / "ran").exists()


def three_motor_arm(tmp_path, mode, **references):
    load_plugin_file(write(tmp_path, THREE))
    urdf = tmp_path / "arm.urdf"
    text = (EXAMPLE.parents[1] / "urdf" / "dof1_qbmove.urdf").read_text()
    urdf.write_text(re.sub(r"<spring_.*>", "", text.replace("libqbmove_plugin", "libthree_plugin")))
    return asrsim.make_scenario(
        urdf, duration=1.0, engine="mujoco", gravity=[0, 0, 0], modes=mode, references={"*": references}
    )


def test_a_law_with_too_few_positions_is_named(tmp_path):
    missing = THREE.replace("stiffness(q, theta_1, theta_2, theta_3, parameters)", "stiffness(q, theta_1, theta_2, parameters)")
    assert "must take q, theta_1, theta_2, theta_3, parameters" in str(failure(write(tmp_path, missing)))


@pytest.mark.parametrize("mode", [3, 6])
@pytest.mark.parametrize("compiled", [False, True])
def test_three_motors_swing_a_link_by_their_springs(tmp_path, mode, compiled):
    """I q'' = 3 k (mean - q): from rest at 0, the link swings about the mean of the standing motors, 0.3 rad."""
    load_plugin_file(write(tmp_path, THREE))
    inertia, k, goals = 0.02, 5.0, (0.4, 0.3, 0.2)
    result = run(
        chain(Body(actuator="three", mass=1e-9, reach=0.0, inertia=inertia)),
        mode=mode,
        gravity=0.0,
        duration=0.5,
        references={"equilibrium_position": 0.3, "stiffness_preset": 0.1},
        compiled=compiled,
        parameters={f"motor_{i}_inertia": 1e6 for i in (1, 2, 3)},
        **({} if mode == 3 else {"initial_motor_positions": {"joint_1": goals}}),
    )
    position = column(result, "link_position")
    expected = 0.3 * (1.0 - np.cos(np.sqrt(3.0 * k / inertia) * result.samples.time))
    np.testing.assert_allclose(position, expected, atol=1e-3)
    for i, theta in enumerate(goals, start=1):
        np.testing.assert_allclose(column(result, f"motor_{i}_position"), theta, atol=1e-6)
        np.testing.assert_allclose(column(result, f"elastic_torque_{i}"), k * (theta - position), atol=1e-6)
    assert np.abs(column(result, "energy_residual")).max() < 1e-3


@pytest.mark.parametrize("mode", [2, 5])
def test_the_equilibrium_of_three_motors_is_logged(tmp_path, mode):
    """Springs of one stiffness rest at the mean of the motors: .3, .25 and .05 rad."""
    scenario = three_motor_arm(tmp_path, mode, reference_1=0.3, reference_2=0.25, reference_3=0.05)
    samples = asrsim.run(scenario).run.samples
    assert samples is not None
    joints = asrsim.prepare(scenario).info.joints
    assert DERIVED_FUNCTIONS["equilibrium_position"](samples, joints)[-1, 0] == pytest.approx(0.2, abs=1e-3)
    assert samples.values["link_position"][-1, 0] == pytest.approx(0.2, abs=1e-3)


def test_a_plugin_brings_signals_and_measures(tiny, asrsim_command):
    """The example file, used by a scenario and its claim; it may be loaded again."""
    plugin = ROOT / "examples" / "plugins" / "my_lab.py"
    tiny.scenario.write_text(
        "robot: pendulum.urdf\nduration: 0.5\nreferences: {elbow: {equilibrium_position: {triangle: {amplitude: 0.1}}}}\n"
        "expect: [{joint: elbow, quantity: reference_1, measure: crest_factor, comparison: <, value: 3}]\n"
    )
    assert "triangle" in asrsim_command("run", tiny.scenario, "--no-plot").err
    for _ in range(2):
        outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--plugin", plugin)
        assert outcome.code == 0, outcome.err
        assert "crest_factor of reference_1" in outcome.out


def test_a_plugin_brings_a_recording_format(tmp_path, monkeypatch):
    from asrsim.recordings import READERS, read_recording

    monkeypatch.setattr(READERS, "_entries", {name: READERS.get(name) for name in READERS})
    load_plugin_file(ROOT / "examples" / "plugins" / "my_lab.py")
    rows = np.zeros(20, [("time", "<f8"), ("q", "<f4"), ("dq", "<f4")])
    rows["time"], rows["q"] = np.arange(20) / 100.0, np.linspace(0.0, 0.5, 20)
    (tmp_path / "lab.mylog").write_bytes(rows.tobytes())
    column = read_recording(tmp_path / "lab.mylog").channels["elbow.link_position"]
    assert column.quantity == "link_position"
    np.testing.assert_allclose(column.values, rows["q"])


def test_readers_of_plugins_run_in_a_process_of_their_own(tmp_path, monkeypatch):
    """What such a reader prints harms nothing, and a reader that takes all memory or time ends that process only."""
    from asrsim.errors import RecordingError
    from asrsim.recordings import READERS, Reader, read_recording

    monkeypatch.setattr(READERS, "_entries", {name: READERS.get(name) for name in READERS})
    plugin = tmp_path / "mine.py"
    plugin.write_text(
        "import numpy as np\n"
        "from asrsim.recordings import READERS, Reader\n"
        "from asrsim.recordings.data import Content, RawColumn, RawTable\n"
        "def read(path, reading):\n"
        "    print('reading')\n"
        "    if path.stem == 'bomb':\n"
        "        np.ones(10**11)\n"
        "    names = ('time', 'elbow.link_position')\n"
        "    columns = tuple(RawColumn(name=name, values=np.arange(20) / 100.0) for name in names)\n"
        "    return Content(format='tdms', tables=(RawTable(columns=columns),))\n"
        "READERS.add('tdms', Reader(suffixes=('.tdms',), read=read))\n"
    )
    load_plugin_file(plugin)
    for name in ("lab", "bomb"):
        (tmp_path / f"{name}.tdms").write_bytes(b"\0\1")
    assert read_recording(tmp_path / "lab.tdms").channels["elbow.link_position"].values[-1] == 0.19
    with pytest.raises(RecordingError, match="needs far more memory"):
        read_recording(tmp_path / "bomb.tdms")
    READERS.add("here", Reader(suffixes=(".here",), read=READERS.get("tdms").read))
    (tmp_path / "lab.here").write_bytes(b"\0\1")
    with pytest.raises(RecordingError, match="was added by the running program"):
        read_recording(tmp_path / "lab.here")
