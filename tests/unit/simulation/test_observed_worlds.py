"""Worlds that follow measured positions."""

import numpy as np
import pytest

from asrsim.errors import SimulationError
from asrsim.scenario import make_scenario
from asrsim.simulation.start import Start
from asrsim.simulation.worlds import Observer, Worlds
from support.paths import ROOT

NAMES = ["link_position", "motor_1_position", "motor_2_position"]
MOVED = {"stiffness_preset": 0.3, "equilibrium_position": {"sinusoid": {"amplitude": 0.4, "frequency": 1.0}}}


def worlds(**keys):
    scenario = make_scenario(
        ROOT / "examples/urdf/dof2_vertical.urdf", duration=0.5, references={"*": MOVED}, **{"engine": "mujoco", **keys}
    )
    return Worlds(scenario, 2, names=NAMES, watched=False, compiled=keys.get("compiled", True))


def positions(found):
    return np.ascontiguousarray(np.stack([found[name] for name in NAMES], axis=-1))


def test_a_world_that_is_observed_by_its_own_motion_is_not_changed():
    with worlds() as made:
        free = positions(made.rollout(NAMES))
        errors = free.copy()
        assert np.array_equal(positions(made.rollout(NAMES, observer=Observer(measured=errors, gains=(0.3, 20.0)))), free)
        assert not errors.any()
        # Without an observer, the next rollout is free again.
        assert np.array_equal(positions(made.rollout(NAMES)), free)


@pytest.mark.parametrize("a", [0.5, 0.9])
def test_a_start_that_is_off_decays_by_the_poles_of_the_observer(a):
    """With both poles a, the error before the correction of step k is that of the start times (1 - k (1 - a) / a) a^k. Within a
    few steps, springs hardly move the link.
    """
    gains = 1.0 - a**2, (1.0 - a) ** 2 / 1e-3
    with worlds(gravity=[0.0, 0.0, 0.0]) as made:
        errors = positions(made.rollout(NAMES))
        errors[..., 1:] = np.nan
        made.rollout(NAMES, start=Start(positions={"joint_1": 1e-3}), observer=Observer(measured=errors, gains=gains))
    k = np.arange(6)
    decay = errors[0, :6, 0, 0] / errors[0, 0, 0, 0]
    np.testing.assert_allclose(decay, (1.0 - k * (1.0 - a) / a) * a**k, atol=0.02)


def test_an_engine_without_a_compiled_step_cannot_observe():
    with worlds(compiled=False) as made:
        assert not made.observes
        with pytest.raises(SimulationError, match="compiled step"):
            made.rollout(NAMES, observer=Observer(measured=np.zeros((1, 501, 2, 3)), gains=(0.1, 1.0)))
