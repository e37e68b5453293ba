"""Coulomb friction of many joints: a joint sticks with less than its friction torque, or slides with all of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asrsim.engines import ENGINES
from asrsim.engines.base import FRICTION, TORQUE, VELOCITY, Engine
from asrsim.robot import load_robot
from asrsim.scenario.data import Scenario

STEP = 1e-5
JOINTS = 7


def chain(folder: Path, random: np.random.Generator) -> Path:
    """Write a chain of seven links with random axes and random friction."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for i in range(JOINTS):
        axis = " ".join(f"{x:.12g}" for x in random.normal(size=3))
        parts.append(f"""<link name="l{i + 1}"><inertial><origin xyz="0.02 0.01 {random.uniform(0.05, 0.2):.6g}"/>
<mass value="{random.uniform(0.1, 1):.6g}"/>
<inertia ixx="2e-3" iyy="3e-3" izz="4e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{i}" type="revolute"><origin xyz="0 0 0.2"/><parent link="l{i}"/><child link="l{i + 1}"/><axis xyz="{axis}"/>
<limit lower="-9" upper="9" effort="99" velocity="99"/><dynamics friction="{random.uniform(0, 3):.6g}"/></joint>""")
    path = folder / "chain.urdf"
    path.write_text("".join(parts) + "</robot>")
    return path


def step(engine: Engine, place: np.ndarray, before: np.ndarray, torque: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """Exchange array (joints, 5) after a step from the given state."""
    engine.start(place.tolist(), before.tolist(), step=STEP, staggered=False, implicitness=0.0)
    exchange = np.zeros((1, JOINTS, 5))
    exchange[0, :, TORQUE], exchange[0, :, FRICTION] = torque, friction
    engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
    return exchange[0]


@pytest.mark.parametrize("resting", [0, 3, 6, 7])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["mujoco", "bullet"])
def test_every_joint_sticks_or_slides(tmp_path: Path, name: str, seed: int, resting: int) -> None:
    random = np.random.default_rng([seed, resting])
    robot = load_robot(chain(tmp_path, random))
    engine, _ = ENGINES.get(name).make(Scenario(name="chain", robot=robot.path), robot)
    try:
        friction = np.array([joint.friction for joint in robot.moving_joints])
        kinds = set()
        for _ in range(20):
            place = random.uniform(-1.5, 1.5, JOINTS)
            before = random.uniform(-2.0, 2.0, JOINTS)
            before[random.permutation(JOINTS)[:resting]] = 0.0
            torque = random.uniform(-6.0, 6.0, JOINTS)
            after = step(engine, place, before, torque, friction)[:, VELOCITY]
            model = engine.model
            assert model is not None
            held = model.mass_matrix(place) @ (after - before) / STEP + model.bias(place, before) - torque
            assert np.all(np.abs(held) <= friction + 1e-6)
            sticks = np.abs(after) < 1e-9
            if np.all((before == 0.0) | (before * after > 0.0)):
                # No joint stops or reverses within the step.
                assert np.abs(held + np.sign(after) * friction)[~sticks] == pytest.approx(0.0, abs=1e-6)
                kinds |= {int(sticks.sum())}
        assert len(kinds) > 1 or resting == 0
    finally:
        engine.close()


@pytest.mark.parametrize("resting", [0, 3, 6])
def test_compiled_and_plain_friction_solvers_agree_bit_for_bit(tmp_path: Path, resting: int) -> None:
    """The solver uses `sqrt`, which has equal bits in plain Python and compiled code. The power 0.5 does not."""
    pytest.importorskip("numba")
    random = np.random.default_rng(resting)
    robot = load_robot(chain(tmp_path, random))
    plain, _ = ENGINES.get("mujoco").make(Scenario(name="chain", robot=robot.path), robot)
    compiled, _ = ENGINES.get("mujoco").make(Scenario(name="chain", robot=robot.path), robot)
    assert compiled.native is not None
    friction = np.array([joint.friction for joint in robot.moving_joints])
    for _ in range(700):  # one in a thousand powers differs
        place, before = random.uniform(-1.5, 1.5, JOINTS), random.uniform(-2.0, 2.0, JOINTS)
        before[random.permutation(JOINTS)[:resting]] = 0.0
        torque = random.uniform(-6.0, 6.0, JOINTS)
        ends = [step(engine, place, before, torque, friction).tolist() for engine in (plain, compiled)]
        assert ends[0] == ends[1]
