"""`asrsim plot`: runs beside experiments, their metrics, frequency responses and verdicts."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from asrsim.cli.app import app
from asrsim.errors import InputError
from asrsim.log import LogWriter, read_log
from asrsim.metrics import MEASURES, Measure, read_metrics
from asrsim.plots import read_curves
from asrsim.plots.claims import claimed_recording
from asrsim.plots.job import PlotJob, plot
from asrsim.plots.overlay import comparison_pages, overlay_figure
from asrsim.plots.pairing import assign
from asrsim.plots.responses import ResponseExperiment, responses
from asrsim.quantities import QUANTITIES
from asrsim.recordings import read_recording
from support.paths import ROOT
from support.plot_example import made_up_log, simulated_log


def lab(path, *, late=0.0, gain=1.0, unit="rad", rate=0.004):
    """A recording of the made-up run: its position times a gain, its clock late."""
    time = np.arange(0.0, 1.0, rate)
    q = gain * 0.4 * np.sin(2 * np.pi * (time - late - 0.05)) * (180 / np.pi if unit == "deg" else 1.0)
    reference = 0.5 * np.sin(2 * np.pi * (time - late))
    rows = [f"{t:.6f},{a:.9f},{b:.9f}" for t, a, b in zip(time, q, reference, strict=True)]
    path.write_text("\n".join([f"time [s],joint_1_position [{unit}],joint_1_reference [rad]", *rows]) + "\n")
    return path


def test_the_lag_is_found_and_removed(tmp_path):
    log = made_up_log(tmp_path / "log.mcap", count=2001)
    recording = lab(tmp_path / "lab.csv", late=0.1, gain=0.9, unit="deg")
    result = plot(PlotJob(logs=(log,), folder=tmp_path / "out", experiments=(str(recording),)))
    (alignment,) = result.compared[0].alignments.values()
    assert alignment.lag == pytest.approx(0.1, abs=1e-3)
    pair = result.compared[0].pairs["joint_1", "link_position"]
    assert np.nanmax(np.abs(pair.difference.values)) == pytest.approx(0.04, abs=2e-3)
    rmse = next(row for row in result.rows if (row.quantity, row.measure) == ("link_position", "rmse"))
    assert rmse.unit == "rad"
    assert rmse.value == pytest.approx(0.04 / np.sqrt(2), rel=0.1)
    assert {path.name for path in result.files} == {"comparison.png", "recorded.json", "metrics.csv"}
    assert "rise" in {row.measure for row in read_metrics(tmp_path / "out" / "metrics.csv")}


def test_a_log_with_a_quantity_that_is_unknown_here_is_compared(tiny, asrsim_command, monkeypatch):
    """A stage of a plugin that is not loaded had logged it."""
    assert asrsim_command("run", tiny.scenario, "--set", "duration=0.1", "--no-plot", "-q", "--out", "out").code == 0
    monkeypatch.delitem(QUANTITIES, "stiffness")
    done = asrsim_command("plot", "out", "-e", "out/log.mcap", "--json")
    assert done.code == 0, done.err
    assert {"stiffness", "link_position"} <= {row["quantity"] for row in json.loads(done.out)["metrics"]}


def test_a_further_measure_is_shown_of_run_and_recording(tmp_path, asrsim_command):
    """The recording is .9 of the run's sinusoid; `crest_factor` is a user's own measure, sqrt(2) for a sinusoid."""
    log, recording = made_up_log(tmp_path / "log.mcap", count=2001), lab(tmp_path / "lab.csv", gain=0.9)
    plugin = ROOT / "examples" / "plugins" / "my_lab.py"
    words = ("plot", log, "-e", recording, "--align", "off", "--plugin", plugin)
    done = asrsim_command(*words, "--measure", "rms", "--measure", "crest_factor", "--json")
    rows = {
        (row["measure"], row["source"]): row for row in json.loads(done.out)["metrics"] if row["quantity"] == "link_position"
    }
    sizes = [rows["rms", source]["value"] for source in ("soft", "lab.csv")]
    assert sizes[1] == pytest.approx(0.9 * sizes[0], rel=0.01)
    assert rows["crest_factor", "lab.csv"]["value"] == pytest.approx(2**0.5, rel=0.01)
    assert "choices" in asrsim_command("plot", log, "-e", recording, "--measure", "rmss", "--json").out


def test_a_coarse_recording_leaves_the_measures_of_the_run_as_they_are(tmp_path, asrsim_command):
    """Samples each 0.11 s miss the peak of the sinusoid; the recording lasts longer than the run."""
    log, recording = made_up_log(tmp_path / "log.mcap", count=801), lab(tmp_path / "lab.csv", rate=0.11)
    words = ("plot", log, "--measure", "peak", "--measure", "rms", "--quantity", "link_position", "--json")

    def values(*more):
        rows = json.loads(asrsim_command(*words, *more).out)["metrics"]
        return {row["measure"]: row["value"] for row in rows if row["source"] == "soft"}

    alone, beside = values(), values("-e", recording, "--align", "off")
    assert alone["peak"] == pytest.approx(0.4, rel=1e-6)
    assert [beside[name] for name in ("peak", "rms")] == pytest.approx([alone[name] for name in ("peak", "rms")], rel=1e-9)


def lead(time, values, reference, *, beyond):
    """Largest amount by which the values exceed the reference, less `beyond`."""
    return np.nan if reference is None else float(np.max(values - reference)) - beyond


@pytest.mark.parametrize("needs", ["pair", "either"])
def test_a_measure_of_two_series_compares_each_record_with_its_own_reference(tmp_path, needs):
    """The recording's position is half the run's, and its reference is the run's. A claim gives the run's number."""
    MEASURES.add("lead", Measure(name="lead", function=lead, unit="series", needs=needs))
    claim = {"joint": "joint_1", "quantity": "link_position", "measure": "lead", "value": 0, "options": {"beyond": 0.1}}
    log, recording = made_up_log(tmp_path / "log.mcap", expect=(claim,)), lab(tmp_path / "lab.csv", gain=0.5)
    done = plot(
        PlotJob(logs=(log,), folder=tmp_path / "out", experiments=(str(recording),), measures=("lead:beyond=0.1",), lag="off")
    )
    found = {row.source: row.value for row in done.rows if (row.quantity, row.measure) == ("link_position", "lead:beyond=0.1")}
    time = np.arange(0.0, 1.0, 0.004)
    reference, motion = 0.5 * np.sin(2.0 * np.pi * time), 0.4 * np.sin(2.0 * np.pi * (time - 0.05))
    assert found["soft"] == pytest.approx(np.max(motion - reference) - 0.1, abs=1e-5)
    assert found["lab.csv"] == pytest.approx(np.max(0.5 * motion - reference) - 0.1, abs=1e-5)
    assert done.claims[0][1].measured == pytest.approx(found["soft"], abs=1e-4)


def test_measures_of_a_run_alone(tmp_path, asrsim_command):
    claim = {"joint": "joint_1", "quantity": "link_position", "measure": "at", "comparison": "<", "value": 1}
    claims = [{**claim, "options": {"when": when}} for when in (0.3, 0.55)]
    log = made_up_log(tmp_path / "log.mcap", joints=2, expect=claims)
    words = (
        "--measure",
        "at:when=0.3",
        "--measure",
        "gain:hertz=1",
        "--measure",
        "rmse:start=0.2,end=0.7",
        "--measure",
        "overshoot",
    )
    done = asrsim_command("plot", log, "--joint", "joint_2", *words)
    for heading in ("at:when=0.3", "gain:hertz=1", "rmse:start=0.2,end=0.7", "overshoot"):
        assert heading in done.out
    assert "at:when=0.3 of link_position" in done.out
    assert "at:when=0.55 of link_position" in done.out
    rows = {row.measure: row for row in read_metrics(tmp_path / "metrics.csv")}
    assert {row.joint for row in rows.values()} == {"joint_2"}
    assert rows["at:when=0.3"].value == pytest.approx(0.4, abs=1e-6)
    # The error of half a period is a sinusoid; 0.05 s are 0.1 pi of the period.
    error = abs(0.5 - 0.4 * np.exp(-0.1j * np.pi))
    assert rows["rmse:start=0.2,end=0.7"].value == pytest.approx(error / np.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize(
    ("asked", "said"),
    [("at", "Write at:when=VALUE"), ("at:when=x", "must be a number"), ("rms:foo", "is not OPTION=VALUE"), ("rmss", "'rms'")],
)
def test_a_wrong_measure_says_how_to_write_it(tmp_path, asrsim_command, asked, said):
    log = made_up_log(tmp_path / "log.mcap", count=201)
    assert said in asrsim_command("plot", log, "--measure", asked).err


@pytest.mark.parametrize("header", [("elbow_cmd",), ("elbow_cmd", "elbow_pos")])
def test_a_late_command_is_not_taken_for_a_late_clock(tiny, asrsim_command, header):
    """The robot recorded itself, with commands as they were sent and a clock that is .21 s late."""
    sine = "elbow: {equilibrium_position: {sinusoid: {amplitude: 0.4, frequency: 1.3}}}"
    late = "imperfections: {commands: {elbow: {delay: 0.034}}}"
    text = f"robot: pendulum.urdf\nduration: 2\nreferences: {{{sine}}}\n{late}\n"
    tiny.scenario.write_text(text)
    assert asrsim_command("run", tiny.scenario, "--quiet", "--no-plot").code == 0
    log = tiny.folder / "out" / "step" / "default" / "log.mcap"
    samples = read_log(log).samples
    columns = {"elbow_cmd": 0.4 * np.sin(2 * np.pi * 1.3 * samples.time), "elbow_pos": samples.values["link_position"][:, 0]}
    table = np.column_stack([samples.time + 0.21, *(columns[name] for name in header)])
    recording = tiny.folder / "lab.csv"
    np.savetxt(recording, table, delimiter=",", comments="", header=",".join(("time", *header)))
    (compared,) = plot(PlotJob(logs=(log,), folder=tiny.folder, experiments=(str(recording),))).compared
    assert compared.alignments[str(recording)].lag == pytest.approx(0.21, abs=1e-4)
    assert {key: pair.rmse < 2e-4 for key, pair in compared.pairs.items()} == dict.fromkeys(compared.pairs, True)


def test_simulation_and_experiment_are_drawn_apart_with_their_difference(tmp_path):
    log, recording = made_up_log(tmp_path / "log.mcap"), lab(tmp_path / "lab.csv", gain=0.95)
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=(str(recording),), lag="off"))
    axes = overlay_figure(result.runs, result.compared, ["joint_1"], ["link_position"]).axes
    assert [line.get_gid() for line in axes[1].get_lines() if line.get_gid()] == ["joint_1.link_position.difference.0"]
    drawn = {line.get_gid(): line for ax in axes for line in ax.get_lines() if line.get_gid()}
    simulation = drawn["joint_1.link_position.simulation.0"].get_ydata()
    experiment = drawn["joint_1.link_position.experiment.0"].get_ydata()
    difference = drawn["joint_1.link_position.difference.0"].get_ydata()
    np.testing.assert_allclose(experiment, 0.95 * simulation, atol=1e-3)
    np.testing.assert_allclose(difference, simulation - experiment, atol=1e-12)
    assert np.ptp(axes[1].get_ylim()) < 3.0 * np.ptp(difference)
    curve = json.loads((tmp_path / "recorded.json").read_text())["curves"][0]
    np.testing.assert_allclose(curve["time"], drawn["joint_1.link_position.experiment.0"].get_xdata(), atol=1e-6)
    np.testing.assert_allclose(curve["values"], experiment, rtol=1e-5, atol=1e-9)
    assert drawn["joint_1.link_position.simulation.0"].get_color() != drawn["joint_1.link_position.experiment.0"].get_color()


@pytest.mark.parametrize(("late", "said"), [(0.1, "0.1 s late"), (-0.1, "0.1 s early"), (0.0, "")])
def test_the_title_says_how_the_recording_was_moved(tmp_path, late, said):
    log, recording = made_up_log(tmp_path / "log.mcap"), lab(tmp_path / "lab.csv", late=late)
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=(str(recording),), lag=late))
    figure = overlay_figure(result.runs, result.compared, ["joint_1"], ["link_position"])
    title = " ".join(text.get_text() for text in figure.texts)
    assert (f"recording {said}" in title) if said else ("recording" not in title)


def test_every_compared_quantity_is_on_one_page(tmp_path):
    quantities = ("link_position", "link_torque", "stiffness", "motor_1_position")
    names = [f"joint_{j}.{quantity}" for j in (1, 2, 3, 4) for quantity in quantities]
    log = made_up_log(tmp_path / "log.mcap", joints=4, count=101, step=0.01)
    table = np.column_stack([0.01 * np.arange(101), *[np.sin(0.1 * np.arange(101))] * len(names)])
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header=f"time,{','.join(names)}", comments="")
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=(str(tmp_path / "lab.csv"),), lag="off"))
    pages = comparison_pages(result.runs, result.compared, references=False)
    drawn = [line.get_gid() for page in pages for axes in page.figure.axes for line in axes.get_lines() if line.get_gid()]
    assert sorted(gid.removesuffix(".experiment.0") for gid in drawn if gid.endswith("experiment.0")) == sorted(names)


def test_several_recordings_are_a_band(tmp_path):
    log = made_up_log(tmp_path / "log.mcap")
    files = tuple(str(lab(tmp_path / f"run{n}.csv", gain=gain)) for n, gain in enumerate((0.8, 1.0, 1.2)))
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=files, lag="off"))
    pair = result.compared[0].pairs["joint_1", "link_position"]
    assert pair.count == 3
    assert pair.low is not None
    assert pair.high is not None
    peak = int(np.argmax(pair.recording.values))
    assert pair.recording.values[peak] == pytest.approx(0.4, rel=1e-3)
    assert (pair.low.values[peak], pair.high.values[peak]) == pytest.approx((0.32, 0.48), rel=1e-3)


def test_recordings_of_different_quantities_are_all_compared(tmp_path):
    log, time = made_up_log(tmp_path / "log.mcap"), np.arange(0.0, 1.0, 0.004)
    names = ("link_position", "link_torque")
    files = [tmp_path / f"{name}.csv" for name in names]
    for name, file in zip(names, files, strict=True):
        np.savetxt(file, np.column_stack([time, time]), delimiter=",", header=f"time,joint_1.{name}", comments="")
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=tuple(map(str, files)), lag="off"))
    assert {quantity for _, quantity in result.compared[0].pairs} == set(names)


def test_recordings_go_to_the_variant_before_the_equals_sign(tmp_path):
    labels = ["soft", "stiff"]
    assert assign(labels, ["lab_soft.csv", "stiff=lab.csv"]) == [(Path("lab_soft.csv"), None), (Path("lab.csv"), 1)]
    with pytest.raises(InputError, match="Did you mean 'stiff'"):
        assign(labels, ["stif=lab.csv"])


def test_a_recording_without_times_is_read_at_the_given_rate(tmp_path):
    lab = tmp_path / "lab.csv"
    lab.write_text("\n".join(["joint_1_position [rad]", *(f"{0.01 * i:.3f}" for i in range(40))]))
    position = claimed_recording(lab, [], rate=50.0).column("joint_1", "link_position")
    np.testing.assert_allclose(np.diff(position.time), 0.02, rtol=0.0, atol=1e-12)


def test_bode_finds_the_gain_and_delay_of_an_experiment(tmp_path):
    log = simulated_log("chirp_1dof_qbmove", tmp_path / "log.mcap", variant="stiff", duration=8.0)
    samples = read_log(log).samples
    q, r = samples.values["link_position"][:, 0], samples.values["reference_1"][:, 0]
    rows = [f"{samples.time[i]:.4f},{0.5 * q[max(i - 20, 0)]:.9f},{r[i]:.9f}" for i in range(0, len(q), 4)]
    (tmp_path / "lab.csv").write_text("\n".join(["time [s],joint_1_position [rad],joint_1_reference [rad]", *rows]))
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=(str(tmp_path / "lab.csv"),), bode=True))
    simulated, recorded = (one.response for one in result.responses)
    f = np.linspace(1.0, 2.0, 5)
    gains, phases = (
        [np.interp(f, one.frequency, getattr(one, name)) for one in (recorded, simulated)] for name in ("gain", "phase")
    )
    np.testing.assert_allclose(gains[0] / gains[1], 0.5, rtol=0.02)
    np.testing.assert_allclose(np.radians(phases[0] - phases[1]), -2 * np.pi * f * 0.02, atol=0.02)


@pytest.mark.parametrize("recorded", [True, False])
def test_a_recording_without_a_reference_is_said_to_have_that_of_the_simulation(tmp_path, recorded):
    log, file = made_up_log(tmp_path / "log.mcap"), lab(tmp_path / "lab.csv")
    if not recorded:
        file.write_text(file.read_text().replace("joint_1_reference", "spare"))
    result = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=(str(file),), bode=True, band=(0.9, 3.0)))
    simulated, measured = (one.findings for one in result.responses)
    assert "reference-of-simulation" not in {one.code for one in simulated}
    said = [one for one in measured if one.code == "reference-of-simulation"]
    assert [(one.file, one.key) for one in said] == ([] if recorded else [(file, "joint_1")])
    assert [one.code for one in measured if one not in said] == ["low-coherence"]


def test_the_response_of_each_joint_is_its_own_from_the_joint_that_is_named(tmp_path):
    """Both joints follow the chirp of joint_1, with gains of 0.5 and 0.25; the recording has half of that."""
    whole = read_log(made_up_log(tmp_path / "whole.mcap", joints=2, count=4001)).samples
    time = whole.time
    chirp = np.sin(2 * np.pi * (0.5 + 0.6 * time) * time)
    values = {**whole.values, "reference_1": np.column_stack([chirp, np.cos(9.0 * time)])}
    values["link_position"] = np.outer(chirp, [0.5, 0.25])
    with LogWriter(tmp_path / "log.mcap", read_log(tmp_path / "whole.mcap").info) as writer:
        writer.write(replace(whole, values=values))
    header = (
        "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad],joint_2.reference_1 [rad],joint_2.link_position [rad]"
    )
    columns = np.column_stack([time, chirp, 0.25 * chirp, np.cos(9.0 * time), 0.125 * chirp])
    np.savetxt(tmp_path / "lab.csv", columns, delimiter=",", header=header, comments="")
    pairing = {name: name for name in ("joint_1", "joint_2")}
    lab = ResponseExperiment(recording=read_recording(tmp_path / "lab.csv"), joints=pairing)
    found, problems = responses(tmp_path / "log.mcap", label="soft", experiments=[lab], given="joint_1.reference_1")
    assert problems == []
    gains = {(one.joint.name, one.experiment): np.median(one.response.gain) for one in found}
    wanted = {("joint_1", False): 0.5, ("joint_1", True): 0.25, ("joint_2", False): 0.25, ("joint_2", True): 0.125}
    assert gains == {key: pytest.approx(gain, rel=0.02) for key, gain in wanted.items()}


def test_a_run_without_excitation_has_no_bode_plot(tmp_path):
    log = made_up_log(tmp_path / "log.mcap", values={"reference_1": np.zeros(1001)})
    with pytest.raises(InputError, match="no joint has a moving reference"):
        plot(PlotJob(logs=(log,), folder=tmp_path, bode=True))


CLAIM = {"joint": "joint_1", "quantity": "link_position", "measure": "maximum", "value": 0.4, "tolerance": 0.01}


@pytest.mark.parametrize(("value", "code", "word"), [(0.4, 0, "pass"), (0.7, 1, "FAIL")])
def test_claims_of_the_logged_scenario_decide_the_exit_code(tmp_path, value, code, word):
    log = made_up_log(tmp_path / "log.mcap", expect=({**CLAIM, "value": value}, {**CLAIM, "variant": "other", "value": 9.0}))
    result = CliRunner().invoke(app, ["plot", str(log)])
    assert result.exit_code == code
    assert f"{word} joint_1: maximum of link_position is 0.4 rad" in result.output
    assert "other" not in result.output
    assert json.loads(CliRunner().invoke(app, ["plot", str(log), "--json"]).stdout)["ok"] is (code == 0)


def test_claims_of_several_runs_name_their_run(tmp_path, asrsim_command):
    logs = [
        made_up_log(tmp_path / variant / "log.mcap", variant=variant, expect=({**CLAIM, "value": value},))
        for variant, value in {"soft": 0.4, "stiff": 0.7}.items()
    ]
    outcome = asrsim_command("plot", *logs)
    assert outcome.code == 1
    assert "pass soft: joint_1: maximum of link_position" in outcome.out
    assert "FAIL stiff: joint_1: maximum of link_position" in outcome.err
    assert (tmp_path / "variants").is_dir()


def test_the_command_prints_how_the_recording_was_read(tmp_path):
    log, recording = made_up_log(tmp_path / "log.mcap"), lab(tmp_path / "lab.csv", late=-0.05)
    result = CliRunner().invoke(app, ["plot", str(log), "-e", str(recording), "--format", "svg"])
    assert result.exit_code == 0, result.output
    for words in ("joint_1.link_position", "0.05 s early", "rmse"):
        assert words in result.output
    assert (tmp_path / "compared" / "comparison.svg").is_file()


def test_json_is_one_document(tmp_path):
    log, recording = made_up_log(tmp_path / "log.mcap"), lab(tmp_path / "lab.csv")
    recording.write_text(recording.read_text().replace("joint_1_reference", "temperature"))
    data = json.loads(CliRunner().invoke(app, ["plot", str(log), "-e", str(recording), "--json"]).stdout)
    assert data["ok"] is True
    assert data["experiments"][0]["columns"] == {"joint_1_position [rad]": "joint_1.link_position"}
    assert Path(data["files"][0]).name == "comparison.png"
    bad = CliRunner().invoke(app, ["plot", str(log), "-e", "nowhere.csv", "--json"])
    assert bad.exit_code == 1
    assert json.loads(bad.stdout)["errors"]


def test_no_common_joint_says_what_there_is(tmp_path):
    log = made_up_log(tmp_path / "log.mcap", joints=2)
    (tmp_path / "lab.csv").write_text("time [s],knee_position [mm]\n" + "".join(f"{n / 100},{n}\n" for n in range(100)))
    with pytest.raises(InputError, match="no common joint") as caught:
        plot(PlotJob(logs=(log,), folder=tmp_path / "out", experiments=(str(tmp_path / "lab.csv"),)))
    assert "--map 'knee_position [mm]=joint_1.link_position [m]'" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_the_gain_of_a_pair_has_its_unit(tmp_path):
    log = simulated_chirp(tmp_path)
    result = plot(PlotJob(logs=(log,), folder=tmp_path, bode=True, given="motor_1_position", output="joint_1.link_velocity"))
    (response,) = result.responses
    assert response.unit == "rad/s/rad"
    gain = {row.measure: row for row in result.rows}["resonance_gain"]
    assert gain.unit == "dB re rad/s/rad"
    assert gain.quantity == "link_velocity"


@pytest.mark.parametrize(
    ("options", "words"),
    [({"given": "motor_9"}, "no quantity 'motor_9'"), ({"output": "elbow.link_position"}, "no joint 'elbow'")],
)
def test_bode_refuses_what_a_log_has_not(tmp_path, options, words):
    with pytest.raises(InputError, match=words):
        plot(PlotJob(logs=(made_up_log(tmp_path / "log.mcap"),), folder=tmp_path, bode=True, **options))


def test_a_recording_alone_has_its_frequency_response(tmp_path):
    """A chirp through a gain of 0.5 and 10 ms of delay, in degrees."""
    time = np.arange(0.0, 8.0, 0.002)
    chirp = lambda t: np.sin(2 * np.pi * (0.5 + 0.4 * t) * t)  # noqa: E731
    recorded = tmp_path / "lab.csv"
    columns = np.c_[time, chirp(time), 0.5 * chirp(time - 0.01) * 180 / np.pi, 0 * time, 0 * time]
    header = "t,arm.reference_1 [rad],arm.link_position [deg],leg.link_position [deg],toe.link_position [deg]"
    np.savetxt(recorded, columns, delimiter=",", header=header, comments="")
    result = plot(PlotJob(logs=(), folder=tmp_path / "out", experiments=(str(recorded),), bode=True))
    (found,) = result.responses
    assert (found.joint.name, found.unit, found.experiment) == ("arm", "", True)
    np.testing.assert_allclose(found.response.gain, 0.5, rtol=0.02)
    np.testing.assert_allclose(found.response.phase, -360 * 0.01 * found.response.frequency, atol=1.0)
    missing = [str(problem) for problem in result.findings if "has no reference_1 of" in str(problem)]
    assert [text.count(name) > 0 for text, name in zip(missing, ("leg", "toe"), strict=True)] == [True, True]
    assert {path.name for path in result.files} == {"bode.png", "metrics.csv"}
    with pytest.raises(InputError, match=r"no log was named.*--experiment FILE --bode"):
        plot(PlotJob(logs=(), folder=tmp_path, experiments=(str(recorded),)))


def simulated_chirp(tmp_path):
    return simulated_log("chirp_1dof_qbmove", tmp_path / "log.mcap", variant="soft", duration=4.0)


def test_forces_on_both_sides_of_a_contact_pair_count(tmp_path):
    """The robot pushes with 3 N, another object pushes back with 1 N; what the ground does is left out."""
    whole = read_log(made_up_log(tmp_path / "whole.mcap", count=11))
    force, poses = np.tile([1.0, 0.0, 0.0], (11, 1)), np.zeros((11, 7))
    poses[:, 0] = 5.0 + whole.samples.time
    contacts = {"box/robot": 3.0 * force, "ball/box": force, "box/ground": 9.0 * force}
    with LogWriter(tmp_path / "log.mcap", whole.info) as writer:
        writer.write(replace(whole.samples, bodies={"box": poses}, contacts=contacts))
    run = read_curves(tmp_path / "log.mcap")
    np.testing.assert_allclose(run.get("box", "force").values, 2.0)
    assert run.get("box", "dx").values[[0, -1]] == pytest.approx([0.0, 0.01])


def test_a_diverged_run_is_drawn_and_named(tmp_path, asrsim_command):
    whole = read_log(made_up_log(tmp_path / "whole.mcap", count=50))
    with LogWriter(tmp_path / "log.mcap", whole.info) as writer:
        writer.write(whole.samples)
        writer.close({"status": "diverged"})
    outcome = asrsim_command("plot", "log.mcap")
    assert outcome.code == 0
    assert "the run is diverged, drawn up to its last sample; its claims are not evaluated" in outcome.err


def test_robots_with_different_joints_share_a_picture(tmp_path):
    logs = (made_up_log(tmp_path / "one.mcap", count=50), made_up_log(tmp_path / "two.mcap", joints=2, count=50))
    result = plot(PlotJob(logs=logs, folder=tmp_path / "out"))
    assert {joint.name for run in result.runs for joint in run.joints} == {"joint_1", "joint_2"}
    assert all(path.is_file() for path in result.files)
