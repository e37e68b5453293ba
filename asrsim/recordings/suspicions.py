"""What the numbers of columns make doubtful: it is told, with the item of a mapping that would cure it. Nothing changes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, listed
from asrsim.recordings.data import Column, RawSeries
from asrsim.samples import Array

_DEGREES = 180 / math.pi
_FACTORS = ((_DEGREES, "degrees"), (1000.0, "thousandths"), (30 / math.pi, "rpm"), (1 / math.tau, "turns"))
_SYMBOLS = {"degrees": ("deg", "deg/s"), "turns": ("rev", "rev/s"), "rpm": ("rpm", "rpm")}
"""Unit -> its symbol of positions and of velocities."""
"""Number in a unit / number in SI, and the unit. The last two are told of velocities only."""
_FEWEST = 20
"""Samples below which columns are not compared with each other."""
_FOLLOWS, _TURNED = 0.9, -0.7
"""Correlation above which a column follows another, and below which it moves against it."""
_GEAR = 8.0
"""Ratio of a recorded motor to the simulated one above which it may be before its gear."""
_MARKS = (-999.0, -9999.0, -99999.0, 9999.0, 99999.0)
"""Numbers that recorders write for a missing one."""
_TURNS = 2 * math.tau
"""rad: links seldom turn further."""


def suspicions(columns: Sequence[Column], series: Sequence[RawSeries]) -> list[Problem]:
    """All suspicions about the columns of a recording that are used. series: theirs, in the file's units."""
    used = {(column.joint, column.quantity): column for column in columns if column.quantity}
    found = [one for column, raw in zip(columns, series, strict=True) if column.quantity for one in _alone(column, raw)]
    found += _unstated(list(used.values()))
    for (joint, quantity), column in used.items():
        position = used.get((joint, str(quantity).replace("velocity", "position")))
        if str(quantity).endswith("velocity") and position is not None:
            found += _slope(position, column)
        if quantity == "reference_1" and (position := used.get((joint, "link_position"))) is not None:
            found += _followed(position, column)
    return found


def beside(expected: Array, measured: Array, column: Column, joint: str, than: str = "the simulation") -> list[Problem]:
    """Suspicions about a column beside what is expected, both (n,) on one time. than: what is expected, in words."""
    target = f"{joint}.{column.quantity}"
    found = [] if (scale := suspect_scale(expected, measured, than, column.source, target)) is None else [scale]
    both = np.isfinite(expected) & np.isfinite(measured)
    correlation = _correlation(expected[both], measured[both]) if both.sum() >= 10 else 0.0
    if correlation < _TURNED:
        message = f"the recording moves against {than} (correlation {correlation:.2f}): is its sign the other way round?"
        found.append(Problem(message, hint=f"Turn it: --map '{column.source}=-{target}'", code="suspected-sign"))
    ratio = _ratio(expected, measured) if str(column.quantity).startswith("motor") and scale is None else 0.0
    if ratio > _GEAR and math.isfinite(ratio):
        message = (
            f"the recording is {ratio:.4g} times as large as {than}, whose motors are counted at the link's side of the gear"
        )
        hint = f"Was it recorded before the gear? Divide by its ratio: --map '{column.source}={1 / ratio:.3g}*{target}'"
        found.append(Problem(message, hint=hint, code="suspected-gear"))
    return found


def suspect_scale(
    expected: Array, measured: Array, than: str = "the simulation", source: str = "COLUMN", target: str = "JOINT.QUANTITY"
) -> Problem | None:
    """A suspicion that a unit is wrong: 57.3 or 1000 times as large, or as small, as expected.

    Compares the ranges (5 to 95 %) of both series, (n,) and (m,); where either does not move, their mean magnitudes.
    """
    ratio = _ratio(expected, measured)
    for factor, unit in _FACTORS[:2]:
        for size, what in ((factor, f"is it in {unit}"), (1 / factor, f"was it converted from {unit} once too often")):
            if _near(ratio, size, 1.25):
                message = f"the recording is {ratio:.4g} times as large as {than}, close to {size:.4g}: {what}?"
                cure = f"Convert it: --map '{source}={1 / size:.7g}*{target}'"
                return Problem(message, hint=cure, code="suspected-unit")
    return None


def beyond_stops(column: Column, joint: str, stops: tuple[float, float]) -> str | None:
    """A question where a link's numbers without a unit lie where its joint cannot go."""
    most = max(abs(stop) for stop in stops)
    if column.quantity != "link_position" or column.stated or _farthest(column) < 1.5 * most:
        return None
    return (
        f"{column.source}: states no unit and goes to {_farthest(column):.3g}, but {joint} stops at {most:.3g} rad or m: is it "
        f"in degrees or mm? Say so with --map '{column.source}={joint}.link_position [deg]'"
    )


