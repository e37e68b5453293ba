"""Checks that the laws of an actuator agree with each other and with physics.

Every check evaluates the laws at seeded random points: deflections inside the limit, default and perturbed parameters. It
reports the worst value, and the point at which it occurs.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from asrsim.actuators import Actuator
from asrsim.actuators.user import declaration_problems
from asrsim.actuators.vectorised import Array

FREE_RANGE = 0.5
"""rad: range of the sampled deflections for an actuator without the parameter `max_deflection`."""
SAMPLES = 200
"""Number of points at which each law is evaluated, for each set of parameters."""
PARAMETER_SETS = 6
"""Number of sets of parameters: the default values, and random values within the bounds."""
FAR = 4.0
"""Multiple of the deflection limit up to which torques must be finite."""
DIFFERENCES = (1e-3, 3e-5, 1e-6)
"""Steps of the differences, as fractions of the deflection limit. The smaller steps serve where a law has a corner."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Result of one check."""

    name: str
    passed: bool
    doc: str
    """The condition that the check tests."""
    figure: float | None = None
    """Worst value that the check measured; None if it measures no value."""
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

    def link_torque(self, actuator: type[Actuator], shift: float = 0.0) -> float:
        """Torque on the link in N m, after the link has moved by `shift` rad."""
        return float(sum(self._replace(q=self.q + shift).call(actuator.elastic_torques)))

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
    names = [parameter.name for parameter in actuator.parameters]
    return parameters[names.index("max_deflection")] if "max_deflection" in names else FREE_RANGE


def _points(actuator: type[Actuator], reach: float = 0.98) -> Iterator[Point]:
    """Random points with deflections up to `reach` times the deflection limit."""
    source = random.Random(2)
    for parameters in parameter_sets(actuator):
        limit = reach * _limit_of(actuator, parameters)
        for _ in range(SAMPLES):
            q = source.uniform(-2.0, 2.0)
            thetas = [q + source.uniform(-limit, limit) for _ in range(actuator.positions() - actuator.adjuster)]
            thetas += [actuator.typical_preset * source.uniform(0.5, 1.5)] if actuator.adjuster else []
            yield Point(q, tuple(thetas), parameters)


class _FailedError(Exception):
    """A check failed for a reason that is not a measured value."""


_Measure = Callable[[type[Actuator]], Iterator[tuple[float, object]]]
"""Function that measures values of an actuator, each with the point at which it was measured."""


def _run(name: str, doc: str, limit: float | None, measure: _Measure, actuator: type[Actuator]) -> Check:
    worst, where, failure = 0.0, "", ""
    try:
        for figure, place in measure(actuator):
            if math.isnan(figure):
                raise _FailedError(f"not a number at {place}")
            if figure > worst:
                worst, where = figure, str(place)
    except _FailedError as error:
        failure = str(error)
    except Exception as error:
        failure = f"raised {type(error).__name__}: {error}"
    if failure:
        return Check(name=name, passed=False, doc=doc, limit=limit, detail=failure)
    return Check(name=name, passed=limit is None or worst <= limit, doc=doc, figure=worst, limit=limit, detail=where)


