"""Judgement of a fit, its texts, and its files."""

import re
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from asrsim import identification
from asrsim.identification import show
from asrsim.identification.data import Channel
from asrsim.identification.judge import ChannelFit, channel_fits, explains_both, fault_of, fits_noise, foreign, praise, verdict
from asrsim.identification.problem import differences
from asrsim.identification.result import Estimate
from asrsim.identification.write import draw_recordings, write_robot
from asrsim.recordings.data import Column
from support.identify_files import CHIRP, SEA, modelled, record, write

NAN = float("nan")
NUMBERS = {
    "recording": "a", "key": "j.q", "unit": "rad", "noise": 1.0, "before": 9.0, "after": 1.0, "held_before": 9.0,
    "held_after": 1.0, "correlation": 0.0, "explained": 0.9,
}  # fmt: skip
GOOD = ChannelFit(**NUMBERS)


def channel(values, noise=1e-3):
    time = 2e-3 * np.arange(len(values))
    return Channel(joint="j", quantity="link_position", unit="rad", time=time, values=values, noise=noise, quantum=0.0)


def test_residuals_beyond_the_noise_are_faults_by_name():
    generator, time = np.random.default_rng(0), 2e-3 * np.arange(2000)
    white, sine = 1e-3 * generator.normal(size=2000), 0.7e-3 * np.sin(2.0 * np.pi * 60.0 * time)
    one = channel(np.sin(time))
    assert fault_of(one, white) == ""
    for left, words in (
        (white + 1e-3, "residuals are not white"),
        (2.0 * white, "the residuals are 2 times the noise"),
        (white + sine, "an oscillation of 60 Hz remains"),
    ):
        assert words in fault_of(one, left)
    # Correlated residuals are a fault also if they are somewhat smaller than the noise, and none if they are far below it.
    slow = 2.0**0.5 * np.sin(20.0 * time)
    assert "residuals are not white" in fault_of(one, 0.8e-3 * slow)
    assert fault_of(one, 0.3e-3 * slow) == ""
    # Noise of the played commands may cause an oscillation.
    assert fault_of(one, white + sine, 0.3 * (white + sine)) == ""


def test_a_simulation_that_diverges_fits_nothing():
    white = np.random.default_rng(0).normal(size=2000)
    for sane in (True, False):
        assert fits_noise(modelled(lambda _, sane=sane: white if sane else None, 1, 2000), np.zeros(1)) == sane  # type: ignore[misc]


def test_the_held_out_error_may_reach_its_predicted_size():
    large = replace(GOOD, held_after=2.0)
    assert verdict([GOOD], lambda: [0.0]) == []
    (reason,) = verdict([large], lambda: [0.0])
    assert "the held-out error is 2 times" in reason
    assert verdict([large], lambda: [1.0]) == []
    assert verdict([replace(large, shaken=1.0)], lambda: [0.0]) == []
    # Each channel is judged by its own errors and its own uncertainty.
    (reason,) = verdict([GOOD, replace(large, key="j.tau")], lambda: [9.0, 0.0])
    assert reason.startswith("j.tau: the held-out error is 2 times")
    # A recording without a fault does not hide the fault of another recording.
    (reason,) = verdict([GOOD, replace(GOOD, recording="b", fault="a swing")], lambda: [0.0, 0.0])
    assert reason == "j.q: a swing"


@pytest.mark.parametrize(("late", "right"), [(0.0, True), (0.4, True), (2.0, False)])
def test_estimates_that_explain_both_parts_like_noise_show_that_the_model_is_right(late, right):
    """late: size of an error that only the held-out part shows, in units of the noise."""
    noise, after = np.random.default_rng(0).normal(size=(2, 2000))
    after[:1500] = 0.0
    problem = replace(modelled(lambda x: noise + late * x[0] * after, 1, 2000), ends=(0.75,))
    assert explains_both(problem, problem.whole, np.ones(1)) == right
    assert not explains_both(problem, problem, np.ones(1)), "estimates of the training part alone show nothing"
    large = replace(GOOD, held_after=2.0)
    assert bool(verdict([large], lambda: [0.0], lambda: right)) != right
    assert "the training part determines the parameters less accurately (j.q: 2 times the error)" in next(praise([large]))


@pytest.mark.parametrize("still", [False, True])
def test_a_held_out_part_in_which_nothing_moves_proves_nothing(still):
    time, generator = np.arange(0.0, 4.0, 2e-3), np.random.default_rng(0)
    values = 1e3 * np.sin(4.0 * np.minimum(time, 2.0) if still else 4.0 * time) + generator.normal(size=len(time))
    problem = replace(modelled(lambda _: 0.0 * values, 1, len(time), recorded=values), ends=(0.75,))
    (found,) = channel_fits(problem, differences(problem.everything, np.zeros(1)), np.zeros(1))
    assert found.held_moves == (not still)
    (said,) = praise([found])
    assert ("no channel moves" in said) == still


