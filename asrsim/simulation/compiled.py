"""The compiled loop: the same laws through Numba, with equal bits. Never needed; chosen when it pays.

All joints of a substep are advanced in one call of a kernel that :mod:`asrsim.simulation.compiler` puts together.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.simulation.compiler import COLUMN, WORK, build_kernel, flatten
from asrsim.simulation.inputs import Block
from asrsim.simulation.loop import Loop


class CompiledLoop(Loop):
    """The loop with one compiled call a substep; raises SimulationError where an actuator cannot be compiled."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if self.before_step or any(self._laws):
            raise SimulationError("sensors, wrenches, contacts and stiffness-dependent damping need the plain loop")
        constants = self.constants(self.substep / self.motor_substeps)
        flat = [flatten(values) for values in constants]
        self._work = np.zeros((len(self.drives), len(WORK) + max(map(len, flat))))
        for j, values in enumerate(flat):
            self._work[j, len(WORK) : len(WORK) + len(values)] = values
        self._kernel = build_kernel(self.drives, constants, self.motor_substeps, now=self._now, before=self._before)

    def _smooth(self, block: Block, start: int, end: int, rows: Array) -> None:
        work, step = self._work, self._kernel.step
        read, apply, advance_engine = self.engine.read, self.engine.apply, self.engine.advance
        every, first = self._correct_every, block.first
        inputs = block.stacked
        self._push()
        for k in range(start, end):
            joints = read()
            if every and not (first + k) % every:
                self._correct(joints)
            apply(forces=step(k, joints, work, inputs, rows))
            advance_engine()
        self._pull()

    def _correct(self, joints: Any) -> None:
        """The Coriolis correction, in the workspace."""
        kernel, work = self._kernel, self._work
        if self._bias_difference is None:
            self.previous[:] = work[:, COLUMN["previous"]].tolist()
            self._correct_coriolis(joints)
            work[:, COLUMN["correction"]] = self.correction
            work[:, COLUMN["difference"]] = self._bias_difference
        else:
            difference = self.engine.bias_difference(*kernel.look(joints, work))
            kernel.hold(tuple(difference or ()), self._ahead, work)

    def _push(self) -> None:
        """The loop's lists into the workspace."""
        work = self._work
        if self._bias_difference is not None:
            work[:, COLUMN["difference"]] = self._bias_difference
        for name, values in (
            ("previous", self.previous),
            ("last_torque", self.last_torque),
            ("last_mean", self.last_mean),
            ("effort", self._efforts),
            ("damping", self._dampings),
            ("brake", self._brakes),
            ("response", self.response),
            ("lean", self.lean),
            ("correction", self.correction),
        ):
            work[:, COLUMN[name]] = values
        for j, state in enumerate(self.states):
            work[j, COLUMN["state_0"] : COLUMN["state_0"] + len(state)] = state

    def _pull(self) -> None:
        """The workspace back into the loop's lists."""
        work = self._work
        for name, values in (
            ("previous", self.previous),
            ("last_torque", self.last_torque),
            ("last_mean", self.last_mean),
            ("correction", self.correction),
        ):
            values[:] = work[:, COLUMN[name]].tolist()
        if self._bias_difference is not None:
            self._bias_difference = work[:, COLUMN["difference"]].tolist()
        for j, state in enumerate(self.states):
            self.states[j] = tuple(work[j, COLUMN["state_0"] : COLUMN["state_0"] + len(state)].tolist())
