"""Checks that the laws of an actuator agree with each other and with physics.

Every check evaluates the laws at seeded random points: deflections inside the limit, default and perturbed parameters. The
check reports the worst value, and the point at which this value occurs.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from asrsim.actuators import Actuator
from asrsim.actuators.user import declaration_problems
from asrsim.actuators.vectorised import Array, over_arrays

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


CHECKS = {
    "finite": ("torques and stiffness are finite over the range and beyond the limit", 0.0),
    "stiffness": ("the stiffness is minus the derivative of the torque by q (relative error)", 1e-6),
    "restoring": ("the stiffness is never negative inside the deflection limit (N m/rad)", 0.0),
    "passive": ("the springs do no work round closed paths of link and motors (relative asymmetry)", 1e-4),
    "energy": ("the derivatives of a declared energy by -q and by theta_i are the torques (relative error)", 1e-3),
    "reference map": ("equilibrium_position inverts motor_references (rad), and there no torque acts on the link", 1e-9),
}
"""Conditions, and largest allowed values, by name of the check."""


def check_actuator(actuator: type[Actuator]) -> CheckReport:
    """Results of all checks. An exception in a law fails the checks that need the law and is not raised."""
    problems = declaration_problems(actuator)
    declaration = Check(
        name="declaration", passed=not problems, doc="name, motors, parameters and laws are declared as `Actuator` requires",
        detail="; ".join(f"{problem.key}: {problem.message}" for problem in problems),
    )  # fmt: skip
    return CheckReport(
        actuator=str(getattr(actuator, "name", actuator.__name__)),
        title=str(getattr(actuator, "title", actuator.__name__)),
        checks=(declaration, *(() if problems else _law_checks(actuator))),
    )


def _law_checks(actuator: type[Actuator]) -> Iterator[Check]:
    measures, failure = _measures(actuator), ""
    for name, (doc, limit) in CHECKS.items():
        check = Check(name=name, passed=False, doc=doc, limit=limit)
        try:
            with np.errstate(all="ignore"):
                figures, text = next(measures)
        except (Exception, SystemExit) as error:
            # A generator ends at the first exception, so the checks after it have this exception as their reason, too.
            failure = failure or f"raised {type(error).__name__}: {error}"
            yield replace(check, detail=failure)
            continue
        if not np.isfinite(figures).all():
            yield replace(check, detail=f"no finite number at {text(int(np.argmin(np.isfinite(figures))))}")
            continue
        worst = int(np.argmax(figures))
        yield replace(check, passed=bool(figures[worst] <= limit), figure=float(figures[worst]), detail=text(worst))


class Points(NamedTuple):
    """Arguments of a law at n points."""

    positions: Array
    """Rows (1 + positions, n): position of the link (rad), positions of the motors (rad) and of an adjuster (in the unit of the
    second reference)."""
    parameters: tuple[Array, ...]
    """Values (n,) of each parameter of the spring."""
    limit: Array
    """Largest deflections (n,), rad."""

    def apply(self, law: Callable[..., Any]) -> Array:
        """Results (n,) of a law, or (results, n) of a law that returns several numbers."""
        return over_arrays(law)(*self.positions, self.parameters)

    def moved(self, row: int, shift: Array) -> Points:
        """The points with one of their positions shifted by `shift` (n,)."""
        positions = self.positions.copy()
        positions[row] += shift
        return self._replace(positions=positions)

    def text(self, i: int) -> str:
        """Description of point `i`."""
        q, *thetas = self.positions[:, i]
        values = ", ".join(f"{value[i]:.6g}" for value in self.parameters)
        motors = ", ".join(f"theta_{number}={theta:.4g}" for number, theta in enumerate(thetas, start=1))
        return f"q={q:.4g}, {motors}, parameters=({values})"


def parameter_sets(actuator: type[Actuator]) -> list[tuple[float, ...]]:
    """Sets of spring parameters: the defaults, and sets with each parameter changed by up to 30 % within its bounds."""
    source = random.Random(1)
    sets = [tuple(float(parameter.default) for parameter in actuator.parameters)]
    for _ in range(PARAMETER_SETS - 1 if actuator.parameters else 0):
        values = [(parameter, parameter.default * source.uniform(0.7, 1.3)) for parameter in actuator.parameters]
        sets.append(tuple(parameter.default if parameter.fault(value) else value for parameter, value in values))
    return sets


def _points(actuator: type[Actuator], reach: float = INSIDE) -> Points:
    """Random points with deflections up to `reach` times the deflection limit."""
    source = np.random.default_rng(2)
    parameters = tuple(np.repeat(parameter_sets(actuator), SAMPLES, axis=0).T)
    count = SAMPLES * len(parameter_sets(actuator))
    names = [parameter.name for parameter in actuator.parameters]
    limit = dict(zip(names, parameters, strict=True)).get("max_deflection", np.full(count, FREE_RANGE))
    q = source.uniform(-2.0, 2.0, count)
    motors = q + reach * limit * source.uniform(-1.0, 1.0, (actuator.positions() - actuator.adjuster, count))
    adjuster = actuator.typical_preset * source.uniform(0.5, 1.5, (int(actuator.adjuster), count))
    return Points(np.vstack([q, motors, adjuster]), parameters, limit)


def _measures(actuator: type[Actuator]) -> Iterator[tuple[Array, Callable[[int], str]]]:
    """For each of `CHECKS`: its values (n,), and a function that describes the point of value `i`."""
    points, far = _points(actuator), _points(actuator, FAR)
    springs, stiffness = points.apply(actuator.elastic_torques), points.apply(actuator.stiffness)
    yield 0.0 * (far.apply(actuator.elastic_torques).sum(axis=0) + far.apply(actuator.stiffness)), far.text

    slopes = [_slopes(actuator, points, part * points.limit) for part in DIFFERENCES]
    by_q = np.array([-slope[0, 0] for slope in slopes])
    # At zero stiffness, a relative error is undefined. Errors are relative to at least a fraction of the largest stiffness.
    floor = max(1e-4 * np.abs(stiffness).max(), 1e-12)
    errors = np.abs(stiffness - by_q) / np.maximum(np.maximum(np.abs(stiffness), np.abs(by_q)), floor)
    best = errors.argmin(axis=0)
    yield errors.min(axis=0), lambda i: f"{points.text(i)}: stiffness {stiffness[i]:.6g}, slope {by_q[best[i], i]:.6g}"
    yield np.maximum(0.0, -stiffness), lambda i: f"{points.text(i)}: stiffness {stiffness[i]:.6g} N m/rad"
    # If the stiffness matrix is symmetric, the springs do no work round closed paths of link and motors.
    sizes = [np.maximum(np.abs(slope).max(axis=(0, 1)), 1e-12) for slope in slopes]
    asymmetries = [np.abs(slope - slope.swapaxes(0, 1)).max(axis=(0, 1)) for slope in slopes]
    yield np.min(np.divide(asymmetries, sizes), axis=0), points.text

    # An energy that is integrated from torques needs no check.
    h, energy, errors = 1e-4 * points.limit, actuator.elastic_energy, [0.0 * stiffness]
    torques = np.vstack([-springs.sum(axis=0), springs])[: len(slopes[0])]
    for row, torque in enumerate(torques if energy is not Actuator.elastic_energy else ()):
        low, high = (points.moved(row, shift).apply(energy) for shift in (-h, h))
        # Where the torque is 0, errors are relative to its change over the step and to rounding errors of the energy.
        scale = np.abs(torque) + h * np.abs(stiffness) + 1e-9 * np.maximum(np.abs(low), np.abs(high)) / h + 1e-12
        errors.append(np.abs((high - low) / (2.0 * h) - torque) / scale)
    yield np.max(errors, axis=0), points.text

    # The first points have the default parameters.
    equilibrium, presets = points.positions[0, :SAMPLES], actuator.typical_preset * np.linspace(0.5, 1.0, SAMPLES)
    thetas = over_arrays(actuator.motor_references)(equilibrium, presets)
    back = over_arrays(actuator.equilibrium_position)(*thetas)
    defaults = tuple(values[:SAMPLES] for values in points.parameters)
    unloaded = Points(np.vstack([equilibrium, thetas]), defaults, points.limit[:SAMPLES])
    loads = unloaded.apply(actuator.elastic_torques)
    rest = loads.sum(axis=0)
    scale = np.maximum(np.abs(loads).max(axis=0), np.abs(unloaded.apply(actuator.stiffness)) * unloaded.limit + 1e-12)
    yield (
        np.maximum(np.abs(back - equilibrium), np.abs(rest) / scale),
        lambda i: (
            f"{unloaded.text(i)}: the equilibrium comes back as {back[i]:.6g}, and {rest[i]:.3g} N m act on the unloaded link"
        ),
    )


def _slopes(actuator: type[Actuator], points: Points, h: Array) -> Array:
    """Derivatives (moving, moving, n) of the torques on link and motors by their positions, by fourth-order differences with
    the steps `h` (n,)."""
    moving = len(points.positions) - actuator.adjuster

    def torques(row: int, shift: Array) -> Array:
        springs = points.moved(row, shift).apply(actuator.elastic_torques)
        return np.vstack([springs.sum(axis=0), -springs])[:moving]

    return np.array([
        (8.0 * (torques(i, h) - torques(i, -h)) - torques(i, 2.0 * h) + torques(i, -2.0 * h)) / (12.0 * h)
        for i in range(moving)
    ])  # fmt: skip
