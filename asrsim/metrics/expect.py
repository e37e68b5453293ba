"""Evaluation of claims about a run: measured number, comparison, verdict."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.document.kinds import Choice, Either, Kind, ListOf, Number, Text
from asrsim.errors import InputError, Problem, ScenarioError
from asrsim.joint_units import unit_at
from asrsim.metrics.asked import measure_text
from asrsim.metrics.measures import MEASURES, measure, trial_problems, unrest
from asrsim.metrics.motion import AXES
from asrsim.quantities import DERIVED, QUANTITIES, shown, unit_of
from asrsim.samples import TIP, TIP_GOAL, Array, JointInfo, Samples

if TYPE_CHECKING:
    from asrsim.scenario.data import Expectation

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "==": operator.eq,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
"""Function for each comparison of a claim."""
RECORDING_OPTIONS: dict[str, Kind[Any]] = {
    "lag": Either((Choice(("auto", "off", "start"), missing="Or state the lag as a number of seconds"), Number())),
    "map": Either((ListOf(of=Text()), Text())),
    "rate": Number(above=0.0),
}
"""Options of a claim with `against` that concern the recording, as in `asrsim plot`, with their kinds of value."""
BODY_QUANTITIES = ("position", "x", "y", "z", "error", "contact_force")
"""Quantities of a body in a claim; `contact_force` is the magnitude of the sum of its contact forces, N.

`error` is the distance in m of a Cartesian task's `tip` from its path.

`contact_force/<other>` is the force of one contact, with `robot`, `ground` or another body; with `.x`, `.y` or `.z` appended,
it is the component of this force along that axis of the world.
"""


@dataclass(frozen=True, kw_only=True)
class ExpectationResult:
    """Claim with its measured number and verdict."""

    expectation: Expectation
    holds: bool
    measured: float
    """Measured number; NaN if the measure is undefined; such a claim does not hold."""
    unit: str
    moving: float = 0.0
    """For a measure that needs a series at rest, motion that is left at the end of the series, in the unit of the series; 0 at
    rest."""
    moving_unit: str = ""
    reading: str = ""
    """Description of the recording's column that the run was compared with, and doubts about the recording."""

    @property
    def text(self) -> str:
        """Line with the claim, the measured number, and the verdict."""
        claim, tail = self.expectation, f" {self.unit}" if self.unit else ""
        who = claim.joint or claim.body or ""
        wanted = f"{claim.comparison} {claim.value:g}" + (f" +- {claim.tolerance:g}" if claim.tolerance else "")
        # Print the number in the unit of the claim, unless the number is so small that it would have a power of ten.
        tiny = 0.0 < abs(self.measured) < 1e-4
        number = shown(self.measured, self.unit, 5) if tiny else f"{self.measured:.5g}{tail}"
        got = "cannot be measured" if math.isnan(self.measured) else f"is {number}"
        if self.moving:
            left = f"{self.moving:.2g} {self.moving_unit}".rstrip()
            got += f", since it is not at rest at the end ({left} of motion is left)"
        other = Path(claim.against).name if claim.against else claim.reference
        against = f" against {other}" if other else ""
        verdict = "holds" if self.holds else "does not hold"
        read = f"; compared with {self.reading}" if self.reading else ""
        what = measure_text(claim.measure, measure_options(claim))
        return f"{who}: {what} of {claim.quantity}{against} {got}, expected {wanted}{tail}: {verdict}{read}"


def evaluate_expectation(
    expectation: Expectation,
    time: Array,
    columns: Mapping[str, Array],
    *,
    reference: Array | None = None,
    joint: JointInfo | None = None,
    checked: bool,
) -> ExpectationResult:
    """Verdict on a claim, measured on the quantities of its joint or body.

    Args:
        expectation: The claim.
        time: Times (n,), s.
        columns: Quantity -> values (n,) (or (n, 7) for `position` of a body) of the joint or body.
        reference: Reference (n,) for measures of a difference; by default the joint's own reference, computed as
            `position_error` + `link_position` if both exist and the claim is about the link position.
        joint: The joint, whose kind, actuator and operation mode state the units; None for a body.
        checked: Whether `check_expectation` accepted the claim already.

    Raises:
        ScenarioError: For unknown quantities, measures or options, with the line of the claim.
    """
    if not checked:
        check_expectation(expectation)
    series = columns.get(expectation.quantity)
    if series is None:
        raise _error(
            expectation,
            f"'{expectation.quantity}' is not recorded for {expectation.joint or expectation.body}",
            choices=tuple(columns),
        )
    if expectation.reference is not None:
        reference = columns[expectation.reference]
    if reference is None and expectation.quantity == "link_position" and "position_error" in columns:
        reference = columns["position_error"] + series
    options = measure_options(expectation)
    try:
        measured = measure(expectation.measure, time, series, reference, **options)
        moving = unrest(expectation.measure, time, series, reference, **options) if math.isnan(measured) else 0.0
    except InputError as error:
        raise _error(expectation, "; ".join(p.message for p in error.problems)) from None
    return ExpectationResult(
        expectation=expectation,
        holds=holds(expectation, measured),
        measured=measured,
        unit=claim_unit(expectation, joint),
        moving=moving,
        moving_unit=_series_unit(expectation, joint),
    )


