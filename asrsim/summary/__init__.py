"""The summary of a run: numbers of each joint, claims, warnings, files; as data, as a table, as JSON."""

from __future__ import annotations

from asrsim.summary.claims import claim_results
from asrsim.summary.collect import Collector, Seen, joint_measures
from asrsim.summary.data import JointReport, RunSummary
from asrsim.summary.make import make_summary

__all__ = ["Collector", "JointReport", "RunSummary", "Seen", "claim_results", "joint_measures", "make_summary"]
