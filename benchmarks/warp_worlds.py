"""CPU time that a step of a world takes on Warp: 2,048 one-joint qbMoves, 1 ms."""

import time
from pathlib import Path

import asrsim

WORLDS, STEPS = 2048, 20
ROBOT = Path(__file__).parents[1] / "examples" / "urdf" / "dof1_qbmove.urdf"
REFERENCES = {"joint_1": {"equilibrium_position": 0.3, "stiffness_preset": 0.2}}

if __name__ == "__main__":
    scenario = asrsim.make_scenario(ROBOT, engine="mujoco", duration=2.0, references=REFERENCES, modes={"*": 6})
    with asrsim.Worlds(scenario, WORLDS, engine="mujoco_warp", names=["link_position"]) as worlds:
        worlds.advance(5)
        start = time.process_time()
        worlds.advance(STEPS)
        spent = time.process_time() - start
    print(f"{1e6 * spent / STEPS / WORLDS:.1f} us a world and step ({worlds.substeps} substeps)")
