"""The scenario as pure data: YAML read and validated."""

from __future__ import annotations

from asrsim.scenario.data import Scenario
from asrsim.scenario.load import load_scenario, make_scenario, scenario_from_data

__all__ = ["Scenario", "load_scenario", "make_scenario", "scenario_from_data"]
