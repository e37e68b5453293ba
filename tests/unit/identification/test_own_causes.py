"""A cause of a user's own: the recipe of the documentation, and a cause whose parameter does not exist."""

import re
from contextlib import ExitStack
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from asrsim.errors import InputError
from asrsim.identification import Cause, Extension, identify
from asrsim.identification.causes import missing_causes
from asrsim.identification.parameters import FitParameter
from asrsim.identification.problem import set_up
from asrsim.identification.task import Tie, task_of
from asrsim.plugins import load_plugin_files
from asrsim.registry import Registry
from support.identify_files import SEA, save, write
from support.paths import ROOT

TIME = np.arange(0.0, 0.8, 0.005)
SPRING, INERTIA, DAMPING, DAMPER = 4.0, 0.009, 0.02, 0.03


def goal(time):
    return 0.4 * np.sin(9.0 * time) ** 3


@cache
def damped():
    """Positions of a link on a spring and a damper, solved without asrsim. Tests share them."""

    def rate(time, state):
        slip = 10.8 * np.sin(9.0 * time) ** 2 * np.cos(9.0 * time) - state[1]
        torque = SPRING * (goal(time) - state[0]) + DAMPER * slip - DAMPING * state[1]
        return state[1], torque / INERTIA

    link = solve_ivp(rate, (0.0, TIME[-1]), (0.0, 0.0), t_eval=TIME, rtol=1e-9, atol=1e-11, max_step=1e-3).y[0]
    return link + 2e-4 * np.random.default_rng(3).normal(size=len(link))


def recorded(folder):
    """Recording of a link on a spring and a damper, and the scenario without the damper."""
    link = damped()
    heading = "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad]"
    return write(folder, "lab", SEA, duration=float(TIME[-1])), save(folder / "a.csv", heading, TIME, goal(TIME), link)


def integrating(folder, integral=12.0, *, proportional=8.0, derivative=0.3, inertia=0.02, damping=0.1):
    """A motor with a PID controller that drives a link by a spring, solved without asrsim: its recording, and the scenario with
    a PD controller.
    """

    def rate(time, state):
        link, speed, motor, motor_speed, sum_ = state
        pull, error = SPRING * (motor - link), goal(time) - motor
        drive = proportional * error - derivative * motor_speed + integral * sum_
        return speed, (pull - DAMPING * speed) / INERTIA, motor_speed, (drive - damping * motor_speed - pull) / inertia, error

    time = np.arange(0.0, 1.2, 0.005)
    found = solve_ivp(rate, (0.0, time[-1]), np.zeros(5), t_eval=time, rtol=1e-9, atol=1e-11, max_step=1e-3).y
    noisy = found[[0, 2]] + 2e-4 * np.random.default_rng(3).normal(size=(2, len(time)))
    heading = "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad],joint_1.motor_1_position [rad]"
    scenario = write(folder, "lab", {**SEA, "mode": 6}, duration=float(time[-1]))
    numbers = f"motor_1_inertia: {inertia}, motor_1_damping: {damping}, motor_1_friction_torque: 0"
    gains = f"controller_1_proportional: {proportional}, controller_1_integral: 0, controller_1_derivative: {derivative}"
    limits = "motor_1_max_torque: 100, motor_1_max_velocity: 100, max_deflection: 10"
    scenario.write_text(f"{scenario.read_text()}parameters: {{joint_1: {{{numbers}, {gains}, {limits}}}}}\n")
    return scenario, save(folder / "a.csv", heading, time, goal(time), *noisy)


