"""The laws on whole arrays: the same source, with :mod:`math` exchanged for NumPy. For what a log needs, after the loop."""

from __future__ import annotations

import math
import types
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.base import Actuator, saturate
from asrsim.rebind import rebind

Array = NDArray[np.float64]
GAUSS = tuple(
    (0.5 * (node + 1.0), 0.5 * weight)
    for node, weight in zip(*(x.tolist() for x in np.polynomial.legendre.leggauss(12)), strict=True)
)
"""Nodes and weights of Gauss's rule with twelve points on [0, 1]."""

_ARRAY_MATH: dict[str, Any] = {
    name: getattr(np, name)
    for name in (
        "sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan", "atan2", "asinh", "acosh", "atanh", "exp", "expm1",
        "log", "log1p", "sqrt", "hypot", "fabs", "copysign", "pow", "floor", "ceil",
    )
}  # fmt: skip
_MATH_NAMESPACE = types.SimpleNamespace(**{**vars(math), **_ARRAY_MATH})


_Law = TypeVar("_Law", bound=Callable[..., Any])


def _once(make: _Law) -> _Law:
    """A law is translated once, for all runs."""
    return cast("_Law", cache(make))


def _saturate_array(value: Any, limit: float) -> Any:
    # np.clip says the same in thrice the time.
    raised = np.maximum(value, -limit)
    return np.minimum(raised, limit, out=raised if isinstance(raised, np.ndarray) else None)


def _with_arrays(value: Any) -> Any:
    """What stands for a global of a law when it runs on arrays."""
    if value is math:
        return _MATH_NAMESPACE
    if value is saturate:
        return _saturate_array
    if isinstance(value, types.BuiltinFunctionType) and value in vars(math).values():
        return _ARRAY_MATH.get(str(value.__name__), value)
    return value


@_once
def over_arrays(law: Callable[..., Any]) -> Callable[..., Array]:
    """A law `(q, theta_1, theta_2, parameters) -> number(s)` on arrays (n,) or (joints, n) of equal shape.

    parameters: a tuple of numbers, or of columns (joints, 1). Two numbers give arrays with a first axis of 2.
    A law with branches cannot take arrays; it is then called sample by sample (slower, same numbers).
    """
    fast = rebind(law, _with_arrays) if isinstance(law, types.FunctionType) else None

    def evaluate(q: Array, *rest: Any) -> Array:
        *thetas, parameters = rest
        if fast is not None:
            try:
                with np.errstate(all="ignore"):
                    values = fast(q, *thetas, parameters)
                if isinstance(values, tuple):
                    return np.stack([np.broadcast_to(value, q.shape) for value in values])
                return np.asarray(values) if np.shape(values) == q.shape else np.array(np.broadcast_to(values, q.shape))
            except (ValueError, TypeError):
                pass
        if q.ndim == 2:
            own = [tuple(p[j, 0] if np.ndim(p) else p for p in parameters) for j in range(len(q))]
            return np.stack([evaluate(q[j], *(theta[j] for theta in thetas), own[j]) for j in range(len(q))], axis=-2)
        rows = [law(*point, parameters) for point in zip(q.tolist(), *(theta.tolist() for theta in thetas), strict=True)]
        return np.array(rows, dtype=float).T

    return evaluate


@_once
def references_over_arrays(actuator: type[Actuator]) -> Callable[[Array, Array], tuple[Array, ...]]:
    """The actuator's reference map on arrays of equal shape: positions of its motors for equilibria and presets."""
    law = actuator.motor_references
    fast = rebind(law, _with_arrays) if isinstance(law, types.FunctionType) else None

    def evaluate(first: Array, second: Array) -> tuple[Array, ...]:
        if fast is not None:
            try:
                # What has the shape already is most often so, and asking is quicker than broadcasting.
                return tuple(
                    goal if np.shape(goal) == first.shape else np.broadcast_to(goal, first.shape)
                    for goal in fast(first, second)
                )
            except (ValueError, TypeError):
                pass
        rows = np.array([law(a, b) for a, b in zip(first.ravel().tolist(), second.ravel().tolist(), strict=True)], dtype=float)
        return tuple(column.reshape(first.shape) for column in rows.T)

    return evaluate


def equilibrium_over_arrays(actuator: type[Actuator]) -> Callable[..., Array]:
    """The positions at which unloaded links rest, of the positions of all motors, arrays of equal shape."""
    law: Callable[..., Any] = actuator.equilibrium_position

    def evaluate(*positions: Array) -> Array:
        shape = positions[0].shape
        try:
            # Plain arithmetic, as in all our actuators, works on arrays as on numbers.
            return np.broadcast_to(np.asarray(law(*positions), dtype=np.float64), shape)
        except (TypeError, ValueError):
            points = zip(*(values.ravel().tolist() for values in positions), strict=True)
            return np.array([law(*point) for point in points], dtype=np.float64).reshape(shape)

    return evaluate


@_once
def energy_over_arrays(actuator: type[Actuator]) -> Callable[..., Array]:
    """Energy of the springs in J on arrays: the actuator's own, else integrated from its torques from the undeflected state."""
    if actuator.elastic_energy is not Actuator.elastic_energy:
        return over_arrays(actuator.elastic_energy)
    torques = over_arrays(actuator.elastic_torques)

    def integrate(q: Array, theta_1: Array, theta_2: Array, parameters: tuple[Any, ...]) -> Array:
        total = np.zeros_like(q)
        d_1, d_2 = theta_1 - q, theta_2 - q
        for node, weight in GAUSS:
            if actuator.adjuster:
                torque_1, _ = torques(q, q + node * d_1, theta_2, parameters)
                total += weight * torque_1 * d_1
            else:
                torque_1, torque_2 = torques(q, q + node * d_1, q + node * d_2, parameters)
                total += weight * (torque_1 * d_1 + torque_2 * d_2)
        return total

    return integrate
