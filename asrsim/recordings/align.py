"""Aligns the clock of a recording with the clock of a simulation. Estimates the lag between the clocks, and resamples
series.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.log.derived import DERIVED_FUNCTIONS, recorded_sources
from asrsim.metrics.lag import TRUSTED, Lag, estimate_lag
from asrsim.quantities import DERIVED, QUANTITIES, is_comparable
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import wrong_unit
from asrsim.samples import Array, JointInfo, Samples, is_staircase

ALIGN_ON = ("reference_1", "link_position", "motor_1_position", "equilibrium_position", "deflection", "link_velocity")
"""Quantities for automatic alignment, in order of preference. The first quantity that moves in both records is used. The
reference is preferred since it is equal in the two records. A response also has a lag, but this lag is part of the difference
that a comparison measures.
"""

SampleReader = Callable[[Sequence[str], Sequence[str]], Samples]
"""Function (quantities, joints) that returns the samples of these quantities and joints."""


def align_recording(
    recording: Recording,
    pairing: Mapping[str, str],
    read: SampleReader,
    *,
    lag: LagChoice = "auto",
    infos: Sequence[JointInfo] = (),
) -> Alignment:
    """Alignment of the clock of a recording with the clock of a run. Only one series of the run is in memory at a time.

    Args:
        recording: The experiment.
        pairing: Maps each joint of the recording to a joint of the run.
        read: Function that returns samples of the run, for example from its log.
        lag: See `LagChoice`.
        infos: Joints of the run. Columns whose unit does not fit their joint are left out.

    Raises:
        RecordingError: The recording and the run share no quantity or, with the lag `auto`, do not overlap in time.
    """
    columns, _ = matched_columns(recording, pairing, infos, (*QUANTITIES, *DERIVED))
    known = {info.name: info for info in infos if info.quantities}
    best: tuple[str, Array, Array, Column] | None = None
    for joint, quantity in sorted(columns, key=lambda key: (*ALIGN_ON, key[1]).index(key[1])):
        stored = simulated_sources([quantity], [known[joint]]) if joint in known else [quantity]
        if not stored:
            continue
        samples = read(stored, (joint,))
        values = simulated(samples, joint, quantity, infos)
        if values is None:
            continue
        column = columns[joint, quantity]
        moves = _moves(values) and _moves(column.values)
        if best is None or moves:
            best = (f"{joint}.{quantity}", samples.time, values, column)
        # If the lag is not estimated, only the times of a series are used, so the first series suffices.
        if moves or lag != "auto":
            break
    if best is None:
        choices = tuple(map(".".join, columns))
        raise RecordingError(
            "cannot align: recording and simulation share no quantity",
            file=recording.path,
            choices=choices,
            code="no-such-quantity",
        )
    name, time, values, column = best
    with naming(recording.path):
        command = name.rpartition(".")[2].startswith("reference")
        # Columns may have separate times. All of them are shifted by the same lag, so the recording begins with the earliest.
        begins = min(float(one.time[0]) for one in recording.channels.values() if len(one.time))
        return align(time, values, column.time, column.values, choice=lag, name=name, command=command, begins=begins)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Context that adds the recording's file to each RecordingError."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(replace(problem, file=path) for problem in error.problems) from None


def matched_columns(
    recording: Recording, pairing: Mapping[str, str], infos: Sequence[JointInfo], quantities: Sequence[str] | None = None
) -> tuple[dict[tuple[str, str], Column], list[Problem]]:
    """Columns by joint of the run and quantity, and problems. Columns whose unit does not fit their joint are left out."""
    known = {info.name: info for info in infos}
    found: dict[tuple[str, str], Column] = {}
    wrong: list[Problem] = []
    for column in recording.channels.values():
        joint = pairing.get(column.joint or "")
        if joint is None or column.quantity is None or not is_comparable(column.quantity, quantities):
            continue
        info = known.get(joint)
        problem = None if info is None else wrong_unit(column, joint, prismatic=info.prismatic, mode=info.mode)
        if problem is None:
            found[joint, column.quantity] = column
        else:
            wrong.append(replace(problem, file=recording.path, message=f"{problem.message}; the column is not compared"))
    return found, wrong


def simulated_sources(names: Iterable[str], joints: Sequence[JointInfo]) -> list[str]:
    """Recorded quantities of a run from which `simulated` computes the named quantities."""
    return recorded_sources([one for name in names for one in (f"sent_{name}", name)], joints)


def simulated(samples: Samples, joint: str, quantity: str, infos: Sequence[JointInfo] = ()) -> Array | None:
    """Simulated values (n,) of a joint's quantity that correspond to the recorded values; None if the simulation did not record
    them.

    A recorded reference corresponds to the command that was sent, before delays and other imperfections of the simulated
    commands. Derived quantities need `infos`.
    """
    index = samples.joints.index(joint)
    sent = samples.values.get(f"sent_{quantity}")
    if sent is not None and not np.all(np.isnan(sent[:, index])):
        values = sent[:, index]
    elif quantity in samples.values:
        values = samples.values[quantity][:, index]
    elif quantity in DERIVED and infos:
        values = DERIVED_FUNCTIONS[quantity](samples, infos)[:, index]
    else:
        return None
    return None if np.all(np.isnan(values)) else values


def _moves(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and float(np.ptp(finite)) > 1e-9


LagChoice = float | Literal["auto", "off", "start"]
"""How the lag is determined. `auto`: by cross-correlation. `off`: the clocks stay unchanged. `start`: the first samples are
aligned. A number: delay of the recording, s.
"""
_CLEARLY = 0.1
"""The recorded sign counts as reversed if the reversed sign increases the correlation by more than this value. Both signs of an
oscillation fit almost equally, with lags that differ by half a period.
"""
_BETTER = 0.02
"""Difference of correlations above which one lag fits better than another."""
_GAP = 3.0
"""Largest gap across which samples are interpolated, in time steps of the source. Up to two lost samples are filled."""


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Shift of the recording's clock, and the method that determined it."""

    lag: float
    """Delay of the recording, s. It is subtracted from the recording's times."""
    how: str
    """Method that gave the delay: `cross-correlation of joint.quantity`, `set`, `off`, `start`, or `not aligned: ` and the
    reason.
    """
    found: Lag | None = None
    findings: tuple[Problem, ...] = ()

    @property
    def said(self) -> str:
        """Delay of the recording as text, for example `0.12 s late`."""
        lag = round(self.lag, 4)
        # Delays between clocks with different origins are large, so the format `g` would drop the fractions of a second.
        return f"{f'{abs(lag):.4f}'.rstrip('0').rstrip('.')} s {'early' if lag < 0.0 else 'late'}"


