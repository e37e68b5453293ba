"""Summary of a run, as data, as tables and as JSON: measures of each joint, verdicts on claims, warnings, and written files."""

from __future__ import annotations

from asrsim.summary.claims import claim_results
from asrsim.summary.collect import Collector, Seen
from asrsim.summary.data import RunSummary
from asrsim.summary.make import make_summary

__all__ = ["Collector", "RunSummary", "Seen", "claim_results", "make_summary"]
