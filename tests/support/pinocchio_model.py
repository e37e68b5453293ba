"""Dynamics of a URDF, computed by Pinocchio, and their differences from those of an engine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from asrsim.engines.base import TORQUE, VELOCITY
from asrsim.robot.model import Robot

Array = np.ndarray


class PinocchioModel:
    """Model of URDF text. Arrays are in the order of `joints`; gravity in the frame of the base, m/s^2."""

    def __init__(self, text: str, joints: Sequence[str], gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> None:
        import pinocchio

        self.library, self.model = pinocchio, pinocchio.buildModelFromXML(text)
        self.model.gravity.linear = np.array(gravity)
        self.data = self.model.createData()
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in joints]
        self.order = [joint.idx_v for joint in self.joints]

    def configuration(self, q: Array) -> Array:
        """Positions in Pinocchio's form, in which a continuous joint is a cosine and a sine."""
        values = np.zeros(self.model.nq)
        for angle, joint in zip(q, self.joints, strict=True):
            values[joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else (math.cos(angle), math.sin(angle))
        return values

    def velocity(self, v: Array) -> Array:
        """Velocities in Pinocchio's order."""
        values = np.zeros(self.model.nv)
        values[self.order] = v
        return values

    def energy(self, q: Array, v: Array) -> float:
        """Kinetic and potential energy, J."""
        return float(self.library.computeMechanicalEnergy(self.model, self.data, self.configuration(q), self.velocity(v)))

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix (n, n)."""
        upper = np.triu(self.library.crba(self.model, self.data, self.configuration(q)))
        return np.asarray((upper + np.triu(upper, 1).T)[np.ix_(self.order, self.order)])

    def bias(self, q: Array, v: Array) -> Array:
        """Velocity and gravity torques (n,), N m."""
        found = self.library.nonLinearEffects(self.model, self.data, self.configuration(q), self.velocity(v))
        return np.asarray(found[self.order])


def differences(engine: Any, truth: PinocchioModel, q: Array, v: Array) -> Array:
    """Errors (3,) of an engine's mass matrix, gravity torques and torques in motion, relative to the largest torque, from
    single steps of a robot without stops."""

    def acceleration(velocity: Array, torque: Array) -> Array:
        exchange = np.zeros((1, len(q), 6))
        exchange[0, :, TORQUE] = torque
        engine.start(q, velocity, step=1.0, staggered=False, implicitness=0.5)
        engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
        return np.asarray(exchange[0, :, VELOCITY] - velocity)

    still, mass, push = np.zeros(len(q)), truth.mass_matrix(q), np.ones(len(q))
    falls = acceleration(still, still)
    pairs = (
        (mass @ (acceleration(still, push) - falls), push, 0.0),
        (-mass @ falls, truth.bias(q, still), 1e-3),
        (-mass @ acceleration(v, still), truth.bias(q, v), 1e-3),
    )
    return np.array([np.abs(ours - true).max() / max(np.abs(true).max(), least) for ours, true, least in pairs])


def without_stops(robot: Robot) -> Robot:
    """The robot without joint limits."""
    return replace(robot, joints=tuple(replace(joint, lower=None, upper=None) for joint in robot.joints))
