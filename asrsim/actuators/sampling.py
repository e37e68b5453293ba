"""Where the checker looks at a law: seeded random points, deflections inside the limit, defaults and perturbed parameters."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from asrsim.actuators import Actuator

FREE_RANGE = 0.5
"""rad, deflections sampled for an actuator without a `max_deflection`."""
SAMPLES = 200
"""Points at which each law of an actuator is tried, for every set of parameters."""
PARAMETER_SETS = 6
"""Sets of parameters with which the laws are tried: the defaults, and others within their bounds."""


class Point(NamedTuple):
    """What the laws take: position of the link (rad), positions of the motors (rad; an adjuster's in its own unit), and the
    spring's parameters."""

    q: float
    thetas: tuple[float, ...]
    parameters: tuple[float, ...]

    def call(self, law: Callable[..., Any]) -> Any:
        """What a law gives here."""
        return law(self.q, *self.thetas, self.parameters)

    def __str__(self) -> str:
        values = ", ".join(f"{value:.6g}" for value in self.parameters)
        thetas = ", ".join(f"theta_{i}={theta:.4g}" for i, theta in enumerate(self.thetas, start=1))
        return f"q={self.q:.4g}, {thetas}, parameters=({values})"


def parameter_sets(actuator: type[Actuator]) -> list[tuple[float, ...]]:
    """The defaults, and sets with every spring parameter changed by up to 30 %, inside its bounds."""
    source = random.Random(1)
    sets = [tuple(float(parameter.default) for parameter in actuator.parameters)]
    for _ in range(PARAMETER_SETS - 1 if actuator.parameters else 0):
        values = []
        for parameter in actuator.parameters:
            value = parameter.default * source.uniform(0.7, 1.3)
            values.append(parameter.default if parameter.fault(value) else value)
        sets.append(tuple(values))
    return sets


def limit_of(actuator: type[Actuator], parameters: tuple[float, ...]) -> float:
    """Largest deflection in rad."""
    for parameter, value in zip(actuator.parameters, parameters, strict=True):
        if parameter.name == "max_deflection":
            return value
    return FREE_RANGE


def sample_points(actuator: type[Actuator], reach: float = 0.98) -> Iterator[Point]:
    """Points with deflections up to `reach` times the limit."""
    source = random.Random(2)
    for parameters in parameter_sets(actuator):
        limit = reach * limit_of(actuator, parameters)
        for _ in range(SAMPLES):
            q = source.uniform(-2.0, 2.0)
            count = actuator.positions() - actuator.adjuster
            thetas = [q + source.uniform(-limit, limit) for _ in range(count)]
            if actuator.adjuster:
                thetas.append(actuator.typical_preset * source.uniform(0.5, 1.5))
            yield Point(q, tuple(thetas), parameters)


def link_torque(actuator: type[Actuator], point: Point, q: float | None = None) -> float:
    """Torque on the link in N m at a point, or at another link position."""
    return float(sum((point if q is None else point._replace(q=q)).call(actuator.elastic_torques)))
