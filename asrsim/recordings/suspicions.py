"""Finds probable errors of unit, sign and range in the numbers of columns. Each problem states the option that corrects the
error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from asrsim.errors import Problem, counted, listed
from asrsim.recordings.data import Column
from asrsim.recordings.reading import item_of
from asrsim.recordings.turns import restarts
from asrsim.samples import Array

_FACTORS = ((180 / math.pi, "degrees"), (1000.0, "thousandths"))
"""Typical wrong units, as pairs (value in this unit divided by the SI value, name of the unit)."""
_FEWEST = 20
"""Smallest number of samples for a comparison of two columns."""
_NEAR, _FAR = 1.5, 10.0
"""A number is suspected to mark missing values if it is far from all other numbers. Its distance must exceed their range times
_NEAR if it is a typical mark, such as 999, and their range times _FAR otherwise.
"""
_LIMITS = (2.0**15, 2.0**15 - 1, 2.0**16 - 1, 2.0**31, 2.0**31 - 1, 2.0**32 - 1)
"""Magnitudes of the largest and smallest integers of computers. Some files mark missing values by them."""
_OTHERS = 0.3
"""Two columns are suspected to be interchanged if interchanging them reduces the error to less than this fraction."""
_FOLLOWS, _TURNED = 0.9, -0.7
"""_FOLLOWS: one column follows another if their correlation is at least this value.
_TURNED: the sign of a column is probably reversed if its correlation with the expected values is below this value.
"""
_NOT_A_TURN = 0.02
"""A restart is not a whole turn if it differs from a turn by more than this fraction."""
_POSITION = re.compile("position|deflection")
"""Pattern of the quantities whose sensors may restart."""
_GEARED = 10.0
"""A motor position counts as measured before the gear if the motor moves more than this number of times as far as the link. If
a soft spring caused this ratio, the link would hardly move.
"""


def suspicions(columns: Sequence[Column], raw: Sequence[Array]) -> list[Problem]:
    """All suspected errors in the used columns of a recording. raw: values of each column in the file's unit."""
    used = {(column.joint, column.quantity): column for column in columns if column.quantity}
    found = [one for column, values in zip(columns, raw, strict=True) if column.quantity for one in _alone(column, values)]
    for (joint, quantity), column in used.items():
        position = used.get((joint, str(quantity).replace("velocity", "position")))
        if str(quantity).endswith("velocity") and position is not None and position.time is column.time:
            found += _slope(position, column)
    return found


def beside(expected: Array, measured: Array, column: Column, joint: str, than: str = "the simulation") -> list[Problem]:
    """Suspected errors of unit and of sign in a column. An error of unit makes values 57.3 or 1000 times too large or too
    small.

    The ranges (5 to 95 %) of the two series are compared. If one series is constant, their mean magnitudes are compared.

    Args:
        expected: Expected values (n,).
        measured: Values of the column at the same times (n,).
        column: The column.
        joint: Joint of the simulation.
        than: Words for the expected values in messages.
    """
    ratio = _ratio(expected, measured)
    found: list[Problem] = []
    for factor, unit in _FACTORS:
        for size, what in ((factor, f"is it in {unit}"), (1 / factor, f"was it converted from {unit} twice")):
            if 0.8 < ratio / size < 1.25:
                message = f"is {ratio:.4g} times as large as {than}, close to {size:.4g}, the ratio of two units: {what}?"
                cure = f"Convert it: --map '{item_of(column, gain=float(f'{1 / size:.7g}'), joint=joint)}'"
                found.append(Problem(message, hint=cure, code="suspected-unit"))
    both = np.isfinite(expected) & np.isfinite(measured)
    correlation = _correlation(expected[both], measured[both])
    if correlation < _TURNED:
        message = f"the recording moves opposite to {than} (correlation {correlation:.2f}): is its sign reversed?"
        found.append(
            Problem(message, hint=f"Reverse it: --map '{item_of(column, gain=-1.0, joint=joint)}'", code="suspected-sign")
        )
    return found


