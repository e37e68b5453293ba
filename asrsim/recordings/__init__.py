"""Recordings of experiments, read from the files that labs have."""
