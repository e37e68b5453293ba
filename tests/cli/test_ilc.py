"""`asrsim ilc` from end to end: its output folder, exit codes and interruption."""

import json

import numpy as np
import pytest

from support.paths import EXAMPLES

CUBE = EXAMPLES / "urdf" / "dof1_qbmove_cube.urdf"
LIFT = """\
robot: cube.urdf
duration: 1.0
step: 0.002
references: {joint_1: {stiffness_preset: 0.2}}
ilc:
  trajectory: {joint_1: {minimum_jerk: {duration: 0.8, to: 0.3}}}
  tolerance: 0.05
  law: paper
  gain: 0.8
"""


@pytest.fixture
def lift(tmp_path):
    path = tmp_path / "lift.yaml"
    path.write_text(LIFT)
    (tmp_path / "cube.urdf").write_text(CUBE.read_text())
    return path


def test_new_ilc_session_reports_what_it_replaces(asrsim_command, lift, tmp_path):
    asrsim_command("ilc", lift, "--out", "here")
    again = asrsim_command("ilc", lift, "--out", "here", "--no-plot")
    assert again.code == 0
    assert "replaced 6 files of an earlier learning run of this scenario" in again.out
    # The new run draws no picture, and has removed the earlier one.
    assert not (tmp_path / "here" / "ilc.png").exists()


def test_keys_of_fixed_gains_are_told_to_have_no_effect_with_the_automatic_law(asrsim_command, lift):
    lift.write_text(lift.read_text().replace("law: paper", "law: auto\n  gain_decay: 0.9"))
    told = asrsim_command("ilc", lift, "--out", "here", "--no-plot", "--set", "ilc.max_iterations=1").out
    assert "gain, gain_decay: these keys have no effect with law auto" in told
    assert "filter" not in told


@pytest.mark.parametrize(
    ("shares", "code", "words"),
    [
        ((1.0,), 0, "the best input"),
        ((0.5,), 0, "give the new recording to --experiment"),
        ((0.5, 0.51), 1, "the best input"),
    ],
)
def test_the_exit_code_of_a_recorded_trial_tells_failed_learning(asrsim_command, lift, tmp_path, shares, code, words):
    """In each trial, the robot moves by a share of the desired motion. There is one update."""
    time = np.arange(0.0, 1.001, 0.002)
    s = np.minimum(time / 0.8, 1.0)
    motion = 0.3 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    for share in shares:
        header = "time [s],joint_1.link_position [rad]"
        np.savetxt(tmp_path / "a.csv", np.column_stack([time, share * motion]), delimiter=",", header=header, comments="")
        done = asrsim_command("ilc", lift, "-e", "a.csv", "--out", "robot", "--set", "ilc.max_iterations=1", "--no-plot")
    assert done.code == code, done.err
    assert words in done.out + done.err


def test_interrupted_ilc_keeps_the_best_trial_and_can_be_resumed(asrsim_command, lift, tmp_path, monkeypatch):
    words = "--no-plot", "--set", "ilc.tolerance=1e-9", "--set", "ilc.max_iterations=2"
    with monkeypatch.context() as patched:
        patched.setattr("asrsim.cli.interrupt.Interruption.stop", lambda self: True)
        assert asrsim_command("ilc", lift, "--out", "here", *words).code == 130
    first = json.loads((tmp_path / "here/ilc.json").read_text())
    assert (first["outcome"], first["iterations"]) == ("interrupted", 0)
    assert (tmp_path / "here/learned.yaml").exists()
    for more in (("here", "--resume"), ("whole",)):
        assert asrsim_command("ilc", lift.name, "--out", *more, *words).code == 1
    assert (tmp_path / "here/learned.csv").read_bytes() == (tmp_path / "whole/learned.csv").read_bytes()
