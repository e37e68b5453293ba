"""What becomes of a simulation's raw record: samples for sinks, and a watch on its energy."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from asrsim.engines.base import Engine
from asrsim.errors import InputError
from asrsim.samples import Array, RunInfo, Samples, concatenate
from asrsim.simulation.divergence import EnergyGuard, runaway
from asrsim.simulation.flows import PLAIN, compiled_passes
from asrsim.simulation.inputs import Block
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.recorder import BEHIND, Recorder, recorded_quantities
from asrsim.simulation.substep import RAW
from asrsim.simulation.world import WorldRecorder

if TYPE_CHECKING:
    from asrsim.kinematics.tip import TipPoses


class Sink(Protocol):
    """Takes samples as they come: logged ones, or those of every step if it has `full_rate = True`; with `bodies = True` too,
    objects' poses and contacts are in every one of those."""

    def write(self, samples: Samples) -> None:
        """The next chunk."""


@dataclass(frozen=True)
class Part:
    """A part of a run as it was stepped: what :meth:`asrsim.simulation.recorder.Recorder.add` takes, and the links' energy."""

    inputs: Array
    raw: Array
    sides: Mapping[int, Array]
    end: int
    """Substeps done by then."""
    checked: bool
    """Whether to ask if energy came from nowhere."""
    energy: float | None
    """J, at its end; None where contacts or wrenches do work of their own on the links."""
    kinetic: float
    """J, of this."""


