"""Time columns: their unit, duplicates, backward steps, gaps and jitter. Everything that is dropped is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.calendars import FASTEST, SLOWEST, calendar_of
from asrsim.samples import Array

EPOCH = 1e8
"""Seconds above which a time is taken as absolute (1973 and later); a run of three years is no run."""
_LISTED = 8
"""Lines that a problem of many names."""
_REST = 60.0
"""s between samples from where on a time is no Unix time."""
_SLOW, _LONG = 0.04, 300.0
"""s between samples, and of a whole recording, that are rather ms."""
_OVERFLOWS = (2.0**16, 2.0**32, 2.0**32 * 1e-3, 2.0**32 * 1e-6)
"""Where counters of a microcontroller begin anew, also those that are written in s."""
_MISSED = 20.0
"""Samples that may be missing where they do."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""s in each unit of time that a file may be in."""
NEAREST = 1e-9
"""s: stamps nearer to each other are one; slopes between them would leave the range of numbers."""


def lines_text(lines: NDArray[np.int64] | list[int]) -> str:
    """`line 4`, `lines 4, 7, 9` or `lines 4, 7, ... (312 in all)`."""
    numbers = [int(line) for line in lines]
    if len(numbers) == 1:
        return f"line {numbers[0]}"
    listed = ", ".join(str(number) for number in numbers[:_LISTED])
    return f"lines {listed}" + (f", ... ({len(numbers)} in all)" if len(numbers) > _LISTED else "")


def scale_time(values: Array, factor: float | None, *, path: Path, name: str) -> tuple[Array, float | None, list[Problem]]:
    """Time in s, the Unix time of its zero for absolute stamps (else None), and what was assumed.

    `factor` is s per unit where the unit is stated; else the unit is inferred: absolute stamps by their size, others so that
    a sample takes at most 0.2 s (0.002 is s, 2 is ms, 2000 is us, 2000000 is ns).
    """
    findings: list[Problem] = []
    values, passed = _past_overflow(values)
    if passed:
        findings.append(
            Problem(f"its counter begins anew at {passed:.10g} and is taken to go on", file=path, key=name, code="overflow")
        )
    finite = values[np.isfinite(values)]
    if not len(finite):
        raise RecordingError("the time column has no number", file=path, key=name, code="no-time")
    steps = np.abs(np.diff(finite))
    steps = steps[steps > 0]
    step = float(np.median(steps)) if len(steps) else 0.0
    size = float(np.median(finite))
    if factor is None and (calendar := calendar_of(size, step)) is not None:
        findings.append(
            Problem(f"is read as {calendar.counts}", file=path, key=name, code="time-unit-assumed",
                    hint=f"Say otherwise with --map '{name}=time [s]'")
        )  # fmt: skip
        return (values - finite[0]) * calendar.unit, (float(finite[0]) - calendar.zero) * calendar.unit, findings
    if factor is None:
        # Unix time: s ~ 1.7e9, ms ~ 1.7e12, us ~ 1.7e15, ns ~ 1.7e18.
        factor = next(f for f, top in ((1.0, 1e11), (1e-3, 1e14), (1e-6, 1e17), (1e-9, np.inf)) if size < top)
        # A clock in us or ns that began with the robot has numbers as large, but they grow from 0, or by hours a sample.
        early, late = np.quantile(finite, (0.05, 0.95))
        if size <= EPOCH or size <= 1e3 * step or late - early > 0.5 * size or step * factor > _REST:
            factor = next(f for f, top in ((1.0, 0.2), (1e-3, 200.0), (1e-6, 2e5), (1e-9, np.inf)) if step <= top)
        if factor != 1.0:
            unit = next(unit for unit, seconds in _SECONDS.items() if seconds == factor)
            findings.append(
                Problem(
                    f"time states no unit; read as {unit}, since its samples are {step:g} apart"
                    + (" (or does it count the rows? Then give --rate)" if step == 1.0 and abs(finite[0]) <= 1.0 else ""),
                    file=path, key=name, hint=f"Say otherwise with --map '{name}=time [s]'", code="time-unit-assumed",
                )
            )  # fmt: skip
        elif step > _SLOW and np.ptp(finite) > _LONG:
            findings.append(
                Problem(f"time states no unit; read as s: {step:g} s between samples, {np.ptp(finite):g} s in all", file=path,
                        key=name, hint=f"If these are ms: --map '{name}=time [ms]'", code="time-unit-assumed")
            )  # fmt: skip
    if size * factor > EPOCH:
        # The first alone may be of another clock: a message from before this one was set.
        far = np.abs(finite - np.median(finite)) * factor > EPOCH
        zero = float(finite[1 if far[0] and far.sum() == 1 else 0])
        # A float of 1.7e9 s resolves 2.4e-7 s: rounded to what was written, a sample at 0.2 s is at 0.2 s again.
        digits = int(np.floor(-np.log10(np.spacing(size) * factor)))
        return np.round((values - zero) * factor, digits), zero * factor, findings
    return values * factor, None, findings


