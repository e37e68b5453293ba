"""Plan a whip motion of a soft arm in plain MuJoCo, and simulate the plan in asrsim.

The plan makes the tip as fast as possible after 0.8 s. `export` writes the arm with motors, springs and friction.
The cross-entropy method plans; `mujoco.rollout` simulates all its candidates in one call.

    python plan_whip.py urdf/two_elastic_joints.urdf
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

import asrsim
from asrsim.exports import export

DURATION, CANDIDATES, ELITE, ROUNDS = 0.8, 96, 12, 12
KNOTS = np.linspace(0.0, DURATION, 7)
"""Times of the motor setpoints, s; the setpoints are interpolated between them. The first time is the start."""
LIMIT = 0.6
"""Largest motor setpoint, rad."""
FASTEST = 6.0
"""Speed limit of the motors, rad/s. A plan with lower speeds does not depend on how a simulator limits the speed."""


def main(robot: Path) -> None:
    """Plan the motion, and compare the tip speeds in both simulators."""
    scenario = asrsim.make_scenario(robot=robot, duration=DURATION, engine="mujoco", gravity=[0.0, 0.0, 0.0])
    with tempfile.TemporaryDirectory() as folder:
        exported = export(scenario, Path(folder) / "arm.xml", plot=False)
        model = mujoco.MjModel.from_xml_path(str(exported.files[0]))
    steps = round(DURATION / model.opt.timestep)
    joints = exported.replay.joints
    speeds = [1 + model.nq + int(model.joint(name).dofadr[0]) for name in joints]
    motors = [1 + model.nq + int(model.joint(model.actuator(i).name).dofadr[0]) for i in range(model.nu)]
    start = np.zeros((CANDIDATES, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    data = [mujoco.MjData(model) for _ in range(2)]
    generator = np.random.default_rng(0)
    mean, spread = np.zeros((len(KNOTS) - 1, model.nu)), 0.4

    def goals(plans: np.ndarray) -> np.ndarray:
        """Motor setpoints (plans, steps, motors) at every step, interpolated from plans (plans, knots, motors)."""
        table = np.concatenate([np.zeros((len(plans), 1, model.nu)), np.clip(plans, -LIMIT, LIMIT)], axis=1)
        place = np.arange(steps) * model.opt.timestep
        return np.stack([[np.interp(place, KNOTS, row) for row in plan.T] for plan in table]).transpose(0, 2, 1)

    for _ in range(ROUNDS):
        plans = mean + spread * generator.normal(size=(CANDIDATES, *mean.shape))
        states, _ = rollout.rollout(model, data, start, goals(plans))
        # The angular velocity of the outer link is the sum of the joint velocities.
        excess = np.maximum(np.abs(states[:, :, motors]) - FASTEST, 0.0).max(axis=(1, 2))
        reached = states[:, -1, speeds].sum(axis=1) - 10.0 * excess
        best = np.argsort(-reached)[:ELITE]
        mean, spread = plans[best].mean(axis=0), plans[best].std(axis=0) + 0.01
    plan = goals(mean[None])
    planned = rollout.rollout(model, data[:1], start[:1], plan)[0][0, -1, speeds].sum()

    with asrsim.Simulation(scenario) as simulation:
        for row in plan[0]:
            for joint, goal in zip(joints, row, strict=True):
                simulation.set_reference(joint, "equilibrium_position", float(goal))
            simulation.advance()
        real = simulation.observe().link_velocity.sum()
    print(f"planned in MuJoCo: {planned:.2f} rad/s; in asrsim: {real:.2f} rad/s")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
