"""Stages of actuators compared with independent solutions: damper, backlash, heating; stages that come later."""

import json
from dataclasses import dataclass
from itertools import pairwise
from math import sin, tau

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import asrsim
from asrsim.actuators import MODES
from asrsim.actuators.stage_checker import check_stage
from asrsim.actuators.stages import STAGES
from asrsim.errors import UnresolvedSpringError
from asrsim.plugins import load_plugin_file
from asrsim.signals import Sinusoid
from asrsim.simulation.prepare import prepare
from asrsim.simulation.worlds import Start, Worlds
from support.paths import ROOT
from validation.models import Body, chain, column, run

MASS, REACH, INERTIA = 0.5, 0.1, 1e-3
INERTIA_AT_AXIS = INERTIA + MASS * REACH**2
STIFFNESS, MOTOR_INERTIA, MOTOR_DAMPING, PROPORTIONAL, DERIVATIVE = 30.0, 0.0233, 0.2698, 125.0, 4.5
FREE = {"spring_stiffness": STIFFNESS, "max_deflection": 3.0, "motor_1_friction_torque": 0.0, "motor_1_max_velocity": 100.0}


R, C = 2.0, 0.5
"""Thermal resistance, K/W, and capacity, J/K, of a very small motor: time constant 1 s."""
WARM = {"thermal_resistance": R, "thermal_capacity": C, "winding_heat": 120.0}


@dataclass
class Pendulum:
    """A pendulum behind an SEA with a sinusoidal reference of its motor, and its stages as plain numbers."""

    damping: float = 0.0
    play: float = 0.0
    heat: float = 0.0
    ripple: float = 0.0
    ripples: float = 0.0
    amplitude: float = 0.3
    frequency: float = 2.0
    largest: float = 6.0

    def rate(self, t, y):
        """Derivative of the state: link position and velocity, motor position and velocity, temperature of the motor in K above
        the surroundings, which have 25 °C."""
        q, v, theta, omega, warm = y
        inside = min(max(theta - q, -0.5 * self.play), 0.5 * self.play)
        torque = STIFFNESS * (theta - q - inside) + self.damping * (omega - v)
        push = PROPORTIONAL * (self.amplitude * sin(tau * self.frequency * t) - theta) - DERIVATIVE * omega
        hold = self.ripple * sin(self.ripples * theta / tau)
        largest = self.largest * min(max((120.0 - 25.0 - warm) / (120.0 - 80.0), 0.0), 1.0)
        push = min(max(push, -largest), largest)
        return [
            v,
            (torque - MASS * 9.81 * REACH * sin(q)) / INERTIA_AT_AXIS,
            omega,
            (push - torque - hold - MOTOR_DAMPING * omega) / MOTOR_INERTIA,
            (self.heat * push**2 - warm / R) / C,
        ]

    def solution(self, times):
        """States (5, n) at `times`, by a Runge-Kutta method of order 8."""
        found = solve_ivp(
            self.rate,
            (0.0, times[-1]),
            [0.1, 0.0, 0.1, 0.0, 0.0],
            method="DOP853",
            t_eval=times,
            rtol=1e-10,
            atol=1e-11,
            max_step=2e-3 if self.play else np.inf,
        )
        return found.y

    def simulated(self, parameters, **how):
        """The same run, simulated."""
        reference = Sinusoid(amplitude=self.amplitude, frequency=self.frequency)
        return run(
            chain(Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)),
            mode=5,
            references={"reference_1": reference},
            parameters=FREE | parameters,
            initial=[0.1],
            **{"duration": 0.5, "compiled": False, "motor_substeps": 1, **how},
        )


