"""`asrsim init --experiment`: recorded commands are played, and the motion is compared with the recording."""

import json
import shutil
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import asrsim
from asrsim.cli.app import app
from asrsim.errors import OutputError, RecordingError
from asrsim.identification import task_of
from asrsim.identification.data import read_data
from asrsim.identification.problem import read_scenario, set_up
from asrsim.log import open_log
from asrsim.plots.claims import judge
from asrsim.recordings import read_recording
from asrsim.robot import load_robot
from asrsim.scenario import apply_to_robot, load_scenario
from asrsim.starter.recording import write_from_recording
from asrsim.statics.sizing import sizing
from support.bags import START, write_bag
from support.examined import check_against_robot
from support.paths import ROOT

EXAMPLES = ROOT / "examples" / "urdf"
TIME = np.arange(0, 0.8, 0.01)
SMOOTH = 0.05 + 0.2 * np.sin(4 * TIME)


def lab(folder, *, zero=0.0, scale=1.0, header="time,q1,q1_ref,current", command=SMOOTH):
    response = np.interp(TIME - 0.03, TIME, command)
    table = np.column_stack([zero + TIME, scale * response, scale * command, TIME])
    np.savetxt(folder / "lab.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
    return folder / "lab.csv"


def make(folder, experiment, robot="dof1_sea", **options):
    made = write_from_recording(EXAMPLES / f"{robot}.urdf", experiment, folder / "s.yaml", **options)  # type: ignore[arg-type]
    (scenario,) = load_scenario(folder / "s.yaml")
    errors, warnings = check_against_robot(scenario, load_robot(scenario.robot))
    assert errors == []
    assert warnings == []
    return made, scenario


def test_commands_are_played_smoothly_between_their_samples(tmp_path):
    made, scenario = make(tmp_path, lab(tmp_path))
    assert [path.name for path in made.files] == [
        "s.yaml",
        "s_commands.csv",
        "lab.csv.yaml",
        "s.fit.yaml",
        "asrsim.schema.json",
    ]
    signal = scenario.references["joint_1"]["equilibrium_position"]
    np.testing.assert_allclose(signal.values(TIME), SMOOTH, atol=1e-12)
    np.testing.assert_allclose(signal.values(TIME[:-1] + 0.005), 0.05 + 0.2 * np.sin(4 * TIME[:-1] + 0.02), atol=1e-7)
    assert scenario.duration == pytest.approx(0.79)
    assert scenario.initial_positions == {"joint_1": pytest.approx(0.05)}
    (claim,) = scenario.expect
    assert (claim.quantity, claim.measure, claim.comparison) == ("link_position", "rmse", "<")
    assert claim.value == pytest.approx(0.1 * np.ptp(SMOOTH), rel=0.05)


def test_files_in_another_folder_name_the_recording_from_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lab(tmp_path)
    (tmp_path / "fits").mkdir()
    write_from_recording(EXAMPLES / "dof1_sea.urdf", Path("lab.csv"), Path("fits") / "s.yaml")
    for name in ("lab.csv.yaml", "s.fit.yaml"):
        text = (tmp_path / "fits" / name).read_text()
        assert "../lab.csv" in text or name != "lab.csv.yaml"
        assert str(tmp_path) not in text
    assert task_of(tmp_path / "fits" / "s.fit.yaml").free
    assert read_recording(tmp_path / "fits" / "lab.csv.yaml").time[-1] == pytest.approx(0.79)


def test_suggested_fit_ties_equal_motors_and_frees_a_delay(tmp_path):
    robot, recording = EXAMPLES / "dof2_vertical.urdf", EXAMPLES.parent / "recordings" / "two_joints.csv"
    write_from_recording(robot, recording, tmp_path / "s.yaml")
    task = task_of(tmp_path / "s.fit.yaml")
    assert [key for key in task.free if "motor" in key and "joint_2" in key] == []
    assert "joint_1.reference_1.delay" in task.free
    ties = {tie.key: tie.to for tie in task.ties}
    assert ties["joint_2.motor_1_*"] == ties["joint_2.motor_2_*"] == "joint_1.motor_1_*"
    assert ties["joint_2.reference_1.delay"] == "joint_1.reference_1.delay"


@pytest.mark.parametrize(
    ("mode", "spring", "motor", "gain"), [(1, False, False, True), (3, True, False, False), (6, True, True, False)]
)
def test_suggested_fit_frees_what_moves_the_joint_in_its_mode(tmp_path, mode, spring, motor, gain):
    """Mode 1 has no spring, and the motors of mode 3 have no dynamics."""
    robot = tmp_path / "arm.urdf"
    robot.write_text((EXAMPLES / "dof1_sea.urdf").read_text().replace("<operation_mode>3", f"<operation_mode>{mode}"))
    write_from_recording(robot, lab(tmp_path), tmp_path / "s.yaml")
    free = {key.removeprefix("joint_1.") for key in task_of(tmp_path / "s.fit.yaml").free}
    assert ("spring_stiffness" in free) == spring
    assert {"motor_1_inertia", "motor_1_damping", "motor_1_friction_torque"}.issubset(free) == motor
    assert any("motor" in key for key in free) == motor
    assert ("controller_1_proportional" in free) == gain
    assert {"damping", "friction"} <= free


@pytest.mark.parametrize(
    ("robot", "header", "told"),
    [
        ("dof1_sea", "time,q1,q1_ref,current", ""),
        ("dof1_sea", "time,joint_1.link_position,joint_1.equilibrium_position,n", "no command was recorded"),
        ("dof1_qbmove", "time,joint_1.position,joint_1.equilibrium_position,joint_1.stiffness_preset", "played instead"),
        ("dof1_qbmove", "time,joint_1.position,joint_1.motor_1_position,joint_1.motor_2_position", "no command was recorded"),
    ],
)
def test_suggested_fit_loads_for_every_kind_of_command(tmp_path, robot, header, told):
    write_from_recording(EXAMPLES / f"{robot}.urdf", lab(tmp_path, header=header), tmp_path / "s.yaml")
    task = task_of(tmp_path / "s.fit.yaml")
    with ExitStack() as stack:
        setup = set_up(task, stack)
    assert set(task.free) <= setup.problem.layout.keys
    text = (tmp_path / "s.yaml").read_text()
    assert told in text


@pytest.mark.parametrize(
    ("zero", "header", "scale", "lag"),
    [
        (0.04, "time,q1,q1_ref,current", 1.0, 0.0),
        (0.5, "time,q1,q1_ref,current", 1.0, 0.5),
        (1.7e9, "time,q1,q1_ref,current", 1.0, 0.0),
        (-2.0, "t [s],q1 [deg],q1_ref [deg],current", 180 / np.pi, -2.0),
    ],
)
def test_the_command_is_played_on_the_recordings_clock(tmp_path, zero, header, scale, lag):
    _, scenario = make(tmp_path, lab(tmp_path, zero=zero, header=header, scale=scale))
    signal = scenario.references["joint_1"]["equilibrium_position"]
    start = 0.04 if zero == 0.04 else 0.0
    np.testing.assert_allclose(signal.values(start + TIME), SMOOTH, atol=1e-6)  # a float of 1.7e9 s resolves 2.4e-7 s
    assert {claim.options["lag"] for claim in scenario.expect} == {lag}
    assert scenario.duration == pytest.approx(start + 0.79, abs=1.1e-3)


def test_bag_commands_are_played_and_stored_in_the_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time = 0.01 * np.arange(300)
    elbow = 0.32 * (1 - np.cos(2 * np.pi * 0.7 * time))
    q = np.column_stack([0.6 * np.sin(np.pi * time) * np.exp(-0.2 * time) + 0.1 * time, elbow])
    arm = "lab_msgs/msg/Arm"
    topics = {"/arm_state": (arm, lambda types, i, _: types[arm](q[i], q[i]))}
    definitions = {arm: "float64[] q\nfloat64[] q_des\n"}
    write_bag(tmp_path / "bag", "sqlite3", topics, START + 10**7 * np.arange(300), definitions=definitions)
    _, scenario = make(tmp_path, tmp_path / "bag", robot="dof2_horizontal")
    np.testing.assert_allclose(scenario.references["joint_2"]["equilibrium_position"].values(time), elbow, atol=1e-6)
    (scenario,) = load_scenario("s.yaml", overrides=["duration=0.2"])
    result = asrsim.run(scenario, out="out")
    shutil.rmtree(tmp_path / "bag")
    claims = judge(open_log(result.log))
    assert [claim.measured for claim in claims] == [claim.measured for claim in result.summary.claims]
    assert len(claims) > 0


@pytest.mark.parametrize(("zero", "decimals"), [(0.0, 3), (0.7004, 9), (1_715_000_000.123, 9), (-0.35, 3)])
def test_stair_commands_are_played_at_their_recorded_steps(tmp_path, zero, decimals):
    """The offset of the clock and its rounding do not matter."""
    from asrsim.simulation.run import simulate

    stairs = 0.05 + 0.1 * np.floor(TIME / 0.07 + 1e-9)
    rows = [f"{zero + t:.{decimals}f},{q:.6f},{q:.6f},0" for t, q in zip(TIME, stairs, strict=True)]
    (tmp_path / "lab.csv").write_text("\n".join(["time [s],q1,q1_ref,current", *rows]) + "\n")
    _, scenario = make(tmp_path, tmp_path / "lab.csv")
    samples = simulate(scenario).samples
    assert samples is not None
    changed = samples.time[1:][np.diff(samples.values["reference_1"][:, 0]) != 0.0]
    recorded = TIME[1:][np.diff(stairs) != 0.0]
    np.testing.assert_allclose(changed, np.ceil(np.round(recorded / 0.001, 3)) * 0.001, atol=1e-9)


@pytest.mark.parametrize(("mode", "unit", "taken"), [(2, "rad", 3), (5, "rad", 6), (4, "rad", 6), (6, "N m", 0), (0, "rad", 1)])
def test_modes_that_cannot_take_the_command_are_replaced(tmp_path, mode, unit, taken):
    mapping = [f"q1_ref=joint_1.reference_1 [{unit}]"]
    made, scenario = make(tmp_path, lab(tmp_path), mapping=mapping, mode=mode, robot="dof1_qbmove")
    assert scenario.modes["joint_1"] == taken
    assert any(f"mode {taken} instead of {mode}" in remark for remark in made.remarks)


@pytest.mark.parametrize(
    ("header", "played"),
    [
        ("time,q1,motor_1_torque,current", "motor_1_torque"),
        ("time,q1,motor_torque1 [N m],current", "motor_torque1 [N m]"),
        ("time,q1,q1_ref,motor1_torque", "motor1_torque"),
        ("time,q1,q1_ref [N m],motor1_torque", "q1_ref [N m]"),
        ("time,q1,joint_1.reference_1,motor1_torque", "joint_1.reference_1"),
    ],
)
def test_mode_4_takes_the_recorded_torque(tmp_path, header, played):
    made, scenario = make(tmp_path, lab(tmp_path, header=header), mode=4)
    assert set(scenario.references["joint_1"]) == {"motor_1_torque"}
    assert played in (tmp_path / "s.yaml").read_text().partition("references:")[2]
    assert not any("instead of" in remark for remark in made.remarks)


@pytest.mark.parametrize(
    ("header", "begins"),
    [
        ("time,tau1 [N m],q1_ref,current", {"joint_1": 0.05}),
        ("time,dq1,q1_ref [N m],current", {}),
        ("time,dq1,joint_1.reference_1,current", {}),
    ],
)
def test_unrecorded_joints_start_at_their_command(tmp_path, header, begins):
    """Exception: a torque command contains no position."""
    mode = None if begins else 4
    _, scenario = make(tmp_path, lab(tmp_path, header=header), mode=mode)
    assert scenario.initial_positions == pytest.approx(begins)


def test_a_scenario_reads_the_recording_as_the_given_document_states(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = np.loadtxt(lab(tmp_path, scale=180 / np.pi), delimiter=",", skiprows=1)
    table[[10, 30], 1] = -999.0
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header="time,alpha,beta,current", comments="")
    (tmp_path / "map.yaml").write_text(
        "map:\n  alpha: joint_1.link_position [deg] - 0.01\n  beta: joint_1.reference_1 [deg]\n"
        "window: [0.1, 0.6]\nmissing: -999\n"
    )
    command = ["init", str(EXAMPLES / "dof1_sea.urdf"), "--experiment", "lab.csv", "--map", "map.yaml", "--out", "s.yaml"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    first = read_recording("lab.csv", mapping=tmp_path / "map.yaml").channels["alpha"].values
    (tmp_path / "map.yaml").unlink()
    (scenario,) = load_scenario(tmp_path / "s.yaml")
    inside = (TIME >= 0.1) & (TIME < 0.595)
    signal = scenario.references["joint_1"]["equilibrium_position"]
    np.testing.assert_allclose(signal.values(TIME[inside] - 0.1), SMOOTH[inside], atol=1e-9)
    (claim,) = scenario.expect
    again = read_recording(claim.against, mapping=claim.options.get("map")).channels["alpha"].values
    np.testing.assert_array_equal(again, first)
    assert np.isnan(first).sum() == 2
    # The first sample of the window is missing.
    assert scenario.initial_positions["joint_1"] == pytest.approx(first[1])


def test_findings_about_a_recording_name_its_file(tmp_path, asrsim_command):
    """Those of the reader, and those about the starter."""
    recording = lab(tmp_path, header="time,q1,motor_pos1,current")
    robot = EXAMPLES / "dof1_sea.urdf"
    done = asrsim_command("init", robot, "--experiment", recording, "--out", "s.yaml", "--json")
    findings = json.loads(done.out)["findings"]
    assert "starter" in {one["code"] for one in findings}
    assert {one["file"] for one in findings} == {str(recording)}
    done = asrsim_command("init", robot, "--experiment", recording, "--out", "s.yaml", "--overwrite")
    assert done.out.count(str(recording)) >= len(findings)


def test_a_command_without_unit_is_stated_as_assumed(tmp_path):
    made, _ = make(tmp_path, lab(tmp_path))
    assert made.recording.channels["q1_ref"].conversion == "rad assumed"
    assert "q1_ref: joint_1.reference_1" in (text := (tmp_path / "lab.csv.yaml").read_text())
    assert "no unit" in next(line for line in text.splitlines() if "q1_ref" in line)


def test_motor_position_replaces_a_missing_command(tmp_path):
    lab(tmp_path, header="time,q1,motor_pos1,current")
    made, _ = make(tmp_path, tmp_path / "lab.csv")
    assert any("motor_1_position is played instead" in remark for remark in made.remarks)
    lab(tmp_path, header="time,q1,foo,current")
    with pytest.raises(RecordingError, match=r"has no such column; it is named by lab\.csv\.yaml"):
        make(tmp_path, tmp_path / "lab.csv", force=True)
    (tmp_path / "lab.csv.yaml").unlink()
    with pytest.raises(RecordingError, match=r"no column is a command.*foo.*--map COLUMN=joint_1.reference_1"):
        make(tmp_path, tmp_path / "lab.csv", force=True)


@pytest.mark.slow
class TestRealRecordings:
    """Tests with unmodified real recordings."""

    def test_an_arm_with_two_elastic_joints(self, tmp_path, shared):
        mapping = [f"tip_deflection{i}_rad=-joint_{i}.deflection" for i in (1, 2)]
        made, scenario = make(
            tmp_path, shared / "recordings/quanser_2dsfl_lqr_10deg.csv", robot="two_elastic_joints", mapping=mapping
        )
        assert made.remarks == ()
        most = {
            ("joint_1", "motor_1_position"): 0.04,
            ("joint_2", "motor_1_position"): 0.015,
            ("joint_1", "deflection"): 0.004,
            ("joint_2", "deflection"): 0.004,
        }
        claims = zip(scenario.expect, asrsim.run(scenario).summary.claims, strict=True)
        measured = {(claim.joint, claim.quantity): result.measured for claim, result in claims}
        assert all(measured[key] < limit for key, limit in most.items())

    def test_series_elastic_module(self, tmp_path, shared):
        _, scenario = make(tmp_path, shared / "recordings/hebi_sine_1hz.csv", mode=6)
        assert {"link_position", "link_velocity"} <= {claim.quantity for claim in scenario.expect}


def test_actuators_of_a_plain_robot_get_the_recorded_mode(tmp_path):
    with pytest.raises(RecordingError, match=r"a command for shoulder, but .* no actuator there.*--actuator shoulder=NAME"):
        make(tmp_path, lab(tmp_path), "plain_arm")
    for unit, mode in (("rad", 6), ("V", 7)):
        experiment = lab(tmp_path, header="time,q1,u,current")
        mapping = ["q1=shoulder.link_position", f"u=shoulder.reference_1 [{unit}]"]
        made, scenario = make(tmp_path, experiment, "plain_arm", actuators={"*": "sea"}, mapping=mapping, force=True)
        mounted = scenario.actuators["shoulder"]
        assert (mounted.type, mounted.mode) == ("sea", mode)
        assert mounted.parameters.get("motor_1_torque_constant") == (1.0 if mode > 6 else None)
        assert made.fit is not None


def deflected(folder, most, frequency=2.0):
    """Recording of a motor that swings by `most` rad about a link at rest, with two outliers."""
    motor = most * np.sin(2 * np.pi * frequency * TIME)
    motor[[10, 50]] = 1.9
    table = np.column_stack([TIME, 0.0 * TIME, motor, motor])
    names = ("link_position", "motor_1_position", "reference_1")
    header = ",".join(["time", *(f"joint_1.{name} [rad]" for name in names)])
    np.savetxt(folder / "lab.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
    return folder / "lab.csv"


def test_limits_that_a_recording_exceeds_are_named(tmp_path):
    """Springs clipped at 0.8 rad and motors of 6 rad/s, the defaults, cannot follow 1 rad at 2 Hz (12.6 rad/s)."""
    made = write_from_recording(EXAMPLES / "dof1_sea.urdf", deflected(tmp_path, 1.0), tmp_path / "s.yaml", mode=5)
    (velocity, deflection) = [text for text in made.remarks if "recording reaches" in text]
    assert "joint_1: the recording reaches 12.4 rad/s, but motor_1_max_velocity is " in velocity
    assert "reaches 0.998 rad, but max_deflection is 0.8 rad: raise it, as in parameters: {joint_1: {" in deflection
    task = task_of(tmp_path / "s.fit.yaml")
    scenario, _, robot = read_scenario(task)
    (data,) = read_data(task, scenario, robot)
    assert {velocity, deflection} <= {*data.remarks}


def test_the_springs_of_a_chosen_actuator_can_follow_the_recorded_deflection(tmp_path):
    recording = deflected(tmp_path, 1.0)
    mapping = [f"joint_1.{name}=shoulder.{name}" for name in ("link_position", "motor_1_position", "reference_1")]
    made, scenario = make(tmp_path, recording, "plain_arm", actuators={"shoulder": "sea"}, mapping=mapping, mode=5)
    assert scenario.actuators["shoulder"].parameters["max_deflection"] == 2.0
    assert not [text for text in made.remarks if "recording reaches" in text]


def test_a_motion_within_the_limits_changes_no_limit(tmp_path):
    made = write_from_recording(EXAMPLES / "dof1_sea.urdf", deflected(tmp_path, 0.4), tmp_path / "s.yaml", mode=5)
    assert not [text for text in made.remarks if "recording reaches" in text]


@pytest.mark.parametrize(("farthest", "told"), [(2.3, True), (1.9, False)])
def test_stops_that_a_recording_passes_are_named(tmp_path, farthest, told):
    """The shoulder stops at 2 rad."""
    place = farthest * np.sin(6.0 * TIME)
    header = "time [s],shoulder.reference_1 [rad],shoulder.link_position [rad]"
    np.savetxt(tmp_path / "lab.csv", np.column_stack([TIME, place, place]), delimiter=",", header=header, comments="")
    robot = EXAMPLES / "plain_arm.urdf"
    made = write_from_recording(robot, tmp_path / "lab.csv", tmp_path / "s.yaml", actuators={"shoulder": "sea"}, mode=5)
    assert any("shoulder stops at" in text and "widen <limit>" in text for text in made.remarks) == told


@pytest.mark.parametrize("actuator", ["sea", "qbmove", "bavs", "awas_ii"])
def test_chosen_springs_hold_the_arm_at_the_recorded_start(tmp_path, actuator):
    """With default parameters, a qbMove at the shoulder would sag by 0.8 rad."""
    pose = 1.2 + 0.1 * np.sin(6.0 * TIME)
    names = [f"{joint}.{quantity}" for joint in ("shoulder", "elbow") for quantity in ("reference_1", "link_position")]
    np.savetxt(
        tmp_path / "lab.csv", np.column_stack([TIME, *[pose] * 4]), delimiter=",", header=f"time,{','.join(names)}", comments=""
    )
    _, scenario = make(tmp_path, tmp_path / "lab.csv", "plain_arm", actuators={"*": actuator}, mode=6)
    assert not sizing(scenario, apply_to_robot(scenario, load_robot(scenario.robot))).weak


@pytest.mark.parametrize("mode", [0, 1, 3, 6])
def test_claims_use_quantities_of_the_chosen_mode(tmp_path, mode):
    names = ("link_position", "reference_1", "motor_1_velocity", "motor_1_position", "deflection")
    header = ",".join(["time", *(f"joint_1.{name}" for name in names)])
    np.savetxt(tmp_path / "lab.csv", np.column_stack([TIME, *[SMOOTH] * 5]), delimiter=",", header=header, comments="")
    _, scenario = make(tmp_path, tmp_path / "lab.csv", mode=mode)
    claimed = {claim.quantity for claim in scenario.expect}
    assert claimed >= {"link_position"} | ({"motor_1_position"} if mode > 1 else set())
    assert ("motor_1_velocity" in claimed) == (mode == 6)
    assert len(asrsim.run(replace(scenario, duration=0.01)).summary.claims) == len(scenario.expect)


@pytest.mark.parametrize("kept", ["s.yaml", "s_commands.csv", "s.fit.yaml"])
def test_all_files_of_a_command_are_written_or_none(tmp_path, kept):
    experiment = lab(tmp_path)
    (tmp_path / kept).write_text("mine")
    with pytest.raises(OutputError, match="exists"):
        write_from_recording(EXAMPLES / "dof1_sea.urdf", experiment, tmp_path / "s.yaml")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["lab.csv", kept])
    assert (tmp_path / kept).read_text() == "mine"


def test_nothing_is_written_where_one_file_cannot_be(tmp_path):
    (tmp_path / "s.fit.yaml").mkdir()
    with pytest.raises(OutputError, match=r"s\.fit\.yaml"):
        write_from_recording(EXAMPLES / "dof1_sea.urdf", lab(tmp_path), tmp_path / "s.yaml", force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.csv", "s.fit.yaml"]


def test_recorded_motors_start_where_they_were(tmp_path):
    header = "time,q1,q1_ref,q1_motor_1_position"
    table = np.loadtxt(lab(tmp_path), delimiter=",", skiprows=1)
    table[:, 3] = 0.07 + table[:, 2]
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header=header, comments="")
    mapping = ["q1=joint_1.link_position", "q1_ref=joint_1.reference_1", "q1_motor_1_position=joint_1.motor_1_position"]
    _, scenario = make(tmp_path, tmp_path / "lab.csv", mapping=mapping, mode=6)
    assert scenario.initial_motor_positions["joint_1"] == (pytest.approx(0.12, abs=1e-8),)
    assert scenario.initial_positions["joint_1"] == pytest.approx(0.05, abs=1e-8)


def test_motors_before_their_gear_start_with_their_links(tmp_path):
    header = "time,q1,q1_ref,q1_motor_1_position"
    table = np.loadtxt(lab(tmp_path), delimiter=",", skiprows=1)
    table[:, 3] = 3.0 + 100.0 * table[:, 1]
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header=header, comments="")
    mapping = ["q1=joint_1.link_position", "q1_ref=joint_1.reference_1", "q1_motor_1_position=joint_1.motor_1_position"]
    made, scenario = make(tmp_path, tmp_path / "lab.csv", mapping=mapping, mode=6)
    assert not scenario.initial_motor_positions
    assert any("moves 100 times as far as its link" in text for text in made.remarks), made.remarks


def test_each_command_of_the_heading_names_the_plugins(tmp_path):
    """Not only the run: `asrsim plot` needs the reader of the recording, too."""
    make(tmp_path, lab(tmp_path), plugins=[tmp_path / "my_reader.py"])
    heading = (tmp_path / "s.yaml").read_text().partition("robot:")[0]
    commands = [line for line in heading.splitlines() if line.startswith("#   asrsim ")]
    assert [line.split()[2] for line in commands] == ["run", "plot"]
    assert all(line.endswith(" --plugin my_reader.py") for line in commands), commands