def _past_overflow(values: Array) -> tuple[Array, float]:
    """Counts that begin anew where their whole numbers end (`micros()` of an Arduino after 71 minutes) go on; and where they
    end, 0 where they do not."""
    where = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[where])
    back = steps < 0
    typical = float(np.median(steps)) if len(steps) else 0.0
    if not back.any() or typical <= 0.0:
        return values, 0.0
    for size in _OVERFLOWS:
        if np.all(np.abs(steps[back] + size - typical) < _MISSED * typical) and typical < 0.01 * size:
            gone = values.copy()
            gone[where[1:]] += size * np.cumsum(back)
            return gone, float(size if values[where].min() >= 0.0 else 0.5 * size)
    return values, 0.0


def suspect_time(values: Array, factor: float, *, path: Path, name: str) -> list[Problem]:
    """A suspicion about a unit that the file states: samples further apart than 0.5 s, or nearer than 30 us."""
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 0]
    step = float(np.median(steps)) if len(steps) else 0.0
    if not step or SLOWEST >= step * factor >= FASTEST:
        return []
    others = [unit for unit, other in _SECONDS.items() if FASTEST <= step * other <= 0.2]
    if not others:
        return []
    return [
        Problem(
            f"its samples are {step * factor:g} s apart by the unit that it states; in {others[0]} they would be "
            f"{step * _SECONDS[others[0]]:g} s", file=path,
            key=name, hint=f"If so: --map '{name}=time [{others[0]}]'", code="suspected-time",
        )
    ]  # fmt: skip


def clean_time(
    time: Array, lines: NDArray[np.int64] | None, *, path: Path, name: str
) -> tuple[NDArray[np.bool_], list[Problem]]:
    """Which samples to keep so that time increases strictly, and what was found. Raises RecordingError for two time bases.

    Of samples with one time stamp the first is kept. A backward step is dropped sample by sample until time passes the
    last good one; if that concerns more than a tenth of the file, its time starts anew and it is an error.
    """
    where = np.arange(1, len(time) + 1) if lines is None else lines
    noun = "sample" if lines is None else "line"
    findings: list[Problem] = []
    valid = np.isfinite(time)
    if not valid.all():
        bad = where[~valid]
        findings.append(
            Problem(f"{len(bad)} {noun}s without a valid time are dropped: {lines_text(bad).replace('line', noun)}",
                    file=path, line=int(bad[0]) if lines is not None else None, key=name, code="bad-time")
        )  # fmt: skip
    # One stamp that is ahead of both that follow it, which go on where the one before it was.
    following = np.r_[time[valid], np.inf, np.inf]
    ahead = (following[:-2] > following[1:-1]) & (following[:-2] > following[2:])
    ahead &= following[1:-1] > np.r_[-np.inf, time[valid][:-1]]
    if ahead.any():
        stray = where[valid][ahead]
        findings.append(
            Problem(f"{len(stray)} time stamps far ahead of those that follow, dropped: "
                    f"{lines_text(stray).replace('line', noun)}", file=path,
                    line=int(stray[0]) if lines is not None else None, key=name, code="stray-time")
        )  # fmt: skip
        valid[np.flatnonzero(valid)[ahead]] = False
    t, w = time[valid], where[valid]
    if len(t) < 2:
        raise RecordingError(
            f"{len(t)} samples with a valid time; at least 2 are needed", file=path, key=name, code="too-short"
        )
    t, w = _without_end(t, w, valid, findings, path=path, name=name, noun=noun)
    _one_base(t, w, path=path, name=name, noun=noun)
    top = np.maximum.accumulate(t)
    fresh = np.concatenate(([True], t[1:] > top[:-1] + NEAREST))
    duplicate = ~fresh & (t == top)
    backward = ~fresh & ~duplicate
    # A repeat of an older stamp within a backward stretch counts as backward, which it is.
    if np.mean(np.diff(t) < 0) > 0.9:
        raise RecordingError(
            f"time falls from {t[0]:g} s to {t[-1]:g} s: the newest sample stands first", file=path, key=name,
            hint="Sort the file by its time", code="backward-time",
        )  # fmt: skip
    if backward.sum() > 0.1 * len(t):
        first = int(np.flatnonzero(backward)[0])
        raise RecordingError(
            f"time jumps back from {t[first - 1]:g} s to {t[first]:g} s at {noun} {w[first]} and stays behind: "
            "two time bases or two recordings in one file", file=path, line=int(w[first]) if lines is not None else None,
            key=name, hint="Expected one time that increases; split the file there", code="two-time-bases",
        )  # fmt: skip
    if fresh.sum() < 2:
        raise RecordingError(
            f"all {len(t)} time stamps are {t[0]:g} s", file=path, key=name, code="too-short",
            hint="Give the sampling rate with --rate",
        )  # fmt: skip
    for mask, what, code in (
        (duplicate, "duplicate time stamps", "duplicate-time"),
        (backward, "time stamps that go backward", "backward-time"),
    ):
        if mask.any():
            bad = w[mask]
            place = lines_text(bad).replace("line", noun)
            hint = None
            if mask is duplicate and mask.sum() > 0.2 * len(t):
                hint = "Time is written with too few digits; give the sampling rate with --rate to keep all samples"
            findings.append(
                Problem(f"{len(bad)} {what}, dropped: {place}", file=path,
                        line=int(bad[0]) if lines is not None else None, key=name, hint=hint, code=code)
            )  # fmt: skip
    findings += _spacing(t[fresh], w[fresh], path=path, name=name, numbered=lines is not None)
    keep = np.zeros(len(time), dtype=bool)
    keep[np.flatnonzero(valid)[fresh]] = True
    return keep, findings


