"""Observed quantities of simulated worlds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.samples import Array
from asrsim.simulation.quantities import recorded_quantities
from asrsim.simulation.worlds import Worlds

_LINKS = ("link_position", "link_velocity")
_MOTORS = ("motor_1_position", "motor_1_velocity", "motor_2_position", "motor_2_velocity")
"""Quantities of the state at the present time. The positions of ideal motors are those of the last step."""
_STEP = (
    "link_torque", "damping_torque", "elastic_torque_1", "elastic_torque_2", "motor_1_torque", "motor_2_torque",
    "friction_torque_1", "friction_torque_2", "reference_1", "reference_2", "external_torque", "stiffness",
)  # fmt: skip
"""Quantities that belong to a step. Their values are those of the last step or, at the start of an episode, of the first
step."""
TIP = "tip"
KNOWN = (*_LINKS, *_MOTORS, *_STEP, TIP)
BEYOND = 1e-3
"""Margin of observed positions beyond the stops, rad or m, since observations are rounded to single precision."""


class Readings:
    """Reader of the observed quantities: arrays (N, n) for N worlds, over the joints that have them."""

    def __init__(self, source: Worlds, names: Sequence[str], tip: tuple[str, Sequence[float]] | None) -> None:
        self._source, self._tip, self._names = source, tip, tuple(names)
        drives = source.prepared.drives
        recorded = [recorded_quantities(drive) for drive in drives]
        problems = []
        self._joints: dict[str, list[int]] = {}
        for name in names:
            self._joints[name] = [j for j, own in enumerate(recorded) if name in own]
            if name not in KNOWN or (name == TIP and tip is None) or not (self._joints[name] or name == TIP):
                why = "exists for no joint in its mode" if name in KNOWN else "cannot be observed here"
                why = "needs the option tip" if name == TIP else why
                hint = None if name in KNOWN else did_you_mean(name, KNOWN)
                problems.append(Problem(f"'{name}' {why}", choices=KNOWN, hint=hint, code="unknown-quantity"))
        model = source.model
        if tip is not None and model is None:
            problems.append(
                Problem("the engine prescribes the motion, so no model gives the position of a tip", code="no-model")
            )
        elif tip is not None and model is not None and tip[0] not in model.links:
            problems.append(Problem(f"the robot has no link '{tip[0]}'", choices=model.links, code="unknown-link"))
        if not names:
            problems.append(Problem("the option observe names no quantity", choices=KNOWN, code="no-quantity"))
        if problems:
            raise InputError(problems)
        self._logged = [name for name in names if name in (*_STEP, *_MOTORS)]

    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper bounds of the observed values; infinite where a value is unbounded."""
        low: list[float] = []
        high: list[float] = []
        stops = [drive.joint.stops for drive in self._source.prepared.drives]
        for name, joints in self._joints.items():
            if name == "link_position":
                low += [stops[j][0] - BEYOND for j in joints]
                high += [stops[j][1] + BEYOND for j in joints]
            else:
                count = 3 if name == TIP else len(joints)
                low += [-np.inf] * count
                high += [np.inf] * count
        return low, high

    def read(self) -> dict[str, Array]:
        """Present values (N, n) of each quantity in SI units."""
        state = self._source.observe()
        step = self._source.read(self._logged) if self._logged else {}
        return {name: self._one(name, joints, state, step) for name, joints in self._joints.items()}

    def _one(self, name: str, joints: list[int], state: Any, step: dict[str, Array]) -> Array:
        if name == TIP:
            return self._tip_position(state.link_position)
        if name in _STEP:
            return step[name][..., joints]
        values = np.asarray(getattr(state, name))[..., joints]
        # Ideal motors have no state: their values come from the last step.
        return np.where(np.isnan(values), step[name][..., joints], values) if name in _MOTORS else values

    def _tip_position(self, positions: Array) -> Array:
        model, tip = self._source.model, self._tip
        if model is None or tip is None:
            raise RuntimeError("the tip was checked before")
        x, y, z = tip[1]
        return model.pose(positions, tip[0], (x, y, z))[0]