def gear_between(motor: Column, link: Column | None) -> float:
    """Ratio of the motor's motion to the link's motion if the motor was measured before the gear; 0 otherwise."""
    if link is None or motor is link:
        return 0.0
    known = np.isfinite(motor.values) & (motor.time >= link.time[0]) & (motor.time <= link.time[-1])
    good = np.isfinite(link.values)
    if not good.any():
        return 0.0
    place = np.interp(motor.time[known], link.time[good], link.values[good])
    if abs(_correlation(place, motor.values[known])) < _FOLLOWS:
        return 0.0
    slope = float(np.polyfit(place, motor.values[known], 1)[0])
    return slope if abs(slope) > _GEARED else 0.0


def interchanged(
    expected: Mapping[str, Array], measured: Mapping[str, Array], columns: Mapping[str, Column], than: str = "the simulation"
) -> Iterator[Problem]:
    """Problems of pairs of columns with the same quantity. Each column of a pair fits the joint of the other column far better
    than its own joint.

    expected, measured: values (n,) at equal times, by joint; columns: column of each joint; than: words for the expected values
    in messages.
    """

    def error(a: str, b: str) -> float:
        squares = np.square(expected[a] - measured[b])
        known = squares[np.isfinite(squares)]
        return float(known.mean()) if len(known) else math.nan

    for a, b in combinations(columns, 2):
        own, other = error(a, a) + error(b, b), error(a, b) + error(b, a)
        if other < _OTHERS**2 * own:
            message = f"fits '{b}' of {than}, and '{columns[b].source}' fits '{a}': are the two columns interchanged?"
            items = f"{columns[a].source}={b}.{columns[a].quantity}", f"{columns[b].source}={a}.{columns[b].quantity}"
            cure = "If so: " + " ".join(f"--map '{item}'" for item in items)
            yield Problem(message, key=columns[a].source, hint=cure, code="suspected-joint")


def condense(findings: Iterable[Problem]) -> list[Problem]:
    """Problems, of which more than two with the same code are merged into one. Its message is the first message, followed by
    the keys of the other problems.
    """
    kinds: dict[str, list[Problem]] = {}
    for one in findings:
        kinds.setdefault(one.code, []).append(one)
    for code, notes in kinds.items():
        if len(notes) > 2:
            places = listed(dict.fromkeys(one.key for one in notes[1:] if one.key), 4)
            message = f"{notes[0].message}; and {len(notes) - 1} similar problems" + (f": {places}" if places else "")
            kinds[code] = [replace(notes[0], message=message)]
    return [one for notes in kinds.values() for one in notes]


def _alone(column: Column, raw: Array) -> Iterator[Problem]:
    """Problems in the numbers of a single column. raw: values in the file's unit."""
    missing = np.isnan(column.values)
    time, values, numbers = column.time[~missing], column.values[~missing], raw[~missing]
    if missing.all():
        yield Problem("contains no number", key=column.source, code="empty-column")
        return
    if missing.any():
        message = (
            f"{int(missing.sum())} of {len(missing)} samples have no number, the first at t = {column.time[missing][0]:.6g} s"
        )
        hint = "Comparisons skip these samples; they are not interpolated"
        yield Problem(message, key=column.source, hint=hint, code="missing-numbers")
    if not str(column.quantity).startswith(("reference", "external")):
        yield from _markers(column, time, numbers)
    if not len(restarts(numbers)[0]) and (count := _turns(values[:1000])):
        message = (
            f"is close to its value {count} samples before, but far from the values of its neighbours: "
            f"do the samples alternate between {count} joints?"
        )
        hint = "If so, state the column with the joint of each row in the document beside the file: `joint: name`"
        yield Problem(message, key=column.source, hint=hint, code="suspected-turns")
    yield from _restarts(column, time, values, numbers)
    if len(values) > 2 and np.ptp(values) == 0.0:
        hint = "" if str(column.quantity).startswith("reference") else "Was the sensor connected?"
        message = f"is constant at {values[0]:g} {column.unit}".rstrip()
        yield Problem(message, key=column.source, hint=hint or None, code="constant-column")


