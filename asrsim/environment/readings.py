"""Values of the quantities that are observed in simulated worlds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.quantities import MOST_MOTORS, each_motor
from asrsim.robot.dynamics import robot_model
from asrsim.samples import Array, picking
from asrsim.simulation.quantities import recorded_quantities
from asrsim.simulation.worlds import Worlds

_LINKS = ("link_position", "link_velocity")
_MOTORS = {f"motor_{i + 1}_{what}": (f"motor_{what}", i) for i in range(MOST_MOTORS) for what in ("position", "velocity")}
"""Quantities of the motors at the present time: name of the field of the worlds' observation, and index of the motor in this
field. For motors without dynamics, the positions are the positions of the last step.
"""
_STEP = (
    "link_torque",
    "damping_torque",
    *each_motor("elastic_torque_{}"),
    *each_motor("motor_{}_torque"),
    *each_motor("friction_torque_{}"),
    *each_motor("reference_{}"),
    "external_torque",
    "stiffness",
)
"""Quantities that belong to a step rather than to a time. Their values are the values of the last step, or, at the start of an
episode, of the first step.
"""
TIP = "tip"
KNOWN = (*_LINKS, *_MOTORS, *_STEP, TIP)
BEYOND = 1e-3
"""Distance in rad or m beyond the stops up to which observed positions are allowed, since they are rounded to single
precision."""


class Links(NamedTuple):
    """Positions and velocities of the links only, which are read faster than an observation that also contains the motors."""

    link_position: Array
    link_velocity: Array


class Readings:
    """Reader of the observed quantities. It gives arrays (N, n) for N worlds and the n joints that have the quantity."""

    def __init__(self, source: Worlds, names: Sequence[str], tip: tuple[str, Sequence[float]] | None) -> None:
        self._source, self._tip = source, tip
        drives = source.prepared.drives
        recorded = [recorded_quantities(drive) for drive in drives]
        problems = []
        choices = tuple(name for name in KNOWN if name == TIP or any(name in own for own in recorded))
        self._joints: dict[str, Any] = {}
        """Indices of the joints that have each quantity, by name of the quantity."""
        for name in names:
            having = [j for j, own in enumerate(recorded) if name in own]
            self._joints[name] = picking(having or [0])
            if name not in KNOWN or (name == TIP and tip is None) or not (having or name == TIP):
                why = (
                    "is recorded for no joint in its operation mode"
                    if name in KNOWN
                    else "is no quantity that an environment can observe"
                )
                why = "needs the option tip" if name == TIP else why
                hint = None if name in KNOWN else did_you_mean(name, KNOWN)
                problems.append(Problem(f"'{name}' {why}", key="observe", choices=choices, hint=hint, code="unknown-quantity"))
        self._model = robot_model(source.prepared.scenario, source.prepared.robot)
        if tip is not None and tip[0] not in self._model.links:
            problems.append(
                Problem(f"the robot has no link '{tip[0]}'", key="tip", choices=self._model.links, code="unknown-link")
            )
        if not names:
            problems.append(Problem("must name at least one quantity", key="observe", choices=choices, code="no-quantity"))
        if problems:
            raise InputError(problems)
        self._moved = any(name in _MOTORS for name in names)
        self._logged = [name for name in names if name in (*_STEP, *_MOTORS)]

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the observed values, in the order in which `read` gives them; infinite without a bound."""
        parts = []
        for name, joints in self._joints.items():
            part = np.full((2, len(self._source.joints)), np.inf)
            if name == "link_position":
                part = np.array([-self._model.lower, self._model.upper]) + BEYOND
            parts.append(np.full((2, 3), np.inf) if name == TIP else part[:, joints])
        low, high = np.concatenate(parts, axis=1)
        return -low, high

    def read(self) -> dict[str, Array]:
        """Present values (N, n) of each observed quantity in SI units, by name."""
        state = self._source.observe() if self._moved else Links(*self._source.links())
        step = self._source.read(self._logged) if self._logged else {}
        return {name: self._one(name, joints, state, step) for name, joints in self._joints.items()}

    def _one(self, name: str, joints: Any, state: Any, step: dict[str, Array]) -> Array:
        if name == TIP and self._tip is not None:
            link, (x, y, z) = self._tip
            return self._model.pose(state.link_position, link, (x, y, z))[0]
        if name in _STEP:
            return step[name][..., joints]
        if name in _LINKS:
            return np.asarray(getattr(state, name))[..., joints]
        field, motor = _MOTORS[name]
        motors = getattr(state, field)
        logged = step[name][..., joints]
        if motor >= motors.shape[-1]:
            return logged
        # Motors without dynamics have no state, so use their values of the last step.
        values = motors[..., joints, motor]
        return np.where(np.isnan(values), logged, values)
