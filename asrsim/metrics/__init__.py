"""Measures of time series: differences, step responses, oscillations, frequency responses; claims about a run."""

from __future__ import annotations

from asrsim.metrics.expect import ExpectationResult, check_expectation, evaluate_expectation
from asrsim.metrics.frequency import frequency_response
from asrsim.metrics.lag import estimate_lag
from asrsim.metrics.measures import MEASURES, Measure, measure
from asrsim.metrics.output import METRICS, MetricRow, read_metrics, write_metrics
from asrsim.metrics.summary import JointSummary, summarise

__all__ = [
    "MEASURES",
    "METRICS",
    "ExpectationResult",
    "JointSummary",
    "Measure",
    "MetricRow",
    "check_expectation",
    "estimate_lag",
    "evaluate_expectation",
    "frequency_response",
    "measure",
    "read_metrics",
    "summarise",
    "write_metrics",
]