def condense(findings: Iterable[Problem]) -> list[Problem]:
    """The notes; more than two of one kind become one, with the words of the first and the places of the others."""
    kinds: dict[str, list[Problem]] = {}
    for one in findings:
        kinds.setdefault(one.code, []).append(one)
    for code, notes in kinds.items():
        if len(notes) > 2:
            places = listed(dict.fromkeys(one.key for one in notes[1:] if one.key), 4)
            message = f"{notes[0].message}; and {len(notes) - 1} more like it" + (f": {places}" if places else "")
            kinds[code] = [replace(notes[0], message=message)]
    return [one for notes in kinds.values() for one in notes]


def _alone(column: Column, raw: RawSeries) -> Iterator[Problem]:
    """What is odd about the numbers of one column."""
    missing = np.isnan(column.values)
    time, values, numbers = column.time[~missing], column.values[~missing], raw.values[~missing]

    def told(code: str, message: str, hint: str | None = None) -> Problem:
        return Problem(message, key=column.source, code=code, hint=hint)

    if missing.all():
        yield told("empty-column", "has no number at all")
        return
    if missing.any():
        edges = np.flatnonzero(np.diff(np.concatenate(([0], missing.astype(np.int8), [0]))))
        starts, ends = edges[::2], edges[1::2] - 1
        longest = int(np.argmax(ends - starts))
        where = f"{column.time[starts[longest]]:.6g} s to {column.time[ends[longest]]:.6g} s"
        said = f"{int(missing.sum())} of {len(missing)} samples have no number, in {len(starts)} stretches"
        said += f"; the longest from {where}"
        yield told("missing-stretch", said, "They are left out of every comparison, not bridged")
    for mark in _MARKS:
        others = numbers[numbers != mark]
        if len(numbers) - len(others) > 1 and len(others) and np.max(np.abs(others)) < 0.02 * abs(mark):
            said = f"{len(numbers) - len(others)} numbers stand far from all others: do they mean a missing one?"
            cure = f"If so, state it in the document beside the file: `missing: {mark:g}`"
            yield Problem(said, key=column.source, value=mark, hint=cure, code="missing-mark")
    if len(glitches := time[_lone(values)]) and not str(column.quantity).startswith("reference"):
        said = f"{len(glitches)} single samples stand far from both neighbours (glitches?), at t = {_times(glitches)} s"
        yield told("glitch", said, "They are kept, and count in every comparison")
    steps = np.abs(np.diff(values))
    turns = np.abs(steps - math.tau) <= 0.1 * math.tau
    if column.unit == "rad" and turns.any() and np.max(steps[~turns], initial=0.0) < 0.1 * math.tau:
        said = (
            f"jumps by a whole turn {turns.sum()} times, at t = {_times(time[1:][turns])} s: does its encoder begin anew there?"
        )
        yield told("wrapped", said, f"Let it go on: --map '{column.source}={column.joint}.{column.quantity} unwrapped'")
    if len(numbers) >= 10 and numbers.min() >= 0.0 and np.array_equal(numbers, np.round(numbers)):
        steps = np.abs(np.diff(numbers))
        for bits in (8, 16, 32):
            jumps = steps > 0.9 * 2.0**bits
            if numbers.max() < 2.0**bits and jumps.any() and np.max(steps[~jumps], initial=0.0) < 0.1 * 2.0**bits:
                said = f"jumps between 0 and 2^{bits}: are these negative numbers of {bits} bits, read without their sign?"
                yield told("unsigned", said, f"If so, take {2**bits} from all above {2 ** (bits - 1)}")
    if len(values) > 2 and np.ptp(values) == 0.0:
        hint = None if str(column.quantity).startswith("reference") else "Was the sensor connected?"
        yield told("constant-column", f"is constant at {values[0]:g} {column.unit}".rstrip(), hint)


def _unstated(columns: Sequence[Column]) -> list[Problem]:
    """A question where angles state no unit beside others in degrees, or would turn more than twice in rad."""
    plain = [column for column in columns if not column.stated and column.unit == "rad"]
    converted = next((column for column in columns if column.conversion.startswith("deg") and column.unit == "rad"), None)
    wide = next((column for column in plain if column.quantity == "link_position" and _farthest(column) > _TURNS), None)
    if not plain or (converted is None and wide is None):
        return []
    why = (
        f"'{converted.source}' is in deg"
        if converted
        else f"'{wide.source}' would turn by {_farthest(wide):.3g} rad"
        if wide
        else ""
    )
    hint = f"If they are in degrees: --map '{plain[0].source}={plain[0].joint}.{plain[0].quantity} [deg]'"
    names = listed([column.source for column in plain], 6)
    return [Problem(f"no unit is stated, rad is assumed, but {why}", key=names, hint=hint, code="unstated-unit")]