@pytest.mark.parametrize("motor_substeps", [1, 3])
def test_damper_is_of_second_order(motor_substeps):
    model = Pendulum(damping=0.4)
    errors, residuals = [], []
    for substeps in (1, 2, 4):
        result = model.simulated({"spring_damping": 0.4}, substeps=substeps, motor_substeps=motor_substeps)
        q = column(result, "link_position")
        errors.append(np.abs(q - model.solution(np.asarray(result.samples.time))[0]).max())
        residuals.append(np.abs(column(result, "energy_residual")).max())
    assert errors[0] < 2e-4
    for values in (errors, residuals):
        for coarse, fine in pairwise(values):
            assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.15)
    lost = column(result, "damper_loss")
    assert np.diff(lost).min() >= 0.0
    # The integral of c times the squared rate of the deflection.
    y = model.solution(np.linspace(0.0, 0.5, 5001))
    power = 0.4 * (y[3] - y[1]) ** 2
    assert lost[-1] == pytest.approx(np.trapezoid(power, dx=1e-4), rel=1e-3)


def test_damper_of_motors_without_dynamics_follows_their_references():
    """In mode 2 the motor has the speed of its reference: the link is driven through the damper too."""
    amplitude, frequency, damping = 0.3, 2.0, 0.4
    errors = []

    def rate(t, y):
        drive = amplitude * (1.0 - np.cos(tau * frequency * t)), amplitude * tau * frequency * np.sin(tau * frequency * t)
        torque = STIFFNESS * (drive[0] - y[0]) + damping * (drive[1] - y[1])
        return [y[1], (torque - MASS * 9.81 * REACH * sin(y[0])) / INERTIA_AT_AXIS]

    for substeps in (1, 2, 4):
        result = run(
            chain(Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)),
            mode=2,
            initial=[0.1],
            duration=0.5,
            references={"reference_1": Sinusoid(amplitude=-amplitude, frequency=frequency, phase=tau / 4, offset=amplitude)},
            parameters=FREE | {"spring_damping": damping},
            compiled=False,
            substeps=substeps,
        )
        times = np.asarray(result.samples.time)
        truth = solve_ivp(rate, (0.0, 0.5), [0.1, 0.0], method="DOP853", t_eval=times, rtol=1e-11, atol=1e-12).y[0]
        errors.append(np.abs(column(result, "link_position") - truth).max())
    assert errors[0] < 3e-4
    for coarse, fine in pairwise(errors):
        assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.2)


def test_a_strong_damper_takes_more_substeps_or_is_refused():
    weak, strong = ({"spring_damping": value} for value in (0.01, 3.0))
    few, many = (Pendulum().simulated(one, duration=0.01).resolution.substeps for one in (weak, strong))
    # Damping by inertia times substep is at most 0.1.
    assert (few, many) == (1, 5)
    with pytest.raises(UnresolvedSpringError, match="dampers"):
        Pendulum().simulated({"spring_damping": 10.0}, duration=0.01, substeps=1)


@pytest.mark.parametrize("motor_substeps", [1, 3])
def test_backlash_is_of_second_order_and_loses_nothing(motor_substeps):
    model = Pendulum(play=0.04)
    errors, residuals = [], []
    for substeps in (1, 4):
        result = model.simulated({"backlash": 0.04}, substeps=substeps, motor_substeps=motor_substeps)
        states = model.solution(np.asarray(result.samples.time))
        errors.append(np.abs(column(result, "link_position") - states[0]).max())
        residuals.append(np.abs(column(result, "energy_residual")).max())
    # The corner of the torque falls anywhere in a step, so that the error is not a smooth function of the step.
    assert errors[0] < 5e-4
    assert np.log2(errors[0] / errors[1]) / 2 == pytest.approx(2.0, abs=0.25)
    assert residuals[1] < residuals[0] / 10.0
    # In the play nothing couples motor and link; outside of it, the spring has its stiffness.
    deflection = column(result, "motor_1_position") - column(result, "link_position")
    torque, stiffness = column(result, "elastic_torque_1"), column(result, "stiffness")
    inside = np.abs(deflection) < 0.02 - 1e-5
    assert inside.sum() > 10
    assert not torque[inside].any()
    assert not stiffness[inside].any()
    beyond = np.abs(deflection) > 0.02 + 1e-5
    np.testing.assert_allclose(torque[beyond], STIFFNESS * (np.abs(deflection) - 0.02)[beyond] * np.sign(deflection[beyond]))
    np.testing.assert_allclose(stiffness[beyond], STIFFNESS, rtol=1e-7)


