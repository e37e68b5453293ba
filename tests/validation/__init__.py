"""Checks of the simulator against external facts. Tests and docs/validation.md use their figures."""
