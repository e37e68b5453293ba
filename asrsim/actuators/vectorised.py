"""Laws of actuators for whole arrays, with NumPy's functions in place of `math`; energy laws for actuators without one."""

from __future__ import annotations

import math
import types
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.base import Actuator, cosh, saturate, sinh
from asrsim.compiled.rebind import rebind

Array = NDArray[np.float64]
GAUSS = tuple(
    (0.5 * (node + 1.0), 0.5 * weight)
    for node, weight in zip(*(x.tolist() for x in np.polynomial.legendre.leggauss(12)), strict=True)
)
"""Nodes and weights of Gauss-Legendre quadrature with twelve points on [0, 1], for the energy of a spring from its torque."""

_UFUNCS: dict[str, Any] = {
    name: law for name in vars(math) if name != "remainder" and isinstance(law := getattr(np, name, None), np.ufunc)
}
"""NumPy's functions by the names that they have in `math`; `remainder` is missing, since NumPy defines it differently."""
_MATH = types.SimpleNamespace(**{**vars(math), **_UFUNCS})


def _saturate(value: Any, limit: float) -> Any:
    # Do not use np.clip, which takes three times as long as np.minimum and np.maximum.
    return np.minimum(np.maximum(value, -limit), limit)


_COUNTERPARTS: dict[Any, Any] = {
    **{getattr(math, name): law for name, law in _UFUNCS.items()},
    saturate: _saturate,
    sinh: np.sinh,
    cosh: np.cosh,
}
"""Function for arrays that replaces each function of numbers in a law."""


def _with_arrays(value: Any) -> Any:
    """Replacement of a law's global variable, for arrays; the variable's own value if no replacement is needed."""
    if value is math:
        return _MATH
    return _COUNTERPARTS.get(value, value) if isinstance(value, (types.FunctionType, types.BuiltinFunctionType)) else value


@cache
def over_arrays(law: Callable[..., Any]) -> Callable[..., Array]:
    """Function that evaluates an actuator's law on arrays of equal shape (n,) or (joints, n). If the law returns several
    numbers, the result has an additional first axis.

    The last argument of a spring law is the tuple of its parameters: each is a number, or a column (joints, 1) with one value
    for each joint. A law with branches is evaluated sample by sample. This evaluation is slower. Its results are the same,
    except for NaN where Python's `math` raises an error.
    """
    fast = rebind(law, _with_arrays) if isinstance(law, types.FunctionType) else None

    def evaluate(first: Array, *rest: Any) -> Array:
        shape = first.shape
        with suppress(ValueError, TypeError), np.errstate(all="ignore"):
            if fast is not None:
                values = fast(first, *rest)
                several = isinstance(values, tuple)
                table = np.empty((len(values), *shape) if several else shape)
                # Fill a table, which takes half as long as numpy.broadcast_to and numpy.array.
                for place, value in enumerate(values) if several else [(..., values)]:
                    table[place] = value
                return table
        springs = isinstance(rest[-1], tuple)
        *positions, parameters = (first, *rest) if springs else (first, *rest, ())
        points = zip(*(np.broadcast_to(values, shape).ravel().tolist() for values in (*positions, *parameters)), strict=True)
        count = len(positions)
        results = [_at(law, point[:count], (point[count:],) if springs else ()) for point in points]
        undefined = np.full_like(next((one for one in results if one is not None), 0.0), np.nan, dtype=float)
        table = np.array([undefined if one is None else one for one in results], dtype=float)
        return table.T.reshape(*table.shape[1:], *shape)

    return evaluate


def _at(law: Callable[..., Any], positions: tuple[float, ...], parameters: tuple[Any, ...]) -> Any:
    """Result of a law for one sample; None if Python's `math` raises an error there, where NumPy would give NaN or inf."""
    try:
        return law(*positions, *parameters)
    except (OverflowError, ZeroDivisionError):
        return None


def _energy_law(actuator: Any) -> Callable[..., float]:
    """Energy law of the actuator in J. If the actuator declares no energy law, this law integrates the torques of the springs
    from their undeflected state.
    """
    if actuator.elastic_energy is not Actuator.elastic_energy:
        own: Callable[..., float] = actuator.elastic_energy
        return own
    torques, adjusted = actuator.elastic_torques, actuator.adjuster

    def energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        total = 0.0
        for node, weight in GAUSS:
            second = theta_2 if adjusted else q + node * (theta_2 - q)
            torque_1, torque_2 = torques(q, q + node * (theta_1 - q), second, parameters)
            total += weight * (torque_1 * (theta_1 - q))
            if not adjusted:
                total += weight * (torque_2 * (theta_2 - q))
        return total

    return energy


energy_law: Callable[[Any], Callable[..., float]] = cache(_energy_law)
"""Function `_energy_law` with a cache: each actuator's law is made only once."""
