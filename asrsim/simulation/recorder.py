"""From raw records to samples: centred velocities, quantities by name, energies; vectorised, a block at a time.

What a row becomes does not depend on where blocks begin.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.samples import Array, Samples
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.energy import ENERGIES, EnergyMeter
from asrsim.simulation.flows import (
    DEFLECTIONS,
    EFFORTS,
    HELD,
    LIMITS,
    MOTOR_SPEEDS,
    MOTOR_STOPS,
    PLAIN,
    SATURATIONS,
    SPEEDS,
    STOPS,
    Passes,
    constants_of,
)  # fmt: skip
from asrsim.simulation.groups import spring_groups
from asrsim.simulation.inputs import grid
from asrsim.simulation.steppings import Stepping
from asrsim.simulation.substep import RAW

BEHIND = 2
"""Rows by which samples are behind: the next one completes a velocity, and the one after tells whether a motor was limited."""
COLUMN = {name: index for index, name in enumerate(RAW)}
DIRECT = {
    "link_position": "link_position", "link_torque": "link_torque", "damping_torque": "damping_torque",
    **{f"elastic_torque_{i}": f"torque_{i}" for i in (1, 2)}, **{f"motor_{i}_position": f"position_{i}" for i in (1, 2)},
    **{f"motor_{i}_velocity": f"velocity_{i}" for i in (1, 2)}, **{f"motor_{i}_torque": f"drive_{i}" for i in (1, 2)},
    **{f"friction_torque_{i}": f"friction_{i}" for i in (1, 2)},
}  # fmt: skip
"""Quantities that are columns of the raw record."""


def recorded_quantities(drive: SteppedJoint) -> tuple[str, ...]:
    """Names of the quantities that this joint records."""
    names = ["link_position", "link_velocity", "link_torque", "external_torque"]
    mode, actuator = drive.mode, drive.actuator
    if drive.joint.damping or drive.link_damping:
        names.append("damping_torque")
    if mode is None or actuator is None:
        return tuple(names)
    names += ["reference_1"] + (["reference_2"] if len(mode.references) > 1 and has_second_reference(drive) else [])
    if mode.spring:
        names += ["elastic_torque_1"] + (["elastic_torque_2"] if actuator.motors == 2 else []) + ["stiffness"]
        names += [f"motor_{i}_position" for i in range(1, 2 if actuator.motors == 1 and not actuator.adjuster else 3)]
    for i in range(1, drive.dynamic_motors + 1):
        names += [f"motor_{i}_velocity", f"motor_{i}_torque", f"friction_torque_{i}"]
    names += [f"motor_{i}_{what}" for i in drive.electric_motors for what in ("voltage", "current")]
    return (*names, *EnergyMeter.quantities(drive))


def has_second_reference(drive: SteppedJoint) -> bool:
    """An SEA has one reference in every mode."""
    return bool(drive.actuator and (drive.actuator.motors == 2 or drive.actuator.adjuster))


@dataclass
class Counts:
    """Limits that a run met, per joint: numbers of substeps."""

    effort: Array
    """Torque clipped at the URDF's effort limit."""
    velocity: Array
    """Link faster than the URDF's velocity limit (reported, not enforced)."""
    saturation: Array
    """A motor at its torque limit."""
    motor_stop: Array
    """A motor at its position stop."""
    motor_speed: Array
    """A motor at its speed limit."""
    deflection: Array
    """A spring beyond its maximum deflection."""
    stop: Array
    """A link at or beyond its position limit, where the engine stops it; the impact takes energy."""
    stiffest: Array
    """Largest stiffness that the spring reached, N m/rad."""
    substeps: int = 0


