"""Checks that the laws of an actuator agree with each other and with physics.

Every check evaluates the laws at seeded random points: deflections inside the limit, default and perturbed parameters. The
check reports the largest deviation from its condition, and the point at which this deviation occurs.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from asrsim.actuators import Actuator
from asrsim.actuators.declaration import declaration_problems
from asrsim.actuators.vectorised import Array, over_arrays
from asrsim.errors import Problem

FREE_RANGE = 0.5
"""Range of the sampled deflections for an actuator without the parameter `max_deflection`, rad."""
SAMPLES, VARIED = 200, 1000
"""SAMPLES: number of points at which each law is evaluated with the default parameters; VARIED: number of points with
parameters that are changed by up to 30 %."""
FAR = 4.0
"""Multiple of the deflection limit up to which torques must be finite."""
INSIDE = 0.95
"""Multiple of the deflection limit up to which slopes are measured, since the slope of a torque jumps at the limit itself."""
DIFFERENCES = (1e-3, 3e-5, 1e-6)
"""Steps of the finite differences, as fractions of the deflection limit. A check takes the step with the smallest error, since
only the smaller steps are accurate near a corner of a law."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Result of one check."""

    name: str
    passed: bool
    doc: str
    """The condition that the check tests."""
    figure: float | None = None
    """Largest deviation from the condition; None if the check measures no deviation."""
    limit: float | None = None
    """Largest allowed `figure`."""
    detail: str = ""
    """Point of the largest deviation, or the reason of the failure."""


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """Results of all checks of one actuator or stage."""

    actuator: str
    title: str
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)


def check_actuator(actuator: type[Actuator]) -> CheckReport:
    """Results of all checks. An exception in a law fails the checks that need the law and is not raised."""
    doc = "name, motors, parameters and laws are declared as `Actuator` requires"
    return report_of(actuator, declaration_problems(actuator), doc, (_run(actuator, *check) for check in CHECKS))


def report_of(kind: type[Any], problems: Sequence[Problem], doc: str, checks: Iterable[Check]) -> CheckReport:
    """Report on a class: the check of its declaration, described by `doc`, and the other checks. If the declaration has
    problems, the other checks are not made."""
    detail = "; ".join(f"{problem.key}: {problem.message}" for problem in problems)
    declaration = Check(name="declaration", passed=not problems, doc=doc, detail=detail)
    return CheckReport(
        actuator=str(getattr(kind, "name", kind.__name__)),
        title=str(getattr(kind, "title", kind.__name__)),
        checks=(declaration, *(() if problems else checks)),
    )


