"""The bench in the default stepping: motors start at rest, as in a simulation, and are right to second order."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import asrsim
from asrsim.engines.base import POSITION, VELOCITY
from asrsim.robot import load_robot
from asrsim.signals.sines import Sinusoid

INERTIA, DAMPING, TORQUE = 0.0233, 0.2698, 6.0
URDF = f"""<robot name="bench"><link name="base"/><link name="link"><inertial><mass value="1"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="300" velocity="100"/></joint>
<gazebo><plugin name="p" filename="libsea_plugin.so"><joint>joint</joint><operation_mode>5</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau><spring_k>0</spring_k>
<mot_J>{INERTIA}</mot_J><mot_D>{DAMPING}</mot_D><mot_tauMax>{TORQUE}</mot_tauMax><mot_tauFric>0</mot_tauFric>
<mot_maxVel>1000</mot_maxVel></plugin></gazebo></robot>"""


def locked(folder: Path, **keys: Any) -> asrsim.Scenario:
    (folder / "robot.urdf").write_text(URDF)
    return asrsim.make_scenario(folder / "robot.urdf", engine="bench", compiled=False, **keys)


def test_a_motor_that_starts_from_rest_is_right_to_second_order(tmp_path: Path) -> None:
    duration, lag = 0.01, INERTIA / DAMPING
    position = TORQUE / DAMPING * (duration - lag * (1 - math.exp(-duration / lag)))
    errors = []
    for step in (1e-3, 5e-4):
        found = asrsim.run(locked(tmp_path, duration=duration, step=step, references={"joint": {"reference_1": 5.0}}))["joint"]
        assert (found["motor_1_position"][0], found["motor_1_velocity"][0]) == (0.0, 0.0)
        errors.append(abs(found["motor_1_position"][-1] - position))
    assert errors[0] < 4e-5
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_a_bench_moves_as_its_signal_says_however_it_is_gone_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion is worked out a few steps ahead: forwards, back to a snapshot, and far ahead."""
    from asrsim.engines import bench

    monkeypatch.setattr(bench, "CHUNK", 8)
    scenario = locked(tmp_path, duration=0.1, references={"joint": {}})
    signal = Sinusoid(amplitude=0.5, frequency=7.0, phase=0.3)
    scenario = replace(scenario, motion={"joint": signal})
    engine = bench.BenchEngine(scenario, load_robot(scenario.robot))
    engine.start([0.0], [0.0], step=scenario.step, staggered=True, implicitness=0.5)
    exchange = np.zeros((1, 5))
    for row in (*range(1, 20), 3, 4, 90, 89, 1, 31, 32):
        engine.state = row - 1
        engine.step(exchange, np.zeros((0, 6)))
        before, here = signal.values(np.array([row - 1, row]) * scenario.step)
        assert exchange[0, POSITION] == pytest.approx(here, abs=1e-12)
        assert exchange[0, VELOCITY] == pytest.approx((here - before) / scenario.step, abs=1e-9)
