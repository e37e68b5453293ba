"""Twins of an independently simulated robot that differs from its model; wrong measurements."""

import json
import re
import struct
import time

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError, RecordingError
from asrsim.live import TRANSPORTS, Received, TransportEntry
from asrsim.recordings import read_recording
from asrsim.twin.follow import FIELDS, Followed, charts, follow_recording, write
from asrsim.twin.live import LiveTwin
from support.paths import EXAMPLES
from support.soft_arm import QBMOVE, SEA, record

NOISE = 1e-3
"""Standard deviation of the noise of positions, rad."""


def goal(value):
    """Commands of one joint."""
    return {"joint_1": {"equilibrium_position": value}}


def wrong(joint):
    """Springs 10 % off, friction 50 %, damping 20 %."""
    factors = {"spring_k": 1.1, "spring_stiffness": 1.1, "friction": 0.5, "damping": 0.8}
    return joint.scaled(lambda name: next((factor for part, factor in factors.items() if part in name), 1.0))


def motion(time, seed, *, rests):
    """Goal of the link, rad."""
    generator = np.random.default_rng(seed)
    waves = zip(generator.uniform(0.2, 2.5, 8), generator.uniform(0.0, 6.0, 8), strict=True)
    moves = sum(0.16 * np.sin(2.0 * np.pi * rate * time + phase) for rate, phase in waves)
    moves *= np.minimum(time / 0.5, 1.0)
    return moves * (0.5 + 0.5 * np.tanh(4.0 * np.sin(2.0 * np.pi * time / 20.0 + 1.0))) if rests else moves


def followed(joint, folder, *, seconds, hits=(), seed=1, rests=False):
    """Steps of a wrong twin, and positions of the independent robot, on which 1 N m acts for 0.15 s at the times `hits`."""
    time, step = 1e-3 * np.arange(round(1e3 * seconds) + 1), 1e-4
    outer = np.zeros((round(seconds / step), 1))
    for number, at in enumerate(hits):
        outer[round(at / step) : round((at + 0.15) / step)] = (-1.0) ** number
    robot = joint.move(time, lambda at: motion(at, seed, rests=rests)[:, None], outer=outer, step=step)[:, 0]
    measured = robot[:, 0] + NOISE * np.random.default_rng(seed).normal(size=len(robot))
    preset = {"stiffness_preset": 0.3} if joint.motors == 2 else {}
    goals = motion(time, seed, rests=rests)
    with asrsim.Twin(wrong(joint).write(folder), bandwidth=8) as twin:
        steps = [
            twin.step(measured[k : k + 1], {"joint_1": {"equilibrium_position": goals[k], **preset}})
            for k in range(len(measured))
        ]
    return steps, robot


def spring_of(joint, robot):
    """Torque of the robot's springs in N m, and their stiffness in N m/rad."""
    deflections = robot[:, 1:] - robot[:, :1]
    (numbers,) = joint.joints
    if joint.motors == 1:
        k = numbers["spring_stiffness"]
        return k * deflections[:, 0], np.full(len(robot), k)
    a, k = numbers["spring_a_1"], numbers["spring_k_1"]
    return k * np.sinh(a * deflections).sum(axis=1), a * k * np.cosh(a * deflections).sum(axis=1)


@pytest.mark.parametrize("joint", [SEA, QBMOVE], ids=["sea", "qbmove"])
def test_a_wrong_twin_finds_hits_and_nothing_else(joint, tmp_path):
    hits = (5.2, 6.1, 7.3)
    steps, robot = followed(joint, tmp_path, seconds=8.0, hits=hits)
    torque, stiffness = spring_of(joint, robot)
    free = slice(2500, 5000)
    external = np.array([step.external_torque[0] for step in steps])
    assert np.sqrt(np.mean(external[free] ** 2)) < 0.03 * np.abs(torque[:5000]).max()
    alarm = np.array([step.alarm[0] for step in steps])
    assert not alarm[:5200].any()
    delays = [int(np.argmax(alarm[round(1e3 * at) :])) for at in hits]
    assert min(delays) > 0
    assert max(delays) <= 15
    known = np.array([step.stiffness[0] for step in steps])[free] / stiffness[free]
    assert np.isfinite(known).mean() > 0.5
    assert np.nanmedian(known) == pytest.approx(1.0, abs=0.04)
    assert np.nanquantile(np.abs(known - 1.0), 0.95) < 0.2
    assert not any(step.notes for step in steps)