def test_a_link_with_backlash_rests_on_the_flank_of_its_spring():
    result = run(
        chain(Body(actuator="qbmove", mass=MASS, reach=REACH, inertia=INERTIA)),
        mode=6,
        initial_equilibrium=True,
        references={"equilibrium_position": 0.8, "stiffness_preset": 0.1},
        parameters={"backlash": 0.05},
        duration=0.1,
        compiled=False,
    )
    assert np.ptp(column(result, "link_position")) < 1e-9
    assert np.abs(column(result, "link_torque")).min() > 0.1


def test_heating_is_of_second_order_and_lowers_the_torque():
    model = Pendulum(heat=120.0, largest=2.5)
    values, errors = WARM | {"motor_1_max_torque": 2.5}, []
    for substeps in (1, 2, 4):
        result = model.simulated(values, substeps=substeps)
        states = model.solution(np.asarray(result.samples.time))
        errors.append(
            [
                np.abs(column(result, "link_position") - states[0]).max(),
                np.abs(column(result, "motor_1_temperature") - 25.0 - states[4]).max(),
            ]
        )
    assert states[4].max() > 65.0
    assert errors[0][0] < 1e-3
    assert errors[0][1] < 1.0
    # The torque has corners where it reaches its limit.
    assert np.log2(np.array(errors[0]) / errors[2]) / 2 == pytest.approx([2.0, 2.0], abs=0.3)


def test_heating_of_an_electric_motor_is_that_of_its_winding():
    """A motor at constant current warms up by R_th R i^2 (1 - exp(-t / (R_th C))), and cannot become hotter than its limit."""
    electric = {"motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 20.0, "motor_1_resistance": 2.0}
    how = {"engine": "bench", "compiled": False, "duration": 3.0, "substeps": 1, "motor_substeps": 1}
    body = chain(Body(actuator="sea", inertia=1e-2))
    warm = {"thermal_resistance": 2.0, "thermal_capacity": 0.25, "max_temperature": 60.0, "derating_temperature": 50.0}
    for current in (2.0, 5.0):
        result = run(body, mode=8, references={"motor_1_current": current}, parameters=FREE | electric | warm, **how)
        time, found = np.asarray(result.samples.time), column(result, "motor_1_temperature")
        if current == 2.0:
            np.testing.assert_allclose(found, 25.0 + 2.0 * 2.0 * 4.0 * (1.0 - np.exp(-time / 0.5)), atol=1e-6)
            assert not result.counts.saturation.any()
        else:
            assert 50.0 < found[-1] < 60.0
            # In the end the motor holds the torque at which it stays as warm as it is.
            held = np.sqrt((found[-1] - 25.0) / (2.0 * 2.0))
            assert column(result, "motor_1_current")[-1] == pytest.approx(held, rel=1e-3)
            assert result.counts.saturation.any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "fixed", "truth"),
    [
        ({"damping": 0.4}, {}, {"spring_damping": 0.4}),
        ({"play": 0.04}, {}, {"backlash": 0.04}),
        ({"heat": 120.0, "largest": 2.5}, WARM | {"motor_1_max_torque": 2.5}, {"thermal_resistance": R, "thermal_capacity": C}),
    ],
    ids=["damper", "backlash", "heating"],
)
def test_parameters_of_a_stage_are_identified_from_an_independent_solution(tmp_path, model, fixed, truth):
    pendulum = Pendulum(**model)
    times = np.arange(0.0, 2.0, 5e-3)
    states = pendulum.solution(times)
    states += np.random.default_rng(1).normal(size=states.shape) * [[1e-4], [0.0], [1e-4], [0.0], [0.02]]
    columns = {
        "time": times,
        "joint_1.reference_1": pendulum.amplitude * np.sin(tau * pendulum.frequency * times),
        "joint_1.link_position": states[0],
        "joint_1.motor_1_position": states[2],
    }
    if "heat" in model:
        columns["joint_1.motor_1_temperature"] = 25.0 + states[4]
    path = tmp_path / "lab.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    (tmp_path / "robot.urdf").write_text(chain(Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)).text)
    start = {name: 0.7 * value if "thermal" in name else 0.0 for name, value in truth.items()}
    keys = {
        "robot": "robot.urdf",
        "duration": 2.0,
        "modes": {"*": 5},
        "initial": {"joint_1": 0.1},
        "engine": "mujoco",
        "parameters": {"joint_1": FREE | fixed | {name: value for name, value in start.items() if value}},
    }
    lab = tmp_path / "lab.yaml"
    lab.write_text(json.dumps(keys))
    result = asrsim.identify(lab, [path], free=[f"joint_1.{name}" for name in truth])
    for name, value in truth.items():
        assert result.find(f"joint_1.{name}").value == pytest.approx(value, rel=0.05)


