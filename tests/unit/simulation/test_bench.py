"""The bench in the default stepping: motors start at rest, as in a simulation, and are right to second order."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import asrsim
from asrsim.engines.base import POSITION, VELOCITY
from asrsim.robot import load_robot
from asrsim.signals.sines import Sinusoid
from asrsim.simulation.bench import Motion, run_bench

INERTIA, DAMPING, TORQUE = 0.0233, 0.2698, 6.0
URDF = f"""<robot name="bench"><link name="base"/><link name="link"><inertial><mass value="1"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="300" velocity="100"/></joint>
<gazebo><plugin name="p" filename="libsea_plugin.so"><joint>joint</joint><operation_mode>5</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau><spring_k>K</spring_k>
<mot_J>{INERTIA}</mot_J><mot_D>{DAMPING}</mot_D><mot_tauMax>{TORQUE}</mot_tauMax><mot_tauFric>0</mot_tauFric>
<mot_maxVel>1000</mot_maxVel></plugin></gazebo></robot>"""


def locked_link(folder: Path, *, stiffness: float, reference: float, step: float, duration: float) -> dict[str, np.ndarray]:
    (folder / "robot.urdf").write_text(URDF.replace("K<", f"{stiffness}<"))
    time = np.arange(round(duration / step) + 1) * step
    still = np.zeros_like(time)
    motion = Motion(position=still, velocity=still, reference_1=np.full_like(time, reference), reference_2=still)
    return run_bench(load_robot(folder / "robot.urdf"), time, {"joint": motion})["joint"]


def test_a_motor_that_starts_from_rest_is_right_to_second_order(tmp_path: Path) -> None:
    duration, lag = 0.01, INERTIA / DAMPING
    position = TORQUE / DAMPING * (duration - lag * (1 - math.exp(-duration / lag)))
    errors = []
    for step in (1e-3, 5e-4):
        found = locked_link(tmp_path, stiffness=0.0, reference=5.0, step=step, duration=duration)
        assert (found["motor_1_position"][0], found["motor_1_velocity"][0]) == (0.0, 0.0)
        errors.append(abs(found["motor_1_position"][-1] - position))
    assert errors[0] < 4e-5
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_bench_and_simulation_with_prescribed_motion_agree(tmp_path: Path) -> None:
    found = locked_link(tmp_path, stiffness=20.0, reference=0.3, step=1e-3, duration=0.2)
    scenario = asrsim.make_scenario(
        tmp_path / "robot.urdf", duration=0.2, engine="bench", references={"joint": {"reference_1": 0.3}}
    )
    series = asrsim.run(scenario)["joint"]
    for name in ("motor_1_position", "motor_1_velocity", "link_torque"):
        np.testing.assert_allclose(found[name], series[name], rtol=0, atol=1e-12)


def test_a_bench_moves_as_its_signal_says_however_it_is_gone_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion is worked out a few steps ahead: forwards, back to a snapshot, and far ahead."""
    from asrsim.engines import bench

    monkeypatch.setattr(bench, "CHUNK", 8)
    locked_link(tmp_path, stiffness=20.0, reference=0.3, step=1e-3, duration=0.01)
    scenario = asrsim.make_scenario(tmp_path / "robot.urdf", duration=0.1, engine="bench", references={"joint": {}})
    signal = Sinusoid(amplitude=0.5, frequency=7.0, phase=0.3)
    scenario = replace(scenario, motion={"joint": signal})
    engine = bench.BenchEngine(scenario, load_robot(scenario.robot))
    engine.start([0.0], [0.0], step=scenario.step, staggered=True, implicitness=0.5)
    exchange = np.zeros((1, 1, 5))
    for row in (*range(1, 20), 3, 4, 90, 89, 1, 31, 32):
        engine.state = row - 1
        engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
        before, here = signal.values(np.array([row - 1, row]) * scenario.step)
        assert exchange[0, 0, POSITION] == pytest.approx(here, abs=1e-12)
        assert exchange[0, 0, VELOCITY] == pytest.approx((here - before) / scenario.step, abs=1e-9)
