"""The scenario that a fit writes repeats its recording, and reads the recording as the fit did."""

import json
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.identification import identify, read_fit
from asrsim.identification.data import PlayedCommand
from asrsim.identification.replay import SeriesReading, as_plain, from_plain, played_table, replay_of
from asrsim.identification.resume import resumed
from asrsim.identification.write import fit_data, write_robot
from asrsim.outfile import write_json
from asrsim.plots.job import PlotJob, plot
from asrsim.scenario import load_scenario
from asrsim.signals import Constant
from support.identify_files import SEA, prepared, save, write

TIME = np.arange(0.0, 2.0005, 2e-3)
"""s."""
GOAL = 0.3 * np.sin(2.0 * np.pi * (0.5 * TIME + 0.7 * TIME**2))
FREE = ("joint_1.damping", *(f"joint_1.link_position.{name}" for name in ("offset", "gain", "delay")))


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Fit to a link sensor with a zero of 50 mrad, a scale 10 % too small and 6 ms late, by a clock 40 s ahead; folder."""
    folder = tmp_path_factory.mktemp("replay")
    save(folder / "goal.csv", "time [s],goal", TIME, GOAL)
    scenario = write(folder, "lab", SEA, references="{equilibrium_position: {playback: {file: goal.csv, column: goal}}}")
    true = asrsim.run(scenario).samples
    link = np.interp(TIME - 0.006, true.time, true.values["link_position"][:, 0])
    measured = link / 1.1 + 0.05 + 5e-4 * np.random.default_rng(3).standard_normal(len(TIME))
    lab = save(folder / "a.csv", "time [s],goal,sensor", TIME + 40.0, GOAL, measured)
    mapping = ["goal=joint_1.reference_1 [rad]", "sensor=joint_1.link_position [rad]"]
    result = identify(scenario, [lab], free=FREE, mapping=mapping)
    place = folder / "fit"
    place.mkdir()
    write_json(place / "fit.json", fit_data(result))
    write_robot(result, place)
    return result, place


def test_a_run_of_the_written_scenario_has_the_error_of_the_fit(fitted):
    result, place = fitted
    (channel,) = result.channels
    gain = result.find("joint_1.link_position.gain").value
    assert (result.fits, gain) == (True, pytest.approx(1.1, rel=3e-3))
    run = asrsim.run(place / "scenario.yaml", out=place / "run")
    (claim,) = run.summary.claims
    printed = gain * np.sqrt(0.75 * channel.after**2 + 0.25 * channel.held_after**2)
    assert claim.holds
    assert claim.measured == pytest.approx(printed, rel=0.03)
    # The picture beside the bare recording reads the recording as the claim does.
    (compared,) = plot(PlotJob(logs=(run.log,), folder=place, experiments=(str(place.parent / "a.csv"),))).compared
    assert compared.pairs["joint_1", "link_position"].rmse == pytest.approx(claim.measured, rel=1e-6)
    (alignment,) = compared.alignments.values()
    assert alignment.lag == 40.0


def test_a_resumed_fit_writes_the_scenario_of_the_fit(fitted, tmp_path):
    result, place = fitted
    again = resumed(read_fit(place), result.task)
    assert again.replay == result.replay == from_plain(json.loads(json.dumps(as_plain(result.replay))))
    write_robot(again, tmp_path)
    texts = [(folder / "lab.urdf").read_text() for folder in (tmp_path, place)]
    assert texts[0] == texts[1]


def test_the_written_scenario_plays_the_command_when_the_fit_did(fitted, tmp_path):
    """The scenario of the fit plays its own file 0.5 s late; the fit used the command of the recording."""
    result, place = fitted
    text = (place.parent / "lab.yaml").read_text().replace("column: goal", "column: goal, start: 0.5")
    late = place.parent / "late.yaml"
    late.write_text(text)
    (scenario,) = load_scenario(late)
    write_robot(replace(result, scenario=scenario), tmp_path)
    (claim,) = asrsim.run(tmp_path / "scenario.yaml", out=tmp_path / "run").summary.claims
    assert claim.holds


def test_a_scenario_that_does_not_play_the_command_keeps_its_reference_and_claims_nothing(fitted, tmp_path):
    result, place = fitted
    steady = write(place.parent, "lab", SEA, references="{equilibrium_position: 0.2}")
    write_robot(replace(result, scenario=load_scenario(steady)[0]), tmp_path)
    (written,) = load_scenario(tmp_path / "scenario.yaml")
    assert written.references_of("joint_1")["equilibrium_position"] == Constant(value=0.2)
    assert written.expect == ()


def test_the_clock_and_the_start_of_a_fit_are_in_its_replay(tmp_path):
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": GOAL, "joint_1.link_position [deg]": 20.0 + GOAL}
    with ExitStack() as stack:
        problem = prepared(stack, tmp_path, columns, ["joint_1.damping"])
        values = {"clock": 0.004, "joint_1.link_position.delay": 0.003, "joint_1.initial_velocity": 0.2}
        found = replay_of(problem.tracks[0], values, problem.playing)
    (channel,) = found.channels
    assert channel.item(channel.late) == "joint_1.link_position [deg]=joint_1.link_position late 0.007"
    assert found.initial["joint_1"]["velocity"] == 0.2
    assert found.initial["joint_1"]["position"] == pytest.approx(np.deg2rad(20.0), abs=0.01)


def test_motors_that_start_as_the_scenario_says_do_so_after_the_fit(tmp_path):
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": GOAL, "joint_1.link_position [rad]": 0.4 + GOAL}
    keys = "initial: {joint_1: {position: 0.1, motor_positions: [0.7, -0.2], motor_velocities: [3.0, -1.0]}}\n"
    with ExitStack() as stack:
        robot = {"actuator": "qbmove", "mode": 5, "tags": "", "keys": keys}
        problem = prepared(stack, tmp_path, columns, ["joint_1.damping"], **robot)
        start = replay_of(problem.tracks[0], {}, problem.playing).initial["joint_1"]
    assert start["position"] == pytest.approx(0.4, abs=0.05)
    assert (start["motor_positions"], start["motor_velocities"]) == ([0.7, -0.2], [3.0, -1.0])


@pytest.mark.parametrize("interpolation", ["hold", "smooth"])
def test_a_command_that_jumped_before_its_sample_is_played_at_its_instant(interpolation):
    """Delay, zero and scale; the jump from 0 to 1 at the sample of .5 s happened 4 ms earlier."""
    time = np.arange(0.0, 1.0, 0.01)
    command = PlayedCommand(
        joint="j",
        quantity="reference_1",
        unit="rad",
        time=time,
        values=(time >= 0.495).astype(float),
        name="goal",
        hold=interpolation == "hold",
    )
    (jump,) = command.curve.jumps.tolist()
    reading = SeriesReading(
        key="j.reference_1",
        column="c",
        meaning="j.reference_1",
        gain=2.0,
        offset=0.1,
        interpolation=interpolation,
        early={repr(jump): 0.004},
    )
    rows = [line.split(",") for line in played_table(command, reading, 0.02).splitlines()[1:]]
    assert rows[0] == ["time", "j.reference_1 [rad]"]
    at, values = np.array(rows[1:], dtype=float).T
    played = replace(command, time=at, values=values)
    (instant,) = played.curve.jumps.tolist()
    assert instant == pytest.approx(jump - 0.004 + 0.02, abs=1e-9)
    assert values[[0, -1]].tolist() == pytest.approx([-0.2, 1.8])


def test_a_series_is_read_with_the_corrections_of_the_fit():
    """gain * (recorded - offset), after the conversion of its column."""
    reading = SeriesReading(key="j.link_position", column="a", meaning="-2*j.link_position [deg] + 0.5", gain=1.5, offset=0.1)
    assert reading.item(0.002) == "a=-3*j.link_position [deg] + 0.6 late 0.002"
