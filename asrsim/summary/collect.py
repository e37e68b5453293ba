"""Collects the data for a run's summary and claims during the run, so that the log of the run need not be read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS, recorded_sources
from asrsim.metrics import JointSummary, summarise
from asrsim.metrics.values import root_mean_square
from asrsim.samples import TIP, TIP_GOAL, Array, JointInfo, Samples, concatenate

if TYPE_CHECKING:
    from asrsim.signals.base import Signal

KEPT = 1_000_000
"""Largest number of positions, of all joints together, that are kept for the summary. The positions of a longer run are thinned
evenly; the peaks are still exact.
"""
SHAKEN = 10.0
"""Overshoot, as a fraction of the reference's step, above which a motion counts as shaking and not as a step response."""


@dataclass(frozen=True)
class Seen:
    """Data that were collected during a run for its summary."""

    measures: tuple[JointSummary, ...]
    """Measures of each joint."""
    tip: Mapping[str, float]
    """For a Cartesian task: distance of the tip from its path in m: `largest`, `rms`, and `last` (mean over the last tenth of
    the run). Empty without a task.
    """
    travels: tuple[float, ...]
    """Difference between the largest and the smallest position of each joint, rad or m."""


class Collector:
    """Receiver of a run's samples. It stores the positions of all joints. It also stores the series that claims use, which are
    not thinned."""

    full_rate = True
    """Whether this receiver needs the samples of every step, also if fewer samples are logged."""

    def __init__(
        self, joints: Sequence[JointInfo], *, samples: int, needs: tuple[Sequence[tuple[str, str]], bool] = ((), False)
    ) -> None:
        """joints: joints in the description of the run; samples: largest number of samples that the run may have; needs: series
        that the claims need, from `asrsim.summary.claims.needs_of`.
        """
        self._joints = tuple(joints)
        self._stride = max(1, -(-samples * len(joints) // KEPT))
        self._peaks = np.full(len(joints), np.nan)
        self._seen = 0
        self._time = _Rows()
        self._positions, self._references = (_Rows(len(joints)) for _ in range(2))
        wanted, self._needs_bodies = needs
        names = ("link_position", "deflection", "position_error", *(quantity for quantity, _ in wanted))
        self.quantities = frozenset(recorded_sources(names, joints))
        """Names of the quantities that the collector needs in the samples of the run."""
        self._whole_time = _Rows()
        self._whole = {key: _Rows() for key in wanted}
        self._bodies: list[Samples] = []
        self._tip_errors = _Rows()

    def write(self, samples: Samples) -> None:
        """Collect the next steps of the run."""
        places = {name: column for column, name in enumerate(samples.joints)}
        order = [places[joint.name] for joint in self._joints]
        kept = slice((-self._seen) % self._stride, None, self._stride)
        self._seen += len(samples.time)
        self._time.add(samples.time[kept])
        positions = samples.values["link_position"][kept, order].T
        self._positions.add(positions)
        self._references.add(DERIVED_FUNCTIONS["position_error"](samples, self._joints)[kept, order].T + positions)
        deflections = np.abs(DERIVED_FUNCTIONS["deflection"](samples, self._joints)[:, order])
        self._peaks = np.fmax(self._peaks, np.fmax.reduce(deflections, axis=0, initial=np.nan))
        if self._whole:
            self._whole_time.add(samples.time)
        for (quantity, joint), rows in self._whole.items():
            rows.add(samples.values[quantity][:, places[joint]])
        if TIP in samples.bodies:
            self._tip_errors.add(np.linalg.norm(samples.bodies[TIP][:, :3] - samples.bodies[TIP_GOAL][:, :3], axis=1))
        if self._needs_bodies:
            own = {"time": samples.time, "joints": (), "values": {}}
            self._bodies.append(Samples(**own, bodies=samples.bodies, contacts=samples.contacts))  # type: ignore[arg-type]

    def seen(self, desired: Mapping[str, Signal] | None = None, *, balanced: bool = False) -> Seen:
        """Data collected so far. Overshoot and settling time are counted from the start of the reference's motion; see
        `step_start`.

        desired: intended position of each joint whose reference is another position, such as a learned input; balanced: whether
        the run begins in equilibrium, so that a constant reference is not a step.
        """
        travels = np.ptp(self._positions.values, axis=1) if self._seen else np.zeros(len(self._joints))
        return Seen(self._measures(desired or {}, balanced), self._tip(), tuple(travels.tolist()))

    def _measures(self, desired: Mapping[str, Signal], balanced: bool) -> tuple[JointSummary, ...]:
        if not self._seen:
            return tuple(summarise(np.empty(0), {}) for _ in self._joints)
        time, positions, references = self._time.values, self._positions.values, self._references.values
        for j, joint in enumerate(self._joints):
            signal = desired.get(joint.name, desired.get("*"))
            if signal is not None:
                references[j] = signal.values(time)
        measures = []
        for position, reference, peak in zip(positions, references, self._peaks.tolist(), strict=True):
            known = bool(np.isfinite(reference).all())
            columns = {"link_position": position}
            step = None if balanced else 0
            if known:
                columns["position_error"] = reference - position
                step = step_start(reference, float(reference[0] if balanced else position[0]))
            one = replace(summarise(time, columns, step=step), peak_deflection=peak)
            measures.append(replace(one, overshoot=math.nan) if known and one.overshoot > SHAKEN else one)
        return tuple(measures)

    def _tip(self) -> dict[str, float]:
        errors = self._tip_errors.values
        if not len(errors):
            return {}
        tail = errors[-max(len(errors) // 10, 1) :]
        return {"largest": float(errors.max()), "rms": root_mean_square(errors), "last": float(tail.mean())}

    def read(self, quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        """Samples of every step with the series that claims need. Claims use this method as their `SampleReader`."""
        if not quantities and not joints:
            return concatenate(self._bodies)
        empty = np.full(len(self._whole_time.values), np.nan)
        columns = {
            name: [self._whole[name, joint].values if (name, joint) in self._whole else empty for joint in joints]
            for name in quantities
        }
        # Do not copy a single column, since long runs with a claim about one joint are usual.
        tables = {name: parts[0][:, None] if len(parts) == 1 else np.column_stack(parts) for name, parts in columns.items()}
        return Samples(time=self._whole_time.values, joints=tuple(joints), values=tables)


class _Rows:
    """Array, (n,) or (rows, n), that grows by values which are appended."""

    def __init__(self, *rows: int) -> None:
        self._parts: list[Array] = [np.empty((*rows, 0))]

    def add(self, values: Array) -> None:
        """Append a copy of these values."""
        self._parts.append(values.copy())

    @property
    def values(self) -> Array:
        """Array of all values that were appended."""
        if len(self._parts) > 1:
            self._parts = [np.concatenate(self._parts, axis=-1)]
        return self._parts[0]


def step_start(reference: Array, initial: float) -> int | None:
    """Index of the sample at which a reference (n,) begins its motion, if it moves in one direction and then stays at rest; 0
    if the reference is constant and differs from the joint's position `initial` at the start.
    None if the reference reverses, still moves in the last tenth of the run, or stays at `initial`: such a motion has no
    overshoot and no settling time.
    """
    changes = reference[1:] - reference[:-1]
    floor = 1e-9 * max(1.0, float(np.abs(reference).max()))
    moves = np.flatnonzero(np.abs(changes) > floor)
    if not len(moves):
        return 0 if abs(float(reference[0]) - initial) > floor else None
    one_way = bool(np.all(changes[moves] > 0) or np.all(changes[moves] < 0))
    return int(moves[0]) + 1 if one_way and moves[-1] < 0.9 * len(changes) else None
