"""The claims of a scenario (`expect:`), evaluated on a run, against recordings too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.errors import Problem, RecordingError, ScenarioError
from asrsim.metrics.expect import ExpectationResult, body_columns, evaluate_expectation
from asrsim.recordings.compare import compare, simulated
from asrsim.recordings.data import Recording
from asrsim.recordings.read import read_recording
from asrsim.samples import Array, JointInfo, Samples

if TYPE_CHECKING:
    from asrsim.scenario.data import Expectation


def evaluate_claims(
    claims: Sequence[Expectation],
    samples: Samples,
    *,
    infos: Sequence[JointInfo] = (),
    variant: str | None = None,
    folder: Path | None = None,
) -> tuple[ExpectationResult, ...]:
    """Evaluates all claims of a variant.

    Args:
        claims: Of the scenario; those of other variants are passed over.
        samples: The whole run.
        infos: Joints of the run, for derived quantities.
        variant: Name of the run's variant; None: all claims are evaluated.
        folder: Of the scenario, for relative `against` paths.

    Raises:
        ScenarioError: A claim that cannot be evaluated (unknown joint, quantity, measure), all of them together.
        RecordingError: A recording that cannot be read or compared.
    """
    results: list[ExpectationResult] = []
    problems: list[Problem] = []
    recordings: dict[str, Recording] = {}
    for claim in claims:
        if variant is not None and claim.variant not in (None, variant):
            continue
        try:
            results.append(_evaluate(claim, samples, infos, folder, recordings))
        except ScenarioError as error:
            problems += error.problems
    if problems:
        raise ScenarioError(problems)
    return tuple(results)


def _evaluate(
    claim: Expectation, samples: Samples, infos: Sequence[JointInfo], folder: Path | None, recordings: dict[str, Recording]
) -> ExpectationResult:
    if claim.body is not None:
        columns = body_columns(samples, claim.body)
        if not columns:
            raise _error(claim, f"the run has no body '{claim.body}'", tuple(samples.bodies))
        return evaluate_expectation(claim, samples.time, columns)
    joint = claim.joint
    if joint is None or joint not in samples.joints:
        raise _error(claim, f"the run has no joint '{joint}'", samples.joints)
    if claim.against is not None:
        return _against(claim, joint, samples, infos, folder, recordings)
    columns = {}
    for quantity in (*samples.values, "position_error", claim.quantity):
        values: Array | None = simulated(samples, joint, quantity, infos)
        if values is not None:
            columns[quantity] = values
    return evaluate_expectation(claim, samples.time, columns)


def _against(
    claim: Expectation,
    joint: str,
    samples: Samples,
    infos: Sequence[JointInfo],
    folder: Path | None,
    recordings: dict[str, Recording],
) -> ExpectationResult:
    """A claim of a difference to a recording; its option `lag` chooses the alignment (auto, off, start, or s)."""
    name = str(claim.against)
    path = Path(name) if folder is None or Path(name).is_absolute() else folder / name
    if name not in recordings:
        recordings[name] = read_recording(path, joints=samples.joints)
    lag = claim.options.get("lag", "auto")
    result = compare(samples, recordings[name], infos=infos, lag=lag)
    series = result.find(joint, claim.quantity)
    if series is None:
        raise RecordingError(
            Problem(message=f"has no column for {joint}.{claim.quantity}, which `expect` compares", file=path,
                    choices=tuple(f"{s.joint}.{s.quantity}" for s in result.series), code="no-such-quantity")
        )  # fmt: skip
    plain = replace(claim, options={key: value for key, value in claim.options.items() if key != "lag"})
    return evaluate_expectation(plain, series.time, {claim.quantity: series.simulation}, reference=series.recording)


def _error(claim: Expectation, message: str, choices: tuple[str, ...]) -> ScenarioError:
    return ScenarioError(Problem(message=message, line=claim.line, key="expect", choices=choices, code="bad-expectation"))
