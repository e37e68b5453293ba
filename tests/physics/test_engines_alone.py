"""PyBullet without an importable MuJoCo gives the same motion as MuJoCo.

Both engines share the time stepping and the solver for friction and stops, but have separate models of the robot.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from asrsim.engines import ENGINES
from asrsim.scenario import load_scenario
from asrsim.simulation.examine import examine

pytestmark = pytest.mark.skipif(not ENGINES.get("bullet").available, reason="PyBullet has no wheel here")
AXES = ("0 1 0", "1 0 0", "0 1 0.3", "0 0 1", "1 0 1")
RUN = """
import json, sys
sys.modules["mujoco"] = None
sys.path.insert(0, sys.argv[1])
import test_engines_alone
print(json.dumps(test_engines_alone.motion("bullet", sys.argv[2], stops=True).tolist()))
"""


def chain(folder):
    """Write a chain of five hinges with narrow position limits."""
    inertial = (
        '<inertial><origin xyz="0.05 0.01 -0.1"/><mass value="0.5"/>'
        '<inertia ixx="2e-3" iyy="3e-3" izz="2.5e-3" ixy="1e-4" ixz="0" iyz="0"/></inertial>'
    )
    links = "".join(f'<link name="l{i}">{inertial}</link>' for i in range(6))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><origin xyz="0 0 -0.2"/><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<axis xyz="{axis}"/><limit lower="-0.6" upper="0.5" effort="100" velocity="100"/></joint>'
        for i, axis in enumerate(AXES)
    )
    (folder / "robot.urdf").write_text(f'<robot name="chain">{links}{joints}</robot>')
    path = folder / "s.yaml"
    path.write_text("robot: robot.urdf\nduration: 1\nwrenches: [{link: l4, force: [1, 0, 0], point: [0, 0, -0.1]}]\n")
    return path


def make(engine, path):
    (scenario,) = load_scenario(path)
    return ENGINES.get(engine).make(scenario, examine(scenario).robot)[0]


def motion(engine, path, *, stops=False, friction=0.05):
    """Positions (400, 5) in 0.4 s with oscillating torques, friction and damping, rad."""
    world = make(engine, path)
    world.start([0.1, -0.2, 0.3, 0.0, 0.1], [2.0, -1.0, 3.0, 1.0, -2.0], step=1e-3, staggered=True, implicitness=0.5)
    exchange, wrenches = np.zeros((1, 5, 6)), np.zeros((1, 1, 6))
    exchange[..., 3:5] = 0.02, friction
    wrenches[0, 0, :3] = 1.0, 0.5, -0.3
    rows = []
    for step in range(400):
        exchange[0, :, 2] = 0.5 * np.sin(0.02 * step + np.arange(5))
        world.step(exchange, wrenches, np.array([1.0 if step else 0.5]))
        rows.append(exchange[0, :, 0].copy())
    world.close()
    found = np.array(rows)
    assert not stops or (np.isclose(found, 0.5, atol=1e-9) | np.isclose(found, -0.6, atol=1e-9)).any()
    return found


def test_pybullet_without_mujoco_agrees_on_friction_and_stops(tmp_path):
    path = chain(tmp_path)
    arguments = [sys.executable, "-c", RUN, str(Path(__file__).parent), str(path)]
    alone = json.loads(subprocess.run(arguments, capture_output=True, text=True, check=True).stdout)
    np.testing.assert_allclose(alone, motion("mujoco", path), rtol=0, atol=1e-6)