class Recorder:
    """Turns blocks of raw records into samples; keeps one row back, whose velocity the next block completes.

    Inside, arrays are (joints, n): every joint's numbers lie side by side.
    """

    def __init__(
        self, drives: Sequence[SteppedJoint], quantities: Sequence[tuple[str, ...]], stepping: Stepping, *, substep: float,
        every: int, last: int, passes: Passes = PLAIN,
    ) -> None:  # fmt: skip
        """quantities: of each joint, all or some of :func:`recorded_quantities`."""
        self.passes = passes
        self.drives = tuple(drives)
        self.stepping = stepping
        self.substep = substep
        self.every = every
        """Substeps between rows of the samples: a step."""
        self.last = last
        """Last substep that is logged."""
        groups = spring_groups(drives)
        n = len(drives)
        self.counts = Counts(
            effort=np.zeros(n, int),
            velocity=np.zeros(n, int),
            saturation=np.zeros(n, int),
            motor_stop=np.zeros(n, int),
            motor_speed=np.zeros(n, int),
            deflection=np.zeros(n, int),
            stop=np.zeros(n, int),
            stiffest=np.zeros(n),
        )
        self._held_inputs, self._held = np.empty((3, len(drives), 0)), np.empty((len(RAW), len(drives), 0))
        self._sides: dict[int, Array] = {}
        self._next = 0
        kinds = dict.fromkeys(quantities)
        names = dict.fromkeys(name for kind in kinds for name in kind)
        self._constants = constants_of(drives, groups, substep)
        self.meter = EnergyMeter(n, groups, self._constants, substep, whole=any(name in ENERGIES for name in names))
        lacking = {kind: [name for name in names if name not in kind] for kind in kinds}
        self._lacking = {name: [j for j in range(n) if name in lacking[quantities[j]]] for name in names}
        """Joints without a quantity, for every quantity that some have."""
        self._groups = [(group, over_arrays(group.actuator.stiffness), group.elastic) for group in groups]
        self._electric = [group for group, _, _ in self._groups if any(drive.electric_motors for drive in group.drives)]

    def __deepcopy__(self, memo: Any) -> Recorder:
        """A recorder that goes on from here: what never changes is shared."""
        twin = copy.copy(self)
        twin.counts = Counts(**{name: copy.copy(value) for name, value in vars(self.counts).items()})
        twin.meter = copy.deepcopy(self.meter, memo)
        twin._sides = dict(self._sides)
        return twin

    def add(self, inputs: Array, raw: Array, sides: Mapping[int, Array]) -> Samples | None:
        """Samples of the rows that `raw` (columns, joints, n) completes, or None where there are none.

        inputs: references 1 and 2 and external torques, (3, joints, n); the first :data:`BEHIND` rows of both are room for
        those that were kept back. sides: see :class:`asrsim.simulation.inputs.Block`.
        """
        size = BEHIND - self._held.shape[2]
        for room, held in (inputs, self._held_inputs), (raw, self._held):
            room[:, :, size:BEHIND] = held
        inputs, raw = inputs[:, :, size:], raw[:, :, size:]
        self._sides |= sides
        self._held_inputs, self._held = inputs[:, :, -BEHIND:].copy(), raw[:, :, -BEHIND:].copy()
        count = min(raw.shape[2] - BEHIND, self.last + 1 - self._next)
        if count <= 0:
            return None
        first = self._next
        self._next += count
        logged = slice((-first) % self.every, count, self.every)
        values = self._values(raw[:, :, : count + BEHIND], inputs[:, :, : count + 1], first, logged)
        time = grid(first, count, self.substep)[logged]
        if not len(time):
            return None
        return Samples(
            time=time,
            joints=tuple(drive.name for drive in self.drives),
            values={name: values[name].T for name in self._lacking},
        )

    def _values(self, raw: Array, inputs: Array, first: int, logged: slice) -> dict[str, Array]:
        """Quantities (joints, m) by name, at the logged ones of the rows of raw (columns, joints, n + 2) but the last two."""
        beyond, raw = raw, raw[:, :, :-1]
        count = raw.shape[2] - 1
        joints = len(self.drives)
        now = raw[:, :, :-1]
        velocity = now[COLUMN["engine_velocity"]]
        if self.stepping.staggered:
            velocity = 0.5 * (velocity + raw[COLUMN["engine_velocity"], :, 1:])
            if first == 0:
                # Nothing comes before the start: there the engine's velocity is the joint's.
                velocity[:, 0] = raw[COLUMN["engine_velocity"], :, 0]
        values = {
            **{name: now[COLUMN[source]] for name, source in DIRECT.items()},
            "link_velocity": velocity,
            "external_torque": inputs[2][:, :count],
            "reference_1": inputs[0][:, :count],
            "reference_2": inputs[1][:, :count],
        }
        stiffness = np.full((joints, count), np.nan)
        for group, law, elastic in self._groups:
            positions = [values[name][group.pick] for name in ("link_position", "motor_1_position", "motor_2_position")]
            stiffness[group.pick] = law(*positions, elastic)
        values["stiffness"] = stiffness
        sides = {k - first: rows for k, rows in self._sides.items() if first <= k <= first + count}
        self._sides = {k: rows for k, rows in self._sides.items() if k >= first + count}
        for group in self._electric:
            for name, found in group.electricity(now[:, group.pick]).items():
                values.setdefault(name, np.full((joints, count), np.nan))[group.pick] = found
        met = np.empty((LIMITS, joints), dtype=np.int64)
        self.passes.meet(beyond, velocity, *self._constants, met)
        self._count(met, count, stiffness)
        energies = self.meter.add(beyond, logged, external=inputs[2], sides=sides, held=met[HELD], passes=self.passes)
        values = {name: values[name][:, logged] for name in self._lacking if name in values} | energies
        for name, lacking in self._lacking.items():
            if lacking:
                values[name] = values[name].copy()
                values[name][lacking] = np.nan
        return values

    def _count(self, met: Any, substeps: int, stiffness: Array) -> None:
        counts = self.counts
        counts.substeps += substeps
        counts.effort += met[EFFORTS]
        counts.velocity += met[SPEEDS]
        counts.saturation += met[SATURATIONS]
        counts.motor_stop += met[MOTOR_STOPS]
        counts.motor_speed += met[MOTOR_SPEEDS]
        counts.deflection += met[DEFLECTIONS]
        counts.stop += met[STOPS]
        counts.stiffest = np.fmax(counts.stiffest, np.maximum(stiffness.max(axis=1), -stiffness.min(axis=1)))
