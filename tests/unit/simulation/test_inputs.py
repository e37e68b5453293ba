"""Commands as they were sent, beside the commands that act after delay, rate, noise and resolution."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from asrsim import Simulation, make_scenario
from asrsim.actuators.qbmove import QbMove
from asrsim.scenario.data import Imperfections
from asrsim.signals import Sinusoid
from asrsim.simulation.inputs import renewal_of
from asrsim.simulation.worlds import Worlds
from validation.models import Body, chain, column, run

BODY = Body(actuator="sea", mass=0.3, reach=0.05)
SINE = Sinusoid(offset=0.1, amplitude=0.4, frequency=1.3)
DELAY = 0.034


def moved(*, compiled=False, imperfections, mode=2, bodies=(BODY,), **keys):
    return run(
        chain(*bodies),
        mode=mode,
        duration=0.4,
        compiled=compiled,
        joints={"joint_1": {"reference_1": SINE}},
        command_imperfections={"joint_1": imperfections},
        **keys,
    )


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_log_has_the_sent_command_and_the_late_command(compiled):
    found = moved(compiled=compiled, imperfections=Imperfections(delay=DELAY))
    time = found.samples.time
    np.testing.assert_allclose(column(found, "sent_reference_1"), SINE.values(time), atol=1e-12)
    np.testing.assert_allclose(column(found, "reference_1"), SINE.values(np.maximum(time - DELAY, 0.0)), atol=1e-12)


@pytest.mark.parametrize("imperfections", [Imperfections(noise=0.01), Imperfections(rate=100.0), Imperfections(quantum=0.05)])
def test_a_sent_command_has_no_noise_no_rate_and_no_resolution(imperfections):
    found = moved(imperfections=imperfections)
    np.testing.assert_allclose(column(found, "sent_reference_1"), SINE.values(found.samples.time), atol=1e-12)
    assert np.abs(column(found, "reference_1") - column(found, "sent_reference_1")).max() > 5e-3


def test_only_joints_whose_commands_have_effects_record_sent_commands():
    found = moved(imperfections=Imperfections(delay=DELAY), bodies=(BODY, replace(BODY, actuator="qbmove")))
    assert [[name for name in joint.quantities if name.startswith("sent")] for joint in found.info.joints] == [
        ["sent_reference_1"],
        [],
    ]
    assert "sent_reference_1" not in moved(imperfections=Imperfections()).samples.values


def test_each_motor_of_a_joint_has_its_sent_command():
    found = run(
        chain(replace(BODY, actuator="qbmove")),
        mode=2,
        duration=0.2,
        compiled=False,
        references={"reference_1": SINE, "reference_2": 0.1},
        command_imperfections={"*": Imperfections(delay=DELAY)},
    )
    np.testing.assert_allclose(column(found, "sent_reference_1"), SINE.values(found.samples.time), atol=1e-12)
    np.testing.assert_allclose(column(found, "sent_reference_2"), 0.1, atol=1e-12)


def test_a_command_from_outside_is_sent_and_acts_at_once(tiny):
    imperfections = {"commands": {"*": {"delay": 0.05}}}
    with Simulation(make_scenario(tiny.robot, duration=1, imperfections=imperfections), record=True) as simulation:
        simulation.advance(20)
        simulation.set_reference("elbow", "equilibrium_position", 0.3)
        simulation.advance(20)
        values = simulation.samples.values
    np.testing.assert_array_equal(values["sent_reference_1"][20:, 0], 0.3)
    np.testing.assert_array_equal(values["reference_1"][20:, 0], 0.3)


def test_a_reference_map_that_is_no_plain_function_is_not_compiled():
    assert renewal_of(lru_cache(QbMove.motor_references)) is None


@pytest.mark.parametrize("late", [-0.5, -0.3, 0.0, 0.3])
def test_a_jump_at_the_border_of_two_chunks_acts_at_its_time(tiny, late):
    """late: distance of the jump from a substep that begins a chunk, in substeps."""
    jump = {"step": {"at": (80 + late) * 1e-3, "to": 0.4}}
    scenario = make_scenario(tiny.robot, duration=0.2, substeps=1, compiled=False, external_torques={"elbow": jump})
    found = []
    for chunk in (40, 4096):
        with Worlds(scenario, 1, chunk=chunk) as worlds:
            assert worlds.prepared.substep == 1e-3
            found.append(worlds.rollout(["link_position"])["link_position"])
    assert np.ptp(found[0]) > 0.01
    np.testing.assert_array_equal(*found)
