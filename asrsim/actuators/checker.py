"""A generic checker of actuators, ours and users': do the laws agree with each other and with physics?

Every check samples the laws at seeded random points: deflections inside the limit, the defaults and perturbed
parameters. It says what it measured, and where the worst point is.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from asrsim.actuators import Actuator
from asrsim.actuators.sampling import Point, limit_of, link_torque, parameter_sets, sample_points
from asrsim.actuators.user import declaration_problems

_FAR = 4.0
"""Deflections up to this multiple of the limit must still give finite torques."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check's verdict."""

    name: str
    passed: bool
    doc: str
    """What was asked."""
    figure: float | None = None
    """The worst value found."""
    limit: float | None = None
    """What `figure` had to stay within."""
    detail: str = ""
    """Where the worst value is, or what went wrong."""


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """All checks of one actuator."""

    actuator: str
    title: str
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)


def check_actuator(actuator: type[Actuator]) -> CheckReport:
    """Run every check; laws that raise fail theirs. Nothing is raised."""
    problems = declaration_problems(actuator)
    declaration = Check(
        name="declaration", passed=not problems, doc="name, motors, parameters and laws are declared as the contract asks",
        detail="; ".join(f"{problem.key}: {problem.message}" for problem in problems),
    )  # fmt: skip
    return CheckReport(
        actuator=str(getattr(actuator, "name", actuator.__name__)),
        title=str(getattr(actuator, "title", actuator.__name__)),
        checks=(declaration, *(_run(*check, actuator) for check in (() if problems else _CHECKS))),
    )


class _FailedError(Exception):
    """A check failed in a way that is no figure."""


_Measure = Callable[[type[Actuator]], Iterator[tuple[float, str]]]


def _run(name: str, doc: str, limit: float | None, measure: _Measure, actuator: type[Actuator]) -> Check:
    worst, where = 0.0, ""
    try:
        for figure, point in measure(actuator):
            if math.isnan(figure):
                raise _FailedError(f"not a number at {point}")
            if figure > worst:
                worst, where = figure, point
    except _FailedError as error:
        return Check(name=name, passed=False, doc=doc, limit=limit, detail=str(error))
    except Exception as error:
        return Check(name=name, passed=False, doc=doc, limit=limit, detail=f"raised {type(error).__name__}: {error}")
    passed = limit is None or worst <= limit
    return Check(name=name, passed=passed, doc=doc, figure=worst, limit=limit, detail=where if worst > 0.0 else "")


