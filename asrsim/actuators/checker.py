"""Checks that the laws of an actuator agree with each other and with physics.

Every check evaluates the laws at seeded random points: deflections inside the limit, default and perturbed parameters. The
check reports the worst value, and the point at which this value occurs.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from asrsim.actuators import Actuator
from asrsim.actuators.user import declaration_problems
from asrsim.actuators.vectorised import Array

FREE_RANGE = 0.5
"""Range of the sampled deflections for an actuator without the parameter `max_deflection`, rad."""
SAMPLES = 200
"""Number of points at which each law is evaluated, for each set of parameters."""
PARAMETER_SETS = 6
"""Number of sets of parameters: the default values, and random values within the bounds."""
FAR = 4.0
"""Multiple of the deflection limit up to which torques must be finite."""
INSIDE = 0.95
"""Multiple of the deflection limit up to which slopes are measured: at the limit the slope jumps."""
DIFFERENCES = (1e-3, 3e-5, 1e-6)
"""Steps of the differences, as fractions of the deflection limit. Near a corner of a law, the smaller steps are accurate."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Result of one check."""

    name: str
    passed: bool
    doc: str
    """The condition that the check tests."""
    figure: float | None = None
    """Worst value that the check measured; None if the check measures no value."""
    limit: float | None = None
    """Largest allowed `figure`."""
    detail: str = ""
    """Point of the worst value, or the reason of the failure."""


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """Results of all checks of one actuator."""

    actuator: str
    title: str
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)


def check_actuator(actuator: type[Actuator]) -> CheckReport:
    """Results of all checks. An exception in a law fails the check and is not raised."""
    problems = declaration_problems(actuator)
    declaration = Check(
        name="declaration", passed=not problems, doc="name, motors, parameters and laws are declared as `Actuator` requires",
        detail="; ".join(f"{problem.key}: {problem.message}" for problem in problems),
    )  # fmt: skip
    return CheckReport(
        actuator=str(getattr(actuator, "name", actuator.__name__)),
        title=str(getattr(actuator, "title", actuator.__name__)),
        checks=(declaration, *(_run(*check, actuator) for check in (() if problems else _CHECKS))),
    )


class Point(NamedTuple):
    """Arguments of a law: position of the link (rad), positions of the motors (rad) and of an adjuster (in the unit of the
    second reference), and parameters of the spring."""

    q: float
    thetas: tuple[float, ...]
    parameters: tuple[float, ...]

    def call(self, law: Callable[..., Any]) -> Any:
        """Result of the law at this point."""
        return law(self.q, *self.thetas, self.parameters)

    def __str__(self) -> str:
        values = ", ".join(f"{value:.6g}" for value in self.parameters)
        thetas = ", ".join(f"theta_{i}={theta:.4g}" for i, theta in enumerate(self.thetas, start=1))
        return f"q={self.q:.4g}, {thetas}, parameters=({values})"


def parameter_sets(actuator: type[Actuator]) -> list[tuple[float, ...]]:
    """Sets of spring parameters: the defaults, and sets with each parameter changed by up to 30 % within its bounds."""
    source = random.Random(1)
    sets = [tuple(float(parameter.default) for parameter in actuator.parameters)]
    for _ in range(PARAMETER_SETS - 1 if actuator.parameters else 0):
        values = [(parameter, parameter.default * source.uniform(0.7, 1.3)) for parameter in actuator.parameters]
        sets.append(tuple(parameter.default if parameter.fault(value) else value for parameter, value in values))
    return sets


def _limit_of(actuator: type[Actuator], parameters: tuple[float, ...]) -> float:
    """Largest deflection in rad."""
    values = {parameter.name: value for parameter, value in zip(actuator.parameters, parameters, strict=True)}
    return values.get("max_deflection", FREE_RANGE)


def _points(actuator: type[Actuator], reach: float = INSIDE) -> Iterator[Point]:
    """Random points with deflections up to `reach` times the deflection limit."""
    source = random.Random(2)
    for parameters in parameter_sets(actuator):
        limit = reach * _limit_of(actuator, parameters)
        for _ in range(SAMPLES):
            q = source.uniform(-2.0, 2.0)
            thetas = [q + source.uniform(-limit, limit) for _ in range(actuator.positions() - actuator.adjuster)]
            thetas += [actuator.typical_preset * source.uniform(0.5, 1.5)] if actuator.adjuster else []
            yield Point(q, tuple(thetas), parameters)


_Measure = Callable[[type[Actuator]], Iterator[tuple[float, object]]]
"""Function that measures values of an actuator, each with the point at which it was measured."""


def _run(name: str, doc: str, limit: float, measure: _Measure, actuator: type[Actuator]) -> Check:
    worst, where = 0.0, ""
    try:
        for figure, place in measure(actuator):
            if not math.isfinite(figure):
                return Check(name=name, passed=False, doc=doc, limit=limit, detail=f"no finite number at {place}")
            if figure > worst:
                worst, where = figure, str(place)
    except Exception as error:
        return Check(name=name, passed=False, doc=doc, limit=limit, detail=f"raised {type(error).__name__}: {error}")
    return Check(name=name, passed=worst <= limit, doc=doc, figure=worst, limit=limit, detail=where)