ALL = {
    "hysteresis_torque": 0.2,
    "hysteresis_deflection": 0.02,
    "spring_damping": 0.2,
    "backlash": 0.02,
    "thermal_resistance": 2.0,
    "winding_heat": 5.0,
    "thermal_capacity": 0.2,
}
"""Parameters with which every stage acts."""


def test_every_stage_has_the_parameters_of_this_test():
    assert all(any(one.name in ALL for one in stage.parameters) for stage in STAGES.loaded())


@pytest.mark.parametrize(
    ("actuator", "mode"),
    [("sea", 3), ("qbmove", 6), *(pytest.param(*other, marks=pytest.mark.slow) for other in (("sea", 6), ("qbmove", 3)))],
)
def test_stages_are_equal_to_the_bit_compiled_and_interpreted(actuator, mode, ripple):
    signals = {"equilibrium_position": Sinusoid(amplitude=0.3, frequency=2.0), "stiffness_preset": 0.01}
    runs = [
        run(
            chain(Body(actuator=actuator, mass=0.3, reach=0.05, inertia=2e-3)),
            mode=mode,
            initial=[0.1],
            duration=0.1,
            references=dict(list(signals.items())[: 1 if actuator == "sea" else 2]),
            parameters=ALL | {"ripple_torque": 0.3},
            compiled=compiled,
            substeps=2,
            motor_substeps=3,
        )
        for compiled in (False, True)
    ]
    for name, values in runs[0].samples.values.items():
        np.testing.assert_array_equal(values, runs[1].samples.values[name], err_msg=name)


def test_of_several_stages_each_does_what_its_equation_says_of_the_motion():
    """Losses and temperature that follow from the logged motion and torque in closed form, in a joint with all of them."""
    found = Pendulum().simulated({name: value for name, value in ALL.items() if name != "backlash"})
    step = np.diff(found.samples.time)
    deflection = column(found, "motor_1_position") - column(found, "link_position")
    slip = column(found, "motor_1_velocity") - column(found, "link_velocity")
    burnt = np.cumsum(step * ALL["spring_damping"] * 0.5 * (slip[1:] ** 2 + slip[:-1] ** 2))
    np.testing.assert_allclose(column(found, "damper_loss")[1:], burnt, rtol=0.02, atol=0.01 * burnt[-1])
    heat = ALL["winding_heat"] * column(found, "motor_1_torque") ** 2
    pull, warm, drag, rise = [0.0], [25.0], ALL["hysteresis_torque"], ALL["thermal_resistance"] * ALL["thermal_capacity"]
    for moved, power, dt in zip(np.diff(deflection), 0.5 * (heat[:-1] + heat[1:]), step, strict=True):
        end = np.sign(moved) * drag
        pull.append(end + (pull[-1] - end) * np.exp(-abs(moved) / ALL["hysteresis_deflection"]))
        warm.append(warm[-1] + dt * (ALL["thermal_resistance"] * power - (warm[-1] - 25.0)) / rise)
    np.testing.assert_allclose(column(found, "motor_1_temperature"), warm, atol=0.02 * np.ptp(warm))
    assert np.ptp(warm) > 5.0
    work = np.cumsum(0.5 * (np.array(pull[1:]) + pull[:-1]) * np.diff(deflection))
    stored = 0.5 * ALL["hysteresis_deflection"] * np.array(pull[1:]) ** 2 / drag
    np.testing.assert_allclose(column(found, "hysteresis_loss")[1:], work - stored, atol=0.02 * work[-1])


