"""From raw records to samples: centred velocities, quantities by name, energies; vectorised, a block at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.samples import Array, Samples
from asrsim.simulation.drives import Drive
from asrsim.simulation.energy import EnergyMeter
from asrsim.simulation.inputs import Block, grid
from asrsim.simulation.loop import COLUMNS
from asrsim.simulation.steppings import Stepping

COLUMN = {name: index for index, name in enumerate(COLUMNS)}


def recorded_quantities(drive: Drive) -> tuple[str, ...]:
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
    return (*names, *EnergyMeter.quantities(drive))


def has_second_reference(drive: Drive) -> bool:
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
    deflection: Array
    """A spring beyond its maximum deflection."""
    substeps: int = 0


class Recorder:
    """Turns blocks of raw records into samples; keeps one row back, whose velocity the next block completes."""

    def __init__(self, drives: Sequence[Drive], stepping: Stepping, *, substep: float, every: int, last: int) -> None:
        self.drives = tuple(drives)
        self.stepping = stepping
        self.substep = substep
        self.every = every
        """Substeps between logged rows."""
        self.last = last
        """Last substep that is logged."""
        self.meter = EnergyMeter(drives, substep)
        n = len(drives)
        self.counts = Counts(np.zeros(n, int), np.zeros(n, int), np.zeros(n, int), np.zeros(n, int))
        self._held: Array | None = None
        self._held_inputs: tuple[Array, ...] = ()
        self._sides: dict[int, Array] = {}
        self._next = 0
        self._quantities = [frozenset(recorded_quantities(drive)) for drive in drives]
        self._names = tuple(dict.fromkeys(name for drive in drives for name in recorded_quantities(drive)))
        self._stiffness = [over_arrays(drive.actuator.stiffness) if drive.actuator else None for drive in drives]

    def add(self, block: Block, raw: Array) -> Samples | None:
        """Samples of the rows that `raw` (n, joints, columns) completes, or None where there are none."""
        inputs = block.arrays
        raw = self._with_held(raw)
        if self._held is not None:
            inputs = tuple(np.concatenate([a, b]) for a, b in zip(self._held_inputs, inputs, strict=True))  # type: ignore[assignment]
        self._held, self._held_inputs = raw[-1:].copy(), tuple(a[-1:] for a in inputs)
        self._sides |= block.sides
        count = min(len(raw) - 1, self.last + 1 - self._next)
        if count < 1:
            return None
        first = self._next
        self._next += count
        values = self._values(raw[: count + 1], inputs, count, first)
        logged = slice((-first) % self.every, count, self.every)
        time = grid(first, count, self.substep)[logged]
        if not len(time):
            return None
        return Samples(
            time=time,
            joints=tuple(drive.name for drive in self.drives),
            values={name: np.ascontiguousarray(column[logged]) for name, column in values.items()},
        )

    def _with_held(self, raw: Array) -> Array:
        """The row kept back and `raw`, laid out so that each column is contiguous."""
        held = 0 if self._held is None else 1
        columns = np.empty((raw.shape[2], held + raw.shape[0], raw.shape[1]))
        rows = np.moveaxis(columns, 0, 2)
        if self._held is not None:
            rows[:1] = self._held
        rows[held:] = raw
        return rows

    def _values(self, raw: Array, inputs: Sequence[Array], count: int, first: int) -> dict[str, Array]:
        raw = self._braked(raw)
        now, after = raw[:count], raw[1 : count + 1]
        n = len(self.drives)
        values = {name: np.full((count, n), np.nan) for name in self._names}
        velocity = now[:, :, 1].copy()
        if self.stepping.staggered:
            velocity = 0.5 * (now[:, :, 1] + after[:, :, 1])
            if first == 0:
                velocity[0] = now[0, :, 1]
        efforts = np.array([np.inf if drive.joint.effort is None else drive.joint.effort for drive in self.drives])
        torque = np.clip(now[:, :, 2], -efforts, efforts)
        columns: dict[str, Array] = {
            "link_position": now[:, :, 0],
            "link_velocity": velocity,
            "link_torque": torque,
            "external_torque": inputs[2][:count],
            "reference_1": inputs[0][:count],
            "reference_2": inputs[1][:count],
        }
        for name, source in (
            ("elastic_torque_{}", "torque_{}"),
            ("motor_{}_position", "position_{}"),
            ("motor_{}_velocity", "velocity_{}"),
            ("motor_{}_torque", "drive_{}"),
            ("friction_torque_{}", "friction_{}"),
        ):
            for i in (1, 2):
                columns[name.format(i)] = now[:, :, COLUMN[source.format(i)]]
        stiffness = np.full((count, n), np.nan)
        for j, drive in enumerate(self.drives):
            law = self._stiffness[j]
            if drive.mode and drive.mode.spring and law:
                q, theta_1, theta_2 = now[:, j, 0], columns["motor_1_position"][:, j], columns["motor_2_position"][:, j]
                stiffness[:, j] = law(q, theta_1, theta_2, drive.elastic)
        columns["stiffness"] = stiffness
        damping = self._dampings(stiffness)
        columns["damping_torque"] = -damping * velocity
        sides = {k - first: rows for k, rows in self._sides.items() if first <= k <= first + count}
        self._sides = {k: rows for k, rows in self._sides.items() if k >= first + count}
        columns |= self.meter.add(
            raw[: count + 1], columns, damping, clipped=torque, external=inputs[2][: count + 1], sides=sides
        )
        self._count(now, columns)
        for name, target in values.items():
            source_column = columns[name]
            for j, recorded in enumerate(self._quantities):
                if name in recorded:
                    target[:, j] = source_column[:, j]
        return values

    def _braked(self, raw: Array) -> Array:
        """With the derivative action of the links' controllers (mode 1) in the actuator's torque."""
        brakes = np.array([drive.link_brake for drive in self.drives])
        if not brakes.any():
            return raw
        speeds = raw[:, :, 1]
        if self.stepping.staggered:
            # Centred; the last row's neighbour is not known yet, and extrapolated.
            speeds = np.concatenate([0.5 * (speeds[:-1] + speeds[1:]), 1.5 * speeds[-1:] - 0.5 * speeds[-2:-1]])
        braked = raw.copy()
        braked[:, :, COLUMN["actuator_torque"]] -= brakes * speeds
        return braked

    def _dampings(self, stiffness: Array) -> Array:
        """Link damping (n, joints) in N m s/rad."""
        damping = np.tile(np.array([drive.joint.damping for drive in self.drives]), (len(stiffness), 1))
        for j, drive in enumerate(self.drives):
            law = drive.link_damping
            if law is not None and drive.actuator is not None:
                damping[:, j] += law.constant
                if drive.mode is not None and drive.mode.spring:
                    damping[:, j] += 2.0 * law.ratio * np.sqrt(np.maximum(law.inertia * stiffness[:, j], 0.0))
        return damping

    def _count(self, now: Array, columns: dict[str, Array]) -> None:
        counts = self.counts
        counts.substeps += len(now)
        for j, drive in enumerate(self.drives):
            joint = drive.joint
            if joint.effort is not None:
                counts.effort[j] += np.count_nonzero(np.abs(now[:, j, 2]) > joint.effort)
            if joint.velocity:
                counts.velocity[j] += np.count_nonzero(np.abs(columns["link_velocity"][:, j]) > joint.velocity)
            for i in range(1, drive.dynamic_motors + 1):
                limit = drive.values[f"motor_{i}_max_torque"]
                counts.saturation[j] += np.count_nonzero(np.abs(columns[f"motor_{i}_torque"][:, j]) >= limit)
            if drive.mode and drive.mode.spring and drive.actuator and "max_deflection" in drive.values:
                limit = drive.values["max_deflection"]
                springs = range(1, drive.actuator.motors + 1)
                beyond = [np.abs(columns[f"motor_{i}_position"][:, j] - now[:, j, 0]) > limit for i in springs]
                counts.deflection[j] += np.count_nonzero(np.any(beyond, axis=0))
