"""Measures on arrays: differences, step responses, oscillations, frequency responses; claims about a run."""

from __future__ import annotations

from asrsim.metrics.expect import ExpectationResult, check_expectation, evaluate_expectation
from asrsim.metrics.measures import MEASURES, Measure, measure
from asrsim.metrics.output import MetricRow, metrics_table, write_metrics_csv, write_metrics_json
from asrsim.metrics.summary import JointSummary, summarise

__all__ = [
    "MEASURES",
    "ExpectationResult",
    "JointSummary",
    "Measure",
    "MetricRow",
    "check_expectation",
    "evaluate_expectation",
    "measure",
    "metrics_table",
    "summarise",
    "write_metrics_csv",
    "write_metrics_json",
]