def _slope(position: Column, velocity: Column) -> Iterator[Problem]:
    """A velocity that is not the slope of its position. Integrals are compared: slopes of measured numbers are noise."""
    time, angle, speed = _on_one_time(position, velocity)
    if len(time) < _FEWEST:
        return
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    # A velocity with a small offset departs from its position along a line.
    line = np.column_stack([np.ones_like(time), time - time[0]])
    angle, integral = (values - line @ np.linalg.lstsq(line, values, rcond=None)[0] for values in (angle, integral))
    correlation = _correlation(angle, integral)
    if abs(correlation) < _FOLLOWS:
        return
    target = f"{velocity.source}=-{velocity.joint}.{velocity.quantity}"
    if correlation < 0.0:
        said = f"goes down where '{position.source}' rises: is the sign of one of them the other way round?"
        yield Problem(said, key=velocity.source, hint=f"Turn it: --map '{target}'", code="suspected-sign")
        return
    ratio = float(np.std(integral) / np.std(angle))
    if _near(ratio, 1.0, 1.5):
        return
    asks, hint = "are both in the units that are assumed, of one side of the gear, and is the time right?", None
    for factor, unit in _FACTORS:
        for i, (column, size) in enumerate(((position, 1 / factor), (velocity, factor))):
            if _near(ratio, size, 1.12) and (column is velocity or unit != "rpm"):
                asks = f"is '{column.source}' in {unit}{' a second' if i and unit in ('degrees', 'turns') else ''}?"
                if not column.stated and unit in _SYMBOLS:
                    hint = f"If so: --map '{column.source}={column.joint}.{column.quantity} [{_SYMBOLS[unit][i]}]'"
    said = f"is {ratio:.3g} times the slope of '{position.source}': {asks}"
    yield Problem(said, key=velocity.source, hint=hint, code="suspected-unit")


def _followed(position: Column, command: Column) -> Iterator[Problem]:
    """A command that the position follows at 57.3 or 1000 times its size, where not both state their units."""
    time, angle, wanted = _on_one_time(position, command)
    if len(time) < _FEWEST or (position.stated and command.stated) or _correlation(angle, wanted) < _FOLLOWS:
        return
    if (ratio := _ratio(angle, wanted)) and suspect_scale(angle, wanted) is not None:
        said = (
            f"is {ratio:.3g} times as large as '{position.source}', which follows it: is one of them in degrees or thousandths?"
        )
        hint = f"If so: --map '{command.source}={command.joint}.{command.quantity} [unit]', or that of the other"
        yield Problem(said, key=command.source, code="suspected-unit", hint=hint)


def _on_one_time(first: Column, second: Column) -> tuple[Array, Array, Array]:
    """Time and numbers (n,) of both columns where both have one; none of them where one does not move."""
    known = np.isfinite(second.values)
    values = second.values
    if first.time is not second.time and known.any():
        values = np.interp(first.time, second.time[known], values[known], left=np.nan, right=np.nan)
    both = np.isfinite(first.values) & np.isfinite(values)
    a, b = first.values[both], values[both]
    moving = len(a) > 0 and min(np.ptp(a), np.ptp(b)) > 1e-9 * max(1.0, float(np.max(np.abs(a))))
    return (first.time[both], a, b) if moving else (first.time[:0], a[:0], b[:0])


def _correlation(a: Array, b: Array) -> float:
    """0 where one of them does not move."""
    spread = float(np.std(a) * np.std(b)) if min(np.ptp(a), np.ptp(b)) > 1e-9 else 0.0
    return float(np.mean((a - a.mean()) * (b - b.mean()))) / spread if spread > 0.0 else 0.0


def _ratio(expected: Array, measured: Array) -> float:
    """Size of what was measured over that of what was expected: of their ranges, or their magnitudes at rest; 0: unknown."""
    known = [values[np.isfinite(values)] for values in (expected, measured)]
    if not all(map(len, known)):
        return 0.0
    sizes = [float(np.ptp(np.percentile(values, (5, 95)))) for values in known]
    if min(sizes) < 1e-9:
        sizes = [float(np.mean(np.abs(values))) for values in known]
    return sizes[1] / sizes[0] if min(sizes) >= 1e-12 else 0.0


def _near(ratio: float, factor: float, width: float) -> bool:
    return 1 / width < ratio / factor < width


def _farthest(column: Column) -> float:
    """The largest magnitude of a column, single samples left out."""
    return float(np.nanpercentile(np.abs(column.values), 98)) if np.isfinite(column.values).any() else 0.0


def _lone(values: Array) -> NDArray[np.bool_]:
    """Samples (n,) far from both neighbours, which agree with each other: single glitches, not steps and not noise."""
    found = np.zeros(len(values), dtype=bool)
    if len(values) < 10:
        return found
    off = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
    noise, extent = 1.4826 * float(np.median(off)), float(np.ptp(np.percentile(values, (2, 98))))
    found[1:-1] = (off > max(12.0 * noise, 0.2 * extent, 1e-12)) & (np.abs(values[2:] - values[:-2]) < 0.3 * off)
    return found if found.mean() < 0.01 or found.sum() == 1 else np.zeros(len(values), dtype=bool)


def _times(times: Array) -> str:
    return listed([f"{t:.6g}" for t in times], 4)
