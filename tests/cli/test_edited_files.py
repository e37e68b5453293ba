"""Edited output files with valid checksums are read or refused with a message; they never cause an internal error."""

import json
from contextlib import suppress

import numpy as np
import pytest

import asrsim
from asrsim.errors import AsrsimError, InputError
from asrsim.learning import LearningProblem
from asrsim.learning.state import LearningState, load_state, save_state
from asrsim.log import LogWriter, read_log
from asrsim.log import writer as writing
from asrsim.plots import draw_run
from asrsim.plots.claims import judge
from asrsim.recordings import read_recording
from asrsim.report import write_report
from asrsim.runs.rerun import rerun
from support.edits import edits


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Short run with claims, an object and a recording."""
    from support.tiny import PENDULUM

    folder = tmp_path_factory.mktemp("edited")
    (folder / "pendulum.urdf").write_text(PENDULUM)
    (folder / "play.csv").write_text("time,value\n0,0\n0.01,0.1\n0.05,0.2\n")
    (folder / "step.yaml").write_text(
        "robot: pendulum.urdf\nduration: 0.05\nlink_damping: {'*': {constant: 0.1}}\n"
        "references: {elbow: {equilibrium_position: {playback: {file: play.csv, column: value}}}}\n"
        "world: {ground: true, objects: {ball: {shape: sphere, size: 0.05, mass: 0.1, position: [1, 1, 1]}}}\n"
        "expect:\n  - {joint: elbow, quantity: link_position, measure: maximum, comparison: '<', value: 9}\n"
        "  - {body: ball, quantity: z, measure: final, value: 1, tolerance: 1}\n"
    )
    return asrsim.run(folder / "step.yaml", out=folder / "out", certify=True)


def use(log):
    """Call every reader of a log."""
    for reader in (
        lambda: read_log(log),
        lambda: read_recording(log),
        lambda: judge(asrsim.log.open_log(log)),
        lambda: rerun(log),
        lambda: draw_run(log, log.parent),
        lambda: write_report(log, log.parent / "page.html", film=False),
    ):
        with suppress(AsrsimError):
            reader()


def write_edited(path, log, name, data, monkeypatch):
    """Write the log with other data under a name, and with valid checksums."""
    plain = writing.info_attachments(log.info)
    with monkeypatch.context() as patch:
        if name == "columns":
            dumps = json.dumps
            patch.setattr("asrsim.log.container.json.dumps", lambda value, **_: dumps(data))
        else:
            text = json.dumps(data).encode()
            patch.setattr(writing, "info_attachments", lambda _: {**plain, name: ("application/json", text)})
        with LogWriter(path, log.info) as writer:
            writer.write(log.samples)


@pytest.mark.parametrize("name", ["run.json", "resolved.json", "columns"])
@pytest.mark.parametrize(("seed", "most"), [(0, 1), pytest.param(1, 200, marks=pytest.mark.slow)])
def test_edited_logs(tmp_path, monkeypatch, run, name, seed, most):
    log = read_log(run.log)
    columns = [[20, "value", "link_position", "elbow"]]
    data = columns if name == "columns" else json.loads(writing.info_attachments(log.info)[name][1])
    for number, other in enumerate(edits(data, seed=seed, most=most)):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_edited(folder / "log.mcap", log, name, other, monkeypatch)
        use(folder / "log.mcap")


@pytest.mark.parametrize(("seed", "most"), [(0, 25), pytest.param(1, 3000, marks=pytest.mark.slow)])
def test_edited_summaries(tmp_path, run, seed, most):
    log = tmp_path / "log.mcap"
    log.write_bytes(run.log.read_bytes())
    for other in edits(run.summary.as_dict(), seed=seed, most=most):
        (tmp_path / "summary.json").write_text(json.dumps(other))
        assert "elbow" in write_report(tmp_path, film=False).read_text(encoding="utf-8")


def _learned():
    numbers = np.linspace(0.0, 1.0, 20).reshape(10, 2)
    problem = LearningProblem(joints=("a", "b"), time=np.arange(10.0), reference=numbers, first_guess=numbers)
    return problem, problem.trial(0, numbers, 0.5 * numbers, 1.0)


@pytest.mark.parametrize("flips", [60, pytest.param(3000, marks=pytest.mark.slow)])
def test_flipped_bits_of_a_learning_state(tmp_path, flips):
    problem, trial = _learned()
    path = tmp_path / "state.npz"
    save_state(path, {}, LearningState(trials=(trial,), recordings=("a",)))
    whole = path.read_bytes()
    generator = np.random.default_rng(0)
    for _ in range(flips):
        data = bytearray(whole)
        data[generator.integers(len(data))] ^= 1 << int(generator.integers(8))
        path.write_bytes(data)
        try:
            again = load_state(path, {}, problem)
        except InputError:
            continue
        assert np.array_equal(again.trials[0].inputs, trial.inputs)