def raised_text(error: BaseException) -> str:
    """An exception of a law in words, with the file and line at which it was raised."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"raised {type(error).__name__}: {error} ({last.filename}:{last.lineno})"


def _run(
    actuator: type[Actuator], name: str, doc: str, limit: float, measure: Callable[[Points], Array], reach: float
) -> Check:
    check = Check(name=name, passed=False, doc=doc, limit=limit)
    try:
        with np.errstate(all="ignore"):
            points = Points(actuator, reach)
            figures = measure(points)
            worst = int(np.argmax(np.where(np.isfinite(figures), figures, np.inf)))
            figure, text = float(figures[worst]), points.text(worst)
    except (Exception, SystemExit) as error:
        return replace(check, detail=raised_text(error))
    if not math.isfinite(figure):
        return replace(check, detail=f"no finite number at {text}")
    return replace(check, passed=figure <= limit, figure=figure, detail=text)


class Points:
    """Arguments of the laws of an actuator at n random points."""

    def __init__(self, actuator: type[Actuator], reach: float) -> None:
        """reach: largest deflection, as a multiple of the deflection limit."""
        self.actuator = actuator
        source, count = np.random.default_rng(2), SAMPLES + VARIED
        declared = [(parameter.default, parameter.minimum, parameter.maximum) for parameter in actuator.parameters]
        default, low, high = np.reshape(declared, (-1, 3)).T[:, :, None]
        values = default * np.where(np.arange(count) < SAMPLES, 1.0, source.uniform(0.7, 1.3, (len(declared), count)))
        self.parameters = tuple(np.where((low < values) & (values < high), values, default))
        """Values (n,) of each parameter of the spring; the first `SAMPLES` points have the default values."""
        names = [parameter.name for parameter in actuator.parameters]
        self.limit = dict(zip(names, self.parameters, strict=True)).get("max_deflection", np.full(count, FREE_RANGE))
        """Largest deflection (n,) of the springs at each point, rad."""
        q = source.uniform(-2.0, 2.0, count)
        self.moving = 1 + actuator.positions() - actuator.adjuster
        """Number of positions that move: the positions of the link and of the motors, without the position of an adjuster."""
        offsets = reach * self.limit * source.uniform(-1.0, 1.0, (self.moving - 1, count))
        # For motors on the housing, the deflection of a spring is a sum of several angles, so make the angles smaller.
        offsets /= 1.0 + actuator.housed
        # A motor on the housing does not turn with the link.
        motors = np.array([[float(not actuator.is_housed(i))] for i in range(self.moving - 1)]) * q + offsets
        adjuster = actuator.typical_preset * source.uniform(0.5, 1.5, (int(actuator.adjuster), count))
        self.positions = np.vstack([q, motors, adjuster])
        """Positions (1 + positions, n) of the link (rad), the motors (rad) and an adjuster (in the unit of the second
        reference)."""

    def apply(self, law: Callable[..., Any], shift: Array | float = 0.0) -> Array:
        """Results (n,) of a spring law, or (results, n) of a law that returns several numbers, at shifted positions."""
        return over_arrays(law)(*(self.positions + shift), self.parameters)

    def forces(self, shift: Array | float = 0.0) -> Array:
        """Torques (moving, n) of the springs on the link and the motors, at shifted positions; an adjuster is left out, since
        it does not move."""
        springs = self.apply(self.actuator.elastic_torques, shift)
        return np.vstack([self.actuator.on_link(springs), -springs])[: self.moving]

    def stiffness(self) -> Array:
        """Stiffness (n,), N m/rad."""
        return self.apply(self.actuator.stiffness)

    def slopes(self, values: Callable[[Array], Array]) -> Array:
        """Derivatives (steps, moving, ..., n) with respect to the positions, by fourth-order differences with each step in
        `DIFFERENCES`. values: function of a shift of the positions."""
        rows = []
        for h in np.outer(DIFFERENCES, self.limit):
            for shift in np.eye(len(self.positions))[: self.moving, :, None] * h:
                near, far = values(shift) - values(-shift), values(2.0 * shift) - values(-2.0 * shift)
                rows.append((8.0 * near - far) / (12.0 * h))
        return np.reshape(rows, (len(DIFFERENCES), self.moving, *rows[0].shape))

    def text(self, i: int) -> str:
        """Description of point `i`, with the torque on the link and the stiffness at this point."""
        q, *thetas = self.positions[:, i]
        values = ", ".join(f"{value[i]:.6g}" for value in self.parameters)
        motors = ", ".join(f"theta_{number}={theta:.4g}" for number, theta in enumerate(thetas, start=1))
        laws = f"torque {self.forces()[0, i]:.4g} N m, stiffness {self.stiffness()[i]:.6g} N m/rad"
        return f"q={q:.4g}, {motors}, parameters=({values}): {laws}"


def _pure(points: Points) -> Array:
    torques, stiffness = points.actuator.elastic_torques, points.actuator.stiffness
    calls: list[Any] = list(zip(*points.positions.tolist(), np.transpose(points.parameters).tolist(), strict=True))
    first = np.array([(*torques(*call), stiffness(*call)) for call in calls])
    again = np.empty_like(first)
    # Call the laws again in another order. Different results show that a law has a hidden state, such as a counter.
    for i in np.random.default_rng(3).permutation(len(calls)).tolist():
        again[i, -1], again[i, :-1] = stiffness(*calls[i]), torques(*calls[i])
    return np.asarray(np.abs(again - first).max(axis=1))


def _finite(points: Points) -> Array:
    return np.asarray(0.0 * (points.forces()[0] + points.stiffness()))


def _stiffness(points: Points) -> Array:
    stiffness = points.stiffness()
    errors = np.abs(points.slopes(points.forces)[:, 0, 0] + stiffness).min(axis=0)
    # If the stiffness is small, the error is relative to a fraction of the largest stiffness.
    return np.asarray(errors / np.maximum(np.abs(stiffness), 1e-4 * np.abs(stiffness).max() + 1e-12))


def _restoring(points: Points) -> Array:
    return np.maximum(0.0, -points.stiffness())


def _passive(points: Points) -> Array:
    # If the stiffness matrix is symmetric, the springs do no work along closed paths of link and motors.
    slopes = points.slopes(points.forces)
    sizes = np.maximum(np.abs(slopes).max(axis=(1, 2)), 1e-12)
    return np.asarray((np.abs(slopes - slopes.swapaxes(1, 2)).max(axis=(1, 2)) / sizes).min(axis=0))


def _energy(points: Points) -> Array:
    energy, forces = points.actuator.elastic_energy, points.forces()
    if energy is Actuator.elastic_energy:
        # The default energy is the integral of the torques, so its derivatives need no check.
        return np.zeros(len(points.limit))
    errors = np.abs(points.slopes(partial(points.apply, energy)) + forces).max(axis=1).min(axis=0)
    # If the torques are small, the error is relative to a fraction of the largest torque.
    return np.asarray(errors / np.maximum(np.abs(forces).max(axis=0), 1e-4 * np.abs(forces).max() + 1e-12))


def _reference(points: Points) -> Array:
    actuator, equilibrium = points.actuator, points.positions[0]
    presets = actuator.typical_preset * np.linspace(0.5, 1.0, len(equilibrium))
    points.positions[1:] = over_arrays(actuator.motor_references)(equilibrium, presets)
    back = over_arrays(actuator.equilibrium_position)(*points.positions[1:])
    offset = points.forces()[0] / (np.abs(points.stiffness()).max() + 1e-12)
    # Check only with the default parameters. With perturbed parameters, opposing springs may be unequal, so that the link rests
    # at another position.
    return np.asarray(np.maximum(np.abs(back - equilibrium), np.abs(offset))[:SAMPLES])


CHECKS = (
    ("pure", "torques and stiffness depend on the arguments only, not on earlier calls", 0.0, _pure, INSIDE),
    ("finite", "torques and stiffness are finite over the range and beyond the limit", 0.0, _finite, FAR),
    ("stiffness", "the stiffness is minus the derivative of the torque by q (relative error)", 1e-6, _stiffness, INSIDE),
    ("restoring", "the stiffness is never negative inside the deflection limit (N m/rad)", 0.0, _restoring, INSIDE),
    ("passive", "the springs do no work round closed paths of link and motors (relative asymmetry)", 1e-4, _passive, INSIDE),
    (
        "energy",
        "the derivatives of a declared energy by -q and theta_i are the torques, also beyond the limit (relative error)",
        1e-3,
        _energy,
        FAR,
    ),
    (
        "reference map",
        "equilibrium_position inverts motor_references, and the link rests there (rad)",
        1e-9,
        _reference,
        INSIDE,
    ),
)
"""Name, condition, largest allowed value and function of each check, and the largest deflection of the check's points as a
fraction of the limit."""
