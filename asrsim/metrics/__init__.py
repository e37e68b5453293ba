"""Measures of time series: differences, step responses, oscillations, frequency responses; claims about a run."""

from __future__ import annotations

from asrsim.metrics.expect import ExpectationResult, check_expectation, evaluate_expectation
from asrsim.metrics.frequency import frequency_response
from asrsim.metrics.lag import estimate_lag
from asrsim.metrics.measures import MEASURES, Measure, measure
from asrsim.metrics.output import MetricRow, write_metrics_csv, write_metrics_json
from asrsim.metrics.summary import JointSummary, summarise

__all__ = [
    "MEASURES",
    "ExpectationResult",
    "JointSummary",
    "Measure",
    "MetricRow",
    "check_expectation",
    "estimate_lag",
    "evaluate_expectation",
    "frequency_response",
    "measure",
    "summarise",
    "write_metrics_csv",
    "write_metrics_json",
]