def test_the_cause_of_the_page_is_named_with_its_size(tmp_path):
    page = (ROOT / "docs" / "identify.md").read_text(encoding="utf-8")
    code = page.partition("## A cause of your own")[2].partition("```python\n")[2].partition("```")[0]
    (tmp_path / "my_cause.py").write_text(code)
    load_plugin_files(tmp_path / "my_cause.py")
    scenario, recording = integrating(tmp_path)
    found = identify(scenario, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert not found.fits
    assert found.causes[0].startswith("integral action in joint_1 (1"), found.causes
    size = re.search(r"--free joint_1\.controller_1_integral=([\d.]+)", found.causes[0])
    assert float(size[1]) == pytest.approx(12.0, rel=0.05)


def cogging(folder, sine=0.25, cosine=0.15, *, periods=75.0, inertia=0.02, damping=0.3):
    """A motor with cogging that drives a link by a spring, solved without asrsim: its recording, and the scenario without."""

    def rate(time, state):
        link, speed, motor, motor_speed = state
        pull, angle = SPRING * (motor - link), periods / (2.0 * np.pi) * motor
        resisted = damping * motor_speed + sine * np.sin(angle) + cosine * np.cos(angle)
        return speed, (pull - DAMPING * speed) / INERTIA, motor_speed, (drive(time) - resisted - pull) / inertia

    def drive(time):
        return 1.5 * np.sin(5.0 * time) + 0.8 * np.sin(13.0 * time)

    time = np.arange(0.0, 1.2, 0.005)
    found = solve_ivp(rate, (0.0, time[-1]), np.zeros(4), t_eval=time, rtol=1e-9, atol=1e-11, max_step=1e-3).y
    noisy = found[[0, 2]] + 1e-3 * np.random.default_rng(3).normal(size=(2, len(time)))
    heading = "time [s],joint_1.reference_1 [N m],joint_1.link_position [rad],joint_1.motor_1_position [rad]"
    scenario = write(folder, "lab", {**SEA, "mode": 4}, duration=float(time[-1]))
    numbers = f"motor_1_inertia: {inertia}, motor_1_damping: {damping}, motor_1_friction_torque: 0"
    limits = "motor_1_max_torque: 100, motor_1_max_velocity: 100, max_deflection: 10"
    scenario.write_text(f"{scenario.read_text()}parameters: {{joint_1: {{{numbers}, {limits}}}}}\n")
    return scenario, save(folder / "a.csv", heading, time, drive(time), *noisy)


def test_the_stage_and_its_cause_on_the_page_are_tried_and_named_with_their_size(tmp_path, asrsim_command):
    page = (ROOT / "docs" / "identify.md").read_text(encoding="utf-8")
    code = page.partition("### An effect that asrsim lacks")[2].partition("```python\n")[2].partition("```")[0]
    (tmp_path / "my_cogging.py").write_text(code)
    checked = asrsim_command("check", "--stage", "cogging", "--plugin", "my_cogging.py")
    assert checked.code == 0, checked.err
    load_plugin_files(tmp_path / "my_cogging.py")
    scenario, recording = cogging(tmp_path)
    found = identify(scenario, [recording], free=["joint_1.spring_stiffness", "joint_1.motor_1_damping"])
    assert not found.fits
    assert found.causes[0].startswith("cogging of the motors of joint_1 (0.29"), found.causes
    (sine, cosine) = re.search(r"cogging_sine=(\S+) --free joint_1.cogging_cosine=([\d.]+)", found.causes[0]).groups()
    assert (float(sine), float(cosine)) == pytest.approx((0.25, 0.15), rel=0.05)


def reported(folder, cause, monkeypatch):
    """Result of a fit that tries only this cause."""
    only = Registry("cause", instance=Cause)
    only.add("own", Cause(title="own", extensions=cause))
    monkeypatch.setattr("asrsim.identification.causes.CAUSES", only)
    scenario, recording = recorded(folder)
    return identify(scenario, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])


def loose(**fields):
    """A cause whose extension has these fields."""

    def cause(problem, x):
        own = {"text": "a loose belt", "parameters": (problem.fixed["joint_1.spring_damping"],), "begins": (1.0,)}
        yield Extension(**own | fields)

    return cause


