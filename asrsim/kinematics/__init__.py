"""Cartesian tasks and gravity compensation."""