def align(
    time_simulation: Array,
    simulation: Array,
    time_recording: Array,
    recording: Array,
    *,
    choice: LagChoice = "auto",
    name: str = "",
    command: bool = False,
    begins: float | None = None,
) -> Alignment:
    """Lag of a recording behind a simulation.

    Args:
        time_simulation: Times of the simulation (n,), s.
        simulation: Values (n,) of the quantity to align on.
        time_recording: Times of the recording (m,), s.
        recording: Values (m,) of this quantity in the recording.
        choice: See `LagChoice`.
        name: Name of the quantity, for messages.
        command: Whether the quantity is a command. If a command is a staircase, each value is held until the next sample.
        begins: Time at which the recording begins, s; by default, the first of `time_recording`.

    Raises:
        RecordingError: The choice is not a `LagChoice` or, with `auto`, the records do not overlap in time.
    """
    start = float((time_recording[0] if begins is None else begins) - time_simulation[0])
    stated = {"off": 0.0, "start": start}.get(str(choice), choice)
    if stated != "auto":
        if not isinstance(stated, float | int) or not np.isfinite(stated):
            raise RecordingError("the lag must be a number of seconds, auto, off or start", value=choice, code="bad-lag")
        return Alignment(lag=float(stated), how=choice if isinstance(choice, str) else "set")
    if start and min(time_simulation[-1], time_recording[-1]) <= max(time_simulation[0], time_recording[0]):
        # One clock began long before the other. Search around the lag at which both records begin at the same time.
        together = align(time_simulation, simulation, time_recording - start, recording, name=name, command=command)
        if together.how.startswith("not aligned"):
            require_overlap(time_simulation, time_recording)
        return replace(together, lag=together.lag + start)
    result = _correlated(time_simulation, simulation, time_recording, recording, name, command)
    if start:
        # The clocks may differ by more than the search allows, even if a wrong lag correlates well. Search again around the lag
        # at which both records begin at the same time.
        together = _correlated(time_simulation, simulation, time_recording - start, recording, name, command)
        if _is_better(_trust(together), _trust(result)):
            return replace(together, lag=together.lag + start)
    return result


