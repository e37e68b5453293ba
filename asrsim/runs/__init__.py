"""Runs and their folders: simulates a scenario and writes log and summary into a folder, and repeats a run from its log."""
