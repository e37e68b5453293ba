"""Lines of a scenario's keys, for faults that show only once the robot is known."""

from __future__ import annotations

from dataclasses import replace

from asrsim.errors import Problem
from asrsim.scenario.data import Scenario


def line_of(scenario: Scenario, key: str) -> int | None:
    """Line of the dotted key, or of the nearest one above it."""
    while key:
        if key in scenario.lines:
            return scenario.lines[key]
        key = key.rpartition(".")[0]
    return None


def placed(scenario: Scenario, problem: Problem) -> Problem:
    """The problem with the scenario's file and line, unless it has a file."""
    if problem.file is not None:
        return problem
    return replace(problem, file=scenario.path, line=line_of(scenario, problem.key or ""))
