"""Worlds on Warp move as asrsim's own worlds do: laws are the same, numbers have single precision."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.simulation.prepare import Start
from support.paths import EXAMPLES

pytest.importorskip("mujoco_warp", reason='needs the extra "warp"')

STEP, SINE = {"step": {"at": 0.05, "to": 0.8}}, {"sinusoid": {"amplitude": 0.6, "frequency": 2.0}}
PARTS = {
    "integral action": {"parameters": {"joint_1": {"controller_1_integral": 50.0}}},
    "motor friction": {"parameters": {"joint_1": {"motor_1_friction_torque": 0.3, "motor_1_stribeck_friction": 0.3}}},
    "hysteresis": {"parameters": {"joint_1": {"hysteresis_torque": 0.3, "hysteresis_deflection": 0.02}}},
    "damper": {"parameters": {"joint_1": {"spring_damping": 0.1}}},
    "backlash": {"parameters": {"joint_1": {"backlash": 0.05}}},
    "heating": {"parameters": {"joint_1": {"thermal_resistance": 2.0, "thermal_capacity": 0.2, "winding_heat": 50.0}}},
    "delay": {"effects": {"commands": {"joint_1": {"delay": 0.0104}}, "sensors": {"joint_1": {"delay": 0.002}}}},
}


def scenario(actuator, *, preset=None, motion=STEP, duration=0.25, **keys):
    references = {"equilibrium_position": motion} | ({} if preset is None else {"stiffness_preset": preset})
    keys = {"duration": duration, "references": {"joint_1": references}, "modes": {"*": 6}} | keys
    return asrsim.make_scenario(EXAMPLES / "urdf" / f"dof1_{actuator}.urdf", engine="mujoco", **keys)


def errors(given, starts=None):
    """Differences of the links' positions in mrad."""
    starts = starts or [Start()]
    found = []
    for engine in (None, "mujoco_warp"):
        with asrsim.Worlds(given, len(starts), engine=engine, watched=False) as worlds:
            found.append(worlds.rollout(["link_position"], start=starts)["link_position"])
    assert np.ptp(found[0], axis=1).max() > 0.05
    return 1e3 * (found[1] - found[0])


def check(error):
    assert np.abs(error).max() < 3.0
    assert np.sqrt(np.mean(error**2)) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("motion", [STEP, SINE], ids=["step", "sine"])
@pytest.mark.parametrize(("actuator", "preset"), [("sea", None), ("qbmove", 0.2), ("bavs", 0.1), ("awas_ii", 0.02)])
def test_joints_move_as_in_asrsim(actuator, preset, motion):
    check(errors(scenario(actuator, preset=preset, motion=motion)))


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_a_drive_moves_as_in_asrsim(part):
    check(errors(scenario("sea", **PARTS[part])))


@pytest.mark.slow
def test_each_world_has_its_own_parameters_and_start():
    starts = [
        Start(parameters={"joint_1": {"spring_stiffness": k}}, positions={"joint_1": q}) for k, q in ((5.0, 0.1), (9.0, 0.0))
    ]
    error = errors(scenario("sea"), starts)
    check(error)


def test_references_are_set_and_worlds_are_reset_one_by_one():
    with asrsim.Worlds(scenario("qbmove", preset=0.2), 3, engine="mujoco_warp") as worlds:
        worlds.set_reference("joint_1", "equilibrium_position", np.array([0.3, -0.3, 0.0]))
        worlds.advance(3)
        before = worlds.observe()
        assert before.link_velocity[0, 0] > 0.0 > before.link_velocity[1, 0]
        worlds.reset(worlds=[1])
        worlds.advance(2, worlds=[1])
        after = worlds.observe()
        assert after.time.tolist() == pytest.approx([0.003, 0.002, 0.003])
        np.testing.assert_array_equal(after.link_position[[0, 2]], before.link_position[[0, 2]])


def test_energies_and_unknown_devices_are_refused():
    with pytest.raises(InputError, match="spring_energy"):
        asrsim.Worlds(scenario("sea"), 2, engine="mujoco_warp", names=["spring_energy"])
    with pytest.raises(InputError, match="no device 'tpu'"):
        asrsim.Worlds(scenario("sea"), 2, engine="mujoco_warp", device="tpu")


def test_environments_run_on_warp():
    pytest.importorskip("gymnasium")
    keys = {"control_rate": 500.0, "reward": lambda state: -abs(float(state.values["link_position"][0]))}
    with_warp = asrsim.make_vec_env(scenario("qbmove", preset=0.2), 3, engine="mujoco_warp", **keys)
    with_warp.reset(seed=1)
    seen, rewards, *_ = with_warp.step(np.array([[1.0], [-1.0], [0.0]]))
    with_warp.close()
    assert seen[0, 1] > 0.0 > seen[1, 1]
    assert (rewards[:2] < 0.0).all()
