"""The numerical error that `--certify` reports is within a factor of two of the true error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asrsim import make_scenario
from asrsim.robot import load_robot
from asrsim.scenario import Scenario
from asrsim.signals import Constant
from asrsim.simulation.certify import certify
from asrsim.simulation.run import simulate
from support.paths import ROOT

ARM = ROOT / "examples/urdf/dof1_qbmove.urdf"
CASES = {
    "sea_k200": 0.0, "sea_k400": 0.0, "awas_s0.005": 0.005, "awas_s0.04": 0.04,
    "bavs_p0.001": 0.001, "bavs_p0.22": 0.22, "qbmove_p0.2": 0.2, "qbmove_p0.6": 0.6,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
@pytest.mark.parametrize("case", CASES)
def test_certificate_is_within_a_factor_of_two_of_the_error(case: str, stepping: str, shared: Path) -> None:
    file = shared / "data/gazebo_urdf" / f"dof1_m3_step_{case}_ideal.urdf"
    robot = load_robot(file)
    references = {"joint": {"equilibrium_position": Constant(value=0.8), "stiffness_preset": Constant(value=CASES[case])}}
    scenario = Scenario(name=case, robot=file, duration=5.0, gravity=(0.0, 0.0, -9.8), references=references, stepping=stepping)
    run = simulate(scenario, robot)
    truth = np.load(shared / "data/ideal.npz")[case]
    error = run.samples.values["link_position"][:, 0] - truth[:, 1]
    reported = certify(scenario, run, robot).joints["joint"]
    assert 0.5 < reported.position_rms / np.sqrt(np.mean(error**2)) < 2.0
    assert 0.5 < reported.position_max / np.max(np.abs(error)) < 2.0


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
@pytest.mark.parametrize("limited", [False, True])
def test_certificate_is_accurate_at_reduced_order(stepping: str, limited: bool) -> None:
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
    reported = certify(scenario, run)
    assert reported is not None
    found = reported.joints["joint_1"]
    assert bool(reported.warnings) == (found.order < reported.scheme_order - 0.3)
    assert found.position_rms == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=0.22)
    assert found.position_max == pytest.approx(float(np.max(np.abs(error))), rel=0.2)
