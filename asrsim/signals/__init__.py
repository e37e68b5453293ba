"""Signals: scalar functions of time, one file a kind."""
