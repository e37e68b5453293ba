"""Small faults that slipped through once: a sign, a factor, a padding."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.learning.law import zero_phase
from asrsim.scenario import load_scenario
from asrsim.simulation.certify import certify
from asrsim.simulation.run import simulate
from support.tiny import Tiny


@pytest.mark.parametrize("cutoff", [0.5, 2.0])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_filter_keeps_a_ramp_to_its_ends(cutoff: float, order: int) -> None:
    """A padding shorter than what the filter remembers leaves its start in the first samples."""
    time = np.arange(0, 20, 0.005)
    ramp = np.column_stack([time, 3 - 0.5 * time])
    off = np.abs(zero_phase(ramp, cutoff, order, 0.005) - ramp)
    assert off.max() < 1e-3 / cutoff


@pytest.mark.parametrize(("stepping", "order"), [("leapfrog", 2), ("euler", 1)])
def test_a_certified_order_is_the_scheme_s_where_forces_are_smooth(stepping: str, order: int, tiny: Tiny) -> None:
    text = tiny.scenario.read_text(encoding="utf-8")
    text = text.replace("step: {at: 0.1, to: 0.5}", "sinusoid: {amplitude: 0.4, frequency: 1.5}")
    tiny.scenario.write_text(f"{text}stepping: {stepping}\n", encoding="utf-8")
    (scenario,) = load_scenario(tiny.scenario)
    reported = certify(scenario, simulate(scenario)).joints["elbow"]
    assert reported.order == pytest.approx(order, abs=0.15)
