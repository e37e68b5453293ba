"""Simulation of scenarios: preparation, time stepping, the loop over substeps, and its checks."""
