"""What summary and claims need of a run, taken from its steps as they come: no log is read again for it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS, DERIVED_SOURCES
from asrsim.metrics import JointSummary, summaries, summarise
from asrsim.samples import TIP, TIP_GOAL, Array, JointInfo, Samples, concatenate

if TYPE_CHECKING:
    from asrsim.signals.base import Signal

KEPT = 1_000_000
"""Samples of all joints together that are looked at; a longer run is thinned evenly, its peaks are not."""
SHAKEN = 10.0
"""Overshoot (a fraction of the step) above which there was no step to speak of: the joint was shaken, not moved."""


@dataclass(frozen=True)
class Seen:
    """What a summary needs of a run's samples."""

    measures: tuple[JointSummary, ...]
    """Of each joint."""
    tip: Mapping[str, float]
    """Cartesian tasks, m: distance of the tip from its path, `largest`, `rms` and `last`, the mean of the last tenth."""
    travels: tuple[float, ...]
    """rad or m of each joint, from its lowest to its highest position."""


class Collector:
    """A sink that keeps the positions of all joints and, whole, the series that claims are about."""

    full_rate = True
    """It asks for every step, whatever the log takes."""
    bodies: bool
    """It asks for objects' poses and contacts at every step, too: claims are about them."""

    def __init__(
        self, joints: Sequence[JointInfo], *, samples: int, needs: tuple[Sequence[tuple[str, str]], bool] = ((), False)
    ) -> None:
        """joints: those of the run's description. samples: how many will come, or more. needs: see
        :func:`asrsim.summary.claims.needs_of`."""
        self._joints = tuple(joints)
        self._stride = max(1, -(-samples * len(joints) // KEPT))
        self._peaks = np.full(len(joints), np.nan)
        self._seen = 0
        thinned = samples // self._stride + 1
        self._time = _Rows(thinned)
        self._positions, self._references = (_Rows(thinned, len(joints)) for _ in range(2))
        wanted, self.bodies = needs
        derived = (source for name in ("deflection", "position_error") for source in DERIVED_SOURCES[name])
        self.quantities = frozenset(("link_position", *derived, *(quantity for quantity, _ in wanted)))
        """Names of what it takes from samples."""
        self._whole_time = _Rows(samples if wanted else 0)
        self._whole = {key: _Rows(samples) for key in wanted}
        self._bodies: list[Samples] = []
        self._tip_errors = _Rows(0)

    def write(self, samples: Samples) -> None:
        """The next steps of the run."""
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
        if self.bodies:
            own = {"time": samples.time, "joints": (), "values": {}}
            self._bodies.append(Samples(**own, bodies=samples.bodies, contacts=samples.contacts))  # type: ignore[arg-type]

    def seen(self, desired: Mapping[str, Signal] | None = None, *, balanced: bool = False) -> Seen:
        """Summaries; overshoot and settling count from where a joint's reference begins to move, see `step_start`.

        desired: motion of joints whose reference is not the position that they should take (a planned or learned input).
        balanced: the run begins in equilibrium, so that a constant reference is no step.
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
        finite: Any = np.isfinite(references)
        known = finite.all(axis=1).tolist()
        starts = references[:, 0] if balanced else positions[:, 0]
        pairs = zip(known, references, starts.tolist(), strict=True)
        steps = [step_start(reference, start) if there else None if balanced else 0 for there, reference, start in pairs]
        errors = np.where(np.array(known)[:, None], references - positions, np.nan)
        found = summaries(time, positions, errors, steps, self._peaks)
        return tuple(
            replace(one, overshoot=math.nan) if there and one.overshoot > SHAKEN else one
            for one, there in zip(found, known, strict=True)
        )

    def _tip(self) -> dict[str, float]:
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
    """Numbers that come in pieces, (n,) or (rows, n), in one array that is made once."""

    def __init__(self, capacity: int, *rows: int) -> None:
        self._array = np.empty((*rows, max(capacity, 1)))
        self._count = 0

    def add(self, values: Array) -> None:
        """Append values."""
        end = self._count + values.shape[-1]
        room = self._array.shape[-1]
        if end > room:
            more = np.empty((*self._array.shape[:-1], max(end - room, room)))
            self._array = np.concatenate([self._array, more], axis=-1)
        self._array[..., self._count : end] = values
        self._count = end

    @property
    def values(self) -> Array:
        """All of them."""
        return self._array[..., : self._count]


def step_start(reference: Array, initial: float) -> int | None:
    """Sample at which a reference (n,) that goes one way and then rests begins to move; 0 if it stands off `initial` always.

    None where it goes to and fro, still moves in the last tenth, or never leaves the joint's initial position: such a motion
    has no overshoot and does not settle.
    """
    changes = reference[1:] - reference[:-1]
    floor = 1e-9 * max(1.0, float(np.abs(reference).max()))
    moves = np.flatnonzero(np.abs(changes) > floor)
    if not len(moves):
        return 0 if abs(float(reference[0]) - initial) > floor else None
    one_way = bool(np.all(changes[moves] > 0) or np.all(changes[moves] < 0))
    return int(moves[0]) + 1 if one_way and moves[-1] < 0.9 * len(changes) else None
