"""The numerical error that `--certify` reports is within a factor of two of the true error."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from asrsim import load_scenario, make_scenario
from asrsim.simulation.accuracy import certify
from asrsim.simulation.examine import examine
from asrsim.simulation.run import simulate
from support.paths import ROOT

ARM = ROOT / "examples/urdf/dof1_qbmove.urdf"


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
@pytest.mark.parametrize("limited", [False, True])
def test_certificate_is_accurate_at_reduced_order(stepping, limited):
    """Motors at their limits reduce the order below two. The estimate with the measured order is accurate to 20 %."""
    wave = {"sinusoid": {"amplitude": 0.4, "angular_frequency": 9.0}}
    weak = {"motor_1_max_torque": 0.5, "motor_2_max_torque": 0.5} if limited else {}
    scenario = make_scenario(
        ARM, duration=0.4, step=4e-3, substeps=1, engine="mujoco", stepping=stepping, modes={"*": 5}, parameters={"*": weak},
        references={"joint_1": {"reference_1": wave, "reference_2": {"sinusoid": {"amplitude": 0.2, "frequency": 1.1}}}},
    )  # fmt: skip
    run, fine = simulate(scenario), simulate(replace(scenario, step=scenario.step / 32, log_every=32))
    assert run.samples is not None
    assert fine.samples is not None
    error = run.samples.values["link_position"] - fine.samples.values["link_position"]
    reported = certify(examine(scenario), run)
    found = reported["joints"]["joint_1"]
    assert bool(reported["warnings"]) == (found["order"] < reported["scheme_order"] - 0.3)
    assert found["position_rms"] == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=0.22)
    assert found["position_max"] == pytest.approx(float(np.max(np.abs(error))), rel=0.2)


@pytest.mark.parametrize(
    "stage",
    [
        {"hysteresis_torque": 0.05, "hysteresis_deflection": 0.03},
        {"spring_damping": 0.02},
        {"backlash": 0.02},
        {"thermal_resistance": 2.0, "thermal_capacity": 0.05, "winding_heat": 5.0, "derating_temperature": 30.0},
    ],
)
def test_certificate_holds_for_stages(stage):
    """The edges of a play and of a limit lower the order; the reported error is still within a factor of two."""
    scenario = make_scenario(
        ARM,
        duration=0.25,
        step=2e-3,
        substeps=1,
        engine="mujoco",
        compiled=False,
        modes={"*": 5},
        parameters={"*": stage},
        references={"joint_1": {"reference_1": {"sinusoid": {"amplitude": 0.4, "angular_frequency": 9.0}}, "reference_2": 0.2}},
    )
    run, fine = simulate(scenario), simulate(replace(scenario, step=scenario.step / 16, log_every=16))
    assert run.samples is not None
    assert fine.samples is not None
    error = np.abs(run.samples.values["link_position"] - fine.samples.values["link_position"]).max()
    assert 0.5 * error < certify(examine(scenario), run)["joints"]["joint_1"]["position_max"] < 2.0 * error


def test_certificate_does_not_depend_on_the_order_of_joints():
    """A manager file may list the joints in another order than the robot."""
    (given,) = load_scenario(
        ROOT / "examples/scenarios/step_2dof.yaml", variant="soft", overrides={"duration": 0.2, "substeps": 2}
    )
    scenarios = [replace(given, joint_order=order) for order in ((), ("joint_2", "joint_1"))]
    runs = [simulate(scenario) for scenario in scenarios]
    first, second = (certify(examine(scenario), run) for scenario, run in zip(scenarios, runs, strict=True))
    assert first["joints"] == second["joints"]
    assert (first["step"], first["stepping"], first["scheme_order"]) == (0.5 * given.step, "leapfrog", 2)


@pytest.mark.parametrize(("start", "order"), [(0.0, 4.0), (0.3, 3.0)], ids=["in balance", "out of balance"])
def test_two_runs_of_smooth_motion_combine_to_the_order_that_the_page_states(start, order):
    """A damped link follows a sine. The damping of the first kick is implicit, which costs an order out of balance."""
    wave = {"sinusoid": {"amplitude": 0.1, "frequency": 2.0}}
    smooth = {"spring_stiffness": 3.0, "motor_1_friction_torque": 0.0, "motor_1_max_torque": 1e4, "motor_1_max_velocity": 1e4}
    scenario = make_scenario(
        ROOT / "examples/urdf/dof1_sea.urdf", duration=0.1, step=4e-3, engine="mujoco", modes={"*": 5},
        initial={"joint_1": start}, references={"joint_1": {"reference_1": wave}}, parameters={"*": smooth},
    )  # fmt: skip
    runs = [simulate(replace(scenario, substeps=n)).samples.values["link_position"] for n in (4, 8, 16, 32)]
    combined = [(4.0 * finer - coarse) / 3.0 for coarse, finer in pairwise(runs)]
    first, second = (np.abs(a - b).max() for a, b in pairwise(combined))
    assert np.log2(first / second) == pytest.approx(order, abs=0.15)
