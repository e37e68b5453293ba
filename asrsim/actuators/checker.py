"""Checks that the laws of an actuator agree with each other and with physics.

Every check evaluates the laws at seeded random points: deflections inside the limit, default and perturbed parameters. The
check reports the worst value, and the point at which this value occurs.
"""

from __future__ import annotations

import random
from collections.abc import Callable
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


Measured = tuple[Array, Callable[[int], str]]
"""Values (n,) of a check, and a function that describes the point of value `i`."""


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
    """Results of all checks. An exception in a law fails the checks that need the law and is not raised."""
    problems = declaration_problems(actuator)
    declaration = Check(
        name="declaration", passed=not problems, doc="name, motors, parameters and laws are declared as `Actuator` requires",
        detail="; ".join(f"{problem.key}: {problem.message}" for problem in problems),
    )  # fmt: skip
    return CheckReport(
        actuator=str(getattr(actuator, "name", actuator.__name__)),
        title=str(getattr(actuator, "title", actuator.__name__)),
        checks=(declaration, *(_run(*check, actuator) for check in (() if problems else CHECKS))),
    )


def _run(name: str, doc: str, limit: float, measure: Callable[[Points], Measured], actuator: type[Actuator]) -> Check:
    check = Check(name=name, passed=False, doc=doc, limit=limit)
    try:
        with np.errstate(all="ignore"):
            figures, text = measure(_points(actuator))
    except (Exception, SystemExit) as error:
        return replace(check, detail=f"raised {type(error).__name__}: {error}")
    if not np.isfinite(figures).all():
        return replace(check, detail=f"no finite number at {text(int(np.argmin(np.isfinite(figures))))}")
    worst = int(np.argmax(figures))
    return replace(check, passed=bool(figures[worst] <= limit), figure=float(figures[worst]), detail=text(worst))


class Points(NamedTuple):
    """Arguments of the laws of an actuator at n points."""

    actuator: type[Actuator]
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

    def results(self) -> Array:
        """Torques of the springs, and the stiffness (results, n)."""
        return np.vstack([self.apply(self.actuator.elastic_torques), self.apply(self.actuator.stiffness)])

    def forces(self) -> Array:
        """Torques (moving, n) of the springs on the link and the motors. An adjuster does not move."""
        springs = self.apply(self.actuator.elastic_torques)
        return np.vstack([springs.sum(axis=0), -springs])[: len(self.positions) - self.actuator.adjuster]

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
    return Points(actuator, np.vstack([q, motors, adjuster]), parameters, limit)


def _slopes(points: Points) -> Array:
    """Derivatives (steps, moving, moving, n) of the forces by the positions: fourth-order differences with each of the steps
    `DIFFERENCES`."""

    def forces(row: int, shift: Array) -> Array:
        return points.moved(row, shift).forces()

    moving = range(len(points.forces()))
    return np.array([
        [(8.0 * (forces(i, h) - forces(i, -h)) - forces(i, 2.0 * h) + forces(i, -2.0 * h)) / (12.0 * h) for i in moving]
        for h in np.outer(DIFFERENCES, points.limit)
    ])  # fmt: skip


def _pure(points: Points) -> Measured:
    return np.abs(points.results() - points.results()).max(axis=0), points.text


def _finite(points: Points) -> Measured:
    far = _points(points.actuator, FAR)
    return 0.0 * far.results().sum(axis=0), far.text


def _stiffness(points: Points) -> Measured:
    stiffness, slopes = points.apply(points.actuator.stiffness), -_slopes(points)[:, 0, 0]
    # At zero stiffness, a relative error is undefined. Errors are relative to at least a fraction of the largest stiffness.
    floor = max(1e-4 * np.abs(stiffness).max(), 1e-12)
    errors = np.abs(stiffness - slopes) / np.maximum(np.maximum(np.abs(stiffness), np.abs(slopes)), floor)
    best = errors.argmin(axis=0)
    return errors.min(axis=0), lambda i: f"{points.text(i)}: stiffness {stiffness[i]:.6g}, slope {slopes[best[i], i]:.6g}"


def _restoring(points: Points) -> Measured:
    stiffness = points.apply(points.actuator.stiffness)
    return np.maximum(0.0, -stiffness), lambda i: f"{points.text(i)}: stiffness {stiffness[i]:.6g} N m/rad"


def _passive(points: Points) -> Measured:
    # If the stiffness matrix is symmetric, the springs do no work round closed paths of link and motors.
    slopes = _slopes(points)
    sizes = np.maximum(np.abs(slopes).max(axis=(1, 2)), 1e-12)
    return (np.abs(slopes - slopes.swapaxes(1, 2)).max(axis=(1, 2)) / sizes).min(axis=0), points.text


def _energy(points: Points) -> Measured:
    energy = points.actuator.elastic_energy
    h, stiffness = 1e-4 * points.limit, points.apply(points.actuator.stiffness)
    errors = [0.0 * stiffness]
    # An energy that is integrated from torques needs no check.
    for row, force in enumerate(points.forces() if energy is not Actuator.elastic_energy else ()):
        low, high = (points.moved(row, shift).apply(energy) for shift in (-h, h))
        # Where the torque is 0, errors are relative to its change over the step and to rounding errors of the energy.
        scale = np.abs(force) + h * np.abs(stiffness) + 1e-9 * np.maximum(np.abs(low), np.abs(high)) / h + 1e-12
        errors.append(np.abs((low - high) / (2.0 * h) - force) / scale)
    return np.max(errors, axis=0), points.text


def _reference(points: Points) -> Measured:
    actuator = points.actuator
    # The first points have the default parameters.
    equilibrium, presets = points.positions[0, :SAMPLES], actuator.typical_preset * np.linspace(0.5, 1.0, SAMPLES)
    thetas = over_arrays(actuator.motor_references)(equilibrium, presets)
    back = over_arrays(actuator.equilibrium_position)(*thetas)
    defaults = tuple(values[:SAMPLES] for values in points.parameters)
    unloaded = Points(actuator, np.vstack([equilibrium, thetas]), defaults, points.limit[:SAMPLES])
    *loads, stiffness = unloaded.results()
    rest = np.sum(loads, axis=0)
    scale = np.maximum(np.abs(loads).max(axis=0), np.abs(stiffness) * unloaded.limit + 1e-12)
    return (
        np.maximum(np.abs(back - equilibrium), np.abs(rest) / scale),
        lambda i: (
            f"{unloaded.text(i)}: the equilibrium comes back as {back[i]:.6g}, and {rest[i]:.3g} N m act on the unloaded link"
        ),
    )


CHECKS = (
    ("pure", "a second call with the same arguments gives the same torques and stiffness", 0.0, _pure),
    ("finite", "torques and stiffness are finite over the range and beyond the limit", 0.0, _finite),
    ("stiffness", "the stiffness is minus the derivative of the torque by q (relative error)", 1e-6, _stiffness),
    ("restoring", "the stiffness is never negative inside the deflection limit (N m/rad)", 0.0, _restoring),
    ("passive", "the springs do no work round closed paths of link and motors (relative asymmetry)", 1e-4, _passive),
    ("energy", "the derivatives of a declared energy by -q and by theta_i are the torques (relative error)", 1e-3, _energy),
    ("reference map", "equilibrium_position inverts motor_references (rad), without torque on the link", 1e-9, _reference),
)
"""Name, condition, largest allowed value and function of each check."""