def _without_end(
    t: Array, where: NDArray[np.int64], valid: NDArray[np.bool_], findings: list[Problem], *, path: Path, name: str, noun: str
) -> tuple[Array, NDArray[np.int64]]:
    """Times and their lines without a first or last stamp that is of another clock than all the others: a robot's first message
    before its clock was set, a line that was cut. `valid` follows."""
    jump = _jump(t)
    if jump not in (0, len(t) - 2):
        return t, where
    end = 0 if jump == 0 else len(t) - 1
    findings.append(
        Problem(f"the {'first' if end == 0 else 'last'} time stamp is {abs(t[jump + 1] - t[jump]):g} s off, of another clock "
                f"than all the others, dropped: {noun} {where[end]}", file=path,
                line=int(where[end]) if noun == "line" else None, key=name, code="stray-time")
    )  # fmt: skip
    valid[np.flatnonzero(valid)[end]] = False
    return np.delete(t, end), np.delete(where, end)


def _jump(t: Array) -> int | None:
    """The step that dwarfs all the others, None where none does."""
    steps = np.abs(np.diff(t))
    if len(steps) < 3:
        return None
    worst = int(np.argmax(steps))
    rest = float(np.sum(np.delete(steps, worst))) or float(np.median(steps))
    return worst if steps[worst] > max(1e3 * rest, 3600.0) and rest > 0 else None


def _one_base(t: Array, where: NDArray[np.int64], *, path: Path, name: str, noun: str) -> None:
    """Raise where one step dwarfs all the others: a clock that was set, or two clocks in one column."""
    if (worst := _jump(t)) is not None:
        raise RecordingError(
            f"time jumps from {t[worst]:g} s to {t[worst + 1]:g} s at {noun} {where[worst + 1]}: two time bases", file=path,
            line=int(where[worst + 1]) if noun == "line" else None, key=name,
            hint="Expected one clock over the whole file; split it or repair the time", code="two-time-bases",
        )  # fmt: skip


def _spacing(t: Array, where: NDArray[np.int64], *, path: Path, name: str, numbered: bool) -> list[Problem]:
    """Dropped samples and jitter of increasing times."""
    findings: list[Problem] = []
    if len(t) < 4:
        return findings
    steps = np.diff(t)
    typical = float(np.median(steps))
    gaps = np.flatnonzero(steps > 1.7 * typical)
    if len(gaps):
        missing = int(np.sum(np.round(steps[gaps] / typical) - 1))
        worst = gaps[np.argmax(steps[gaps])]
        place = f" after line {where[worst]}" if numbered else ""
        findings.append(
            Problem(
                f"{missing} samples are missing in {len(gaps)} gaps; the longest is {steps[worst]:.4g} s at "
                f"t = {t[worst]:.6g} s{place}",
                file=path, line=int(where[gaps[0]]) if numbered else None, key=name, code="dropped-samples",
            )
        )  # fmt: skip
    regular = steps[steps <= 1.7 * typical]
    jitter = float(np.std(regular))
    if jitter > 0.01 * typical:
        findings.append(
            Problem(
                f"samples are {typical * 1e3:.4g} ms apart with a jitter of {jitter * 1e3:.2g} ms (standard "
                f"deviation), {np.min(steps) * 1e3:.4g} to {np.max(steps) * 1e3:.4g} ms",
                file=path, key=name, code="jitter",
            )
        )  # fmt: skip
    return findings
