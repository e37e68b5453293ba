"""Quantities that follow from logged ones: computed, never stored."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.vectorised import equilibrium_over_arrays
from asrsim.samples import Array, JointInfo, Samples

_IDEAL_MOTORS = tuple(mode.number for mode in MODES.values() if mode.spring and not mode.motor)


def equilibrium_position(samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """(n, number of joints) rad: where the motors hold the unloaded link; NaN for a joint without motors.

    joints: those of the log (:attr:`RunInfo.joints`), matched by name. Ideal motors (modes 2, 3) that are not
    recorded stand at the references.
    """
    result = np.full((len(samples.time), len(samples.joints)), np.nan)
    for column, joint in _columns(samples, joints):
        theta_1 = _column(samples, "motor_1_position", column)
        theta_2 = _column(samples, "motor_2_position", column)
        if np.all(np.isnan(theta_1)) and joint.mode in _IDEAL_MOTORS:
            result[:, column] = _reference_position(samples, joint, column)
        else:
            result[:, column] = _mapped(joint, theta_1, theta_2)
    return result


def deflection(samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """(n, number of joints) rad: equilibrium position minus link position."""
    return equilibrium_position(samples, joints) - _positions(samples)


def position_error(samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """(n, number of joints) rad: reference of the position minus link position; NaN in the torque modes (0, 4)."""
    result = np.full((len(samples.time), len(samples.joints)), np.nan)
    for column, joint in _columns(samples, joints):
        result[:, column] = _reference_position(samples, joint, column) - _column(samples, "link_position", column)
    return result


DERIVED_FUNCTIONS: dict[str, Callable[[Samples, Sequence[JointInfo]], Array]] = {
    "deflection": deflection,
    "equilibrium_position": equilibrium_position,
    "position_error": position_error,
}
"""Name of a derived quantity (:data:`asrsim.quantities.DERIVED`) -> its function."""

DERIVED_SOURCES: dict[str, tuple[str, ...]] = {
    "deflection": ("link_position", "motor_1_position", "motor_2_position", "reference_1", "reference_2"),
    "equilibrium_position": ("motor_1_position", "motor_2_position", "reference_1", "reference_2"),
    "position_error": ("link_position", "reference_1", "reference_2"),
}
"""Quantities to read from a log for a derived one, as far as it has them."""


def _columns(samples: Samples, joints: Sequence[JointInfo]) -> list[tuple[int, JointInfo]]:
    return [(samples.joints.index(joint.name), joint) for joint in joints if joint.name in samples.joints]


def _column(samples: Samples, quantity: str, column: int) -> Array:
    values = samples.values.get(quantity)
    return np.full(len(samples.time), np.nan) if values is None else values[:, column]


def _positions(samples: Samples) -> Array:
    columns = [_column(samples, "link_position", column) for column in range(len(samples.joints))]
    return np.column_stack(columns) if columns else np.empty((len(samples.time), 0))


def _reference_position(samples: Samples, joint: JointInfo, column: int) -> Array:
    """The link position that the references ask for; NaN where they drive the joint's motors or the link directly."""
    reference_1 = _column(samples, "reference_1", column)
    mode = MODES.get(joint.mode) if joint.mode is not None else None
    if mode is None or mode.direct or "torque" in mode.references[0]:
        return np.full(len(samples.time), np.nan)
    if mode.mapped or not mode.spring:
        return reference_1
    return _mapped(joint, reference_1, _column(samples, "reference_2", column))


def _mapped(joint: JointInfo, theta_1: Array, theta_2: Array) -> Array:
    """Equilibrium position of two motor positions; NaN if the actuator is not registered here."""
    if joint.actuator not in ACTUATORS:
        return np.full(len(theta_1), np.nan)
    return equilibrium_over_arrays(ACTUATORS.get(joint.actuator))(theta_1, theta_2)
