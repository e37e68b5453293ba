"""What was learned, as plain values for JSON."""

from __future__ import annotations

from typing import Any

from asrsim.kinematics.inverse import Demand
from asrsim.learning.transfer import TransferReport
from asrsim.learning.trial import LearningResult, Trial
from asrsim.plain import finite_or_none


def trial_data(trial: Trial, joints: tuple[str, ...]) -> dict[str, Any]:
    """One trial's numbers; rad and s."""
    return {
        "iteration": trial.number,
        "largest_error": {joint: finite_or_none(value) for joint, value in zip(joints, trial.largest, strict=True)},
        "rms_error": {joint: finite_or_none(value) for joint, value in zip(joints, trial.rms, strict=True)},
        "largest_norm": finite_or_none(trial.norm),
        "ratio": trial.ratio,
        "wall_time": trial.seconds,
    }


def result_data(result: LearningResult, joints: tuple[str, ...]) -> dict[str, Any]:
    """A learning run's numbers."""
    return {
        "outcome": result.outcome,
        "converged": result.converged,
        "reason": result.reason,
        "iterations": result.iterations,
        "best": result.best,
        "trials": [trial_data(trial, joints) for trial in result.trials],
    }


def demand_data(demand: Demand) -> dict[str, Any]:
    """What the motion asks of one part of a joint."""
    return {
        "joint": demand.joint,
        "what": demand.what,
        "motor": demand.motor or None,
        "needed": finite_or_none(demand.needed),
        "limit": finite_or_none(demand.limit),
        "unit": demand.unit,
        "time": demand.time,
        "score": finite_or_none(demand.score),
    }


def transfer_data(report: TransferReport) -> dict[str, Any]:
    """A transfer's numbers."""
    return {
        "draws": len(report.draws),
        "tolerance": report.tolerance,
        "within_tolerance": report.within,
        "within_tolerance_95": list(report.within_interval),
        "largest_error_quantiles": {f"{share:g}": finite_or_none(value) for share, value in report.quantiles().items()},
        "errors": [
            {"draw": dict(draw), "largest_error": [finite_or_none(float(value)) for value in row]}
            for draw, row in zip(report.draws, report.largest, strict=True)
        ],
    }
