"""Recordings with their simulations: initial states, effects of sensors, and derivatives on several threads."""

from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from asrsim.identification import door
from asrsim.identification.extensions import Extension
from asrsim.identification.judge import channel_fits
from asrsim.identification.problem import differences, jacobian, set_up, slopes_along
from asrsim.identification.task import task_of
from support.identify_files import SEA, prepared, save, write


def noise(*shape, seed=0):
    return 1e-4 * np.random.default_rng(seed).normal(size=shape)


TIME = np.arange(0.0, 0.8005, 1e-3)
"""s."""


def test_predictions_include_the_effects_of_the_sensor(tmp_path):
    """Delay of sensor and clock, gain and zero; a shorter prediction equals the beginning of a longer one."""
    goal = 0.3 * np.sin(9.0 * TIME)
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": goal, "joint_1.link_position [rad]": goal**2 + noise(len(TIME))}
    with ExitStack() as stack:
        problem = prepared(stack, tmp_path, columns, ["joint_1.damping"])
        predict = partial(problem.tracks[0].predict, playing=problem.playing, until=1.0)
        (base,) = predict({}) or ()
        assert np.ptp(base) > 0.3
        place = "joint_1.link_position"
        (found,) = predict({f"{place}.gain": 2.0, f"{place}.offset": 0.1}) or ()
        np.testing.assert_allclose(found, base / 2.0 + 0.1, rtol=1e-12)
        for keys in ({f"{place}.delay": 0.02}, {"clock": 0.02}, {f"{place}.delay": 0.05, "clock": -0.03}):
            (found,) = predict(keys) or ()
            np.testing.assert_allclose(found[20:], base[:-20], rtol=0.0, atol=1e-12)
            assert found[:20].tolist() == [base[0]] * 20
        (ahead,) = predict({"clock": -0.2}) or ()
        np.testing.assert_allclose(ahead[:-200], base[200:], rtol=0.0, atol=1e-12)
        for keys in ({}, {"clock": -0.2}):
            (whole,), (part,) = predict(keys) or (), predict(keys, until=0.3) or ()
            assert part.tolist() == whole[TIME <= 0.3 + 1e-9].tolist()


@pytest.mark.parametrize("place", [0.3, -0.4])
@pytest.mark.parametrize("speed", [-3.0, 0.0, 3.0])
def test_a_link_starts_with_the_recorded_position_and_velocity(tmp_path, place, speed):
    """If the zero of its sensor is free, the link starts at the scenario's position."""
    swing = 0.1 * np.sin(20.0 * np.maximum(TIME - 0.2, 0.0)) - 5.0 * TIME**2 * np.sign(speed)
    moved = place + speed * TIME + swing + noise(len(TIME))
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": 0.0 * TIME, "joint_1.link_position [rad]": moved}
    velocity = ["joint_1.initial_velocity"] if speed else []
    for free, start, freed in (
        ("joint_1.damping", place, ["joint_1.initial_position", *velocity]),
        ("joint_1.link_position.offset", 0.15, velocity),
    ):
        with ExitStack() as stack:
            problem = prepared(stack, tmp_path, columns, [free], keys="initial: {joint_1: 0.15}\n")
            initial = problem.tracks[0].initial
            assert initial["joint_1.initial_position"] == pytest.approx(start, abs=1e-3)
            assert initial["joint_1.initial_velocity"] == pytest.approx(speed, abs=0.05)
            assert [entry.key for entry in problem.layout.entries] == [free, *freed]
            if freed == ["joint_1.initial_position"]:
                # A link at rest stays where its sensor shows it; a free zero of this sensor frees the position.
                (found,) = problem.layout.entries[1:]
                assert place - 0.01 < found.low < place < found.high < place + 0.01
                zero = Extension(parameters=(problem.known["joint_1.link_position.offset"],))
                released = zero.added_to(problem).layout.entries[1]
                assert (released.key, released.low, released.high) == (found.key, -np.inf, np.inf)
            elif freed[:1] == ["joint_1.initial_position"]:
                assert problem.layout.entries[1].high == np.inf


def test_a_fit_says_what_is_doubtful_in_its_recording(tmp_path):
    goal = 0.3 * np.sin(9.0 * TIME)
    link = np.where(np.arange(len(TIME)) % 400 == 30, 0.0, 1.0 + goal + noise(len(TIME)))
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": goal, "joint_1.link_position [rad]": link}
    with ExitStack() as stack:
        (track,) = prepared(stack, tmp_path, columns, ["joint_1.damping"]).tracks
    assert any("falls to exactly 0 and back" in remark for remark in track.data.remarks)


