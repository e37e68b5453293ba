"""What summary and claims need of a run, taken from its steps as they come: no log is read again for it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.log.reader import concatenate
from asrsim.metrics import JointSummary, summarise
from asrsim.samples import TIP, TIP_GOAL, Array, JointInfo, Samples
from asrsim.summary.claims import needs_of

if TYPE_CHECKING:
    from asrsim.scenario.data import Expectation
    from asrsim.signals.base import Signal

KEPT = 1_000_000
"""Samples of all joints together that are looked at; a longer run is thinned evenly, its peaks are not."""
SHAKEN = 10.0
"""Overshoot (a fraction of the step) above which there was no step to speak of: the joint was shaken, not moved."""


class Collector:
    """A sink that keeps the positions of all joints and, whole, the series that claims are about."""

    full_rate = True
    """It asks for every step, whatever the log takes."""
    bodies: bool
    """It asks for objects' poses and contacts at every step, too: claims are about them."""

    def __init__(self, joints: Sequence[JointInfo], *, samples: int, claims: Sequence[Expectation] = ()) -> None:
        """joints: those of the run's description. samples: how many will come, or more. claims: see :meth:`read`."""
        self._joints = tuple(joints)
        self._stride = max(1, -(-samples * len(joints) // KEPT))
        self._peaks = np.full(len(joints), np.nan)
        self._seen = 0
        thinned = samples // self._stride + 1
        self._time = _Rows(thinned)
        self._positions = [_Rows(thinned) for _ in joints]
        self._references = [_Rows(thinned) for _ in joints]
        wanted, self.bodies = needs_of(claims, joints)
        self._whole_time = _Rows(samples if wanted else 0)
        self._whole = {key: _Rows(samples) for key in wanted}
        self._bodies: list[Samples] = []
        self._tip_errors = _Rows(0)

    def write(self, samples: Samples) -> None:
        """The next steps of the run."""
        order = [samples.joints.index(joint.name) for joint in self._joints]
        kept = slice((-self._seen) % self._stride, None, self._stride)
        self._seen += len(samples.time)
        self._time.add(samples.time[kept])
        errors = DERIVED_FUNCTIONS["position_error"](samples, self._joints)
        for j, column in enumerate(order):
            position = samples.values["link_position"][:, column]
            self._positions[j].add(position[kept])
            self._references[j].add((errors[:, column] + position)[kept])
        deflections = np.abs(DERIVED_FUNCTIONS["deflection"](samples, self._joints)[:, order])
        self._peaks = np.fmax(self._peaks, np.fmax.reduce(deflections, axis=0, initial=np.nan))
        if self._whole:
            self._whole_time.add(samples.time)
        for (quantity, joint), rows in self._whole.items():
            rows.add(samples.values[quantity][:, samples.joints.index(joint)])
        if TIP in samples.bodies:
            self._tip_errors.add(np.linalg.norm(samples.bodies[TIP][:, :3] - samples.bodies[TIP_GOAL][:, :3], axis=1))
        if self.bodies:
            own = {"time": samples.time, "joints": (), "values": {}}
            self._bodies.append(Samples(**own, bodies=samples.bodies, contacts=samples.contacts))  # type: ignore[arg-type]

    def measures(self, desired: Mapping[str, Signal] | None = None) -> tuple[JointSummary, ...]:
        """A summary of each joint; overshoot and settling count from where its reference begins to move, see `step_start`.

        desired: motion of joints whose reference is not the position that they should take (a planned or learned input).
        """
        if not self._seen:
            return tuple(summarise(np.empty(0), {}) for _ in self._joints)
        time = self._time.values
        found = []
        for j, joint in enumerate(self._joints):
            signal = (desired or {}).get(joint.name, (desired or {}).get("*"))
            reference = self._references[j].values if signal is None else signal.values(time)
            summary = _summary(time, self._positions[j].values, reference)
            found.append(replace(summary, peak_deflection=float(self._peaks[j])))
        return tuple(found)

    @property
    def tip(self) -> dict[str, float]:
        """Cartesian tasks, m: distance of the tip from its path, `largest`, `rms` and `last`, the mean of the last tenth."""
        errors = self._tip_errors.values
        if not len(errors):
            return {}
        tail = errors[-max(len(errors) // 10, 1) :]
        return {"largest": float(errors.max()), "rms": float(np.sqrt(np.mean(errors**2))), "last": float(tail.mean())}

    def read(self, quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        """Every step of what the claims need, as :data:`asrsim.summary.claims.Reader` gives it."""
        if not quantities and not joints:
            return concatenate(self._bodies)
        empty = np.full(len(self._whole_time.values), np.nan)
        columns = {
            name: [self._whole[name, joint].values if (name, joint) in self._whole else empty for joint in joints]
            for name in quantities
        }
        # One joint's column is not copied: long runs have few claims of few joints.
        tables = {name: parts[0][:, None] if len(parts) == 1 else np.column_stack(parts) for name, parts in columns.items()}
        return Samples(time=self._whole_time.values, joints=tuple(joints), values=tables)


class _Rows:
    """Numbers that come in pieces, in one array that is made once."""

    def __init__(self, capacity: int) -> None:
        self._array = np.empty(max(capacity, 1))
        self._count = 0

    def add(self, values: Array) -> None:
        """Append values (n,)."""
        end = self._count + len(values)
        if end > len(self._array):
            self._array = np.concatenate([self._array, np.empty(max(end - len(self._array), len(self._array)))])
        self._array[self._count : end] = values
        self._count = end

    @property
    def values(self) -> Array:
        """All of them, (n,)."""
        return self._array[: self._count]


def joint_measures(
    chunks: Iterable[Samples], joints: Sequence[JointInfo], *, samples: int, desired: Mapping[str, Signal] | None = None
) -> tuple[JointSummary, ...]:
    """A summary of each joint of a run that is there already; arguments as for :class:`Collector`."""
    collector = Collector(joints, samples=samples)
    for chunk in chunks:
        collector.write(chunk)
    return collector.measures(desired)


def _summary(time: Array, position: Array, reference: Array) -> JointSummary:
    if not np.isfinite(reference).all():
        return summarise(time, {"link_position": position})
    start = step_start(reference, float(position[0]))
    found = summarise(time, {"link_position": position, "position_error": reference - position}, step=start)
    return found if not found.overshoot > SHAKEN else replace(found, overshoot=math.nan)


def step_start(reference: Array, initial: float) -> int | None:
    """Sample at which a reference (n,) that goes one way and then rests begins to move; 0 if it stands off `initial` always.

    None where it goes to and fro, still moves in the last tenth, or never leaves the joint's initial position: such a motion
    has no overshoot and does not settle.
    """
    changes = np.diff(reference)
    floor = 1e-9 * max(1.0, float(np.max(np.abs(reference))))
    moves = np.flatnonzero(np.abs(changes) > floor)
    if not len(moves):
        return 0 if abs(float(reference[0]) - initial) > floor else None
    one_way = bool(np.all(changes[moves] > 0) or np.all(changes[moves] < 0))
    return int(moves[0]) + 1 if one_way and moves[-1] < 0.9 * len(changes) else None
