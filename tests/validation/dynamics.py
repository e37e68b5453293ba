"""Checks of the engines' rigid-body dynamics against Pinocchio, for the example robots and for rotated bases."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.robot import Robot, engine_urdf, load_robot
from asrsim.samples import Array
from asrsim.scenario import Scenario
from asrsim.simulation.prepared import make_engine
from validation.check import Check
from validation.check import engine as current
from validation.models import Body, chain, run

EXAMPLES = Path(__file__).parents[2] / "examples" / "urdf"
TURN = (0.3, -0.5, 1.1)
"""Roll, pitch and yaw of the rotated base, rad."""
GRAVITY = (0.0, 0.0, -9.81)
SAMPLES = 20


class Twin:
    """Pinocchio model of a robot with joints in asrsim's order. rpy: rotation of the base, rad."""

    def __init__(self, robot: Robot, rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        import pinocchio as pin

        self.pin = pin
        text, _ = engine_urdf(robot)
        with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(text, encoding="utf-8")
            self.model = pin.buildModelFromUrdf(str(path))
        turn = pin.rpy.rpyToMatrix(*rpy)
        self.model.gravity.linear = turn.T @ np.array(GRAVITY)
        self.data = self.model.createData()
        names = [joint.name for joint in robot.moving_joints]
        ids = [self.model.getJointId(name) for name in names]
        self.order = [self.model.joints[i].idx_v for i in ids]
        self._wide = [(self.model.joints[i].idx_q, self.model.joints[i].nq) for i in ids]

    def configuration(self, q: Array) -> Array:
        """Configuration in Pinocchio's form, in which a continuous joint is a cosine and a sine."""
        values = np.zeros(self.model.nq)
        for angle, (index, width) in zip(q, self._wide, strict=True):
            values[index : index + width] = angle if width == 1 else (math.cos(angle), math.sin(angle))
        return values

    def _there(self, v: Array) -> Array:
        values = np.zeros(self.model.nv)
        values[self.order] = v
        return values

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix (n, n)."""
        upper = np.triu(self.pin.crba(self.model, self.data, self.configuration(q)))
        full = upper + np.triu(upper, 1).T
        return np.asarray(full[np.ix_(self.order, self.order)])

    def gravity(self, q: Array) -> Array:
        """Joint torques (n,) that compensate gravity, N m."""
        return np.asarray(self.pin.computeGeneralizedGravity(self.model, self.data, self.configuration(q))[self.order])

    def bias(self, q: Array, v: Array) -> Array:
        """Velocity and gravity torques (n,), N m."""
        return np.asarray(self.pin.nonLinearEffects(self.model, self.data, self.configuration(q), self._there(v))[self.order])

    def acceleration(self, q: Array, v: Array, torque: Array) -> Array:
        """Joint accelerations (n,), rad/s^2."""
        found = self.pin.aba(self.model, self.data, self.configuration(q), self._there(v), self._there(torque))
        return np.asarray(found[self.order])


def robots() -> Iterator[tuple[str, Robot]]:
    """Yield the example robots and a chain with axes in all directions, with their names."""
    for path in sorted(EXAMPLES.glob("*.urdf")):
        yield path.stem, load_robot(path)
    yield "chain of 4, axes x, y, z, oblique", spatial_chain()


def spatial_chain(**changes: Any) -> Robot:
    """Chain of four joints about x, y, z and an oblique axis."""
    body = Body(mass=0.5, reach=0.06, inertia=4e-4, length=0.12, **changes)
    return chain(*(replace(body, axis=axis) for axis in ("1 0 0", "0 1 0", "0 0 1", "0.6 0.0 0.8")))


def rigid_body() -> Iterator[Check]:
    """Errors of mass matrix, gravity torques and velocity torques at random states."""
    for name, robot in robots():
        for label, rpy in (("", (0.0, 0.0, 0.0)), (", base turned", TURN)):
            twin = Twin(robot, rpy)
            scenario = Scenario(name="check", robot=robot.path, gravity=GRAVITY, base_rpy=rpy, engine=current())
            engine, _ = make_engine(scenario, robot)
            worst = np.zeros(3)
            source = np.random.default_rng(1)
            try:
                for _ in range(SAMPLES):
                    q, v, u = source.uniform(-1.5, 1.5, (3, len(robot.moving_joints)))
                    worst = np.maximum(worst, _distances(engine, twin, q, v, u))
            finally:
                engine.close()
            for what, error in zip(("mass matrix", "gravity torques", "velocity torques"), worst, strict=True):
                yield Check(
                    name=f"{what}, {name}{label}", figure=float(error), bound=1e-12, source="Pinocchio, share of the largest"
                )


def _distances(engine: Any, twin: Twin, q: Array, v: Array, u: Array) -> Array:
    mass = twin.mass_matrix(q)
    gravity = twin.gravity(q)
    there = twin.bias(q, v) - twin.bias(q, u)
    model, still = engine.model, np.zeros(len(q))
    difference = model.bias(q, v) - model.bias(q, u)
    return np.array([
        np.max(np.abs(model.mass_matrix(q) - mass)) / np.max(np.abs(mass)),
        np.max(np.abs(model.bias(q, still) - gravity)) / max(np.max(np.abs(gravity)), 1e-3),
        np.max(np.abs(difference - there)) / max(np.max(np.abs(there)), 1e-3),
    ])  # fmt: skip


def spatial_swing() -> Iterator[Check]:
    """Error of a simulated free swing in space against Pinocchio's forward dynamics, integrated by DOP853."""
    from scipy.integrate import solve_ivp

    robot = spatial_chain()
    n = len(robot.moving_joints)
    start = [0.8, 0.5, -0.4, 0.6]
    for label, rpy in (("base upright", (0.0, 0.0, 0.0)), ("base turned", TURN)):
        twin = Twin(robot, rpy)

        def derivative(t: float, state: Array, twin: Twin = twin) -> Array:
            return np.concatenate([state[n:], twin.acceleration(state[:n], state[n:], np.zeros(n))])

        truth = solve_ivp(
            derivative, (0.0, 0.6), [*start, *[0.0] * n], method="DOP853", rtol=1e-11, atol=1e-12, t_eval=np.arange(601) * 1e-3
        )
        errors = []
        for step in (1e-3, 2.5e-4):
            result = run(robot, initial=start, duration=0.6, step=step, base_rpy=rpy)
            if result.samples is not None:
                positions = result.samples.values["link_position"][:: round(1e-3 / step)]
                errors.append(float(np.max(np.abs(positions - truth.y[:n].T))))
        name = f"free swing in space, 4 joints, {label}"
        yield Check(name=name, figure=errors[0], bound=2e-3, unit="rad", source="Pinocchio and DOP853")
        order = math.log(errors[0] / errors[1]) / math.log(4.0)
        yield Check(name=f"order of a swing in space, {label}", figure=order, bound=1.8, at_least=True, source="2")
