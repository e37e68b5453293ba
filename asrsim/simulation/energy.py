"""Where the energy goes: work of the motors, stored in springs, lost, given to the link; and what does not add up.

The sums are of second order in the step, so with the default stepping the residual falls as h^2; in a run that is
not resolved it does not, and that is how divergence shows before any number overflows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.actuators.vectorised import energy_over_arrays
from asrsim.samples import Array
from asrsim.simulation.drives import Drive


class EnergyMeter:
    """Running energies of each joint in J since the start."""

    def __init__(self, drives: Sequence[Drive], substep: float) -> None:
        self.drives = tuple(drives)
        self.substep = substep
        self._laws = [energy_over_arrays(d.actuator) if d.actuator and d.mode and d.mode.spring else None for d in drives]
        self._totals = np.zeros((4, len(self.drives)))
        self._start: Array | None = None
        self.turnover = np.zeros(len(self.drives))
        """J: energy that went through each joint, the scale of a residual."""
        self.given = np.zeros(len(self.drives))
        """J: work of actuators and external torques on the links, less what their damping took, up to the last row."""

    @staticmethod
    def quantities(drive: Drive) -> tuple[str, ...]:
        """What a joint has of it."""
        if drive.mode is None:
            return ()
        names = ["motor_work", "link_work"]
        if drive.mode.spring:
            names += ["spring_energy"]
        if drive.dynamic_motors:
            names += ["friction_loss", "energy_residual"]
        if drive.joint.damping or drive.link_damping:
            names += ["damping_loss"]
        return tuple(names)

    def add(
        self, raw: Array, columns: dict[str, Array], damping: Array, *, clipped: Array, external: Array
    ) -> dict[str, Array]:
        """Energies at the rows of `columns` (n, joints); raw (n + 1, joints, columns) has one row more."""
        n, joints = clipped.shape
        q = raw[:, :, 0]
        speed = raw[1:, :, 1]
        # Between rows: torque of both ends, motion exactly.
        torque = np.concatenate([clipped, raw[n:, :, 2]])
        link = 0.5 * (torque[:-1] + torque[1:]) * np.diff(q, axis=0)
        dissipated = damping * speed * speed * self.substep
        pushed_in = 0.5 * (external[:-1] + external[1:]) * np.diff(q, axis=0)
        self.given += (link + pushed_in - dissipated).sum(axis=0)
        work = link.copy()
        lost = np.zeros((n, joints))
        stored = np.zeros((n, joints))
        kinetic = np.zeros((n, joints))
        for j, drive in enumerate(self.drives):
            law = self._laws[j]
            if law is None:
                continue
            theta = raw[:, j, 5], raw[:, j, 9]
            energy = law(q[:, j], *theta, drive.elastic)
            stored[:, j] = energy[:-1]
            if not drive.dynamic_motors:
                # Ideal motors may jump: their work is what the energy changes by as they move at the link's mean position.
                middle = 0.5 * (q[:-1, j] + q[1:, j])
                work[:, j] = law(middle, theta[0][1:], theta[1][1:], drive.elastic) - law(
                    middle, theta[0][:-1], theta[1][:-1], drive.elastic
                )
                continue
            work[:, j] = 0.0
            if drive.actuator is not None and drive.actuator.adjuster:
                middle, motor = 0.5 * (q[:-1, j] + q[1:, j]), 0.5 * (theta[0][:-1] + theta[0][1:])
                work[:, j] += law(middle, motor, theta[1][1:], drive.elastic) - law(middle, motor, theta[1][:-1], drive.elastic)
            for i, base in zip(range(1, drive.dynamic_motors + 1), (5, 9), strict=False):
                moved = np.diff(raw[:, j, base])
                pushed, rubbed, fast = raw[:, j, base + 2], raw[:, j, base + 3], raw[:, j, base + 1]
                mean_speed = moved / self.substep
                work[:, j] += 0.5 * (pushed[:-1] + pushed[1:]) * moved
                drag = drive.values[f"motor_{i}_damping"] * mean_speed * mean_speed * self.substep
                lost[:, j] += 0.5 * (rubbed[:-1] + rubbed[1:]) * moved + drag
                kinetic[:, j] += 0.5 * drive.values[f"motor_{i}_inertia"] * fast[:-1] ** 2
        flows = np.stack([work, lost, dissipated, link])
        running = self._totals[:, None, :] + np.concatenate([np.zeros((4, 1, joints)), np.cumsum(flows, axis=1)], axis=1)
        self._totals = running[:, -1]
        self.turnover += np.nansum(np.abs(work), axis=0) + np.nansum(np.abs(link) + np.abs(pushed_in), axis=0)
        at = running[:, :-1]
        if self._start is None:
            self._start = stored[0] + kinetic[0]
        return {
            "motor_work": at[0],
            "friction_loss": at[1],
            "damping_loss": at[2],
            "link_work": at[3],
            "spring_energy": stored,
            "energy_residual": at[0] - at[1] - at[3] - (stored + kinetic - self._start),
        }