class Recording:
    """Raw records in, samples out. Nothing is kept but what `keep` asks for."""

    def __init__(
        self,
        prepared: Prepared,
        engine: Engine,
        *,
        last: int,
        sinks: Sequence[Sink] | Callable[[RunInfo], Sequence[Sink]],
        keep: bool,
    ) -> None:
        scenario, substeps = prepared.scenario, prepared.resolution.substeps
        self._prepared, self._engine = prepared, engine
        self._sinks = list(sinks(prepared.info) if callable(sinks) else sinks)
        self.active = bool(keep or self._sinks)
        self.taker: Callable[[Part], None] | None = None
        """Takes what was stepped in place of :meth:`evaluate`, and sees to it that it is evaluated in its order."""
        self.parts: list[Part] | None = None
        """What was stepped and not looked at, where :mod:`asrsim.simulation.together` will."""
        self.wanted: frozenset[str] = frozenset()
        self.kept: list[Samples] | None = [] if keep else None
        self._last = last
        self.passes = PLAIN
        """What goes over the records' rows."""
        self.recorder = self._make_recorder()
        self._whole = any(getattr(sink, "full_rate", False) for sink in self._sinks)
        self._tip = _tip_of(prepared) if self.active else None
        closely = any(getattr(sink, "bodies", False) for sink in self._sinks) or (self._tip and not scenario.fixed_base)
        self._look_every = 1 if self._whole and closely else scenario.log_every
        self.every = substeps * self._look_every
        """Substeps between looks at the world."""
        self._world = WorldRecorder(engine, last)
        self._first_world = copy.deepcopy(self._world.kept())
        watched = self.active and not (scenario.world.empty and scenario.fixed_base)
        self.watch: Callable[[int], None] | None = self._world.look if watched else None
        """Told of a substep where the world is looked at, before it."""
        self.energy = engine.mechanical_energy()
        """J, of the links at the start."""
        self._alone = self.energy is not None and not scenario.wrenches
        # The released order of a step is not passive, and runs springs that it does not resolve: no fault of the user's.
        self.guarded = engine.model is not None and not prepared.stepping.released
        self._guard = EnergyGuard(self.energy or 0.0)
        count = len(prepared.drives)
        self._inputs, self._raw = np.empty((3, count, BEHIND)), np.empty((len(RAW), count, BEHIND))
        """References and external torques, and raw records, of the present chunk, for :class:`Part`."""
        self._filled = 0
        """Substeps in them."""
        self._idle = np.empty((0, count, len(RAW)))
        self._sides: dict[int, Array] = {}

    def defer(self, wanted: Collection[str]) -> None:
        """From now on parts are only kept; wanted: quantities of which samples will be made."""
        self.active, self.wanted = True, frozenset(wanted)
        self.parts = []
        self.taker = self.parts.append

    def quicken(self) -> None:
        """Records are long: let what goes over their rows be compiled."""
        if self.active:
            self.passes = self.recorder.passes = compiled_passes()

    def room(self, rest: int) -> Array:
        """Memory for the raw records of the `rest` of the chunk, (rest, joints, columns). Where they will be evaluated, a
        column's numbers lie side by side, joint by joint; else the same memory serves every time."""
        if not self.active:
            if len(self._idle) < rest:
                self._idle = np.empty((rest, *self._idle.shape[1:]))
            return self._idle[:rest]
        begin = BEHIND + self._filled
        if self._raw.shape[2] < begin + rest:
            self._inputs, self._raw = _longer(self._inputs, begin, rest), _longer(self._raw, begin, rest)
        return self._raw[:, :, begin : begin + rest].transpose(2, 1, 0)

    def take(self, block: Block, start: int, end: int) -> None:
        """The block's substeps from `start` to `end`, whose raw records are in the `room`."""
        if self.active:
            begin = BEHIND + self._filled
            self._filled += end - start
            self._inputs[:, :, begin : BEHIND + self._filled] = block.arrays[:, :, start:end]
            self._sides |= {k: sides for k, sides in block.sides.items() if start <= k - block.first < end}

    def flush(self, substep: int, *, check: bool = True) -> None:
        """Hand on what there is up to `substep`; raises what :meth:`evaluate` does."""
        if self._filled:
            (self.taker or self.evaluate)(self._part(substep, check=check))

    def evaluate(self, part: Part) -> None:
        """Samples of a part, handed on; raises DivergenceError where energy came from nowhere."""
        samples = self.recorder.add(part.inputs, part.raw, part.sides)
        if samples is not None:
            self._hand_on(samples)
        fault = None
        if part.checked and self.guarded:
            meter = self.recorder.meter
            balance = {"given": meter.given, "residual": meter.residual, "turnover": meter.turnover}
            fault = self._guard.fault(part.energy, kinetic=part.kinetic, **balance, names=self._engine.joints)
        if fault is not None:
            resolution = self._prepared.resolution
            raise runaway(fault[0], min(part.end, self._last) * self._prepared.substep, fault[1], resolution.omega_h)

    def _part(self, end: int, *, check: bool) -> Part:
        """What came since the last one, with the links' energy where it is checked: a motion no longer finite has none."""
        inputs, raw = (_handed_over(table, BEHIND + self._filled) for table in (self._inputs, self._raw))
        if raw.base is not None:
            self._inputs, self._raw = inputs[:, :, :BEHIND], raw[:, :, :BEHIND]
        sides, self._sides, self._filled = self._sides, {}, 0
        model, kinetic = self._engine.model, 0.0
        if not (check and self.guarded and self._alone and model is not None):
            return Part(inputs, raw, sides, end, check, None, kinetic)
        positions, velocities = self._engine.read()
        speeds = np.array(velocities)
        kinetic = 0.5 * float(speeds @ model.mass_matrix(positions) @ speeds)
        return Part(inputs, raw, sides, end, check, self._engine.mechanical_energy(), kinetic)

    def _hand_on(self, samples: Samples) -> None:
        step, every = self._prepared.scenario.step, self._prepared.scenario.log_every
        first = round(float(samples.time[0]) / step)
        if self._look_every == 1:
            samples = self._world.add_to(samples)
        if self._whole and self._tip is not None:
            samples = self._tip.added(samples)
        logged = samples if every == 1 else _thinned(samples, slice((-first) % every, None, every))
        if self._look_every != 1:
            logged = self._world.add_to(logged)
        if self._tip is not None and not self._whole:
            logged = self._tip.added(logged)
        if self.kept is not None and len(logged.time):
            self.kept.append(logged)
        for sink in self._sinks:
            if getattr(sink, "full_rate", False):
                sink.write(samples)
            elif len(logged.time):
                sink.write(logged)

    @property
    def samples(self) -> Samples:
        """All that is kept; raises InputError where nothing is."""
        if self.kept is None:
            raise InputError("keeps no samples: make it with record=True", key="simulation", code="samples")
        return concatenate(self.kept, joints=self._engine.joints)

    def take_over(self, varied: Prepared, engine: Engine) -> None:
        """Go on with other numbers, and maybe another engine."""
        self._prepared, self._engine = varied, engine
        self._world.engine = engine
        if self.active:
            self._tip = _tip_of(varied)

    def _make_recorder(self) -> Recorder:
        prepared = self._prepared
        substeps = prepared.resolution.substeps
        return Recorder(
            prepared.drives, [recorded_quantities(drive) for drive in prepared.drives], prepared.stepping,
            substep=prepared.substep, every=substeps, last=self._last, passes=self.passes,
        )  # fmt: skip

    def renew(self) -> None:
        """A fresh start, with the numbers that were taken over last; the engine is at its start."""
        if not self.active:
            return
        self._filled, self._sides, self.energy = 0, {}, self._engine.mechanical_energy()
        if self.parts is not None:
            self.defer(self.wanted)
            return
        self.recorder = self._make_recorder()
        self._guard = EnergyGuard(self.energy or 0.0)
        self._world.put_back(copy.deepcopy(self._first_world))
        self.kept = None if self.kept is None else []

    def state(self) -> Any:
        """A copy of what decides how the recording goes on; None where nothing is recorded."""
        if not self.active:
            return None
        tables = [table[:, :, : BEHIND + self._filled] for table in (self._inputs, self._raw)]
        going_on = copy.deepcopy((self.recorder, self._guard, tables, self._sides, self._world.kept()))
        return going_on, None if self.kept is None else list(self.kept)

    def put_back(self, state: Any) -> None:
        """Go on from a state; what went to sinks stays there."""
        if state is not None:
            going_on, kept = state
            self.recorder, self._guard, (self._inputs, self._raw), self._sides, world = copy.deepcopy(going_on)
            self._filled = self._raw.shape[2] - BEHIND
            self._world.put_back(world)
            self.kept = None if kept is None else list(kept)


def _longer(table: Array, begin: int, rest: int) -> Array:
    """A table with room for `rest` rows behind the `begin` that it has."""
    longer = np.empty((*table.shape[:2], begin + rest))
    longer[:, :, :begin] = table[:, :, :begin]
    return longer


def _handed_over(table: Array, rows: int) -> Array:
    """The table's first rows; a copy where most of it is empty: samples keep what they are made of."""
    return table[:, :, :rows] if 2 * rows >= table.shape[2] else table[:, :, :rows].copy()


def _thinned(samples: Samples, rows: slice) -> Samples:
    def thin(table: Mapping[str, Array]) -> dict[str, Array]:
        return {name: values[rows] for name, values in table.items()}

    values, bodies, contacts = map(thin, (samples.values, samples.bodies, samples.contacts))
    return replace(samples, time=samples.time[rows], values=values, bodies=bodies, contacts=contacts)


def _tip_of(prepared: Prepared) -> TipPoses | None:
    if prepared.scenario.task is None:
        return None
    from asrsim.kinematics.tip import TipPoses

    return TipPoses(prepared.scenario, prepared.robot)
