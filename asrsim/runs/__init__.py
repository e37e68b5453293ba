"""Runs and their folders: simulate into a folder with log and summary, and repeat a run from its log."""