@pytest.mark.slow
@pytest.mark.parametrize("joint", [SEA, QBMOVE], ids=["sea", "qbmove"])
def test_ten_minutes_of_free_motion_raise_no_alarm(joint, tmp_path):
    assert not any(step.alarm[0] for step in followed(joint, tmp_path, seconds=600.0, seed=12, rests=True)[0])


def test_a_threshold_above_what_the_springs_carry_is_said(tmp_path):
    """30 mrad of noise at 250 Hz, 8 Hz of bandwidth: no push that the springs can bear would raise an alarm."""
    noise = np.random.default_rng(0).normal(size=750)
    with asrsim.Twin(SEA.write(tmp_path), bandwidth=8, overrides=["step=0.004"]) as twin:
        for k, one in enumerate(noise.tolist()):
            swing = 0.3 * np.sin(0.03 * k)
            found = twin.step([swing + 0.03 * one], goal(swing))
            if found.notes:
                break
    (text,) = found.notes
    assert re.search(
        r"noise of .* mrad \(mm\) at 250 Hz raises the alarm threshold to .*, above the largest torque of its springs", text
    )


def test_a_twin_is_in_mujoco_unless_its_scenario_states_an_engine():
    pytest.importorskip("pybullet")
    keys = {"duration": 1.0, "modes": {"*": 6}}
    robot = EXAMPLES / "urdf" / "dof1_sea.urdf"
    for engine, stated in (("mujoco", {}), ("bullet", {"engine": "bullet"})):
        with asrsim.Twin(asrsim.make_scenario(robot, **keys, **stated)) as twin:
            assert twin.worlds.prepared.scenario.engine == engine


def test_a_robot_at_rest_shows_no_stiffness(tmp_path):
    generator = np.random.default_rng(0)
    with asrsim.Twin(SEA.write(tmp_path)) as twin:
        steps = [twin.step({"joint_1": NOISE * generator.normal()}, goal(0.0)) for _ in range(2000)]
    assert np.isnan([step.stiffness[0] for step in steps]).all()
    assert not any(step.alarm[0] for step in steps)


@pytest.fixture
def five():
    return asrsim.make_scenario(EXAMPLES / "urdf" / "dof5_arm.urdf", engine="mujoco", duration=1.0)


def test_an_external_torque_is_observed_only_at_its_joint(five):
    with asrsim.Simulation(five) as robot, asrsim.Twin(five) as twin:
        robot.set_reference("joint_3", "external_torque", 2.0)
        for _ in range(1500):
            found = twin.step(robot.observe().link_position, {})
            robot.advance()
    np.testing.assert_allclose(found.external_torque, [0.0, 0.0, 2.0, 0.0, 0.0], atol=0.06)
    assert found.time == pytest.approx(1.499)


def test_a_mirrored_motion_has_mirrored_torques_and_the_same_alarms(tmp_path):
    """A hanging link with an SEA and dry friction, pushed to one side for a while."""
    scenario, time = SEA.write(tmp_path), 1e-3 * np.arange(700)
    goals = 0.3 * np.sin(9.0 * time)
    measured = goals + np.where(time > 0.5, 0.4, 0.0) * np.sin(np.pi * (time - 0.5) / 0.2)
    found = []
    for sign in (1.0, -1.0):
        with asrsim.Twin(scenario, bandwidth=8, compiled=False) as twin:
            steps = [twin.step([sign * q], goal(sign * to)) for q, to in zip(measured, goals, strict=True)]
        found.append({name: np.array([getattr(one, name)[0] for one in steps]) for name in FIELDS})
    right, left = found
    assert right["alarm"].any()
    for name, sign in (("external_torque", -1), ("residual", -1), ("threshold", 1), ("alarm", 1), ("stiffness", 1)):
        np.testing.assert_allclose(left[name], sign * right[name], atol=1e-9, err_msg=name)


def test_a_joint_that_is_not_measured_runs_free(five):
    with asrsim.Simulation(five) as robot, asrsim.Twin(five) as twin:
        notes = []
        for _ in range(300):
            positions = dict(zip(twin.joints, robot.observe().link_position, strict=True))
            del positions["joint_2"]
            found = twin.step(positions, goal(np.nan))
            notes += found.notes
            robot.advance()
    assert np.isnan(found.external_torque).tolist() == [False, True, False, False, False]
    assert [note.partition(":")[0] for note in notes] == ["joint_1", "joint_2"]
    assert "not finite" in notes[0]
    assert "not corrected" in notes[1]