def raising(problem, x):
    raise KeyError("belt")


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        (raising, "raised KeyError: 'belt'"),
        (lambda problem, x: None, "must return or yield extensions; it returns None"),
        (loose(begins=((0.5, 2.0),)), r"a number for each of its 1 parameters.*it gives \(0\.5, 2\.0\)"),
        (
            loose(parameters=(FitParameter(key="joint_1.belt", unit="N m", start=0.1),)),
            r"joint_1\.belt: the cause 'own' frees a parameter",
        ),
        (loose(parameters="joint_1.friction"), "a tuple of parameters of `problem.fixed`"),
        (loose(text=""), "must give each extension a `text`"),
        (loose(text=3), "must give `text` as a text; it gives 3"),
        (loose(size="1 N m"), "must give `size` as a function"),
        (loose(begins=1.0), "must give `begins` as a tuple"),
        (loose(ties=("joint_1.friction",)), "must give `ties` as a tuple"),
        (loose(ties=(Tie(key="joint_1.friction", to="joint_1.armature"),)), "must give `ties` as a tuple"),
        (loose(elastic="joint_1"), "must give `elastic` as a joint and a frequency"),
        (loose(share=None), "must give `share` as a number"),
    ],
)
def test_a_cause_that_fails_is_a_remark_with_its_line_and_the_fit_is_complete(cause, said, tmp_path, monkeypatch):
    found = reported(tmp_path, cause, monkeypatch)
    assert found.status == "complete"
    assert found.find("joint_1.spring_stiffness").value == pytest.approx(SPRING, rel=0.5)
    (remark,) = [one for one in found.remarks if "'own'" in one]
    assert remark.startswith("the cause 'own' was not tried: ")
    assert re.search(said, remark)
    assert re.search(r"test_own_causes.py:\d+\)", remark) or "joint_1.belt" in remark


@pytest.mark.parametrize(
    ("size", "said"),
    [
        (lambda level: level, "it must return a text; it returns 0.0"),
        (lambda level, other: "", "TypeError"),
        (lambda level: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_a_size_that_is_no_text_is_a_remark_and_the_value_is_shown_in_its_place(size, said, tmp_path, monkeypatch):
    found = reported(tmp_path, loose(size=size), monkeypatch)
    assert any("`size` of the cause 'a loose belt' was not used" in one and said in one for one in found.remarks)
    assert any("a loose belt (0.0" in one for one in found.causes), found.causes


def test_a_broken_cause_of_a_package_is_named_where_no_effect_was_found(tmp_path, monkeypatch):
    """Otherwise `no missing effect was found` would be wrong: the cause was not tried."""
    fresh = Registry("cause", "asrsim.causes", instance=Cause)
    monkeypatch.setattr("asrsim.identification.causes.CAUSES", fresh)
    points = [EntryPoint("oil", "json:decoder", "asrsim.causes")]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points)
    scenario, recording = recorded(tmp_path)
    found = identify(scenario, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert not found.fits
    assert "the cause 'oil' of an installed package cannot be used: json:decoder is not an instance of" in found.remarks[0]


@pytest.mark.parametrize(("key", "said"), [("joint_1.rest_shift", True), ("joint_1.link_position.ofset", False)])
def test_an_unknown_parameter_of_a_joint_may_belong_to_a_stage_of_a_plugin(key, said, tmp_path):
    scenario, recording = recorded(tmp_path)
    with pytest.raises(InputError, match="no parameter has this key") as caught:
        identify(scenario, [recording], free=[key])
    assert ("Your own stages and actuators need --plugin FILE" in str(caught.value)) is said


def test_with_the_suspected_effect_a_smooth_command_is_no_longer_played_as_a_staircase(tmp_path, monkeypatch):
    """A staircase may imitate an effect that the model lacks: this does not show that the command was held."""
    only = Registry("cause", instance=Cause)
    only.add("own", Cause(title="own", extensions=loose()))
    monkeypatch.setattr("asrsim.identification.causes.CAUSES", only)
    scenario, recording = recorded(tmp_path)
    with ExitStack() as stack:
        task = task_of(scenario, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"])
        problem = set_up(task, stack).problem.played(frozenset({"joint_1.reference_1"}))
        noise = tuple(tuple(channel.noise for channel in track.channels) for track in problem.tracks)
        suspected = next(missing_causes(replace(problem, weights=noise), np.zeros(len(problem.layout))))
        assert suspected.text.startswith("a loose belt (0.0")
        assert suspected.model[0].playing.staircases == frozenset()
