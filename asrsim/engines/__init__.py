"""Engines: they know joints and torques, never springs."""
