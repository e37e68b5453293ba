"""Worlds on Warp move as asrsim's own worlds do: laws are the same, numbers have single precision."""

import re

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.plugins import load_plugin_file
from asrsim.simulation.start import Start
from support.paths import EXAMPLES, ROOT

pytest.importorskip("mujoco_warp", reason='needs the extra "warp"')

STEP, SINE = {"step": {"at": 0.05, "to": 0.8}}, {"sinusoid": {"amplitude": 0.6, "frequency": 2.0}}
PARTS = {
    "integral action": {"parameters": {"joint_1": {"controller_1_integral": 50.0}}},
    "motor friction": {"parameters": {"joint_1": {"motor_1_friction_torque": 0.3, "motor_1_stribeck_friction": 0.3}}},
    "hysteresis": {"parameters": {"joint_1": {"hysteresis_torque": 0.3, "hysteresis_deflection": 0.02}}},
    "damper": {"parameters": {"joint_1": {"spring_damping": 0.1}}},
    "backlash": {"parameters": {"joint_1": {"backlash": 0.05}}},
    "heating": {"parameters": {"joint_1": {"thermal_resistance": 2.0, "thermal_capacity": 0.2, "winding_heat": 50.0}}},
    "delay": {"imperfections": {"commands": {"joint_1": {"delay": 0.0104}}, "sensors": {"joint_1": {"delay": 0.002}}}},
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


def check(error, most=0.01):
    """Bounds in mrad are those of docs/worlds.md."""
    assert np.abs(error).max() < most


@pytest.mark.slow
@pytest.mark.parametrize("motion", [STEP, SINE], ids=["step", "sine"])
@pytest.mark.parametrize(("actuator", "preset"), [("sea", None), ("qbmove", 0.2), ("bavs", 0.1), ("awas_ii", 0.02)])
def test_joints_move_as_in_asrsim(actuator, preset, motion):
    check(errors(scenario(actuator, preset=preset, motion=motion)))


@pytest.mark.slow
def test_an_actuator_of_a_user_moves_as_in_asrsim():
    load_plugin_file(EXAMPLES / "plugins" / "my_vsa.py")
    check(errors(scenario("qbmove", preset=0.2, actuators={"joint_1": {"type": "my_vsa", "mode": 6}})))


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_a_drive_moves_as_in_asrsim(part):
    # A torque that falls with the temperature has the rounding of both.
    check(errors(scenario("sea", **PARTS[part])), 0.02 if part == "heating" else 0.01)


@pytest.mark.slow
def test_a_part_between_motor_and_ground_moves_as_in_asrsim(tmp_path):
    text = (ROOT / "docs" / "stages.md").read_text(encoding="utf-8").partition("### Between motor and ground")[2]
    (tmp_path / "ripple.py").write_text(text.partition("```python\n")[2].partition("```")[0])
    load_plugin_file(tmp_path / "ripple.py")
    check(errors(scenario("sea", parameters={"joint_1": {"ripple_torque": 0.5}})))


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "most"), [({"sinusoid": {"amplitude": 0.4, "frequency": 1.0}}, 0.07), (STEP, 0.7)])
def test_five_joints_move_as_in_asrsim(motion, most):
    """Only the CPU's worlds have Coriolis torques of second order: fast motions differ more than slow ones."""
    references = {"*": {"equilibrium_position": motion, "stiffness_preset": 0.2}}
    robot = EXAMPLES / "urdf" / "dof5_arm.urdf"
    error = errors(asrsim.make_scenario(robot, engine="mujoco", duration=0.2, references=references, modes={"*": 6}))
    check(error, most)


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


@pytest.mark.parametrize("push", [1e12, 1e38], ids=["runs away", "has no number"])
def test_a_world_that_diverges_is_told_and_stops_alone_until_it_is_reset(push):
    with asrsim.Worlds(scenario("sea", duration=1.0), 2, engine="mujoco_warp") as worlds:
        worlds.set_reference("joint_1", "external_torque", np.array([push, 0.0]))
        worlds.advance(20)
        assert worlds.healthy.tolist() == [False, True]
        assert worlds.time[1] == pytest.approx(0.02)
        worlds.reset(worlds=[0])
        worlds.advance(1)
        assert worlds.healthy.all()


@pytest.mark.slow
def test_the_page_on_worlds_does_what_it_says(monkeypatch, capsys):
    lines = (ROOT / "docs" / "worlds.md").read_text().splitlines()
    monkeypatch.chdir(ROOT)
    found = {}
    exec("\n".join(line[4:] for line in lines if line.startswith("    ") or not line), found)
    assert len(re.findall(r"-?\d+\.\d+", capsys.readouterr().out)) == 64
    assert found["shared"].shape == (64, 2)


def test_the_state_on_the_device_is_shared_without_copies():
    with asrsim.Worlds(scenario("qbmove", preset=0.2), 3, engine="mujoco_warp") as worlds:
        shared = {name: array.numpy() for name, array in worlds.device_arrays().items()}
        worlds.set_reference("joint_1", "equilibrium_position", np.array([0.3, -0.3, 0.0]))
        worlds.advance(3)
        seen = worlds.observe()
        np.testing.assert_array_equal(shared["link_position"], seen.link_position)
        np.testing.assert_array_equal(shared["link_velocity"], seen.link_velocity)
        np.testing.assert_array_equal(shared["motor_2_velocity"], seen.motor_velocity[..., 1])
    with asrsim.Worlds(scenario("qbmove", preset=0.2), 1) as plain, pytest.raises(InputError, match="only worlds on Warp"):
        plain.device_arrays()


def test_torch_shares_the_state_on_the_device():
    pytest.importorskip("torch")
    import warp

    with asrsim.Worlds(scenario("sea"), 2, engine="mujoco_warp") as worlds:
        positions = warp.to_torch(worlds.device_arrays()["link_position"])
        worlds.advance(60)
        assert (positions > 0.0).all()
        np.testing.assert_array_equal(positions.numpy(), worlds.observe().link_position)


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


@pytest.mark.slow
@pytest.mark.parametrize("actuator", ["sea", "qbmove"])
def test_a_link_meets_its_stop_as_in_asrsim(tmp_path, actuator):
    """The link arrives at about 4 rad/s, rests at the stop, and leaves it."""
    text = (EXAMPLES / "urdf" / f"dof1_{actuator}.urdf").read_text()
    stopped = text.replace('type="continuous"', 'type="revolute"').replace("<limit ", '<limit lower="-0.4" upper="0.4" ')
    assert stopped.count('upper="0.4"') == 1
    (tmp_path / "robot.urdf").write_text(stopped)
    there_and_back = {"sum": [{"step": {"at": 0.05, "to": 1.0}}, {"step": {"at": 0.4, "to": -1.2}}]}
    references = {"equilibrium_position": there_and_back} | ({} if actuator == "sea" else {"stiffness_preset": 0.1})
    given = asrsim.make_scenario(
        tmp_path / "robot.urdf", engine="mujoco", duration=0.6, references={"joint_1": references}, modes={"*": 6}
    )
    check(errors(given), 0.02)
