"""Derived quantities, which are computed from logged quantities and are never stored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.vectorised import over_arrays
from asrsim.quantities import MOST_MOTORS
from asrsim.samples import Array, JointInfo, Samples

_IDEAL_MOTORS = tuple(mode.number for mode in MODES.values() if mode.spring and not mode.motor)


def _equilibrium_position(samples: Samples, joint: JointInfo, column: int) -> Array:
    """Equilibrium positions (n,), rad: link positions at which the elastic torque is zero; NaN without motors.

    Positions of ideal motors (modes 2, 3) that are not recorded equal the references.
    """
    if joint.mode in _IDEAL_MOTORS and np.isnan(_values(samples, "motor_1_position", column)).all():
        return _reference_position(samples, joint, column)
    return _mapped(samples, joint, "motor_{}_position", column)


def _deflection(samples: Samples, joint: JointInfo, column: int) -> Array:
    """Deflections (n,), rad: equilibrium position minus link position."""
    return _equilibrium_position(samples, joint, column) - _values(samples, "link_position", column)


def _position_error(samples: Samples, joint: JointInfo, column: int) -> Array:
    """Position errors (n,), rad: position reference minus link position; NaN in the torque modes (0, 4)."""
    return _reference_position(samples, joint, column) - _values(samples, "link_position", column)


def own_reference(samples: Samples, joint: JointInfo) -> Array | None:
    """Link positions (n,) that the references of a joint command, with which claims compare the link position of the joint;
    None without such references.
    """
    found = _reference_position(samples, joint, samples.joints.index(joint.name))
    return found if np.isfinite(found).any() else None


def _by_joint(law: Callable[[Samples, JointInfo, int], Array], samples: Samples, joints: Sequence[JointInfo]) -> Array:
    """Values (n, joints), computed joint by joint with `law`. NaN for joints that the log does not describe.

    joints: Joints of the log (`RunInfo.joints`), matched by name.
    """
    result = np.full((len(samples.joints), len(samples.time)), np.nan).T
    described = {joint.name: joint for joint in joints}
    for column, name in enumerate(samples.joints):
        if name in described:
            result[:, column] = law(samples, described[name], column)
    return result


DERIVED_FUNCTIONS: dict[str, Callable[[Samples, Sequence[JointInfo]], Array]] = {
    "deflection": partial(_by_joint, _deflection),
    "equilibrium_position": partial(_by_joint, _equilibrium_position),
    "position_error": partial(_by_joint, _position_error),
}
"""Function that computes each derived quantity (`asrsim.quantities.DERIVED`) of all joints, by name of the quantity."""

_MOTORS = tuple(f"motor_{i}_position" for i in range(1, MOST_MOTORS + 1))
_REFERENCES = tuple(f"reference_{i}" for i in range(1, MOST_MOTORS + 1))
DERIVED_SOURCES: dict[str, tuple[str, ...]] = {
    "deflection": ("link_position", *_MOTORS, *_REFERENCES),
    "equilibrium_position": (*_MOTORS, *_REFERENCES),
    "position_error": ("link_position", *_REFERENCES),
}
"""Logged quantities from which each derived quantity is computed, if the log has them."""


def recorded_sources(names: Iterable[str], joints: Sequence[JointInfo]) -> list[str]:
    """Quantities recorded for at least one of the joints, from which the named quantities, logged or derived, are computed."""
    recorded = {name for joint in joints for name in joint.quantities}
    sources = dict.fromkeys(source for name in names for source in DERIVED_SOURCES.get(name, (name,)))
    return [name for name in sources if name in recorded]


def _values(samples: Samples, quantity: str, column: int) -> Array:
    """Values (n,) of a quantity of a joint; NaN if they are not recorded."""
    values = samples.values.get(quantity)
    return np.full(len(samples.time), np.nan) if values is None else values[:, column]


def _reference_position(samples: Samples, joint: JointInfo, column: int) -> Array:
    """Link positions (n,) that the references command; NaN in modes whose references drive motors or links directly."""
    mode = MODES.get(joint.mode) if joint.mode is not None else None
    if mode is None or mode.direct or "torque" in mode.references[0]:
        return np.full(len(samples.time), np.nan)
    if mode.mapped or not mode.spring:
        return _values(samples, "reference_1", column)
    return _mapped(samples, joint, "reference_{}", column)


def _mapped(samples: Samples, joint: JointInfo, quantity: str, column: int) -> Array:
    """Equilibrium positions (n,) for the values of a quantity of each motor; NaN if the actuator is not registered.

    quantity: Name with {} in place of the motor's number, such as `motor_{}_position`.
    """
    if joint.actuator not in ACTUATORS:
        return np.full(len(samples.time), np.nan)
    actuator = ACTUATORS.get(joint.actuator)
    positions = [_values(samples, quantity.format(i + 1), column) for i in range(actuator.positions())]
    return over_arrays(actuator.equilibrium_position)(*positions)
