"""`asrsim ilc` from end to end: its output folder, exit codes and interruption."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from support.paths import EXAMPLES

CUBE = EXAMPLES / "urdf" / "dof1_qbmove_cube.urdf"
LIFT = f"""\
robot: {CUBE}
duration: 1.0
step: 0.002
references: {{joint_1: {{stiffness_preset: 0.2}}}}
ilc:
  trajectory: {{joint_1: {{minimum_jerk: {{duration: 0.8, to: 0.3}}}}}}
  tolerance: 0.05
  law: paper
  gain: 0.8
"""


@pytest.fixture
def lift(tmp_path):
    path = tmp_path / "lift.yaml"
    path.write_text(LIFT)
    return path


def test_new_ilc_session_reports_what_it_replaces(asrsim_command, lift, tmp_path):
    asrsim_command("ilc", lift, "--out", "here")
    again = asrsim_command("ilc", lift, "--out", "here", "--no-plot")
    assert again.code == 0
    assert "replaced 6 files of an earlier learning run of this scenario" in again.out
    # The new run has removed all files of the earlier run.
    assert not (tmp_path / "here" / "ilc.png").exists()


@pytest.mark.parametrize(
    ("shares", "code", "words"),
    [((1.0,), 0, "the best input"), ((0.5,), 0, "give the recording to --next again"), ((0.5, 0.51), 1, "the best input")],
)
def test_the_exit_code_of_a_recorded_trial_tells_failed_learning(asrsim_command, lift, tmp_path, shares, code, words):
    """In each trial, the robot moves by a share of the desired motion. There is one update."""
    time = np.arange(0.0, 1.001, 0.002)
    s = np.minimum(time / 0.8, 1.0)
    motion = 0.3 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    for share in shares:
        header = "time [s],joint_1.link_position [rad]"
        np.savetxt(tmp_path / "a.csv", np.column_stack([time, share * motion]), delimiter=",", header=header, comments="")
        done = asrsim_command("ilc", lift, "--next", "a.csv", "--out", "robot", "--set", "ilc.max_iterations=1")
    assert done.code == code, done.err
    assert words in done.out + done.err


def test_ilc_fails_if_learning_does_not_converge(asrsim_command, lift):
    result = asrsim_command("ilc", lift, "--out", "o", "--set", "ilc.max_iterations=1", "--json", "--no-plot")
    assert result.code == 1
    assert json.loads(result.out)["outcome"] == "exhausted"


@pytest.mark.parametrize("kept", [True, False])
def test_interrupted_ilc_says_whether_trials_are_kept(asrsim_command, lift, tmp_path, monkeypatch, kept):
    def interrupted(*given, **options):
        if kept:
            (tmp_path / "here" / "state.npz").write_bytes(b"state")
        raise KeyboardInterrupt

    (tmp_path / "here").mkdir()
    monkeypatch.setattr("asrsim.learning.session.run_session", interrupted)
    outcome = asrsim_command("ilc", lift, "--out", "here")
    assert outcome.code == 130
    assert ("--resume" in outcome.err) == kept


def trials_in(state):
    with np.load(state) as stored:
        return len(stored["inputs"])


@pytest.mark.slow
def test_interrupted_and_resumed_ilc_gives_equal_bits(asrsim_command, tmp_path):
    """SIGINT interrupts the paper's learning. The final input is the same as without an interruption."""
    scenario = EXAMPLES / "scenarios" / "ilc_2dof.yaml"
    arguments = ["--set", "ilc.max_iterations=4", "--no-plot"]
    asrsim_command("ilc", scenario, "--out", "whole", *arguments)
    command = [sys.executable, "-m", "asrsim.cli.app", "ilc", str(scenario), "--out", "cut", *arguments]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=dict(os.environ))
    state, deadline = tmp_path / "cut" / "state.npz", time.monotonic() + 120.0
    while not (state.exists() and trials_in(state) >= 2):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"--resume" in said
    assert 2 <= trials_in(state) < 5
    asrsim_command("ilc", scenario, "--out", "cut", "--resume", *arguments)
    assert (tmp_path / "cut" / "learned.csv").read_bytes() == (tmp_path / "whole" / "learned.csv").read_bytes()
