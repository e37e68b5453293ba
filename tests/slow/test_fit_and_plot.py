"""`plot` of the scenario that `identify` wrote, beside the recording that it was fitted to, shows the error that it printed."""

import json

import numpy as np
import pytest

import asrsim
from asrsim.plots.job import PlotJob, plot
from support.tiny import PENDULUM

pytestmark = pytest.mark.slow

MOTION = (
    {"sinusoid": {"amplitude": 0.3, "frequency": 0.7}},
    {"step": {"at": 1, "to": 0.2}},
    {"step": {"at": 2.3, "to": -0.3}},
)
WAVE = ({"sinusoid": {"amplitude": 0.3, "frequency": 0.7}},)


class Bench:
    """A laboratory: a robot whose recordings differ from its simulation by delays, zeros, scales and clocks."""

    def __init__(self, folder, command):
        self.folder, self.command = folder, command

    def record(self, actuator, motion=MOTION, *, imperfections=None, preset=None, duration=4):
        """Samples of the true robot."""
        robot = self.folder / "arm.urdf"
        robot.write_text(
            PENDULUM.replace("libsea", f"lib{actuator}")
            .replace("<operation_mode>3", "<operation_mode>6")
            .replace("_k>10", "_k>12")
        )
        references = {"equilibrium_position": {"sum": [*motion]}}
        if actuator != "sea":
            references["stiffness_preset"] = preset or 0.2
        scenario = asrsim.make_scenario(
            robot, duration=duration, references={"elbow": references}, imperfections=imperfections or {}
        )
        return asrsim.run(scenario).samples

    def fit(self, columns, *free, preset=None, every=4):
        """Write a recording, fit it, and run the written scenario; return fit.json and the comparison of the run."""
        table = np.column_stack([*columns.values()])[::every]
        np.savetxt(self.folder / "lab.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
        assert self.command("init", "arm.urdf", "--experiment", "lab.csv", "--out", "s.yaml").code == 0
        if preset is not None:
            path = self.folder / "s.yaml"
            lines = path.read_text().splitlines()
            lines = [f"    stiffness_preset: {preset}" if "    stiffness_preset: " in line else line for line in lines]
            path.write_text("\n".join(lines) + "\n")
        options = [f"--free={key}" for key in free]
        assert self.command("identify", "s.yaml", "--experiment", "lab.csv", *options, "--out", "fit", "--no-plot").code == 0
        (path,) = self.folder.rglob("fit.json")
        assert self.command("run", path.parent / "scenario.yaml", "--no-plot", "--out", "again").code == 0
        (log,) = (self.folder / "again").rglob("log.mcap")
        (compared,) = plot(PlotJob(logs=(log,), folder=self.folder, experiments=(str(self.folder / "lab.csv"),))).compared
        return json.loads(path.read_text()), compared


@pytest.fixture
def bench(tmp_path, asrsim_command):
    """A laboratory in an empty folder."""
    return Bench(tmp_path, asrsim_command)


def noise(samples, seed=1):
    """Noise of .5 mrad of a sensor."""
    return 5e-4 * np.random.default_rng(seed).standard_normal(len(samples.time))


def assert_equal_errors(found, compared):
    """The error of each channel in the plot is the printed one, in the unit and scale of the robot."""
    gains = {one["key"].removesuffix(".gain"): one["value"] for one in found["estimates"] if one["key"].endswith(".gain")}
    for channel in found["channels"]:
        # A quarter of the recording is held out.
        printed = np.sqrt(0.75 * channel["after"] ** 2 + 0.25 * channel["held_after"] ** 2) * gains.get(channel["key"], 1.0)
        assert compared.pairs[tuple(channel["key"].rsplit(".", 1))].rmse == pytest.approx(printed, rel=0.03)


@pytest.mark.parametrize(
    ("actuator", "delay", "late", "presets"),
    [
        ("sea", 0.03, 0.0, False),
        ("sea", 0.0, 0.0, False),
        ("sea", 0.03, 120.5, False),
        ("qbmove", 0.03, 0.0, False),
        ("qbmove", 0.02, 3.0, True),
    ],
)
def test_the_error_of_a_fit_is_the_error_of_its_plot(bench, actuator, delay, late, presets):
    """A recording of one reference, or of both, with noise of .5 mrad, by a clock of its own."""
    imperfections = {"commands": {"elbow": {"delay": delay}}} if delay else {}
    preset = {"sinusoid": {"amplitude": 0.05, "frequency": 0.4, "offset": 0.2}} if presets else None
    samples = bench.record(actuator, imperfections=imperfections, preset=preset)
    sent = "sent_reference" if delay else "reference"
    columns = {"time": samples.time + late, "elbow_cmd": samples.values[f"{sent}_1"][:, 0]}
    columns["elbow_pos"] = samples.values["link_position"][:, 0] + noise(samples)
    if presets:
        columns["elbow_preset"] = samples.values[f"{sent}_2"][:, 0]
    free = ("elbow.damping", "elbow.reference_1.delay", *(["elbow.reference_2.delay"] if presets else []))
    found, compared = bench.fit(columns, *free, preset=None if presets else 0.2)
    assert compared.alignments[str(bench.folder / "lab.csv")].lag == pytest.approx(late, abs=1e-5)
    assert_equal_errors(found, compared)


def test_zeros_scales_and_delays_of_sensors_are_in_the_plot(bench):
    """A link sensor with a zero of 20 mrad, 4 % too small a scale, 12 ms late, and a motor sensor 5 ms late."""
    samples = bench.record("sea")
    link, motor = (samples.values[name][:, 0] for name in ("link_position", "motor_1_position"))
    columns = {
        "time": samples.time,
        "elbow_cmd": samples.values["reference_1"][:, 0],
        "elbow_pos": np.interp(samples.time - 0.012, samples.time, link) / 1.04 + 0.02 + noise(samples),
        "elbow_motor_pos": np.interp(samples.time - 0.005, samples.time, motor) + noise(samples, 2),
    }
    free = [f"elbow.link_position.{name}" for name in ("offset", "gain", "delay")]
    found, compared = bench.fit(columns, "elbow.damping", "elbow.motor_1_position.delay", *free)
    values = {one["key"]: one["value"] for one in found["estimates"]}
    assert values["elbow.link_position.gain"] == pytest.approx(1.04, rel=2e-3)
    assert values["elbow.link_position.delay"] == pytest.approx(0.012, abs=3e-4)
    assert_equal_errors(found, compared)


def test_zero_and_scale_of_a_command_are_played(bench):
    """A command that was recorded with a zero of 30 mrad and 5 % too large."""
    samples = bench.record("sea")
    columns = {
        "time": samples.time,
        "elbow_cmd": 1.05 * samples.values["reference_1"][:, 0] + 0.03,
        "elbow_pos": samples.values["link_position"][:, 0] + noise(samples),
    }
    found, compared = bench.fit(columns, "elbow.damping", "elbow.reference_1.gain", "elbow.reference_1.offset")
    assert_equal_errors(found, compared)


def test_a_command_that_was_recorded_late_is_played_early(bench):
    """The command's column is 9 ms late: its delay is negative."""
    samples = bench.record("sea", WAVE)
    command = samples.values["reference_1"][:, 0]
    columns = {
        "time": samples.time,
        "elbow_cmd": np.interp(samples.time - 0.009, samples.time, command),
        "elbow_pos": samples.values["link_position"][:, 0] + noise(samples),
    }
    found, compared = bench.fit(columns, "elbow.damping", "elbow.reference_1.delay")
    (delay,) = (one["value"] for one in found["estimates"] if one["key"] == "elbow.reference_1.delay")
    assert delay == pytest.approx(-0.009, abs=3e-4)
    assert_equal_errors(found, compared)


def test_a_clock_beyond_a_quarter_of_a_periodic_record(bench):
    """A wave of 0.7 Hz for 4 s, recorded by a clock that is 3 s ahead, and channels 15 ms behind the command."""
    samples = bench.record("sea", WAVE)
    columns = {
        "time": samples.time + 3.0,
        "elbow_cmd": samples.values["reference_1"][:, 0],
        "elbow_pos": np.interp(samples.time - 0.015, samples.time, samples.values["link_position"][:, 0]) + noise(samples),
    }
    found, compared = bench.fit(columns, "elbow.damping", "clock")
    assert compared.alignments[str(bench.folder / "lab.csv")].lag == pytest.approx(3.0, abs=1e-9)
    assert_equal_errors(found, compared)


def test_jumps_before_the_sample_that_shows_them_are_played_at_their_instants(bench):
    """A command at 100 Hz that jumps 4 ms and 7 ms before the samples that show it."""
    motion = ({"step": {"at": 0.506, "to": 0.4}}, {"step": {"at": 2.303, "to": -0.6}})
    samples = bench.record("sea", motion)
    columns = {
        "time": samples.time,
        "elbow_cmd": samples.values["reference_1"][:, 0],
        "elbow_pos": samples.values["link_position"][:, 0] + noise(samples),
    }
    found, compared = bench.fit(columns, "elbow.damping", "elbow.spring_stiffness", every=10)
    jumps = [one["value"] for one in found["estimates"] if one["key"].startswith("jump_")]
    assert jumps == pytest.approx([0.004, 0.007], abs=3e-4)
    assert_equal_errors(found, compared)