def _pure(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    def results(point: Point) -> tuple[float, ...]:
        torques, stiffness = point.call(actuator.elastic_torques), point.call(actuator.stiffness)
        if not isinstance(torques, tuple) or len(torques) != max(2, actuator.motors):
            raise _FailedError(f"elastic_torques must return {max(2, actuator.motors)} numbers as a tuple, got {torques!r}")
        if not all(isinstance(value, float) for value in (*torques, stiffness)):
            raise _FailedError(f"laws must return floats, got {torques!r} and {stiffness!r} at {point}")
        return (*torques, stiffness)

    points = list(_points(actuator))
    first = [results(point) for point in points]
    for point, earlier in zip(reversed(points), reversed(first), strict=True):
        again = results(point)
        if again != earlier and not any(map(math.isnan, earlier)):
            raise _FailedError(f"the same input gave {earlier} and {again}: the law has a state; at {point}")
    yield 0.0, ""


def _finite(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    has_limit = any(parameter.name == "max_deflection" for parameter in actuator.parameters)
    for point in _points(actuator, FAR if has_limit else 1.0):
        try:
            values = (*point.call(actuator.elastic_torques), point.call(actuator.stiffness))
        except ArithmeticError as error:
            raise _FailedError(f"{type(error).__name__} at {point}") from error
        if not all(map(math.isfinite, values)):
            raise _FailedError(f"not finite at {point}: {values}")
    yield 0.0, ""


def _stiffness_agrees(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    points = list(_points(actuator, 0.95))  # away from the limit, at which the slope jumps
    stated = [point.call(actuator.stiffness) for point in points]
    # Where the stiffness is 0 a relative error is undefined: errors refer to a share of the largest stiffness at least.
    floor = max(1e-4 * max(map(abs, stated)), 1e-12)
    for point, value in zip(points, stated, strict=True):
        slopes = [-_slope(partial(point.link_torque, actuator), h) for h in _steps(actuator, point)]
        figure, slope = min((abs(value - slope) / max(abs(value), abs(slope), floor), slope) for slope in slopes)
        yield figure, f"{point}: stiffness {value:.6g}, slope {slope:.6g}"


def _steps(actuator: type[Actuator], point: Point) -> list[float]:
    """Steps of the differences in rad."""
    return [part * _limit_of(actuator, point.parameters) for part in DIFFERENCES]


def _slope(function: Callable[[float], Any], h: float) -> Any:
    """Derivative at 0 by a fourth-order central difference with step `h`."""
    return (8.0 * (function(h) - function(-h)) - function(2.0 * h) + function(-2.0 * h)) / (12.0 * h)


def _restoring(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    for point in _points(actuator):
        stiffness = point.call(actuator.stiffness)
        yield max(0.0, -stiffness), f"{point}: stiffness {stiffness:.6g} N m/rad"


def _passive(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    """Asymmetry of the stiffness matrix. If it is symmetric, the springs do no work round closed paths of link and motors."""
    moving = 1 + actuator.positions() - actuator.adjuster

    def forces(point: Point, along: int, shift: float) -> Array:
        places = [place + (shift if i == along else 0.0) for i, place in enumerate((point.q, *point.thetas))]
        torques = Point(places[0], tuple(places[1:]), point.parameters).call(actuator.elastic_torques)
        return np.array([sum(torques), *(-torque for torque in torques)][:moving])

    for point in _points(actuator, 0.95):
        figures = []
        for h in _steps(actuator, point):
            slopes = np.array([_slope(partial(forces, point, i), h) for i in range(moving)])
            largest = max(float(np.abs(slopes).max()), 1e-12)
            figures.append(float(np.abs(slopes - slopes.T).max()) / largest)
        yield min(figures), point


def _energy(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    """Relative error of the energy's derivative by q. An energy that is integrated from torques needs no check."""
    if actuator.elastic_energy is Actuator.elastic_energy:
        return
    for point in _points(actuator, 0.95):
        h = 1e-4 * _limit_of(actuator, point.parameters)
        low, high = (point._replace(q=point.q + d).call(actuator.elastic_energy) for d in (-h, h))
        slope, torque = (low - high) / (2.0 * h), point.link_torque(actuator)
        # The floor is the rounding error of the difference of energies.
        floor = max(abs(torque), 1e-9 * max(abs(low), abs(high)) / h, 1e-12)
        yield abs(slope - torque) / floor, f"{point}: slope {slope:.6g}, torque {torque:.6g}"


def _reference_map(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    for equilibrium, preset, thetas in _mapped(actuator):
        back = actuator.equilibrium_position(*thetas)
        yield abs(back - equilibrium), f"equilibrium {equilibrium:.4g}, preset {preset:.4g}: comes back as {back:.6g}"


def _rest(actuator: type[Actuator]) -> Iterator[tuple[float, object]]:
    parameters = parameter_sets(actuator)[0]
    for equilibrium, _, thetas in _mapped(actuator):
        point = Point(equilibrium, thetas, parameters)
        torques, stiffness = point.call(actuator.elastic_torques), point.call(actuator.stiffness)
        scale = max(*map(abs, torques), abs(stiffness) * _limit_of(actuator, parameters), 1e-12)
        yield abs(sum(torques)) / scale, f"{point}: {sum(torques):.3g} N m on the unloaded link"


def _mapped(actuator: type[Actuator]) -> Iterator[tuple[float, float, tuple[float, ...]]]:
    """Random equilibria and presets, with the motor positions that the reference map gives."""
    source = random.Random(4)
    for _ in range(50):
        equilibrium, preset = source.uniform(-1.0, 1.0), actuator.typical_preset * source.uniform(0.5, 1.0)
        yield equilibrium, preset, actuator.motor_references(equilibrium, preset)


_CHECKS: tuple[tuple[str, str, float | None, _Measure], ...] = (
    ("pure", "the same input gives the same floats, in any order", None, _pure),
    ("finite", "torques and stiffness are finite over the range and beyond the limit", None, _finite),
    ("stiffness", "the stiffness is minus the derivative of the torque by q (relative error)", 1e-6, _stiffness_agrees),
    ("restoring", "the stiffness is never negative inside the deflection limit (N m/rad)", 0.0, _restoring),
    ("passive", "the springs do no work round closed paths of link and motors (relative asymmetry)", 1e-4, _passive),
    ("energy", "the derivative of a declared energy by q is minus the torque (relative error)", 1e-3, _energy),
    ("reference map", "equilibrium_position inverts motor_references (rad)", 1e-9, _reference_map),
    ("rest", "at the equilibrium no torque acts on the unloaded link (share of the springs' torque)", 1e-9, _rest),
)