def _trust(alignment: Alignment) -> float:
    """Correlation of an alignment; 0 if the records are not aligned."""
    return 0.0 if alignment.found is None or alignment.how.startswith("not aligned") else alignment.found.correlation


def _is_better(correlation: float, other: float) -> bool:
    """Whether a lag with the correlation `correlation` is clearly better than a lag with the correlation `other`, which is 0 if
    that lag is not trusted. A clearly better lag leaves less than half of the variance unexplained.
    """
    unexplained, before = 1.0 - correlation**2, 1.0 - other**2
    return correlation > other + _BETTER and (not other or unexplained < 0.5 * before)


def _correlated(
    time_simulation: Array, simulation: Array, time_recording: Array, recording: Array, name: str, command: bool
) -> Alignment:
    """Alignment by cross-correlation. The arguments are as in `align`."""
    step = min(float(np.median(np.diff(time))) for time in (time_simulation, time_recording))
    first = _held(time_simulation, simulation, step) if command else (time_simulation, simulation)
    second, values = _held(time_recording, recording, step) if command else (time_recording, recording)
    found = estimate_lag(*first, second, values)
    # Try the reversed sign, too. Otherwise a periodic signal with a reversed sign would be shifted by half a period.
    turned = estimate_lag(*first, second, -values)
    how = f"cross-correlation of {name}"
    if found is None:
        why = f"{name} must move in the recording and in the simulation"
    elif turned is not None and turned.correlation > max(found.correlation + _CLEARLY, TRUSTED) and not turned.at_limit:
        return Alignment(lag=turned.seconds, how=f"{how}, which has the opposite sign", found=turned)
    elif found.correlation < TRUSTED:
        why = f"the best correlation of {name} is {found.correlation:.2f} (at {found.seconds:.4g} s)"
    elif found.at_limit:
        why = f"{name} fits best at the limit of the search, {found.seconds:.4g} s"
    else:
        message = f"{name} is periodic, so several lags fit equally well; the smallest, {found.seconds:.4g} s, is used"
        hint = "Set the lag with --align if another lag is right"
        findings = [Problem(message, code="lag", hint=hint)] * found.ambiguous
        exact, (least, most) = _exact(time_simulation, simulation, time_recording, recording, found.seconds)
        if most - least > _WIDE * step:
            message = f"{name} changes between two samples, so all lags from {least:.4g} to {most:.4g} s fit equally well"
            findings.append(Problem(f"{message}; {exact:.4g} s is used", code="lag", hint=hint))
        return Alignment(lag=exact, how=how, found=found, findings=tuple(findings))
    problem = Problem(f"time is not aligned: {why}", code="lag", hint="Set the lag with --align, in s")
    return Alignment(lag=0.0, how=f"not aligned: {why}", found=found, findings=(problem,))


def _held(time: Array, values: Array, step: float) -> tuple[Array, Array]:
    """Times and values of a command. A staircase with longer steps is sampled every `step` s. Linear interpolation between its
    samples would be half a sample early.
    """
    known = np.isfinite(values)
    stamps, stairs = time[known], values[known]
    if not is_staircase(stairs) or step > 0.75 * np.median(np.diff(stamps)):
        return time, values
    fine = np.arange(stamps[0], stamps[-1] + 0.5 * step, step)
    # Add a fraction of a step to the times, so that rounding does not delay a value by one step.
    return fine, stairs[np.searchsorted(stamps, fine + 1e-3 * step, side="right") - 1]


