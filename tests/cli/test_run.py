"""Output files, messages and exit codes of `asrsim run` and `asrsim rerun`."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS, Sea
from asrsim.log import LogWriter, read_log
from support.bags import ramp_bag
from support.paths import ROOT

FOREVER = ("--set", "duration=1e5", "--set", "compiled=false")
LOAD = "external_torques={elbow: {step: {at: 0.5, to: 1e9}}}"
"""Torque that makes every joint diverge."""
LIMIT = 60.0
"""Time limit for a subprocess on a slow machine, s."""


def log_of(tiny, variant="default"):
    return tiny.folder / "out" / "step" / variant / "log.mcap"


def test_a_run_leaves_log_summary_and_table(tiny, asrsim_command):
    outcome = asrsim_command("run", tiny.scenario, "--no-plot")
    assert outcome.code == 0
    assert outcome.err == ""
    log = read_log(log_of(tiny))
    assert log.status == "complete"
    assert log.samples.time[-1] == 1.5
    assert len(log.samples.time) == 1501
    row = next(line for line in outcome.out.splitlines() if line.split()[:1] == ["elbow"])
    steady = log.samples.joint("elbow")["link_position"][-150:].mean()
    assert f"{steady:.4f}"[:5] in row
    assert "out/step/default" in outcome.out
    assert "\x1b[" not in outcome.out


@pytest.mark.parametrize("scenario", ["step_2dof", "step_1dof_awas_ii"])
def test_tables_of_examples_fit_80_columns(scenario, asrsim_command):
    """Both examples reach limits, whose columns would not fit beside those of the measures."""
    path = ROOT / "examples" / "scenarios" / f"{scenario}.yaml"
    lines = asrsim_command("run", path, "--no-plot", "--set", "duration=0.5").out.splitlines()
    rules = [line for line in lines if set(line) == set(" ─")]
    assert sum(line.startswith("  limits: ") for line in lines) == len(rules) / 2
    # Each rule is as long as the longest line of its table.
    assert max(map(len, rules)) <= 80


def test_json_output_equals_the_summary_file(tiny, asrsim_command):
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--json", "--set", "duration=0.3")
    document = json.loads(outcome.out)
    assert outcome.err == ""
    assert document["ok"] is True
    run = document["runs"][0]
    assert run["status"] == "complete"
    assert run["samples"] == 301
    assert [joint["name"] for joint in run["joints"]] == ["elbow"]
    assert json.loads(Path(run["files"]["summary"]).read_text()) == run


def test_the_summary_and_the_log_state_what_ran_with_which_settings(tiny, asrsim_command):
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants: {soft: {parameters: {elbow: {spring_k: 8}}}, stiff: {}}\n")
    settings = {
        "duration": 0.2, "step": 0.002, "log_rate": 100, "seed": 7, "substeps": 3, "compiled": "false", "engine": "mujoco",
        "gravity": "[0, 0, -1.5]",
    }  # fmt: skip
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--json", "--variant", "soft", *words)
    (run,) = json.loads(outcome.out)["runs"]
    stated = {
        "scenario": "step", "scenario_path": str(tiny.scenario), "variant": "soft", "robot": "pendulum",
        "robot_path": str(tiny.robot), "duration": 0.2, "step": 0.002, "log_every": 5, "substeps": 3,
        "samples": 21, "stepping": "leapfrog", "engine": "mujoco", "loop": "plain", "seed": 7,
    }  # fmt: skip
    assert {key: run[key] for key in stated} == stated
    assert run["simulated_time"] == pytest.approx(0.2)
    assert run["total_substeps"] == pytest.approx(300, abs=3)
    info = read_log(Path(run["files"]["log"])).info
    assert (info.urdf_path, info.scenario_path) == (str(tiny.robot), str(tiny.scenario))
    assert (info.urdf, info.scenario) == (tiny.robot.read_text(), tiny.scenario.read_text())
    assert info.resolved["parameters"]["elbow"]["spring_stiffness"] == 8.0
    told = {key: info.metadata[key] for key in ("engine", "stepping", "order", "substeps", "seed", "gravity")}
    assert told == {
        "engine": "mujoco", "stepping": "leapfrog", "order": "2", "substeps": "3", "seed": "7", "gravity": "(0.0, 0.0, -1.5)",
    }  # fmt: skip


def test_run_draws_pictures_by_default(tiny, asrsim_command):
    assert asrsim_command("run", tiny.scenario, "--set", "duration=0.2").code == 0
    pictures = list(log_of(tiny).parent.glob("*.png"))
    assert pictures
    summary = json.loads((log_of(tiny).parent / "summary.json").read_text())
    assert summary["files"].keys() == {"log", "summary", "plots"}
    assert sorted(summary["files"]["plots"]) == sorted(f"out/step/default/{path.name}" for path in pictures)


def test_each_variant_has_its_own_folder(tiny, asrsim_command):
    soft_and_stiff = "variants:\n  soft: {parameters: {elbow: {spring_k: 5}}}\n  stiff: {parameters: {elbow: {spring_k: 50}}}\n"
    tiny.scenario.write_text(tiny.scenario.read_text() + soft_and_stiff)
    short = ("run", tiny.scenario, "--no-plot", "--set", "duration=0.01")
    assert asrsim_command(*short).code == 0
    soft, stiff = (read_log(log_of(tiny, name)).samples.joint("elbow")["stiffness"][0] for name in ("soft", "stiff"))
    assert (soft, stiff) == (5.0, 50.0)
    assert asrsim_command(*short, "--out", "both").code == 0
    assert (tiny.folder / "both" / "soft" / "log.mcap").is_file()
    assert asrsim_command(*short, "--variant", "stiff", "--out", "one").code == 0
    assert read_log(tiny.folder / "one" / "log.mcap").info.variant == "stiff"


def test_invalid_variant_is_named_and_ends_the_command(tiny, asrsim_command):
    variants = "variants:\n  a: {duration: 0.1}\n  b: {parameters: {elbow: {spring_k: 1e12}}}\n  c: {duration: 0.1}\n"
    tiny.scenario.write_text(tiny.scenario.read_text() + variants)
    outcome = asrsim_command("run", tiny.scenario, "--no-plot")
    assert outcome.code == 1
    assert "step / b could not be run" in outcome.err
    assert read_log(log_of(tiny, "a")).status == "complete"
    assert not log_of(tiny, "b").exists()
    assert not log_of(tiny, "c").exists()


def test_other_variants_run_after_a_failed_claim(tiny, asrsim_command):
    claim = "{variant: a, joint: elbow, quantity: link_position, measure: final, comparison: '>', value: 9}"
    tiny.scenario.write_text(tiny.scenario.read_text() + f"variants: {{a: {{}}, b: {{}}}}\nexpect: [{claim}]\n")
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--json")
    assert outcome.code == 1
    assert [(run["variant"], run["ok"]) for run in json.loads(outcome.out)["runs"]] == [("a", False), ("b", True)]


def test_equal_warnings_of_variants_are_printed_once(tiny, asrsim_command):
    tiny.robot.write_text(tiny.robot.read_text().replace("<spring_k>", "<sprang>1</sprang><spring_k>"))
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants: {a: {}, b: {}}\n")
    outcome = asrsim_command("run", tiny.scenario, "--no-plot")
    assert outcome.code == 0
    warnings = [line for line in outcome.err.splitlines() if line.startswith("warning ")]
    assert len(warnings) == 1
    assert "pendulum.urdf:25: " in warnings[0]
    assert "warning " not in outcome.out
    assert "1 warning as above" in outcome.err


@pytest.mark.parametrize(("value", "code"), [(0.45, 0), (0.3, 1)])
def test_expectations_decide_the_exit_code(tiny, asrsim_command, value, code):
    claim = f"{{joint: elbow, quantity: link_position, measure: steady_state, value: {value}, tolerance: 0.05}}"
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--set", f"expect=[{claim}]")
    assert outcome.code == code
    assert ("pass" in outcome.out) == (code == 0)
    assert ("FAIL" in outcome.err) == (code == 1)
    summary = json.loads((log_of(tiny).parent / "summary.json").read_text())
    assert summary["expect"][0]["holds"] is (code == 0)
    assert summary["ok"] is (code == 0)


def test_invalid_claims_are_reported_before_the_run(tiny, asrsim_command):
    claim = "{joint: elbow, quantity: motor_2_position, measure: final, value: 0}"
    outcome = asrsim_command("run", tiny.scenario, "--set", f"expect=[{claim}]", *FOREVER)
    assert outcome.code == 1
    assert "motor_2_position" in outcome.err
    assert not log_of(tiny).exists()


def test_rerun_reports_the_missing_part_of_a_shorter_repetition(tiny, asrsim_command, monkeypatch):
    from asrsim.runs import rerun
    from asrsim.simulation.run import simulate

    asrsim_command("run", tiny.scenario, "-o", "out", "--no-plot", "-q", "--set", "duration=0.1")
    shorter = lambda scenario, *given, **how: simulate(replace(scenario, duration=0.04), *given, **how)  # noqa: E731
    monkeypatch.setattr("asrsim.runs.rerun.simulate", shorter)
    found = rerun.rerun(tiny.folder / "out" / "log.mcap")
    assert (found.samples, found.missing, found.logged_samples, found.identical) == (41, 60, 101, False)
    outcome = asrsim_command("rerun", "out/log.mcap")
    assert outcome.code == 1
    assert "60 samples before the log" in outcome.err


def test_repeated_run_removes_obsolete_files_of_the_earlier_run(tiny, asrsim_command):
    quick = ("run", tiny.scenario, "-o", "out", "--set", "duration=0.1", "--no-plot", "-q")
    outcome = asrsim_command(*quick, "--report")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    assert "elbow" in (tiny.folder / "out" / "report.html").read_text()
    asrsim_command(*quick)
    assert sorted(path.name for path in (tiny.folder / "out").iterdir()) == ["log.mcap", "summary.json"]


def test_a_run_that_cannot_be_built_leaves_the_earlier_results(tiny, asrsim_command):
    asrsim_command("run", tiny.scenario, "--no-plot")
    before = log_of(tiny).read_bytes()
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--set", "initial={elbow: 9}")
    assert outcome.code == 1
    assert "initial" in outcome.err
    assert log_of(tiny).read_bytes() == before


def test_divergence_ends_with_joint_and_time(tiny, asrsim_command):
    tiny.robot.write_text(tiny.robot.read_text().replace('effort="50"', 'effort="1e9"').replace("revolute", "continuous"))
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", "--set", LOAD)
    assert outcome.code == 1
    assert "joint 'elbow' diverged at t = " in outcome.err
    log = read_log(log_of(tiny))
    assert log.status == "diverged"
    assert not log.truncated
    assert len(log.samples.time) > 0
    assert log.metadata["joint"] == "elbow"
    summary = json.loads((log_of(tiny).parent / "summary.json").read_text())
    assert summary["status"] == "diverged"
    assert "elbow" in summary["message"]


def test_ctrl_c_during_compilation_ends_the_command():
    """During compilation nothing polls `stop`, so the signal ends the command. After the first poll, the run handles it."""
    from asrsim.cli.interrupt import Interruption

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), Interruption():
        signal.raise_signal(signal.SIGINT)
    with Interruption() as interruption:
        assert not interruption.stop()
        signal.raise_signal(signal.SIGINT)
        assert interruption.stop()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    with Interruption():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no timers")
def test_ctrl_c_that_a_library_swallows_is_raised_again_but_not_while_files_are_closed():
    """In a process of its own: other tests' threads and timers would take part."""
    code = """
import signal, time
from contextlib import suppress
from asrsim.cli.interrupt import AGAIN, interruptible

def work():
    try:
        with suppress(BaseException):
            signal.raise_signal(signal.SIGINT)
        time.sleep(20 * AGAIN)
    finally:
        time.sleep(2 * AGAIN)
        print("closed")

signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    with interruptible():
        work()
except KeyboardInterrupt:
    print("raised", signal.getitimer(signal.ITIMER_REAL)[0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["closed", "raised", "0.0"], done.stderr


@pytest.mark.parametrize("place", ["asrsim.robot", "at the end"])
def test_interrupts_end_with_a_message_at_any_time(tiny, place):
    """The signal arrives during an import, in the command, or after it (too late), in a separate process."""
    code = (
        "import signal, sys, atexit\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a parent in the background would ignore it
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {place!r}: sys.meta_path.remove(self); signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        f"if {place == 'at the end'}: atexit.register(signal.raise_signal, signal.SIGINT)\n"
        f"sys.argv = ['asrsim', 'check', {str(tiny.scenario)!r}]\n"
        "from asrsim.__main__ import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tiny.folder,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    if place == "at the end":
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert (done.returncode, done.stderr) == (130, "asrsim: aborted\n")


def test_certify_reports_the_numerical_error(tiny, asrsim_command):
    outcome = asrsim_command("run", tiny.scenario, "--certify", "--json", "--set", "duration=0.3", "--no-plot")
    certificate = json.loads(outcome.out)["runs"][0]["certificate"]
    assert 0.0 < certificate["joints"]["elbow"]["position_max"] < 1e-3
    assert json.loads(read_log(log_of(tiny)).metadata["certificate"])["joints"] == certificate["joints"]


def test_engines_agree_by_the_cross_check_if_nothing_touches(tiny, asrsim_command):
    command = "run", tiny.scenario, "--no-plot", "--cross-check", "--certify", "--set", "duration=0.1"
    for ground, agree in (("false", True), ("true", False)):
        outcome = asrsim_command(*command, "--set", f"world.ground={ground}")
        assert (outcome.code, "the engines agree" in outcome.out, "legitimate" in outcome.out) == (0, agree, not agree)
        summary = json.loads((log_of(tiny).parent / "summary.json").read_text())
        for kind in ("cross_check", "certificate"):
            assert f"{summary[kind]['joints']['elbow']['position_max']:.2g}" in outcome.out


def test_rerun_needs_nothing_but_the_log(tiny, asrsim_command):
    """Also the played bag, a folder of several files, is in the log."""
    ramp_bag(tiny.folder / "bag", "sqlite3")
    play = "external_torques.elbow={playback: {file: bag, column: /q}}"
    asrsim_command("run", tiny.scenario, "--no-plot", "--set", "duration=0.4", "--set", "step=5e-4", "--set", play)
    log = tiny.folder / "alone.mcap"
    shutil.move(log_of(tiny), log)
    shutil.rmtree(tiny.folder / "bag")
    tiny.scenario.unlink()
    tiny.robot.unlink()
    outcome = asrsim_command("rerun", log)
    assert outcome.code == 0
    assert "801 samples compared: identical" in outcome.out


def test_rerun_finds_one_changed_bit(tiny, asrsim_command):
    asrsim_command("run", tiny.scenario, "--no-plot", "--set", "duration=0.4")
    log = read_log(log_of(tiny))
    velocity = log.samples.values["link_velocity"].copy()
    velocity[123, 0] = np.nextafter(velocity[123, 0], np.inf)
    tampered = tiny.folder / "tampered.mcap"
    with LogWriter(tampered, log.info) as writer:
        writer.write(replace(log.samples, values={**log.samples.values, "link_velocity": velocity}))
    outcome = asrsim_command("rerun", tampered)
    assert outcome.code == 1
    assert "link_velocity of elbow" in outcome.err
    assert "t = 0.123 s" in outcome.err
    document = json.loads(asrsim_command("rerun", tampered, "--json").out)
    assert [(one["name"], one["joint"], one["sample"], one["count"]) for one in document["differences"]] == [
        ("link_velocity", "elbow", 123, 1)
    ]


def test_rerun_needs_consent_to_run_code_of_a_log(tiny, asrsim_command):
    plugin = tiny.folder / "my_drive.py"
    plugin.write_text(
        "from asrsim.actuators.sea import Sea\n\nclass MyDrive(Sea):\n    name = 'my_drive'\n    title = 'My drive'\n"
    )
    tiny.robot.write_text(tiny.robot.read_text().replace("libsea", "libmy_drive"))
    assert asrsim_command("run", tiny.scenario, "--no-plot", "--plugin", plugin, "--set", "duration=0.1").code == 0
    plugin.unlink()
    ACTUATORS._entries.pop("my_drive")
    refused = asrsim_command("rerun", log_of(tiny))
    assert refused.code == 1
    assert "--trust-plugins" in refused.err
    assert "my_drive" not in ACTUATORS.names()
    trusted = asrsim_command("rerun", log_of(tiny), "--trust-plugins")
    assert "identical" in trusted.out


def test_rerun_of_a_program_s_own_actuator_names_it_and_no_plugin(tiny, asrsim_command):
    """An actuator that a program registers is in no plugin file, so the log cannot carry its code."""
    ACTUATORS.add("own_drive", type("OwnDrive", (Sea,), {"name": "own_drive", "title": "Own drive"}))
    tiny.robot.write_text(tiny.robot.read_text().replace("libsea", "libown_drive"))
    assert asrsim_command("run", tiny.scenario, "--no-plot", "--set", "duration=0.01", "--set", "compiled=false").code == 0
    ACTUATORS._entries.pop("own_drive")
    refused = asrsim_command("rerun", log_of(tiny))
    assert refused.code == 1
    assert "own_drive" in refused.err
    assert "whose Python code is in the log" not in refused.err


def test_version_and_unknown_commands(asrsim_command):
    assert asrsim_command("--version").out.startswith("asrsim ")
    assert asrsim_command("rum").code == 2


def test_plot_without_a_log_is_wrong_usage(asrsim_command):
    outcome = asrsim_command("plot")
    assert outcome.code == 2
    assert "name a log" in outcome.err
    assert asrsim_command("plot", "--experiment", "lab.csv").code == 2


def test_an_unexpected_error_is_one_line_unless_debugging(asrsim_command, monkeypatch):
    def fail(*_arguments, **_options):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("asrsim.simulation.examine.read_scenarios", fail)
    outcome = asrsim_command("run", "any.yaml")
    assert outcome.code == 1
    line = fail.__code__.co_firstlineno + 1
    assert f"unexpected error: ZeroDivisionError: by zero ({__file__}:{line})" in outcome.err.replace("\n", "")
    assert "Traceback" not in outcome.err
