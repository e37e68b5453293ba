"""Recorded commands in files of their own, where the playback signal cannot read them from the recording."""

from __future__ import annotations

import io

import numpy as np

from asrsim.scenario.starter_playback import Plan, Played


def extract(plan: Plan, name: str) -> dict[str, str]:
    """File name -> text of the played columns that the signal cannot read from the recording itself, in SI.

    One file a time base; `name`: of the first.
    """
    groups: dict[int, list[Played]] = {}
    for one in plan.played:
        if not one.direct:
            groups.setdefault(id(one.column.time), []).append(one)
    return {file: _table(members) for (file, members) in zip(_names(name, len(groups)), groups.values(), strict=True)}


def file_of(plan: Plan, one: Played, name: str) -> str:
    """Name of the extract in which a column is."""
    times = list(dict.fromkeys(id(other.column.time) for other in plan.played if not other.direct))
    return _names(name, len(times))[times.index(id(one.column.time))]


def _names(name: str, count: int) -> list[str]:
    stem, dot, ending = name.rpartition(".")
    return [name if number == 1 else f"{stem}_{number}{dot}{ending}" for number in range(1, count + 1)]


def _table(members: list[Played]) -> str:
    time = members[0].column.time
    values = np.column_stack([time, *(one.column.values for one in members)])
    # A playback must be whole: what is missing is bridged by the samples around it.
    for i in range(1, values.shape[1]):
        good = np.isfinite(values[:, i])
        values[:, i] = np.interp(time, time[good], values[good, i])
    text = io.StringIO()
    header = ",".join(["time [s]", *(f'"{one.label}"' for one in members)])
    np.savetxt(text, values, delimiter=",", header=header, comments="", fmt="%.12g")
    return text.getvalue()
