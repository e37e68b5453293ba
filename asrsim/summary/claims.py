"""Evaluates the claims of a scenario (its `expect:`) on the samples of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError, Problem, ScenarioError, listed
from asrsim.log.derived import DERIVED_FUNCTIONS, recorded_sources
from asrsim.metrics import MEASURES, ExpectationResult, check_expectation, evaluate_expectation
from asrsim.metrics.asked import measure_text
from asrsim.metrics.expect import body_columns, claim_unit, holds, measure_options, subject_of
from asrsim.recordings.align import SampleReader
from asrsim.samples import Array, JointInfo, Samples
from asrsim.scenario.data import Expectation


def claim_problems(claims: Sequence[Expectation], joints: Sequence[JointInfo], *, file: Path | None) -> list[Problem]:
    """Problems of claims that cannot be evaluated, as far as they can be found before the run. joints: joints of the run, or
    empty if they are not known yet.
    """
    problems: list[Problem] = []
    measurable: set[tuple[object, ...]] = set()
    for claim in claims:
        own = [*_unrecorded(claim, joints)]
        try:
            check_expectation(claim, measurable=measurable)
        except InputError as error:
            own += error.problems
        if claim.against is not None and joints and not own:
            own += _unreadable(claim, joints)
        problems += own
    return [replace(problem, file=problem.file or file) for problem in problems]


def _unrecorded(claim: Expectation, joints: Sequence[JointInfo]) -> Iterator[Problem]:
    """Problems of a claim about quantities that its joints do not record."""
    named = {"quantity": claim.quantity, "reference": claim.reference} if claim.body is None else {}
    for key, name in named.items():
        missing = [joint for joint in _joints_of(claim, joints) if name not in {None, *joint.quantities, *DERIVED_FUNCTIONS}]
        if missing:
            names, choices = [f"'{joint.name}'" for joint in missing], sorted({*missing[0].quantities, *DERIVED_FUNCTIONS})
            yield Problem(
                f"is not recorded for joint {listed(names, 3)}",
                line=claim.line,
                key=f"expect.{key}",
                value=name,
                choices=tuple(choices),
                meant=name,
                code="expect",
            )


def claim_results(
    claims: Sequence[Expectation], joints: Sequence[JointInfo], read: SampleReader, *, file: Path | None = None
) -> tuple[ExpectationResult, ...]:
    """Every claim with its verdict; a claim about the joint `"*"` has one verdict for each joint. Raises ScenarioError, whose
    message names the scenario's `file`.
    """
    return Claims(claims, joints, file=file).results(read)


class Claims:
    """Evaluates the claims of a scenario on many runs with the same joints."""

    def __init__(
        self, claims: Sequence[Expectation], joints: Sequence[JointInfo], *, file: Path | None = None, checked: bool = False
    ) -> None:
        """file: path of the scenario, for error messages; checked: whether `claim_problems` is skipped, since it has already
        found no problem."""
        self._joints, self._file, self._checked = tuple(joints), file, checked
        self._single = [
            (claim if joint is None else replace(claim, joint=joint.name), joint, _needed(claim, joint) if joint else ((), ()))
            for claim in claims
            for joint in (None, *_joints_of(claim, joints))
            if joint is not None or claim.body is not None
        ]

    def results(self, read: SampleReader) -> tuple[ExpectationResult, ...]:
        """Verdicts on the run whose samples the function `read` returns. Raises ScenarioError."""
        if not self._single:
            return ()
        from asrsim.summary.recorded import RecordedSeries

        recorded = RecordedSeries(self._joints, read)
        results: list[ExpectationResult] = []
        measured: dict[tuple[object, ...], ExpectationResult] = {}
        for claim, joint, needed in self._single:
            subject = subject_of(claim)
            if (known := measured.get(subject)) is not None:
                results.append(replace(known, expectation=claim, holds=holds(claim, known.measured)))
                continue
            how: dict[str, Any] = {"checked": self._checked}
            reading = ""
            try:
                if joint is None:
                    samples = read((), ())
                    time, columns = samples.time, body_columns(samples, claim.body or "")
                elif claim.against is not None:
                    series = recorded.series(claim, joint)
                    time, columns = series.time, {claim.quantity: series.simulation}
                    reading = series.reading
                    how |= {"reference": series.recording, "joint": joint}
                else:
                    samples = read(*needed)
                    time, columns = samples.time, _columns(claim, samples, joint)
                    how["joint"] = joint
                measured[subject] = replace(evaluate_expectation(claim, time, columns, **how), reading=reading)
                results.append(measured[subject])
            except InputError as error:
                placed = [_placed(fault, claim) if claim.against is not None else fault for fault in error.problems]
                raise ScenarioError([replace(fault, file=fault.file or self._file) for fault in placed]) from error
        return tuple(results)


def _unreadable(claim: Expectation, joints: Sequence[JointInfo]) -> list[Problem]:
    """Problems of a claim's recording that can be found before the run."""
    from asrsim.summary.recorded import require_columns

    try:
        require_columns(claim, joints, _joints_of(claim, joints))
    except InputError as error:
        return [_placed(problem, claim) for problem in error.problems]
    return []


