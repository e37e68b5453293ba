"""Derived quantities, which are computed from logged quantities and never stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.base import MOST_MOTORS
from asrsim.actuators.vectorised import over_arrays
from asrsim.samples import Array, JointInfo, Samples, picking

_IDEAL_MOTORS = tuple(mode.number for mode in MODES.values() if mode.spring and not mode.motor)


def equilibrium_position(samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """Equilibrium positions (n, joints), rad: link positions at which the elastic torque is zero; NaN without motors.

    joints: Joints of the log (`RunInfo.joints`), matched by name. Positions of ideal motors (modes 2, 3) that are not recorded
    equal the references.
    """
    result = np.full((len(samples.joints), len(samples.time)), np.nan)
    for (actuator, mode), rows in _kinds(samples, joints):
        result[rows] = _mapped(samples, actuator, "motor_{}_position", rows)
        if mode in _IDEAL_MOTORS:
            unknown = np.arange(len(result))[rows][np.isnan(_rows(samples, "motor_1_position")[rows]).all(axis=1)]
            result[unknown] = _reference_position(samples, actuator, mode, unknown)
    return result.T


def deflection(samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """Deflections (n, joints), rad: equilibrium position minus link position."""
    return equilibrium_position(samples, joints) - _rows(samples, "link_position").T


def position_error(samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """Position errors (n, joints), rad: position reference minus link position; NaN in the torque modes (0, 4)."""
    position = _rows(samples, "link_position")
    result = np.full(position.shape, np.nan)
    for (actuator, mode), rows in _kinds(samples, joints):
        result[rows] = _reference_position(samples, actuator, mode, rows) - position[rows]
    return result.T


DERIVED_FUNCTIONS: dict[str, Callable[[Samples, Sequence[JointInfo]], Array]] = {
    "deflection": deflection,
    "equilibrium_position": equilibrium_position,
    "position_error": position_error,
}
"""Function that computes each derived quantity (`asrsim.quantities.DERIVED`), by name of the quantity."""

_MOTORS = tuple(f"motor_{i}_position" for i in range(1, MOST_MOTORS + 1))
_REFERENCES = tuple(f"reference_{i}" for i in range(1, MOST_MOTORS + 1))
DERIVED_SOURCES: dict[str, tuple[str, ...]] = {
    "deflection": ("link_position", *_MOTORS, *_REFERENCES),
    "equilibrium_position": (*_MOTORS, *_REFERENCES),
    "position_error": ("link_position", *_REFERENCES),
}
"""Logged quantities from which each derived quantity is computed, if the log has them."""


def _kinds(samples: Samples, joints: Sequence[JointInfo]) -> Iterator[tuple[tuple[str, int | None], Any]]:
    """Pairs (actuator, mode), each with the index of the pair's joints in the rows of an array (joints, n)."""
    kinds: dict[tuple[str, int | None], list[int]] = {}
    places = {name: row for row, name in enumerate(samples.joints)}
    for joint in joints:
        if joint.name in places:
            kinds.setdefault((joint.actuator, joint.mode), []).append(places[joint.name])
    return ((kind, picking(rows)) for kind, rows in kinds.items())


def _rows(samples: Samples, quantity: str) -> Array:
    """Values (joints, n) of a quantity; NaN where it is not recorded."""
    values = samples.values.get(quantity)
    return np.broadcast_to(np.nan, (len(samples.joints), len(samples.time))) if values is None else values.T


def _reference_position(samples: Samples, actuator: str, mode: int | None, rows: Any) -> Array:
    """Link positions that the references command; NaN in modes whose references drive motors or links directly."""
    reference_1: Array = _rows(samples, "reference_1")[rows]
    meaning = MODES.get(mode) if mode is not None else None
    if meaning is None or meaning.direct or "torque" in meaning.references[0]:
        return np.full(reference_1.shape, np.nan)
    if meaning.mapped or not meaning.spring:
        return reference_1
    return _mapped(samples, actuator, "reference_{}", rows)


def _mapped(samples: Samples, actuator: str, quantity: str, rows: Any) -> Array:
    """Equilibrium positions for the values of a quantity of each motor; NaN if the actuator is not registered.

    quantity: Name with {} in place of the motor's number, such as `motor_{}_position`.
    """
    if actuator not in ACTUATORS:
        return np.full(_rows(samples, "link_position")[rows].shape, np.nan)
    kind = ACTUATORS.get(actuator)
    positions = [_rows(samples, quantity.format(i + 1))[rows] for i in range(kind.positions())]
    return over_arrays(kind.equilibrium_position)(*positions)
