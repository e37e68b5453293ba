"""A battery that every registered actuator goes through: its laws against physics, and its joint in the simulation."""

import math
from dataclasses import replace

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.base import cosh, sinh
from asrsim.actuators.checker import Points
from asrsim.actuators.vectorised import energy_law, over_arrays
from asrsim.errors import ScenarioError
from validation.models import Body, chain, column, run

NAMES = ACTUATORS.names()
BODY = Body(mass=0.3, reach=0.05, inertia=1e-3, damping=0.05)


@pytest.fixture(params=NAMES)
def law(request):
    return ACTUATORS.get(request.param)


# -- laws --------------------------------------------------------------------------------------------------------------


def test_energies_without_a_law_are_integrated(law):
    bare = type("Bare", (law,), {"elastic_energy": Actuator.elastic_energy})
    values = tuple(parameter.default for parameter in law.parameters)
    q = np.array([-0.1, 0.0, 0.05])
    second = np.full(3, law.typical_preset) if law.adjuster else np.array([0.02, -0.1, 0.1])
    positions = (q, np.array([0.1, 0.05, -0.1]), second)
    found, expected = (over_arrays(energy_law(kind))(*positions, values) for kind in (bare, law))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_its_laws_on_arrays_are_its_laws(law):
    """Positions inside and beyond the deflection limit, with the defaults and perturbed parameters."""
    points = Points(law, reach=1.3)
    table = np.vstack([points.positions, *points.parameters])[:, ::30].T.tolist()
    found = np.vstack([points.forces(), points.stiffness()])[:, ::30].T
    for (q, x, y, *parameters), (torque, *_, stiffness) in zip(table, found, strict=True):
        assert torque == pytest.approx(sum(law.elastic_torques(q, x, y, parameters)), rel=1e-13, abs=1e-15)
        assert stiffness == pytest.approx(law.stiffness(q, x, y, parameters), rel=1e-13)


def test_beyond_the_deflection_limit_the_torque_stays(law):
    names = [parameter.name for parameter in law.parameters]
    if "max_deflection" not in names:
        pytest.skip("it has no deflection limit")
    parameters = tuple(parameter.default for parameter in law.parameters)
    limit = parameters[names.index("max_deflection")]
    second = law.typical_preset if law.adjuster else 0.0
    at = law.elastic_torques(0.0, limit, second, parameters)[0]
    assert law.elastic_torques(0.0, 1.5 * limit, second, parameters)[0] == at
    assert law.elastic_torques(0.0, 0.9 * limit, second, parameters)[0] < at


# -- joints ------------------------------------------------------------------------------------------------------------


def references(law, mode):
    if MODES[mode].mapped:
        return {"equilibrium_position": 0.2, "stiffness_preset": law.typical_preset}
    first, second = law.motor_references(0.2, law.typical_preset)
    if law.adjuster:
        second = law.typical_preset
    return {
        0: {"link_torque": 0.05},
        1: {"link_position": 0.2},
        2: {"reference_1": first, "reference_2": second},
        4: {"motor_1_torque": 0.05, "motor_2_torque": second if law.adjuster else 0.05},
        5: {"reference_1": first, "reference_2": second},
        7: {"motor_1_voltage": 0.5, "motor_2_voltage": second if law.adjuster else 0.5},
        8: {"motor_1_current": 0.5, "motor_2_current": second if law.adjuster else 0.5},
    }[mode]


@pytest.mark.parametrize("stepping", ["leapfrog", "toolbox"])
@pytest.mark.parametrize("mode", sorted(MODES))
def test_every_mode_runs_in_every_stepping(law, mode, stepping):
    constants = {f"motor_{i}_{name}": 0.2 for i in range(1, law.motors + 1) for name in ("torque_constant", "resistance")}
    how = {"references": references(law, mode), "duration": 0.2, "stepping": stepping}
    if mode > 6:
        how["parameters"] = constants
    if mode > 6 and stepping == "toolbox":
        with pytest.raises(ScenarioError, match="which the toolbox does not have"):
            run(chain(replace(BODY, actuator=law.name)), mode=mode, **how)
        return
    result = run(chain(replace(BODY, actuator=law.name)), mode=mode, **how)
    assert result.samples is not None
    joint = result.samples.joint("joint_1")
    assert set(result.info.joints[0].quantities) >= set(joint)
    for name, values in joint.items():
        assert len(values) == 201, name
        assert np.all(np.isfinite(values)), name
    # In the released order AwAS-II's adjuster is a motor, whose friction this torque does not overcome: no spring, no motion.
    if not (law.adjuster and mode == 4 and stepping == "toolbox"):
        assert np.max(np.abs(joint["link_position"])) > 1e-4
    assert ("motor_1_velocity" in joint) == MODES[mode].motor
    assert ("motor_2_velocity" in joint) == (MODES[mode].motor and law.motors == 2)
    assert ("stiffness" in joint) == MODES[mode].spring


@pytest.mark.parametrize("mode", [2, 3, 5, 6])
def test_without_load_the_link_rests_at_the_equilibrium(law, mode):
    """Gravity off: the reference map's equilibrium is where the link goes, in every mode that holds motors."""
    result = run(
        chain(replace(BODY, actuator=law.name)),
        mode=mode,
        gravity=0.0,
        references=references(law, mode),
        duration=3.0,
        parameters={f"motor_{i}_friction_torque": 0.0 for i in range(1, law.motors + 1)},
    )
    assert column(result, "link_position")[-1] == pytest.approx(0.2, abs=2e-4)
    assert column(result, "link_torque")[-1] == pytest.approx(0.0, abs=1e-3)


def test_what_is_logged_is_the_law(law):
    """Torques and stiffness of a log follow from its positions."""
    result = run(chain(replace(BODY, actuator=law.name)), mode=6, references=references(law, 6), duration=0.2)
    elastic = tuple(result.robot.actuators[0].values()[parameter.name] for parameter in law.parameters)
    second = column(result, "motor_2_position") if law.motors == 2 or law.adjuster else np.zeros(201)
    for k in (0, 57, 200):
        point = float(column(result, "link_position")[k]), float(column(result, "motor_1_position")[k]), float(second[k])
        torques = law.elastic_torques(*point, elastic)
        assert column(result, "elastic_torque_1")[k] == pytest.approx(torques[0], rel=1e-12, abs=1e-15)
        assert column(result, "link_torque")[k] == pytest.approx(sum(torques), rel=1e-12, abs=1e-15)
        assert column(result, "stiffness")[k] == pytest.approx(law.stiffness(*point, elastic), rel=1e-12)


@pytest.mark.parametrize("size", [1e-9, 1e-4, 0.1, 0.2499, 0.25, 1.0, 8.0, 700.0])
def test_hyperbolic_functions_keep_every_digit(size):
    assert sinh(size) == pytest.approx(math.sinh(size), rel=1e-15)
    assert sinh(-size) == -sinh(size)
    assert cosh(size) == pytest.approx(math.cosh(size), rel=1e-15)