def _placed(problem: Problem, claim: Expectation) -> Problem:
    """Problem of a claim's recording, placed at the claim's line in the scenario, unless it states a line of the recording."""
    if problem.line is not None:
        return problem
    message = problem.message if problem.file is None else f"{problem.file.name}: {problem.message}"
    return replace(problem, message=message, file=None, line=claim.line, key=problem.key or "expect")


def _joints_of(claim: Expectation, joints: Sequence[JointInfo]) -> list[JointInfo]:
    if claim.joint is None:
        return []
    return [joint for joint in joints if claim.joint in ("*", joint.name)]


def claim_titles(claims: Sequence[Expectation], joints: Sequence[JointInfo]) -> list[str]:
    """Description of each result of `claim_results`, in the order of the results."""
    found = []
    for claim in claims:
        names = [claim.body] if claim.body is not None else []
        names += [joint.name for joint in _joints_of(claim, joints)]
        what = measure_text(claim.measure, measure_options(claim))
        found += [f"{name} {claim.quantity}: {what} {claim.comparison} {claim.value:g}" for name in names]
    return found


def claim_units(claims: Sequence[Expectation], joints: Sequence[JointInfo]) -> list[str]:
    """Unit of the measured number of each result of `claim_results`, in the order of the results."""
    found = []
    for claim in claims:
        found += [claim_unit(claim)] if claim.body is not None else []
        found += [claim_unit(claim, joint) for joint in _joints_of(claim, joints)]
    return found


def needs_of(claims: Sequence[Expectation], joints: Sequence[JointInfo]) -> tuple[tuple[tuple[str, str], ...], bool]:
    """Series that `claim_results` reads from a run, each as (quantity, joint), and whether `claim_results` reads bodies and
    contacts."""
    wanted: dict[tuple[str, str], None] = {}
    for claim in claims:
        for joint in _joints_of(claim, joints):
            wanted |= dict.fromkeys((name, joint.name) for name in _needed(claim, joint)[0])
        if claim.against is not None:
            from asrsim.recordings.align import ALIGN_ON, simulated_sources

            # The recording may be aligned by any quantity that varies in run and recording, and by any joint that is recorded.
            names = (*ALIGN_ON, claim.quantity)
            wanted |= dict.fromkeys((name, joint.name) for joint in joints for name in simulated_sources(names, [joint]))
    return tuple(wanted), any(claim.body is not None for claim in claims)


def _needed(claim: Expectation, joint: JointInfo) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return tuple(recorded_sources([claim.quantity, claim.reference or "", *_derived(claim)], [joint])), (joint.name,)


def _derived(claim: Expectation) -> tuple[str, ...]:
    """Derived quantities that a claim needs: its own quantity if this quantity is derived, and `position_error` if the claim
    may use the reference of its joint.
    """
    own = claim.quantity == "link_position" and claim.against is None and claim.reference is None
    compared = own and MEASURES.get(claim.measure).needs != "series"
    asked = (claim.quantity, claim.reference)
    return tuple(name for name in DERIVED_FUNCTIONS if name in asked or (compared and name == "position_error"))


def _columns(claim: Expectation, samples: Samples, joint: JointInfo) -> dict[str, Array]:
    columns = samples.joint(joint.name)
    for name in _derived(claim):
        column = DERIVED_FUNCTIONS[name](samples, [joint])[:, samples.joints.index(joint.name)]
        if np.isfinite(column).any():
            columns[name] = column
    return columns
