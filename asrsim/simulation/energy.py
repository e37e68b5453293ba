"""Where the energy goes: work of the motors, stored in springs, lost, given to the link; and what does not add up.

The sums are of second order in the step, so with the default stepping the residual falls as h^2; in a run that is
not resolved it does not, and that is how divergence shows before any number overflows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.actuators.vectorised import energy_over_arrays
from asrsim.samples import Array
from asrsim.simulation.drives import Drive

_MOTOR_VALUES = ("inertia", "damping", "min_position", "max_position", "max_velocity")


class EnergyMeter:
    """Running energies of each joint in J since the start."""

    def __init__(self, drives: Sequence[Drive], substep: float) -> None:
        self.drives = tuple(drives)
        self.substep = substep
        self._staggered = all(drive.stepping.staggered for drive in drives)
        self._laws = [energy_over_arrays(d.actuator) if d.actuator and d.mode and d.mode.spring else None for d in drives]
        self._totals = np.zeros((4, len(self.drives)))
        self._start: Array | None = None
        self.turnover = np.zeros(len(self.drives))
        """J: energy that went through each joint, the scale of a residual."""
        self.residual = np.zeros(len(self.drives))
        """J that vanished in each actuator, at the last row; negative where a spring gave more than it held."""
        self.given = np.zeros(len(self.drives))
        """J: work of actuators and external torques on the links, less what their damping took, up to the last row."""

    @staticmethod
    def quantities(drive: Drive) -> tuple[str, ...]:
        """What a joint has of it."""
        if drive.mode is None:
            return ()
        names = ["motor_work", "link_work"]
        if drive.mode.spring:
            names += ["spring_energy", "energy_residual"]
        if drive.dynamic_motors:
            names += ["friction_loss"]
        if drive.joint.damping or drive.link_damping:
            names += ["damping_loss"]
        return tuple(names)

    def add(
        self,
        raw: Array,
        columns: dict[str, Array],
        damping: Array,
        *,
        clipped: Array,
        external: Array,
        sides: Mapping[int, Array],
    ) -> dict[str, Array]:
        """Energies at the rows of `columns` (n, joints); raw (n + 1, joints, columns) has one row more.

        sides: means over the two halves of a kick that an input cuts, by row of `raw`: what pushes jumps, and the trapezoid
        rule must not go across.
        """
        n, joints = clipped.shape
        cut = np.zeros(n, dtype=bool)
        for row in sides:
            cut[max(row - 1, 0) : row + 1] = True

        def mean(values: Array, column: int) -> Array:
            """Means (n, ...) over the steps between rows of `values` (n + 1, ...), `column` of the sides."""
            means = 0.5 * (values[:-1] + values[1:])
            for row, (before, after) in sides.items():
                if row < n:
                    means[row] += 0.5 * (after[:, column] - values[row])
                if row:
                    means[row - 1] += 0.5 * (before[:, column] - values[row])
            return means

        efforts = np.array([np.inf if drive.joint.effort is None else drive.joint.effort for drive in self.drives])
        torque = mean(np.concatenate([clipped, np.clip(raw[n:, :, 2], -efforts, efforts)]), 2)
        limited = np.abs(raw[:, :, 2]) > efforts
        pushed = {column: mean(raw[:, :, column], column) for column in (3, 4, 7, 8, 11, 12)} if any(self._laws) else {}
        q = raw[:, :, 0]
        moved = np.diff(q, axis=0)
        link = torque * moved
        # An explicit scheme damps by the velocity before the kick; else the velocity over the step is the middle one.
        speed = raw[1:, :, 1] if self._staggered else 0.5 * (raw[:-1, :, 1] + raw[1:, :, 1])
        dissipated = damping * speed * moved
        pushed_in = mean(external, -1) * moved
        self.given += (link + pushed_in - dissipated).sum(axis=0)
        work = link.copy()
        lost = np.zeros((n, joints))
        stored = np.zeros((n, joints))
        kinetic = np.zeros((n, joints))
        for j, drive in enumerate(self.drives):
            law = self._laws[j]
            if law is None:
                continue
            energy = law(q[:, j], raw[:, j, 5], raw[:, j, 9], drive.elastic)
            stored[:, j] = energy[:-1]
            released = link[:, j]
            if limited[:, j].any():
                released = (pushed[3][:, j] + pushed[4][:, j]) * moved[:, j]
                lost[:, j] = released - link[:, j]
            if not drive.dynamic_motors:
                work[:, j] = self._ideal(law, drive, raw[:, j], cut, released + np.diff(energy))
                continue
            work[:, j] = 0.0
            for i in range(1, drive.dynamic_motors + 1):
                given, taken, fast = self._motor(
                    drive, i, raw[:, j], {column: values[:, j] for column, values in pushed.items()}
                )
                work[:, j] += given
                lost[:, j] += taken
                kinetic[:, j] += fast
            if drive.actuator is not None and drive.actuator.adjuster:
                work[:, j] += self._adjuster(law, drive, raw[:, j], cut, pushed[3][:, j])
        flows = np.stack([work, lost, dissipated, link])
        running = self._totals[:, None, :] + np.concatenate([np.zeros((4, 1, joints)), np.cumsum(flows, axis=1)], axis=1)
        self._totals = running[:, -1]
        self.turnover += np.nansum(np.abs(work), axis=0) + np.nansum(np.abs(link) + np.abs(pushed_in), axis=0)
        at = running[:, :-1]
        if self._start is None:
            self._start = stored[0] + kinetic[0]
        residual = at[0] - at[1] - at[3] - (stored + kinetic - self._start)
        self.residual = residual[-1]
        return {
            "motor_work": at[0],
            "friction_loss": at[1],
            "damping_loss": at[2],
            "link_work": at[3],
            "spring_energy": stored,
            "energy_residual": residual,
        }

    def _motor(self, drive: Drive, index: int, raw: Array, pushed: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Work of motor `index`, what it lost, both (n,) a step, and its kinetic energy at whole steps (n,), in J."""
        base = 1 + 4 * index
        values = {name: drive.values[f"motor_{index}_{name}"] for name in _MOTOR_VALUES}
        moved = np.diff(raw[:, base])
        speed = moved / self.substep
        work = pushed[base + 2] * moved
        kinetic = 0.5 * values["inertia"] * raw[:, base + 1] ** 2
        lost = pushed[base + 3] * moved + values["damping"] * speed * speed * self.substep
        # A stop and a speed limit take what is left over: the shock, and the torque that they hold.
        held = (raw[:, base] >= values["max_position"]) | (raw[:, base] <= values["min_position"])
        held |= np.abs(raw[:, base + 1]) >= values["max_velocity"] * (1.0 - 1e-9)
        held |= np.concatenate([held[1:], [False]]) | np.concatenate([[False], held[:-1]])
        ends = held[:-1] | held[1:]
        spring = pushed[2 + index] * moved
        lost = np.where(ends, work - spring - np.diff(kinetic), lost)
        return work, lost, kinetic[:-1]

    def _ideal(self, law: Any, drive: Drive, raw: Array, cut: Array, taken: Array) -> Array:
        """Work (n,) in J of motors that are where they should be: the energy's change by their motion, link at its mean place.

        Where they jump the link's place at that moment counts: they give what is taken.
        """
        middle = 0.5 * (raw[:-1, 0] + raw[1:, 0])
        after = law(middle, raw[1:, 5], raw[1:, 9], drive.elastic)
        return np.asarray(np.where(cut, taken, after - law(middle, raw[:-1, 5], raw[:-1, 9], drive.elastic)))

    def _adjuster(self, law: Any, drive: Drive, raw: Array, cut: Array, spring: Array) -> Array:
        """Work (n,) in J of an adjuster, which is where it should be: the energy's change by its motion at fixed deflection."""
        middle, motor = 0.5 * (raw[:-1, 0] + raw[1:, 0]), 0.5 * (raw[:-1, 5] + raw[1:, 5])
        work = law(middle, motor, raw[1:, 9], drive.elastic) - law(middle, motor, raw[:-1, 9], drive.elastic)
        # Where it jumps the deflection at that moment counts: it gives what spring, link and motor take.
        change = np.diff(law(raw[:, 0], raw[:, 5], raw[:, 9], drive.elastic))
        taken = change + spring * (np.diff(raw[:, 0]) - np.diff(raw[:, 5]))
        return np.asarray(np.where(cut, taken, work))
