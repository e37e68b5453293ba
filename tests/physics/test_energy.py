"""Logged energies: their sum balances, also at limits and stops."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS, MODES
from asrsim.signals import PulseTrain, Sinusoid, Step
from validation.models import INSTALLED, Body, chain, column, run

BODY = Body(mass=0.4, reach=0.05, inertia=2e-3, damping=0.02)
WAVE = Sinusoid(amplitude=0.3, frequency=2.0)


def shares(robot, **options):
    """Ratio of energy residual and work at steps of 1 ms and 0.25 ms, without substeps."""
    found = []
    for step in (1e-3, 2.5e-4):
        result = run(robot, step=step, substeps=1, motor_substeps=1, **options)
        work = np.max(np.abs(column(result, "motor_work"))) + np.max(np.abs(column(result, "link_work")))
        found.append(float(np.max(np.abs(column(result, "energy_residual"))) / work))
    return found


@pytest.mark.parametrize("mode", [2, 4, 5])
def test_work_of_a_jumping_adjuster_balances_the_other_energies(mode):
    """The adjuster follows its reference exactly. Its work in a jump equals the energy that spring, link and motor absorb."""
    first = {2: "reference_1", 4: "motor_1_torque", 5: "reference_1"}[mode]
    second = PulseTrain(start=0.02, period=0.08, width=0.04, low=0.01, high=0.025)
    coarse, fine = shares(
        chain(replace(BODY, actuator="awas_ii")),
        mode=mode,
        duration=0.3,
        references={first: Sinusoid(amplitude=0.3, frequency=4.0), {4: "motor_2_torque"}.get(mode, "reference_2"): second},
    )
    assert coarse < 3e-3
    assert fine < coarse / 6.0


@pytest.mark.parametrize(
    "parameters",
    [
        pytest.param({"motor_1_max_torque": 0.5}, id="torque limit of the motor"),
        pytest.param({"motor_1_max_velocity": 1.0}, id="speed limit of the motor"),
        pytest.param({"motor_1_max_position": 0.1, "motor_1_min_position": -0.1}, id="stops of the motor"),
        pytest.param({"motor_1_friction_torque": 0.5}, id="strong friction"),
        pytest.param({"max_deflection": 0.02}, id="deflection limit"),
        pytest.param({"controller_1_integral": 400.0}, id="integral action"),
        pytest.param({"effort": 0.5}, id="effort limit"),
    ],
)
def test_the_balance_closes_at_limits(parameters):
    limits = f'<limit lower="-3" upper="3" effort="{parameters.get("effort", 1e9)}" velocity="100"/>'
    springs = {name: value for name, value in parameters.items() if name != "effort"}
    coarse, fine = shares(
        chain(replace(BODY, actuator="sea", limits=limits)),
        mode=6,
        duration=0.4,
        references={"equilibrium_position": WAVE},
        parameters={"spring_stiffness": 20.0, **springs},
    )
    assert coarse < 1e-2
    assert fine < 0.6 * coarse


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("friction", [0.0, 0.01])
def test_the_balance_of_a_light_motor_closes_after_a_jump(engine, compiled, friction):
    """The motor oscillates several times in each step, which motor substeps resolve."""
    light = {"motor_1_inertia": 1e-5, "motor_1_damping": 0.0, "motor_1_friction_torque": friction, "motor_1_max_velocity": 1e9}
    result = run(
        chain(replace(BODY, actuator="sea")),
        mode=5,
        duration=0.2,
        engine=engine,
        compiled=compiled,
        references={"reference_1": Step(at=0.05037, after=0.3)},
        parameters={"spring_stiffness": 20.0, "controller_1_proportional": 20.0, "controller_1_derivative": 0.0, **light},
    )
    assert result.resolution.motor_substeps > 5
    assert np.abs(column(result, "energy_residual")).max() < 0.03 * np.abs(column(result, "motor_work")).max()


def test_logged_energies_balance():
    """Motor work = losses + springs + kinetic energy of the motor + link work, at every row; all start at zero."""
    result = run(
        chain(replace(BODY, actuator="sea")),
        mode=4,
        duration=0.5,
        references={"motor_1_torque": WAVE},
        parameters={"spring_stiffness": 20.0},
    )
    parts = {name: column(result, name) for name in ("motor_work", "friction_loss", "link_work", "energy_residual")}
    for name, values in parts.items():
        assert values[0] == 0.0, name
    kinetic = 0.5 * 0.0233 * column(result, "motor_1_velocity") ** 2
    held = column(result, "spring_energy") + kinetic
    left = parts["motor_work"] - parts["friction_loss"] - parts["link_work"] - (held - held[0])
    np.testing.assert_allclose(left, parts["energy_residual"], atol=1e-12)
    # Only the elastic energy of the bristles can return from the friction.
    bristles = 0.02**2 / (2.0 * 1000.0)
    assert np.max(np.maximum.accumulate(parts["friction_loss"]) - parts["friction_loss"]) < 2.1 * bristles
    assert np.all(np.diff(column(result, "damping_loss")) >= 0.0)
    # The work on the link equals its kinetic energy plus the damping loss.
    mass = BODY.inertia + BODY.mass * BODY.reach**2
    link = 0.5 * mass * column(result, "link_velocity") ** 2
    link += BODY.mass * 9.81 * BODY.reach * (1.0 - np.cos(column(result, "link_position")))
    np.testing.assert_allclose(parts["link_work"] - column(result, "damping_loss"), link, atol=2e-4 * np.max(link))


def test_energies_do_not_depend_on_how_often_rows_are_logged():
    options = {"mode": 6, "duration": 0.3, "references": {"equilibrium_position": WAVE, "stiffness_preset": 0.2}}
    every = run(chain(replace(BODY, actuator="qbmove")), **options)
    some = run(chain(replace(BODY, actuator="qbmove")), log_every=7, **options)
    assert every.samples is not None
    assert some.samples is not None
    for name, values in some.samples.values.items():
        np.testing.assert_array_equal(values, every.samples.values[name][::7])


@pytest.mark.parametrize("mode", [0, 1])
def test_a_rigid_joint_has_no_spring_energy(mode):
    name = {0: "link_torque", 1: "link_position"}[mode]
    result = run(chain(replace(BODY, actuator="sea")), mode=mode, duration=0.1, references={name: 0.1})
    quantities = result.info.joints[0].quantities
    assert "link_work" in quantities
    assert not {"spring_energy", "energy_residual", "friction_loss"} & set(quantities)
    np.testing.assert_array_equal(column(result, "motor_work"), column(result, "link_work"))


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("effort", [0.8, 1e6])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_work_of_a_jumping_controller_is_kinetic_energy(share, effort, engine, compiled):
    """There is no other force. The reference jumps every 20 ms, `share` of a step after a row of the log; 0.8 N m is a limit
    that acts on one side of the jumps. Half way between the jumps the error falls with the square of the step."""
    limits = f'<limit lower="-30" upper="30" effort="{effort}" velocity="1000"/>'
    inertia, left = 0.01, []
    for step in (1e-3, 2.5e-4):
        jumps = PulseTrain(low=0.1, high=0.5, start=0.02 + share * step, period=0.04, width=0.02)
        result = run(
            chain(Body(actuator="sea", mass=1e-9, reach=0.0, inertia=inertia, limits=limits)), mode=1, gravity=0.0,
            duration=0.2, step=step, substeps=1, engine=engine, compiled=compiled, references={"link_position": jumps},
            parameters={"controller_1_proportional": 4.0, "controller_1_integral": 5.0, "controller_1_derivative": 0.1},
        )  # fmt: skip
        between = slice(round(0.01 / step), None, round(0.02 / step))
        energy = 0.5 * inertia * column(result, "link_velocity") ** 2
        left.append(np.abs(energy - column(result, "link_work"))[between].max())
    assert left[0] < 1e-4
    assert np.log2(left[0] / left[1]) / 2.0 > 1.9


def test_energy_of_a_push_within_a_substep_is_logged():
    """The push ends before the next row of the log, so only the half kicks include it."""
    blow = PulseTrain(high=800.0, period=10.0, width=0.2e-3, start=0.4991, count=1)
    result = run(chain(BODY), step=1e-3, substeps=1, duration=0.6, external={"*": blow})
    assert np.max(np.abs(column(result, "external_torque"))) == 0.0
    assert np.max(np.abs(column(result, "link_velocity"))) > 10.0
    assert result.status == "complete"


@pytest.mark.parametrize("mode", [2, 3, 5, 6])
@pytest.mark.parametrize("actuator", ACTUATORS.names())
def test_energy_residual_falls_with_the_square_of_the_step(actuator, mode):
    """The run has springs with hysteresis, moving motors with and without dynamics, and a swinging link."""
    law = ACTUATORS.get(actuator)
    wave = {"amplitude": 0.2, "frequency": 2.0}
    second = {"amplitude": 0.1 * law.typical_preset, "frequency": 3.0, "offset": law.typical_preset}
    if mode in (2, 5) and not law.adjuster:
        second = {"amplitude": 0.15, "frequency": 3.0, "offset": -0.1}
    names = MODES[mode].references[: 2 if law.motors == 2 or law.adjuster else 1]
    references = {name: Sinusoid(**keys) for name, keys in zip(names, (wave, second), strict=False)}
    residuals, losses = [], []
    for substeps in (1, 2, 4):
        result = run(
            chain(Body(actuator=actuator, mass=0.3, reach=0.05, inertia=2e-3, damping=0.01)),
            mode=mode,
            references=references,
            parameters={"hysteresis_torque": 0.05, "hysteresis_deflection": 0.05},
            initial=[0.1],
            duration=0.25,
            compiled=False,
            substeps=substeps,
            motor_substeps=1,
        )
        residuals.append(np.abs(column(result, "energy_residual")).max())
        losses.append(column(result, "hysteresis_loss")[-1])
    assert losses[-1] > 1e-4
    for coarse, fine in pairwise(residuals):
        assert np.log2(coarse / fine) > 1.8


@pytest.mark.parametrize("after", [0.1, 1.0, -1.0])
def test_the_work_of_a_controlled_link_is_the_change_of_its_kinetic_energy(after):
    """The link moves at the start. Its controller brakes it, and is at the effort limit after some jumps of the reference."""
    limits = '<limit lower="-3" upper="3" effort="0.5" velocity="100"/>'
    result = run(
        chain(replace(BODY, actuator="sea", limits=limits, damping=0.0)),
        mode=1,
        gravity=0.0,
        duration=0.03,
        step=1e-3,
        substeps=1,
        compiled=False,
        references={"link_position": Step(at=0.0103, after=after)},
        initial_velocities={"joint_1": 2.0},
    )
    inertia = 2e-3 + 0.4 * 0.05**2
    kinetic = 0.5 * inertia * column(result, "link_velocity") ** 2
    np.testing.assert_allclose(column(result, "link_work"), kinetic - kinetic[0], rtol=0.0, atol=2e-5)