def _restarts(column: Column, time: Array, values: Array, numbers: Array) -> Iterator[Problem]:
    """Problems of a sensor that restarts after each turn or when its counter is full, and of integers that were read as
    unsigned.

    time, values, numbers: times, values in SI units, and values in the file's unit (n,) of the samples that have a number.
    """
    read, removed = column.read_as, "unwrapped" in column.conversion
    places, size = (np.empty(0, dtype=np.int64), 0.0) if removed else restarts(numbers)
    odd = False
    if len(places):
        turn = size * abs((values[places[0] + 1] - values[places[0]]) / (numbers[places[0] + 1] - numbers[places[0]]))
        odd = abs(turn - math.tau) > _NOT_A_TURN * math.tau
    whole = len(numbers) >= 10 and numbers.min() >= 0.0 and np.array_equal(numbers, np.round(numbers)) and not removed
    periods = [(numbers, 2.0**bits) for bits in (8, 16, 32) if whole and numbers.max() < 2.0**bits]
    told = False
    for series, period in [(values, math.tau)] * (column.unit == "rad" and not odd) + periods:
        steps = np.abs(np.diff(series))
        jumps = np.abs(steps - period) <= 0.1 * period
        if jumps.any() and np.max(steps[~jumps], initial=0.0) < 0.1 * period:
            told = True
            message = f"jumps by {period:.6g} {jumps.sum()} times, first at t = {time[1:][jumps][0]:.6g} s: "
            if series is values:
                message += "does its encoder restart after each turn?"
                hint = f"Remove the jumps: --map '{item_of(column, unwrapped=True)}'"
            else:
                message += "are these negative numbers that were read as unsigned?"
                hint = f"If so, subtract {period:.0f} from all numbers above {period / 2:.0f} in the file. "
                hint += f"If a counter restarts: --map '{item_of(column, unwrapped=True, period=period)}'"
            yield Problem(message, key=column.source, hint=hint, code="wrapped" if series is values else "unsigned")
    if told or not _POSITION.search(str(column.quantity)):
        return
    if len(places):
        about = float(f"{size:.4g}")
        message = (
            f"jumps by about {about:.12g} in the numbers of the file {counted(len(places), 'time')}, first at "
            f"t = {time[places[0] + 1]:.6g} s, against the direction of its motion: does its sensor restart?"
        )
        item = item_of(column, unwrapped=True, period=about)
        hint = f"If so, state the exact number after which it restarts: --map '{item}'"
        yield Problem(message, key=column.source, hint=hint, code="wrapped")
    elif read is not None and read.unwrapped and not removed and abs(read.scale) != 1.0:
        message = "has no jump by a whole turn, neither before nor after its factor: `unwrapped` changes nothing"
        hint = f"If its sensor restarts after another number: --map '{item_of(column, unwrapped=True, period=4096)}'"
        yield Problem(message, key=column.source, hint=hint, code="not-wrapped")


def _markers(column: Column, time: Array, numbers: Array) -> Iterator[Problem]:
    """Problems of numbers that are probably not measurements: a number far from all other numbers, and numbers 0 between values
    far from 0.

    time, numbers: times and values (n,) of the samples that have a number; the values are in the file's unit.
    """
    if len(numbers) < _FEWEST:
        return
    for mark in (numbers.min(), numbers.max()):
        there = numbers == mark
        low, high = (others.min(), others.max()) if len(others := numbers[~there]) > 0.5 * len(numbers) else (mark, mark)
        gap = max(low - mark, mark - high)
        # Programs write 999 or 32767 for missing values. Other numbers are suspected only if they are farther away.
        usual = re.fullmatch(r"-?9{2,}(\.9+|\.0)?", str(mark)) or abs(mark) in _LIMITS
        if high > low and gap > (_NEAR if usual else _FAR) * (high - low):
            message = f"is {mark:g} in {counted(int(there.sum()), 'sample')}, the first at t = {time[there][0]:.6g} s, and "
            message += f"from {low:g} to {high:g} in all other samples: does this number mark missing values?"
            hint = f"If so, state it in the document beside the file: `missing: {mark:.12g}`"
            yield Problem(message, key=column.source, hint=hint, code="suspected-marker")
            return
    zero = numbers == 0.0
    starts, ends = np.flatnonzero(~zero[:-1] & zero[1:]), np.flatnonzero(zero[:-1] & ~zero[1:]) + 1
    if not len(starts) or not len(ends) or len(changes := np.abs(np.diff(numbers[~zero]))) < _FEWEST:
        return
    ends = ends[np.searchsorted(ends, starts[starts < ends[-1]], side="right")]
    starts = starts[: len(ends)]
    before, after = numbers[starts], numbers[ends]
    usual_change = max(float(np.percentile(changes, 95)), float(np.diff(np.unique(numbers)).min()))
    lost = (ends - starts <= 4) & (
        np.minimum(np.abs(before), np.abs(after)) > 10.0 * np.maximum(np.abs(after - before), usual_change)
    )
    if lost.any():
        message = (
            f"falls to exactly 0 and back {counted(int(lost.sum()), 'time')}, first at t = {time[starts[lost][0] + 1]:.6g} s, "
        )
        message += "between values far from 0: were these samples lost?"
        hint = "If so, delete these numbers in the file, or state `missing: 0` in the document beside it"
        yield Problem(message, key=column.source, hint=hint, code="suspected-lost")