def test_fits_that_prove_little_are_told():
    _, hidden = praise([replace(GOOD, after=4.0)])
    assert "errors of the model may be hidden" in hidden
    values = np.sin(np.arange(12.0))
    problem = replace(modelled(lambda _: 0.0 * values, 1, 12, recorded=values), ends=(0.75,))
    (found,) = channel_fits(problem, differences(problem.everything, np.zeros(1)), np.zeros(1))
    assert found.fault == "its samples are too few to judge the fit"


def test_a_recording_with_the_wrong_sign_or_unit_is_suspected():
    values = np.sin(np.arange(0.0, 9.0, 1e-2))
    source = Column(time=values, values=values, unit="rad", joint="j", quantity="link_position", source="q", conversion="")
    for factor, words in ((-1.0, "--map 'q=-j.link_position'"), (0.001, "close to 1000"), (1.0, "")):
        problem = modelled(lambda _, factor=factor: (factor - 1.0) * values, 1, len(values), recorded=values)  # type: ignore[misc]
        (track,) = problem.tracks
        track.channels = (replace(track.channels[0], column=source),)
        (found,) = channel_fits(problem, differences(problem.everything, np.zeros(1)), np.zeros(1))
        assert words in found.suspicion
        assert bool(words) == bool(found.suspicion)


def test_a_diverging_validation_does_not_fit():
    lost = replace(GOOD, recording="b", after=NAN, held_after=NAN, explained=NAN)
    (reason,) = verdict([GOOD, lost], lambda: [0.0, 0.0])
    assert reason == "the simulation of b diverges with the fitted parameters"
    assert not lost.is_exact
    assert foreign([GOOD, lost]) == []


def test_channels_that_the_fit_does_not_follow_are_named():
    lost = replace(GOOD, key="j.tau", explained=-0.4)
    assert foreign([GOOD]) == []
    assert "its zero offset and the start values" in foreign([lost])[0]
    assert foreign([GOOD, replace(lost, suspicion="is its sign reversed?")]) == ["j.tau: is its sign reversed?"]


# -- what is said ------------------------------------------------------------------------------------------------------------


def estimate(key, verdict="weak", **numbers):
    usual = {"name": key, "unit": "N m", "start": 0.123456, "value": 2.0, "low": 1.0, "high": 3.0}
    return Estimate(**usual | numbers, key=key, verdict=verdict)


def result(**changes):
    usual = {
        "estimates": (), "channels": (), "remarks": (), "status": "complete", "whole": False, "fits": True, "accepted": False,
        "misfit": (), "causes": (), "transfers": (),
    }  # fmt: skip
    return SimpleNamespace(**{**usual, **changes})


def test_the_tables_have_as_many_digits_as_are_known():
    rows = (
        estimate("j.a", "identified", low=1.99999, high=2.00001),
        estimate("j.b", "no effect", low=NAN, high=NAN, value=1234567.8),
        estimate("j.c", low=-1e-3, high=1e-3, start=1.29284e-10, value=2e-4),
        estimate("j.d", low=-1e-3, high=3e-3, value=1e-9, is_place=True),
    )
    table = {name: cells for name, cells, _ in show.estimate_columns(result(estimates=rows))}
    assert table["start"] == ["0.12346", "0.12346", "0", "0.12346"]
    assert table["95 % interval"] == ["2 .. 2", "-", "-0.001 .. 0.001", "-0.001 .. 0.003"]
    assert table["+-"] == ["0.0005 %", "-", "500 %", "0.002 N m"]
    errors = show.errors(result(channels=(GOOD, replace(GOOD, recording="b", held_after=NAN))))
    assert errors[0][1] == ["j.q (a)", "j.q (b)"]
    assert errors[5][1] == ["1", "-"]


def test_a_model_that_does_not_fit_never_explains_100_percent():
    texts = [text for text, _ in show.judgement(result(fits=False, explained=1.0 - 1e-9))]
    assert "  it explains at least 99.99 % of the variance of each channel" in texts


# -- files -------------------------------------------------------------------------------------------------------------------

