"""Which quantity aligns a recording with a run: one choice for pictures, metrics and claims, so that their numbers agree."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from asrsim.errors import RecordingError
from asrsim.log.derived import DERIVED_FUNCTIONS, DERIVED_SOURCES
from asrsim.quantities import DERIVED
from asrsim.recordings.align import Alignment, LagChoice, align
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import wrong_unit
from asrsim.samples import Array, JointInfo, Samples

ALIGN_ON = ("reference_1", "link_position", "motor_1_position", "equilibrium_position", "deflection", "link_velocity")
"""What auto aligns on, the first that moves in both. The reference first: it is the same signal in both, whereas the lag of a
response belongs to the difference that is to be judged."""

Reader = Callable[[Sequence[str], Sequence[str]], Samples]
"""(quantities, joints) -> all samples of those."""
SeriesOf = Callable[[str, str], tuple[Array, Array] | None]
"""(joint, quantity) -> times (n,) in s and values (n,) of the run, None where it has none."""


def align_recording(
    recording: Recording,
    pairing: Mapping[str, str],
    series: SeriesOf,
    *,
    lag: LagChoice = "auto",
    limit: float | None = None,
    on: tuple[str, str] | None = None,
    infos: Sequence[JointInfo] = (),
) -> Alignment:
    """How a recording's clock is moved to that of a run; at most one series of the run is looked at at a time.

    Args:
        recording: The experiment.
        pairing: Joint of the recording -> joint of the run.
        series: Gives the run's series.
        lag: See `LagChoice`.
        limit: s, largest lag that auto may find; None: a quarter of the shorter record.
        on: Joint (of the run) and quantity to correlate; None: the first of `ALIGN_ON` that moves in both.
        infos: The run's joints: columns in a unit that cannot be theirs come last.

    Raises:
        RecordingError: `on` is not in both; no overlap in time under auto.
    """
    candidates = list(_candidates(recording, pairing, infos))
    best: tuple[str, Array, Array, Column] | None = None
    for key, column in candidates:
        if on is not None and key != on:
            continue
        found = series(*key)
        if found is None:
            continue
        moves = _moves(found[1]) and _moves(column.values)
        if best is None or moves:
            best = (f"{key[0]}.{key[1]}", *found, column)
        # Without a search any series will do: its times are all that counts.
        if moves or lag != "auto":
            break
    if best is None:
        name = "a quantity in common" if on is None else f"{on[0]}.{on[1]}"
        raise RecordingError(
            f"cannot align on {name}, it is not in both", file=recording.path, code="no-such-quantity",
            choices=tuple(f"{joint}.{quantity}" for (joint, quantity), _ in candidates),
        )  # fmt: skip
    name, time, values, column = best
    try:
        return align(time, values, column.time, column.values, choice=lag, limit=limit, name=name)
    except RecordingError as error:
        raise RecordingError(replace(problem, file=recording.path) for problem in error.problems) from None


def series_of(read: Reader, infos: Sequence[JointInfo]) -> SeriesOf:
    """The series of a run of which parts can be read, such as a log's."""
    recorded = {info.name: info.quantities for info in infos}

    def series(joint: str, quantity: str) -> tuple[Array, Array] | None:
        sources = DERIVED_SOURCES.get(quantity, (quantity,))
        stored = [name for name in recorded.get(joint, ()) if name in sources]
        if not stored:
            return None
        samples = read(stored, (joint,))
        values = simulated(samples, joint, quantity, infos)
        return None if values is None else (samples.time, values)

    return series


def simulated(samples: Samples, joint: str, quantity: str, infos: Sequence[JointInfo] = ()) -> Array | None:
    """A joint's quantity of a simulation, (n,), derived ones too where `infos` is given; None if it is not recorded."""
    index = samples.joints.index(joint)
    if quantity in samples.values:
        values = samples.values[quantity][:, index]
    elif quantity in DERIVED and infos:
        if quantity != "equilibrium_position" and "link_position" not in samples.values:
            return None
        values = DERIVED_FUNCTIONS[quantity](samples, infos)[:, index]
    else:
        return None
    return None if np.all(np.isnan(values)) else values


def _candidates(
    recording: Recording, pairing: Mapping[str, str], infos: Sequence[JointInfo]
) -> Iterator[tuple[tuple[str, str], Column]]:
    """Columns of paired joints, those to align on first."""
    columns = [column for column in recording.channels.values() if column.quantity and column.joint in pairing]
    rank = {quantity: i for i, quantity in enumerate(ALIGN_ON)}
    known = {info.name: info for info in infos}

    def order(column: Column) -> tuple[bool, int]:
        info = known.get(pairing[str(column.joint)])
        wrong = info is not None and wrong_unit(column, info.name, prismatic=info.prismatic, mode=info.mode) is not None
        return wrong, rank.get(str(column.quantity), len(rank))

    for column in sorted(columns, key=order):
        yield (pairing[str(column.joint)], str(column.quantity)), column


def _moves(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and float(np.ptp(finite)) > 1e-9