def _values(actuator: type[Actuator], point: Point) -> tuple[float, ...]:
    return (*point.call(actuator.elastic_torques), point.call(actuator.stiffness))


def _pure(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    points = list(_points(actuator))
    first = [_values(actuator, point) for point in points]
    for point, earlier in zip(reversed(points), reversed(first), strict=True):
        yield max(abs(a - b) for a, b in zip(_values(actuator, point), earlier, strict=True)), point


def _finite(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    limited = any(parameter.name == "max_deflection" for parameter in actuator.parameters)
    for point in _points(actuator, FAR if limited else 1.0):
        yield 0.0 * sum(_values(actuator, point)), point


def _slopes(actuator: type[Actuator], point: Point) -> Iterator[Array]:
    """Derivatives of the torques on link and motors by their positions, by fourth-order differences with several steps."""
    moving = 1 + actuator.positions() - actuator.adjuster
    places = np.array([point.q, *point.thetas])

    def torques(along: int, shift: float) -> Array:
        q, *thetas = (places + shift * (np.arange(len(places)) == along)).tolist()
        springs = Point(q, tuple(thetas), point.parameters).call(actuator.elastic_torques)
        return np.array([sum(springs), *(-torque for torque in springs)][:moving])

    for part in DIFFERENCES:
        h = part * _limit_of(actuator, point.parameters)
        yield np.array([
            (8.0 * (torques(i, h) - torques(i, -h)) - torques(i, 2.0 * h) + torques(i, -2.0 * h)) / (12.0 * h)
            for i in range(moving)
        ])  # fmt: skip


def _stiffness_agrees(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    points = list(_points(actuator))
    stated = [point.call(actuator.stiffness) for point in points]
    # At zero stiffness, a relative error is undefined. Errors are relative to at least a fraction of the largest stiffness.
    floor = max(1e-4 * max(map(abs, stated)), 1e-12)
    for point, value in zip(points, stated, strict=True):
        slopes = [-float(slopes[0, 0]) for slopes in _slopes(actuator, point)]
        figure, slope = min((abs(value - slope) / max(abs(value), abs(slope), floor), slope) for slope in slopes)
        yield figure, f"{point}: stiffness {value:.6g}, slope {slope:.6g}"


def _restoring(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    for point in _points(actuator):
        stiffness = point.call(actuator.stiffness)
        yield max(0.0, -stiffness), f"{point}: stiffness {stiffness:.6g} N m/rad"


def _passive(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    """Asymmetry of the stiffness matrix. If the matrix is symmetric, the springs do no work round closed paths of link and
    motors."""
    for point in _points(actuator):
        yield min(float(np.abs(m - m.T).max() / max(np.abs(m).max(), 1e-12)) for m in _slopes(actuator, point)), point


def _energy(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    """Relative error of the energy's derivative by q. An energy that is integrated from torques needs no check."""
    for point in _points(actuator) if actuator.elastic_energy is not Actuator.elastic_energy else ():
        h = 1e-4 * _limit_of(actuator, point.parameters)
        low, high = (point._replace(q=point.q + d).call(actuator.elastic_energy) for d in (-h, h))
        slope, torque = (low - high) / (2.0 * h), sum(point.call(actuator.elastic_torques))
        # The floor is the rounding error of the difference of energies.
        floor = max(abs(torque), 1e-9 * max(abs(low), abs(high)) / h, 1e-12)
        yield abs(slope - torque) / floor, f"{point}: slope {slope:.6g}, torque {torque:.6g}"


def _reference_map(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    parameters = parameter_sets(actuator)[0]
    source = random.Random(4)
    for _ in range(50):
        equilibrium, preset = source.uniform(-1.0, 1.0), actuator.typical_preset * source.uniform(0.5, 1.0)
        thetas = actuator.motor_references(equilibrium, preset)
        back = actuator.equilibrium_position(*thetas)
        yield abs(back - equilibrium), f"equilibrium {equilibrium:.4g}, preset {preset:.4g}: comes back as {back:.6g}"
        point = Point(equilibrium, thetas, parameters)
        torques, stiffness = point.call(actuator.elastic_torques), point.call(actuator.stiffness)
        scale = max(*map(abs, torques), abs(stiffness) * _limit_of(actuator, parameters), 1e-12)
        yield abs(sum(torques)) / scale, f"{point}: {sum(torques):.3g} N m on the unloaded link"


_CHECKS: tuple[tuple[str, str, float, _Measure], ...] = (
    ("pure", "the same input gives the same torques and stiffness, in any order", 0.0, _pure),
    ("finite", "torques and stiffness are finite over the range and beyond the limit", 0.0, _finite),
    ("stiffness", "the stiffness is minus the derivative of the torque by q (relative error)", 1e-6, _stiffness_agrees),
    ("restoring", "the stiffness is never negative inside the deflection limit (N m/rad)", 0.0, _restoring),
    ("passive", "the springs do no work round closed paths of link and motors (relative asymmetry)", 1e-4, _passive),
    ("energy", "the derivative of a declared energy by q is minus the torque (relative error)", 1e-3, _energy),
    ("reference map", "equilibrium_position inverts motor_references (rad), and there no torque acts on the link", 1e-9,
     _reference_map),
)  # fmt: skip