def _exact(
    time_simulation: Array, simulation: Array, time_recording: Array, recording: Array, lag: float
) -> tuple[float, tuple[float, float]]:
    """Exact lag near an estimated lag, at which both records of a command have the same values, and the range of all such lags.
    It is the estimate if there is no such lag.

    With the exact lag, two records of a command have the same values at the samples of the coarser record. If the finer record
    holds each value until the next sample, a range of lags fits, whose width is up to one sample. If a lag of 0 is in this
    range, the clocks are left unchanged. Otherwise the command is assumed to change at samples of the coarser record. The
    largest lag of the coarser record in the range is then the true lag.
    """
    records = [
        (time[np.isfinite(own)], own[np.isfinite(own)])
        for time, own in ((time_simulation, simulation), (time_recording, recording))
    ]
    steps = [float(np.median(np.diff(time))) for time, _ in records]
    fine, (times, values) = records if steps[1] >= steps[0] else records[::-1]
    sign = 1.0 if steps[1] >= steps[0] else -1.0
    scale = float(np.var(values))

    def misfit(shift: float) -> float:
        at = times - shift
        inside = (at >= fine[0][0]) & (at <= fine[0][-1])
        if not inside.any() or np.ptp(values[inside]) == 0.0:
            return np.inf
        return float(np.mean((np.interp(at[inside], *fine) - values[inside]) ** 2))

    best, width = sign * lag, max(steps)
    if abs(lag) <= width and misfit(0.0) <= _SAME * scale:
        return 0.0, (0.0, 0.0)
    equal = [shift for shift in np.linspace(best - width, best + width, _SHIFTS) if misfit(shift) <= _SAME * scale]
    for _ in range(_ROUNDS):
        shifts = np.linspace(best - width, best + width, _SHIFTS)
        misfits = np.array([misfit(shift) for shift in shifts])
        best = float(shifts[np.flatnonzero(misfits <= (1.0 + 1e-6) * misfits.min() + 1e-12 * scale)[-1]])
        width *= 2.0 / (_SHIFTS - 1)
    if not misfit(best) <= _SAME * scale:
        return lag, (lag, lag)
    ends = sorted(sign * one for one in (min(equal, default=best), best))
    return sign * best, (ends[0], ends[1])


_ROUNDS, _SHIFTS = 4, 41
"""_ROUNDS: number of rounds of the search for the exact lag.
_SHIFTS: number of lags that each round tries. Each round is 20 times finer than the round before, so that four rounds divide
the first range by 160,000.
"""
_WIDE = 2.5
"""Range of equally good lags above which it is reported, in steps of the finer record."""
_SAME = 1e-8
"""Two records are equal if their mean square difference, relative to their variance, is at most this value. They then agree in
four digits.
"""


def require_overlap(time_simulation: Array, time_recording: Array, lag: float = 0.0) -> tuple[float, float]:
    """Start and end of the common time interval on the simulation's clock, s. Raises RecordingError if the records do not
    overlap.
    """
    start = max(float(time_simulation[0]), float(time_recording[0]) - lag)
    end = min(float(time_simulation[-1]), float(time_recording[-1]) - lag)
    if end <= start:
        raise RecordingError(
            "no overlap in time: the simulation lasts from "
            f"{time_simulation[0]:g} to {time_simulation[-1]:g} s, and the recording lasts from {time_recording[0] - lag:g} to "
            f"{time_recording[-1] - lag:g} s",
            code="no-overlap",
            hint="Align the first samples with --align start, or set the lag with --align SECONDS",
        )
    return start, end


def resample(time: Array, values: Array, grid: Array) -> Array:
    """Values (m,) at the times of the grid, resampled from values (n,). They are NaN outside the record and in gaps longer than
    three steps.

    The interpolation is linear if the source is at least four times as fine as the grid. Otherwise it is Akima's piecewise
    cubic interpolation (Journal of the ACM 17, 1970), which follows smooth motion and does not overshoot at steps. The values
    are not filtered.
    """
    keep = np.isfinite(values)
    t, v = time[keep], values[keep]
    if len(t) < 2:
        return np.full(len(grid), np.nan)
    step = float(np.median(np.diff(t)))
    result = np.interp(grid, t, v)
    if len(grid) > 1 and step > 0.25 * np.median(np.diff(grid)):
        from scipy.interpolate import Akima1DInterpolator

        result = np.asarray(Akima1DInterpolator(t, v)(np.clip(grid, t[0], t[-1])), dtype=np.float64)
    # Time stamps are rounded, so use the end value up to half a step beyond the ends.
    outside = (grid < t[0] - 0.5 * step) | (grid > t[-1] + 0.5 * step)
    after = np.clip(np.searchsorted(t, grid, side="left"), 1, len(t) - 1)
    # A time is in a gap only if it is strictly between two samples, since a time at a sample has a value.
    inside = (t[after] - t[after - 1] > _GAP * step) & (grid > t[after - 1]) & (grid < t[after])
    return np.where(outside | inside, np.nan, result)