@pytest.mark.parametrize("seen", [True, False])
def test_a_link_without_a_recording_begins_with_its_motors(tmp_path, seen):
    swing = 0.2 * np.sin(10.0 * np.maximum(TIME - 0.2, 0.0))
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": 0.7 + swing, "joint_1.reference_2 [rad]": 0.1 + swing}
    columns |= {
        f"joint_1.motor_{i}_position [rad]": home + swing**2 + noise(len(TIME), seed=i) for i, home in ((1, 0.7), (2, 0.1))
    }
    if seen:
        columns["joint_1.link_position [rad]"] = 0.33 + swing**3 + noise(len(TIME))
    keys = "initial: {joint_1: {position: 0.25, motor_positions: [0.4, -0.2]}}\n"
    with ExitStack() as stack:
        (track,) = prepared(stack, tmp_path, columns, ["joint_1.damping"], actuator="qbmove", mode=5, tags="", keys=keys).tracks
        (drive,) = track.door.drives
        assert track.motor_starts(drive, {}) == (pytest.approx([0.7, 0.1], abs=1e-3), [])
        assert track.start("joint_1", {})[0] == pytest.approx(0.33 if seen else 0.25 + 0.3, abs=1e-3)
        # A link that is not recorded starts with its motors.
        moved = track.start("joint_1", {"joint_1.initial_motor_1_position": 0.9})[0]
        assert moved == pytest.approx(0.33 if seen else 0.25 + 0.4, abs=1e-3)
        # A long rest shows the starts of the motors so exactly that they are fixed.
        assert track.uncertain == (["joint_1.initial_position"] if seen else [])


def test_a_motor_does_not_start_at_a_noisy_first_sample(tmp_path):
    """`asrsim init` copies the first sample, which noise moves by 0.23 mrad; the motor starts at 0 and moves at once."""
    moved = 0.2 * (1.0 - np.cos(5.0 * TIME)) + noise(len(TIME))
    moved[0] = 2.34e-4
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": 0.0 * TIME, "joint_1.motor_1_position [rad]": moved}
    keys = "initial: {joint_1: {position: 0, motor_positions: [0.000234]}}\n"
    with ExitStack() as stack:
        problem = prepared(stack, tmp_path, columns, ["joint_1.motor_1_inertia"], mode=5, keys=keys)
        (track,), (drive,) = problem.tracks, problem.tracks[0].door.drives
        assert track.motor_starts(drive, {})[0] == pytest.approx([0.0], abs=1.2e-4)
        assert [one.key for one in problem.layout.entries] == ["joint_1.motor_1_inertia", "joint_1.initial_motor_1_position"]


def test_derivatives_on_many_threads_equal_those_on_one(tmp_path, monkeypatch):
    goal = 0.3 * np.sin(9.0 * TIME)
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": goal + noise(len(TIME)), "joint_1.link_position [rad]": goal**2}
    found = {None: [], 3: [], 4: []}
    monkeypatch.setattr(door, "THREADED", 1)
    for threads in (1, 2):
        monkeypatch.setattr(door, "cores", lambda threads=threads: threads)
        with ExitStack() as stack:
            problem = prepared(stack, tmp_path, columns, ["link_1.izz", "joint_1.damping"])
            for draw, matrices in found.items():
                drawn = replace(problem, playing=replace(problem.playing, draw=draw))
                matrices.append(jacobian(drawn, np.zeros(len(problem.layout))))
    for one, two in found.values():
        np.testing.assert_array_equal(one, two)
    assert len({one.tobytes() for one, _ in found.values()}) == 3


@pytest.mark.parametrize(("mode", "motor"), [(5, "motor_1_position"), (2, "reference_1")])
def test_a_link_starts_where_motor_and_deflection_say(tmp_path, mode, motor):
    """A link that moves at 2 rad/s behind a motor at rest; the motor is measured, or played in mode 2."""
    home = 0.4 + 0.0 * TIME
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": home, f"joint_1.{motor} [rad]": home + noise(len(TIME), seed=1)}
    columns["joint_1.deflection [rad]"] = 0.3 - 2.0 * TIME + 5.0 * TIME**2 + noise(len(TIME), seed=2)
    with ExitStack() as stack:
        problem = prepared(stack, tmp_path, columns, ["joint_1.damping"], mode=mode)
        initial = problem.tracks[0].initial
        assert initial["joint_1.initial_position"] == pytest.approx(0.1, abs=1e-3)
        assert initial["joint_1.initial_velocity"] == pytest.approx(2.0, abs=0.1)
        starts = ["joint_1.initial_position", "joint_1.initial_velocity"]
        # The speed of a measured motor is free, too, and not that of its link.
        starts += ["joint_1.initial_motor_1_position", "joint_1.initial_motor_1_velocity"] if mode == 5 else []
        assert [entry.key for entry in problem.layout.entries] == ["joint_1.damping", *starts]
        if mode == 5:
            (drive,) = problem.tracks[0].door.drives
            assert problem.tracks[0].motor_starts(drive, {}) == (pytest.approx([0.4], abs=1e-3), pytest.approx([0.0], abs=0.1))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("rate", [4.0, 12.0, 40.0])
