"""Scenarios that asrsim writes for a robot (`asrsim init`): commented, runnable, with parameters that hold the arm."""