def _turns(values: Array) -> int:
    """Number of joints between which the samples seem to alternate; 0 if they seem to belong to a single joint."""
    if len(values) < _FEWEST or np.ptp(values) == 0.0:
        return 0
    changes = np.array([np.mean(np.abs(values[lag:] - values[:-lag])) for lag in range(1, min(41, len(values) // 2))])
    near = np.flatnonzero(changes < 0.1 * changes[0])
    # Do not suspect a smooth motion, whose largest changes are over half a period. Do not suspect a sensor at rest, which
    # alternates between neighbouring values.
    apart = changes.max() < 3 * changes[0] and changes[0] > 10 * np.diff(np.unique(values)).min()
    return int(near[0]) + 1 if len(near) and apart else 0


def _slope(position: Column, velocity: Column) -> Iterator[Problem]:
    """Problem of a velocity that is not the derivative of the position. Compares integrals, since derivatives amplify noise."""
    both = np.isfinite(position.values) & np.isfinite(velocity.values)
    time, angle, speed = position.time[both], position.values[both], velocity.values[both]
    if len(time) < _FEWEST or min(np.ptp(angle), np.ptp(speed)) < 1e-9 * max(1.0, float(np.max(np.abs(angle)))):
        return
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    # Remove a straight line from the position and from the integral, since the integral of a small velocity offset is a
    # straight line.
    line = np.column_stack([np.ones_like(time), time - time[0]])
    angle, integral = (values - line @ np.linalg.lstsq(line, values, rcond=None)[0] for values in (angle, integral))
    correlation = _correlation(angle, integral)
    if correlation < -_FOLLOWS:
        message = f"is negative where '{position.source}' rises: is the sign of one column reversed?"
        hint = f"Reverse it: --map '{item_of(velocity, gain=-1.0)}'"
        yield Problem(message, key=velocity.source, hint=hint, code="suspected-sign")
    ratio = float(np.std(integral) / np.std(angle)) if correlation > _FOLLOWS else 1.0
    if not 1 / 1.5 < ratio < 1.5:
        message = f"is {ratio:.3g} times the slope of '{position.source}': are the units of position, velocity and time right?"
        hint = (
            "Likely causes: 57.3: velocity in deg/s; 0.0175: position in deg; 9.55: velocity in rpm; 1000: a prefix such as "
            "milli; any other ratio: one of the columns was measured before the gear"
        )
        yield Problem(message, key=velocity.source, hint=hint, code="suspected-unit")


def _correlation(a: Array, b: Array) -> float:
    """Correlation coefficient of two series (n,); 0 if they are short, or if one of them is constant."""
    return float(np.corrcoef(a, b)[0, 1]) if len(a) >= _FEWEST and min(np.ptp(a), np.ptp(b)) > 1e-9 else 0.0


def _ratio(expected: Array, measured: Array) -> float:
    """Ratio of the measured range to the expected range. At rest, it is the ratio of the mean magnitudes. 0: the ratio is
    unknown.
    """
    known = [values[np.isfinite(values)] for values in (expected, measured)]
    if not all(map(len, known)):
        return 0.0
    sizes = [float(np.ptp(np.percentile(values, (5, 95)))) for values in known]
    if min(sizes) < 1e-9:
        sizes = [float(np.mean(np.abs(values))) for values in known]
    return sizes[1] / sizes[0] if min(sizes) >= 1e-12 else 0.0
