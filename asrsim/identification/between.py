"""Large jumps of recorded commands that came between two samples: a recording shows them at the later one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from asrsim.identification.fit import Best, fits_noise, left_of
from asrsim.identification.keys import JUMP, Parameter
from asrsim.identification.layout import Entry, Layout
from asrsim.identification.residuals import Residuals
from asrsim.identification.setup import Setup
from asrsim.identification.solver import cost_of, solve
from asrsim.identification.track import Track
from asrsim.samples import Array

ASKED = 20.0
"""Chi squared of one number from which on a recording asks for it: of noise alone, one time in a hundred thousand."""
MUCH = 0.5
"""Share of what is more than noise that jumps explain at least: where a model is wrong otherwise, any explains a part."""


def timed(residuals: Residuals, best: Best, setup: Setup) -> bool:
    """Free the times of jumps, each within the interval before its sample, where recordings ask for it; whether they do."""
    narrow, trained = residuals.layout, residuals.ends
    # What was held out has jumps of its own.
    residuals.ends = [track.data.duration for track in residuals.tracks]
    entries = [
        Entry(one, number, one.key if len(setup.tracks) == 1 else f"{one.key} ({track.data.name})", one.start)
        for number, track in enumerate(residuals.tracks) for one in _jumps(track)
        if all((one.key, number) != (entry.parameter.key, entry.track) for entry in narrow.entries)
    ]  # fmt: skip
    found = []
    if entries and not fits_noise(left_of(residuals, best.x)):
        wide = residuals.under(narrow.with_entries(entries))
        base = residuals(best.x)
        halves = []
        for i, entry in enumerate(entries):
            x = np.append(best.x, np.zeros(len(entries)))
            x[len(narrow) + i] = entry.place(0.5 * entry.parameter.high)
            halves.append(wide(x) - base)
        others = np.linalg.qr(residuals.jacobian(best.x, base=base))[0]
        shares = _shares(base, np.stack(halves, axis=1), others)
        found = [(entry, 0.5 * entry.parameter.high * share) for entry, share in zip(entries, shares, strict=True) if share]
    residuals.ends = trained
    if not found:
        return False
    residuals.layout = narrow.with_entries([entry for entry, _ in found])
    x = solve(residuals, np.append(best.x, [entry.place(value) for entry, value in found]), loss=setup.task.loss)
    setup.layout, best.x, best.cost = residuals.layout, x, cost_of(residuals(x), setup.task.loss)
    return True


def time_jumps_of_predicted(setup: Setup, layout: Layout, x: Array) -> None:
    """Play jumps of recordings that are only predicted where these ask for them: when they came is nothing of the model's."""
    for number, track in enumerate(setup.tracks):
        jumps = list(_jumps(track)) if track.data.held else []
        table = layout.table(x, number)
        base = _weighted(track, table) if jumps else None
        if base is None or np.mean(base**2) < 1.0:
            continue
        halves = [_weighted(track, {**table, one.key: 0.5 * one.high}) for one in jumps]
        slopes = np.stack([np.zeros(len(base)) if half is None else half - base for half in halves], axis=1)
        shares = _shares(base, slopes, np.zeros((len(base), 0)))
        track.early = {one.key: 0.5 * one.high * share for one, share in zip(jumps, shares, strict=True) if share}


def _jumps(track: Track) -> Iterator[Parameter]:
    """Seconds by which each large jump may come before its sample."""
    for command in track.data.commands:
        curve = (command.as_stairs if command.key in track.held else command).curve
        for number, piece in enumerate(curve.large, start=1):
            width = float(curve.time[piece] - curve.time[piece - 1])
            yield Parameter(key=f"{command.key}.{JUMP}{number}", unit="s", start=0.0, low=0.0, high=width, own=True)


def _weighted(track: Track, table: dict[str, float]) -> Array | None:
    """Deviations (m,) of the whole recording in those of its noise."""
    found = track.predict(table)
    if found is None:
        return None
    return np.concatenate([(a - one.values) / one.floor for a, one in zip(found, track.channels, strict=True)])


def _shares(base: Array, halves: Array, others: Array) -> Array:
    """(k,) of half an interval by which each jump comes early; 0 where that is not asked for, or others explain it.

    base: (m,) residuals; halves: (m, k) what half an interval makes of them; others: (m, n) orthonormal.
    """
    from scipy.optimize import lsq_linear

    left = base - others @ (others.T @ base)
    slopes = halves - others @ (others.T @ halves)
    shares = np.asarray(lsq_linear(slopes, -left, bounds=(0.0, 2.0)).x)
    after = left + slopes @ shares
    asked = shares**2 * np.sum(slopes**2, axis=0) > ASKED * max(float(np.mean(after**2)), 1.0)
    explained = float(left @ left - after @ after) > MUCH * (float(left @ left) - len(left))
    return np.where(asked & explained, shares, 0.0)
