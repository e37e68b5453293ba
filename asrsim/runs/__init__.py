"""Runs and their folders: simulates into a folder with log and summary, and repeats a run from its log."""
