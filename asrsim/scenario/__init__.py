"""Scenarios as pure data: reads and validates YAML, and applies the scenario to its robot."""

from __future__ import annotations

from asrsim.scenario.check import apply_to_robot
from asrsim.scenario.data import Scenario
from asrsim.scenario.load import (
    load_scenario,
    make_scenario,
    read_scenarios,
    scenario_from_data,
)

__all__ = [
    "Scenario",
    "apply_to_robot",
    "load_scenario",
    "make_scenario",
    "read_scenarios",
    "scenario_from_data",
]