ENDS = (".urdf", ".yaml")
ENDINGS = {
    "fits": ({}, (), 0, {"fit.json", "curves.json", "robot", "picture"}, ""),
    "does not fit": (
        {"misfit": ("too large",)},
        (),
        1,
        {"fit.json", "curves.json", "picture"},
        "no robot is written, since the model",
    ),
    "all the same": ({"misfit": ("too large",)}, ("--all",), 1, {"fit.json", "curves.json", "robot", "picture"}, ""),
    "accepted": (
        {"misfit": ("too large",), "accepted": True},
        ("--accept",),
        1,
        {"fit.json", "curves.json", "robot", "picture"},
        "",
    ),
    "interrupted": ({"status": "interrupted"}, ("--all",), 130, {"fit.json"}, ""),
    "out of time": ({"status": "unfinished"}, (), 1, {"fit.json"}, ""),
    "without pictures": ({}, ("--no-plot",), 0, {"fit.json", "curves.json", "robot"}, ""),
    "checked": ({"status": "checked"}, ("--check",), 0, set(), ""),
}
"""How a fit ended: changes of the result, options, exit code, files, words."""


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Recording of a joint, scenario with a wrong damping, and the fit of the damping."""
    folder = tmp_path_factory.mktemp("fit")
    recording = record(write(folder, "true", SEA, f"{{equilibrium_position: {CHIRP}}}"), folder / "a.csv")
    guess = write(folder, "guess", {**SEA, "damping": 0.03})
    return recording, guess, identification.identify(identification.task_of(guess, [recording], free=["joint_1.damping"]))


def test_a_finished_fit_is_accepted_without_a_new_one(fitted, tmp_path, monkeypatch, asrsim_command):
    """`--resume` writes the files that the same fit with `--accept` writes; it refuses fits of other tasks."""
    recording, guess, found = fitted
    found = replace(found, misfit=("too large",), channels=tuple(replace(one, explained=0.92) for one in found.channels))

    def command(name, *options, accepted=None, free="joint_1.damping"):
        fit = Mock(return_value=replace(found, accepted=accepted), side_effect=None if accepted is not None else AssertionError)
        monkeypatch.setattr(identification, "identify", fit)
        about = ("-e", recording, "--free", free, "-o", tmp_path / name, "--no-plot")
        outcome = asrsim_command("identify", guess, *about, *options)
        return outcome, {path.name: path.read_bytes() for path in (tmp_path / name).glob("*") if path.suffix in ENDS}

    _, accepted = command("one", "--accept", accepted=True)
    outcome, none = command("two", accepted=False)
    assert not none
    assert "--resume and --accept or --all" in outcome.out
    assert command("two", "--resume")[1] == {}
    outcome, resumed = command("two", "--resume", "--accept")
    assert outcome.code == 1
    # The folders differ in nothing but their names.
    assert resumed == accepted
    assert set(resumed) == {"guess.urdf", "scenario.yaml"}
    assert identification.read_fit(tmp_path / "two").accepted
    for options, words, free in (
        (("--set", "duration=1"), "overrides", "joint_1.damping"),
        ((), "not a parameter of this fit", "joint_1.friction"),
        (("--check",), "leave out --check", "joint_1.damping"),
    ):
        outcome, _ = command("two", "--resume", *options, free=free)
        assert outcome.code != 0
        assert words in outcome.err


def test_which_files_an_end_leaves(fitted, tmp_path, monkeypatch, asrsim_command):
    recording, guess, found = fitted
    for name, (changes, options, code, files, words) in ENDINGS.items():
        ended = partial(lambda made, *_, **__: made, replace(found, **changes))
        monkeypatch.setattr(identification, "identify", ended)
        about = ("-e", recording, "--free", "joint_1.damping", "-o", tmp_path / name)
        outcome = asrsim_command("identify", guess, *about, *options)
        kinds = {".urdf": "robot", ".yaml": "robot", ".png": "picture"}
        written = {kinds.get(path.suffix, path.name) for path in (tmp_path / name).rglob("*") if path.is_file()}
        assert (name, outcome.code, written - {".lock"}) == (name, code, files)
        assert words in outcome.out + outcome.err
    channels = (*found.channels, replace(found.channels[0], track=1))
    paths = draw_recordings(replace(found, ends=found.ends * 2, channels=channels), tmp_path)
    assert [path.name for path in paths] == ["overlay_1_a.png", "overlay_2_a.png"]
    # Only together do the parameters explain the recording; a parameter without effect keeps its start.
    (one,) = found.estimates
    for word, left in (("weak", []), ("only as ratio", []), ("no effect", ["joint_1.friction"])):
        both = one, replace(one, key="joint_1.friction", verdict=word)
        _, said = write_robot(replace(found, estimates=both), tmp_path / "fits")
        assert re.findall("not written, since without effect: (.*) \\(", "".join(said)) == left