def test_an_infinite_position_is_not_measured(tmp_path):
    with asrsim.Twin(SEA.write(tmp_path)) as twin:
        steps = [twin.step([np.inf if k == 10 else 0.0], goal(0.0)) for k in range(20)]
    assert np.flatnonzero(np.isnan([step.external_torque[0] for step in steps])).tolist() == [10]
    assert not any(step.notes for step in steps)


def test_a_twin_far_from_its_robot_is_set_to_it(tmp_path):
    with asrsim.Twin(SEA.write(tmp_path)) as twin:
        before = [twin.step({"joint_1": 0.0}, goal(0.0)) for _ in range(600)][-1]
        jump = twin.step({"joint_1": 0.6}, {})
        after = [twin.step({"joint_1": 0.6}, goal(0.6)) for _ in range(100)][-1]
    assert not before.notes
    assert "+0.6 from its twin" in jump.notes[0]
    assert abs(after.residual[0]) < 0.02


def test_a_robot_on_its_stop_raises_no_alarm():
    """The encoder reads 5 mrad beyond the stop, on which the spring presses with 3.28 N m. A torque on a link at its stop has
    no effect, so the estimate of the impact, which twin and robot have at different times, stays: 0.27, 0.35 and 0.38 N m at
    steps of 1, 0.5 and 0.25 ms. It is below a tenth of the spring's torque at 1 ms."""
    beyond = {"joint_1": {"equilibrium_position": 2.5}}
    arm = asrsim.make_scenario(EXAMPLES / "urdf" / "two_elastic_joints.urdf", engine="mujoco", duration=2.0, references=beyond)
    with asrsim.Simulation(arm) as robot, asrsim.Twin(arm) as twin:
        steps = []
        for _ in range(2000):
            positions = robot.observe().link_position
            steps.append(twin.step(positions + np.array([0.005, 0.0]), {}))
            robot.advance()
    assert positions[0] == 1.57
    assert not any(step.alarm.any() for step in steps[1200:])
    assert abs(steps[-1].external_torque[0]) < 0.328


def test_a_twin_that_diverges_continues(tmp_path, monkeypatch):
    with asrsim.Twin(SEA.write(tmp_path)) as twin:
        twin.step({"joint_1": 0.1}, goal(0.1))
        with monkeypatch.context() as patch:
            patch.setattr(asrsim.Worlds, "healthy", np.zeros(6, dtype=bool))
            assert "the twin diverged" in twin.step({"joint_1": 0.1}, {}).notes[0]
        assert not twin.step({"joint_1": 0.1}, {}).notes


def test_wrong_names_and_bandwidths_are_errors(five):
    with pytest.raises(InputError, match="twentieth of the rate of steps, 50 Hz"):
        asrsim.Twin(five, bandwidth=60.0)
    with pytest.raises(InputError, match="no dynamics"):
        asrsim.Twin(asrsim.make_scenario(EXAMPLES / "urdf" / "dof5_arm.urdf", engine="bench", duration=1.0))
    with asrsim.Twin(five) as twin:
        for positions in ({"joint_9": 0.0}, [0.0], ["up"] * 5, {"joint_1": "up"}):
            with pytest.raises(InputError, match="5 positions, of joint_1, joint_2"):
                twin.step(positions, {})
        for commands in ({"joint_1": 0.3}, goal("fast")):
            with pytest.raises(InputError, match="numbers by name of the reference"):
                twin.step([0.0] * 5, commands)
        with pytest.raises(InputError, match="elbow"):
            twin.step([0.0] * 5, {"elbow": {"equilibrium_position": 0.0}})


# -- live ------------------------------------------------------------------------------------------------------------