@pytest.mark.parametrize("compiled", [False, True])
def test_worlds_with_and_without_a_stage_run_side_by_side(compiled):
    """A stage that a later start brings changes neither the worlds that run nor their snapshots."""
    scenario = Pendulum().simulated({}, duration=0.1, substeps=2)
    prepared = prepare(scenario.scenario, scenario.robot)
    damped = {"joint_1": {"spring_damping": 0.2}}
    with Worlds(prepared, 2, compiled=compiled) as worlds:
        worlds.advance(20)
        before = worlds.snapshot(worlds=[0])
        worlds.reset(Start(parameters=damped), worlds=[1])
        worlds.advance(30)
        both = worlds.observe().link_position[:, 0]
        worlds.restore(before)
        worlds.advance(30, worlds=[0])
        assert worlds.observe().link_position[0, 0] == both[0]
    alone = []
    for values in ({}, damped):
        with Worlds(prepared.vary(values), 1, compiled=compiled) as worlds:
            worlds.advance(30 if values else 50)
            alone.append(worlds.observe().link_position[0, 0])
    assert both.tolist() == alone
    assert alone[0] != alone[1]


@pytest.fixture
def ripple(tmp_path):
    """The stage of the page about stages: a torque between motor and ground that depends on the motor's position."""
    text = (ROOT / "docs" / "stages.md").read_text(encoding="utf-8").partition("### Between motor and ground")[2]
    (tmp_path / "ripple.py").write_text(text.partition("```python\n")[2].partition("```")[0])
    load_plugin_file(tmp_path / "ripple.py")
    return STAGES.get("ripple")


def test_a_part_between_motor_and_ground_is_of_second_order_and_loses_nothing(ripple):
    level, count = 0.4, 40.0
    model = Pendulum(ripple=level, ripples=count)
    errors, residuals = [], []
    for substeps in (1, 2, 4):
        result = model.simulated({"ripple_torque": level, "ripples": count}, substeps=substeps)
        truth = model.solution(np.asarray(result.samples.time))
        errors.append(np.abs(column(result, "motor_1_position") - truth[2]).max())
        residuals.append(np.abs(column(result, "energy_residual")).max())
    assert np.abs(Pendulum().solution(np.asarray(result.samples.time))[2] - truth[2]).max() > 30 * errors[0]
    for values in (errors, residuals):
        for coarse, fine in pairwise(values):
            assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.2)


def test_the_part_between_motor_and_ground_passes_its_checks_and_wrong_bounds_do_not(ripple):
    assert check_stage(ripple).passed
    weak = type("Weak", (ripple,), {"ground_stiffness_bound": staticmethod(lambda own: 0.5 * own.level * own.rate)})
    assert [check.name for check in check_stage(weak).checks if not check.passed] == ["ground stiffness"]
    free = type("Free", (ripple,), {"energy": staticmethod(lambda memory, own: 0.0)})
    assert [check.name for check in check_stage(free).checks if not check.passed] == ["energy"]


def test_motors_without_dynamics_have_no_part_between_motor_and_ground(ripple):
    values = {"ripple_torque": 0.4, "ripples": 40.0}
    assert ripple.constants(values, 1, MODES[3]) is None
    assert ripple.constants(values, 1, MODES[6]) is not None