def claim_unit(expectation: Expectation, joint: JointInfo | None = None) -> str:
    """Unit of a claim's measured number; "" for a pure number. joint: as in `evaluate_expectation`."""
    return MEASURES.get(expectation.measure).unit_of(_series_unit(expectation, joint))


def _series_unit(expectation: Expectation, joint: JointInfo | None) -> str:
    if expectation.quantity in QUANTITIES or expectation.quantity in DERIVED:
        return unit_of(expectation.quantity) if joint is None else unit_at(expectation.quantity, joint)
    return "N" if expectation.quantity.startswith("contact_force") else "m"


def holds(expectation: Expectation, measured: float) -> bool:
    """Whether a claim holds for its measured number."""
    return compares(measured, expectation.comparison, expectation.value, expectation.tolerance)


def subject_of(expectation: Expectation) -> tuple[object, ...]:
    """Key of the number that a claim measures. Claims with equal keys share the number and differ in the comparison."""
    claim = expectation
    options = repr(sorted(claim.options.items(), key=repr))
    return claim.joint, claim.body, claim.quantity, claim.measure, claim.reference, claim.against, options


def compares(measured: float, comparison: str, value: float, tolerance: float) -> bool:
    """Whether `measured comparison value` holds. The tolerance applies to `==` only; NaN never satisfies a comparison."""
    if comparison == "==":
        # Accept a violation that is as small as the rounding errors of the two numbers.
        return abs(measured - value) <= tolerance + 4e-16 * max(abs(measured), abs(value))
    return COMPARISONS[comparison](measured, value)


def check_expectation(expectation: Expectation, *, measurable: set[tuple[object, ...]] | None = None) -> None:
    """Check before the run that a claim can be evaluated; raises ScenarioError if not.

    measurable: keys of claims that are known to be measurable, which are not checked again. The key of this claim is added.
    """
    if expectation.measure not in MEASURES:
        found = MEASURES.unknown(expectation.measure)
        raise _error(expectation, found.message, choices=found.choices, hint=found.hint)
    if expectation.body is not None and not _is_body_quantity(expectation.quantity):
        raise _error(expectation, f"a body has no quantity '{expectation.quantity}'", choices=BODY_QUANTITIES)
    problems: list[Problem] = []
    if expectation.tolerance and expectation.comparison != "==":
        message = f"a tolerance is valid with '==' only, not with '{expectation.comparison}'"
        hint = "Include the margin in the value"
        problems.append(Problem(message, key="tolerance", value=expectation.tolerance, hint=hint, code="tolerance"))
    subject = subject_of(expectation)
    if measurable is None or subject not in measurable:
        problems += trial_problems(
            expectation.measure,
            expectation.options,
            RECORDING_OPTIONS if expectation.against is not None else {},
            poses=None if expectation.body is None else expectation.quantity == "position",
            compared=expectation.quantity == "link_position" or bool(expectation.against or expectation.reference),
        )
    if problems:
        raise ScenarioError(
            [
                Problem(p.message, key=p.key, choices=p.choices, hint=p.hint, code=p.code, line=expectation.line)
                for p in problems
            ]
        )
    if measurable is not None:
        measurable.add(subject)


def measure_options(expectation: Expectation) -> dict[str, Any]:
    """Options of the claim that belong to the measure, not to the recording."""
    if expectation.against is None:
        return dict(expectation.options)
    return {key: value for key, value in expectation.options.items() if key not in RECORDING_OPTIONS}


def _is_body_quantity(name: str) -> bool:
    force, dot, axis = name.partition(".")
    known = force in BODY_QUANTITIES if not dot else force == "contact_force" and axis in AXES
    return known or (name.startswith("contact_force/") and name != "contact_force/")


def body_columns(samples: Samples, body: str) -> dict[str, Array]:
    """Quantities of a body: `position` (n, 7), x, y, z, `contact_force` and `contact_force/<other>` (n,); 0 without contact."""
    columns: dict[str, Array] = {}
    poses = samples.bodies.get(body)
    if poses is not None:
        columns["position"] = poses
        columns |= {axis: poses[:, index] for axis, index in AXES.items()}
    if body == TIP and TIP_GOAL in samples.bodies and poses is not None:
        columns["error"] = np.linalg.norm(poses[:, :3] - samples.bodies[TIP_GOAL][:, :3], axis=1)
    forces = samples.forces_on(body)
    vectors = {f"contact_force/{other}": force for other, force in forces.items()}
    if forces or poses is not None:
        vectors["contact_force"] = sum(forces.values(), np.zeros((len(samples.time), 3)))
    for name, force in vectors.items():
        columns[name] = np.linalg.norm(force, axis=1)
        columns |= {f"{name}.{axis}": force[:, index] for axis, index in AXES.items()}
    return columns


def _error(claim: Expectation, message: str, **more: Any) -> ScenarioError:
    return ScenarioError(message, line=claim.line, key="expect", code="bad-expectation", **more)