class Robot:
    """Transport with a simulated softer arm, which does one step for each poll, obeys topics, and is pushed after 0.9 s."""

    def __init__(self, burst, late, *, applies):
        """burst: number of steps whose positions arrive together; late: number of steps by which the twin's commands are late;
        applies: whether the arm publishes the commands that it applied."""
        self.burst, self.late, self.applies, self.states, self.commands = burst, late, applies, [], []
        scenario = asrsim.make_scenario(
            EXAMPLES / "urdf" / "two_elastic_joints.urdf",
            engine="mujoco",
            duration=2.0,
            parameters={"joint_2": {"spring_stiffness": 5.4}},
        )
        self.simulation, self.heard, self.polls, self.began = asrsim.Simulation(scenario), [], 0, time.time()

    def make(self, interface, access, tell):
        self.numbers = {inlet.name: number for number, inlet in enumerate(interface.inlets)}
        self.outlets = [outlet.name for outlet in interface.outlets]
        self.wanted = [True] * len(self.outlets)
        return self

    def poll(self):
        self.polls += 1
        sent = self.began + 1e-3 * self.polls
        goal = 0.3 * np.sign(np.sin(0.02 * self.polls))
        self.commands.append(Received(self.numbers["/joint_1/equilibrium_position"], [goal], sent=sent))
        self.simulation.set_reference("joint_1", "equilibrium_position", goal)
        self.simulation.set_reference("joint_2", "external_torque", 1.5 if self.polls > 900 else 0.0)
        self.simulation.advance()
        state, joints = self.simulation.observe(), ["joint_1", "joint_2"]
        about = {"stamp": 1e9 + state.time, "sent": sent + 5e-4}
        if self.applies:
            names = ["joint_1.equilibrium_position", "joint_2.external_torque"]
            self.states.append(Received(self.numbers["/applied_commands"], [goal, 1.5], names, **about))
        self.states.append(Received(self.numbers["/joint_states"], state.link_position.tolist(), joints, **about))
        if self.polls % self.burst == 0:
            yield from self.states
            self.states.clear()
        if len(self.commands) > self.late:
            yield self.commands.pop(0)

    def publish(self, time, messages):
        values = [struct.unpack("<4xd", message)[0] for message in messages]
        self.heard.append(dict(zip(self.outlets, values, strict=True)))

    def close(self):
        self.simulation.close()


@pytest.mark.parametrize(("burst", "late", "applies"), [(20, 0, False), (1, 15, False), (20, 200, True)])
def test_a_live_twin_finds_a_push_whatever_the_delays(monkeypatch, burst, late, applies):
    """Commands jump by 0.6 rad, so a command that is applied a few steps late would raise an alarm."""
    robot, told = Robot(burst, late, applies=applies), []
    monkeypatch.setattr(TRANSPORTS, "_entries", dict(TRANSPORTS._entries))
    TRANSPORTS.add("robot", TransportEntry(make=robot.make, doc="", module="json"))
    scenario = asrsim.make_scenario(EXAMPLES / "urdf" / "two_elastic_joints.urdf", engine="mujoco", duration=2.0)
    LiveTwin(scenario, transports=["robot"], duration=1.2, tell=told.append).run(stop=lambda: False)
    assert any("alarm at joint_2" in text for text in told)
    assert not any("alarm at joint_1" in text for text in told)
    assert robot.heard[-1]["/twin/joint_2/external_torque"] == pytest.approx(1.5, rel=0.2)


# -- recordings ------------------------------------------------------------------------------------------------------


def recorded(folder, *, late=0.0):
    """Recording of an independent SEA, in which three commands are missing. late: delay of the positions, s."""
    path = record(SEA, folder / "lab.csv", seed=0, duration=2.0)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    heading, rows = path.read_text().splitlines()[0], round(late / 1e-3)
    if rows:
        table[rows:, 2:] = table[:-rows, 2:].copy()
    table[700:703, 1] = np.nan
    np.savetxt(path, table, delimiter=",", header=heading, comments="")
    return path


def test_a_recording_is_followed(tmp_path):
    scenario = wrong(SEA).write(tmp_path)
    found = follow_recording(scenario, recorded(tmp_path))
    (note,) = found.notes
    assert "3 of 2001 samples have no number" in note
    assert found.rows()[0]["alarms"] == []
    table, picture = write(found, tmp_path / "out")
    assert picture.stat().st_size > 20_000
    read = read_recording(table, joints=["joint_1"])
    assert read.column("joint_1", "external_torque").values == pytest.approx(found.external_torque[:, 0], nan_ok=True)


def test_each_joint_has_its_chart_with_threshold_and_alarms():
    time = np.linspace(0.0, 1.0, 5)
    table = {
        name: np.outer(1.0 + time, scales) for name, scales in (("external_torque", (1.0, -2.0)), ("threshold", (0.5, 3.0)))
    }
    alarm = np.array([[False, True]] * 3 + [[True, False]] * 2)
    units = {"external_torque": ("N m", "N"), "stiffness": ("N m/rad", "N/m")}
    found = Followed(
        name="arm", joints=("turn", "slide"), units=units, time=time,
        positions=np.zeros((5, 2)), stiffness=np.outer(time, (10.0, 100.0)), residual=np.zeros((5, 2)), alarm=alarm, notes=(),
        **table,
    )  # fmt: skip
    for j, (torque, stiffness) in enumerate(charts(found)):
        assert (torque.head, torque.unit, stiffness.unit) == (("turn", "N m", "N m/rad"), ("slide", "N", "N/m"))[j]
        quiet, loud = torque.bands
        np.testing.assert_array_equal(torque.lines[0].y, found.external_torque[:, j])
        np.testing.assert_array_equal([quiet.low, quiet.high], [-found.threshold[:, j], found.threshold[:, j]])
        np.testing.assert_array_equal(loud.where, alarm[:, j])
        np.testing.assert_array_equal(stiffness.lines[0].y, found.stiffness[:, j])
        assert torque.span[1] > np.abs(found.external_torque[:, j]).max()
    assert [found.alarms(j) for j in (0, 1)] == [[(0.75, 1.0)], [(0.0, 0.5)]]