def _pure(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    points = list(sample_points(actuator))
    first = []
    for point in points:
        torques, stiffness = point.call(actuator.elastic_torques), point.call(actuator.stiffness)
        if not isinstance(torques, tuple) or len(torques) != max(2, actuator.motors):
            raise _FailedError(f"elastic_torques must return {max(2, actuator.motors)} numbers as a tuple, got {torques!r}")
        if not all(isinstance(value, float) for value in (*torques, stiffness)):
            raise _FailedError(f"laws must return floats, got {torques!r} and {stiffness!r} at {point}")
        first.append((*torques, stiffness))
    for point, earlier in zip(reversed(points), reversed(first), strict=True):
        again = (*point.call(actuator.elastic_torques), point.call(actuator.stiffness))
        if again != earlier and not any(map(math.isnan, earlier)):
            raise _FailedError(f"the same input gave {earlier} and {again}: the law has a state; at {point}")
    yield 0.0, ""


def _finite(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    has_limit = any(parameter.name == "max_deflection" for parameter in actuator.parameters)
    for point in sample_points(actuator, _FAR if has_limit else 1.0):
        try:
            values = (*point.call(actuator.elastic_torques), point.call(actuator.stiffness))
        except ArithmeticError as error:
            raise _FailedError(f"{type(error).__name__} at {point}") from error
        if not all(map(math.isfinite, values)):
            raise _FailedError(f"not finite at {point}: {values}")
    yield 0.0, ""


def _stiffness_agrees(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    points = list(sample_points(actuator, 0.95))  # off the limit, where the slope breaks
    stated = [point.call(actuator.stiffness) for point in points]
    # Where a law is flat its slope has no relative error: the largest stiffness sets a floor.
    floor = max(1e-4 * max(map(abs, stated)), 1e-12)
    for point, value in zip(points, stated, strict=True):
        # Smaller differences serve where the first one happens to reach over a corner of the law.
        h = 1e-3 * limit_of(actuator, point.parameters)
        slopes = [_slope(actuator, point, part * h) for part in (1.0, 0.03, 0.001)]
        figure, slope = min((abs(value - slope) / max(abs(value), abs(slope), floor), slope) for slope in slopes)
        yield figure, f"{point}: stiffness {value:.6g}, slope {slope:.6g}"


def _slope(actuator: type[Actuator], point: Point, h: float) -> float:
    """-d tau_q / dq by a fourth-order central difference."""
    far = link_torque(actuator, point, point.q - 2 * h) - link_torque(actuator, point, point.q + 2 * h)
    near = link_torque(actuator, point, point.q - h) - link_torque(actuator, point, point.q + h)
    return (8.0 * near - far) / (12.0 * h)


def _restoring(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    for point in sample_points(actuator):
        stiffness = point.call(actuator.stiffness)
        yield max(0.0, -stiffness), f"{point}: stiffness {stiffness:.6g} N m/rad"


def _passive(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    """Work round closed loops of link and motors, against the work that goes to and fro in them."""
    source = random.Random(3)
    for parameters in parameter_sets(actuator):
        limit = limit_of(actuator, parameters)
        for loop in range(8):
            count = 1 + actuator.positions() - actuator.adjuster
            amplitudes = [source.uniform(0.1, 0.3) * limit for _ in range(count)]
            phases = [source.uniform(0.0, 2.0 * math.pi) for _ in range(count)]
            frozen = loop < 2
            if frozen:
                amplitudes[1:] = [0.0] * (count - 1)
            offset = 0.0 if actuator.motors == 1 else source.uniform(-0.3, 0.3) * limit
            work, moved = _loop_work(actuator, parameters, amplitudes, phases, offset)
            kind = "motors frozen" if frozen else "motors moving"
            yield (abs(work) / moved if moved > 0.0 else 0.0), f"{kind}: {work:.3g} J of {moved:.3g} J in one loop"


def _loop_work(
    actuator: type[Actuator], parameters: tuple[float, ...], amplitudes: list[float], phases: list[float], offset: float
) -> tuple[float, float]:
    """Work taken by the springs round an ellipse, and its magnitude; the periodic trapezoid rule is exact for smooth laws.

    Amplitudes (rad) and phases are those of link and motors; the motors are `offset` apart from the link, in turn to either
    side.
    """
    count = 1000
    work = moved = 0.0
    sides = [offset if i % 2 == 0 else -offset for i in range(len(amplitudes) - 1)]
    preset = (actuator.typical_preset,) if actuator.adjuster else ()
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        q, *thetas = (a * math.sin(angle + p) for a, p in zip(amplitudes, phases, strict=True))
        dq, *ways = (a * math.cos(angle + p) * 2.0 * math.pi / count for a, p in zip(amplitudes, phases, strict=True))
        placed = tuple(theta + side for theta, side in zip(thetas, sides, strict=True))
        torques = Point(q, (*placed, *preset), parameters).call(actuator.elastic_torques)
        power = sum(torque * way for torque, way in zip(torques, ways, strict=False)) - sum(torques) * dq
        work += power
        moved += abs(power)
    return work, moved


def _reference_map(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    for equilibrium, preset, thetas in _mapped(actuator, seed=4):
        back = actuator.equilibrium_position(*thetas)
        yield abs(back - equilibrium), f"equilibrium {equilibrium:.4g}, preset {preset:.4g}: comes back as {back:.6g}"


def _rest(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    parameters = parameter_sets(actuator)[0]
    limit = limit_of(actuator, parameters)
    for equilibrium, _, thetas in _mapped(actuator, seed=5):
        point = Point(equilibrium, thetas, parameters)
        torques, stiffness = point.call(actuator.elastic_torques), point.call(actuator.stiffness)
        scale = max(*map(abs, torques), abs(stiffness) * limit, 1e-12)
        yield abs(sum(torques)) / scale, f"{point}: {sum(torques):.3g} N m on the unloaded link"


def _mapped(actuator: type[Actuator], *, seed: int) -> Iterator[tuple[float, float, tuple[float, ...]]]:
    """Random equilibria and presets, and the motors' positions for them."""
    source = random.Random(seed)
    for _ in range(50):
        equilibrium, preset = source.uniform(-1.0, 1.0), actuator.typical_preset * source.uniform(0.5, 1.0)
        yield equilibrium, preset, actuator.motor_references(equilibrium, preset)


def _energy(actuator: type[Actuator]) -> Iterator[tuple[float, str]]:
    """Slope of the declared energy in q against the torque; without one the torques are integrated, with nothing to check."""
    if actuator.elastic_energy is Actuator.elastic_energy:
        return
    for point in sample_points(actuator, 0.95):
        h = 1e-4 * limit_of(actuator, point.parameters)
        low, high = (point._replace(q=point.q + d).call(actuator.elastic_energy) for d in (-h, h))
        torque = link_torque(actuator, point)
        # The energies' own rounding, seen through the difference, is no fault of the law.
        floor = max(abs(torque), 1e-9 * max(abs(low), abs(high)) / h, 1e-12)
        yield (
            abs((low - high) / (2.0 * h) - torque) / floor,
            f"{point}: slope {(low - high) / (2 * h):.6g}, torque {torque:.6g}",
        )


_CHECKS: tuple[tuple[str, str, float | None, _Measure], ...] = (
    ("pure", "the same input gives the same floats, in any order", None, _pure),
    ("finite", "torques and stiffness are finite over the range and beyond the limit", None, _finite),
    ("stiffness", "the stiffness is minus the torque's slope in q (relative error)", 1e-6, _stiffness_agrees),
    ("restoring", "the stiffness is never negative inside the deflection limit (N m/rad)", 0.0, _restoring),
    ("passive", "no work is made round closed loops of link and motors (share of the work moved)", 1e-4, _passive),
    ("energy", "the energy, where declared, has minus the torque for its slope in q (relative error)", 1e-3, _energy),
    ("reference map", "equilibrium_position undoes motor_references (rad)", 1e-9, _reference_map),
    ("rest", "at the equilibrium the unloaded link feels no torque (share of the springs' torque)", 1e-9, _rest),
)