def test_a_deflection_with_the_wrong_sign_is_known_without_a_simulation(tmp_path, sign, rate):
    """A link on a spring, at 12 rad/s with a damping ratio of 0.1, behind a motor that moves slower, as fast, and faster."""
    place, speed, places, motor = 0.0, 0.0, [], 0.3 * np.sin(rate * TIME) + 0.1 * np.sin(5.0 * TIME)
    for goal in motor.tolist():
        places.append(place)
        for _ in range(10):
            speed += 1e-4 * (144.0 * (goal - place) - 2.4 * speed)
            place += 1e-4 * speed
    bent = sign * (motor - np.array(places)) + noise(len(TIME))
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": motor, "joint_1.deflection [rad]": bent}
    with ExitStack() as stack:
        problem = prepared(stack, tmp_path, columns, ["joint_1.damping"], mode=2)
        start = np.zeros(len(problem.layout))
        (found,) = channel_fits(problem, differences(problem.everything, start), start)
        assert ("=-joint_1.deflection'" in found.suspicion) == (sign < 0.0)


@pytest.mark.parametrize("level", [0.0, 2.0])
def test_derivatives_by_a_parameter_of_the_second_recording_are_zero_in_the_first(tmp_path, level):
    """With and without an observer."""
    scenario = write(tmp_path, "lab", SEA, duration=0.8)
    columns = TIME, 0.3 * np.sin(9.0 * TIME), 0.2 * np.sin(9.0 * TIME) + noise(len(TIME))
    heading = "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad]"
    tables = [save(tmp_path / f"{name}.csv", heading, *columns) for name in "ab"]
    task = task_of(scenario, tables, free=["joint_1.damping"], own=["joint_1.link_position.offset"])
    with ExitStack() as stack:
        problem = set_up(task, stack).problem.observed(level)
        keys = [(entry.key, entry.track) for entry in problem.layout.entries]
        column = keys.index(("joint_1.link_position.offset", 1))
        slopes = slopes_along(problem, np.zeros(len(keys)), [column])[:, 0]
        assert not slopes[problem.rows(0)].any()
        assert slopes[problem.rows(1)].any()


def test_a_motor_before_its_gear_is_not_compared_and_another_zero_is_estimated(tmp_path):
    """The motor's sensor has another zero than the two others, and in the second recording another scale."""
    time = np.arange(0.0, 3.0, 2e-3)
    link, bent = np.sin(4.0 * time), 0.05 * np.cos(4.0 * time)
    names = ("reference_1", "link_position", "deflection", "motor_1_position")
    header = ",".join(["time [s]", *(f"joint_1.{name} [rad]" for name in names)])
    for gear in (1.0, 100.0):
        recording = save(tmp_path / f"{gear}.csv", header, time, link, link, bent, gear * (link + bent + 0.4))
        with ExitStack() as stack:
            problem = set_up(
                task_of(write(tmp_path, "lab", {**SEA, "mode": 6}), [recording], free=["joint_1.damping"]), stack
            ).problem
        remarks, compared = problem.tracks[0].data.remarks, {channel.quantity for channel in problem.tracks[0].channels}
        if gear == 1.0:
            assert problem.layout.table(np.zeros(len(problem.layout)), 0)["joint_1.motor_1_position.offset"] == pytest.approx(
                0.4
            )
        else:
            assert "motor_1_position" not in compared
            assert any("moves 100.1 times as far as the link" in text for text in remarks), remarks


def test_a_played_motor_and_a_deflection_show_the_link(tmp_path):
    """In mode 2 the command is the motor's position; a delayed command acts later than it was recorded."""
    goal, bent = np.sin(5.0 * TIME), 0.05 * np.cos(9.0 * TIME) + noise(len(TIME))
    header = "time [s],joint_1.reference_1 [rad],joint_1.deflection [rad]"
    recording = save(tmp_path / "a.csv", header, TIME, goal, bent)
    scenario = write(tmp_path, "lab", {**SEA, "mode": 2}, duration=float(TIME[-1]))
    with ExitStack() as stack:
        problem = set_up(task_of(scenario, [recording], free=["joint_1.damping"]), stack).problem
        assert problem.observes
        measured = problem.tracks[0].measured
        np.testing.assert_allclose(measured.at({}, 0.0, 1, 800)[:, 0, 0], (goal - bent)[:801], atol=1e-9)
        late = measured.at({"joint_1.reference_1.delay": 0.1}, 0.0, 1, 800)[300:, 0, 0]
        np.testing.assert_allclose(late, goal[200:701] - bent[300:801], atol=1e-9)