def test_a_twin_says_what_is_doubtful_in_its_recording(tmp_path):
    path = recorded(tmp_path)
    head, *rows = path.read_text().splitlines()
    rows[300:302] = [",".join([*row.split(",")[:2], "-9999", *row.split(",")[3:]]) for row in rows[300:302]]
    path.write_text("\n".join([head, *rows]) + "\n")
    notes = follow_recording(SEA.write(tmp_path), path, stop=lambda: True).notes
    assert any("is -9999 in 2 samples" in note and "`missing: -9999`" in note for note in notes)


def test_an_interrupted_twin_writes_the_steps_so_far(tmp_path):
    found = follow_recording(SEA.write(tmp_path), recorded(tmp_path), stop=lambda: True)
    assert found.interrupted
    assert 0 < len(found.time) < 2000
    table, _ = write(found, tmp_path / "out")
    assert len(np.loadtxt(table, delimiter=",", skiprows=2)) == len(found.time)


def test_a_prismatic_joint_has_forces_and_lengths(tmp_path):
    scenario, path, robot = SEA.write(tmp_path), recorded(tmp_path), tmp_path / "arm.urdf"
    robot.write_text(robot.read_text().replace("revolute", "prismatic"))
    path.write_text(path.read_text().replace("[rad]", "[m]"))
    (table,) = write(follow_recording(scenario, path, stop=lambda: True), tmp_path / "out", plot=False)
    units = ["external_torque [N]", "stiffness [N/m]", "residual [m]", "alarm"]
    assert table.read_text().splitlines()[1].split(",") == ["time [s]", *(f"joint_1.{field}" for field in units)]


def test_clocks_that_differ_are_noted_and_aligned(tmp_path):
    scenario, path = SEA.write(tmp_path), recorded(tmp_path, late=0.2)
    notes = follow_recording(scenario, path).notes
    (note,) = (note for note in notes if "clocks differ" in note)
    assert "--clock-offset 0.2" in note
    assert not any("clocks" in note for note in follow_recording(scenario, path, clock_offset=0.2).notes)


def test_a_recording_without_commands_is_followed_by_the_scenario(tmp_path):
    path = recorded(tmp_path)
    path.write_text(path.read_text().replace("joint_1.reference_1 [rad]", "temperature"))
    notes = follow_recording(SEA.write(tmp_path), path).notes
    assert notes[0] == "joint_1: no command equilibrium_position is recorded, so this reference follows the scenario"


def test_a_recording_without_positions_is_an_error(tmp_path):
    path = recorded(tmp_path)
    path.write_text(path.read_text().replace("link_position", "motor_1_velocity"))
    with pytest.raises(RecordingError, match="needs link_position"):
        follow_recording(SEA.write(tmp_path), path)


def test_command_prints_a_table_or_json(tmp_path, asrsim_command):
    scenario, path = SEA.write(tmp_path), recorded(tmp_path)
    done = asrsim_command("twin", str(scenario), "-e", str(path), "--out", str(tmp_path / "out"), "--json")
    assert done.code == 0
    assert json.loads(done.out)["joints"][0]["joint"] == "joint_1"


@pytest.mark.parametrize("stated", [{}, {"compiled": False}])
def test_a_twin_runs_without_compiled_code_where_there_is_none_or_its_scenario_says_so(stated, monkeypatch):
    if not stated:
        monkeypatch.setattr("asrsim.simulation.core.numba_available", lambda: False)
    scenario = asrsim.make_scenario(EXAMPLES / "urdf" / "dof1_sea.urdf", duration=1.0, modes={"*": 6}, **stated)
    with asrsim.Twin(scenario) as twin:
        assert not twin.worlds.compiled
        assert np.isfinite(twin.step([0.0], goal(0.1)).external_torque).all()
