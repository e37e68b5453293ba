"""Compiled code: functions compiled by Numba, copied for other libraries, with records in memory and a cache."""
