"""Checks of the simulator against facts from outside it; tests and docs/validation.md take their figures from here."""
