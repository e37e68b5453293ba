"""Sizes of the rows of joints in the tables S and P, and the columns at which the parts of a row with variable length begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.stages import Stage
from asrsim.records import columns
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.fields import JointConstants, JointState, MotorState, columns_of_stages
from asrsim.simulation.layout import GOALS


@dataclass(frozen=True)
class RowShape:
    """Sizes of the parts of a row in S and P whose length depends on the robot. These sizes are equal for all joints of a
    robot."""

    motors: int
    """Number of motors in every row."""
    ring: int
    """Number of values in the memory of one sensor."""
    stages: tuple[tuple[type[Stage], ...], ...]
    """Stages of each joint, in the order of their columns."""
    kept: tuple[type[Stage], ...]
    """Stages whose state is in every row."""
    constants: int
    """Number of columns of P."""

    @property
    def memory(self) -> int:
        """Column of S at which the memory of the sensors begins."""
        return len(columns(JointState)) + self.motors * len(columns(MotorState))

    @property
    def sensors(self) -> int:
        """Number of values in the memory of the sensors."""
        return self.motors * self.ring

    def place(self, stage: type[Stage] | None) -> int:
        """Column of S at which the state of a stage begins; for None, the column at which the states of all stages end."""
        column = self.memory + self.sensors
        for one in self.kept:
            if one is stage:
                break
            column += 1 + self.motors * len(columns(one.Memory))
        return column

    @property
    def state(self) -> int:
        """Number of columns of S."""
        return self.place(None)

    @property
    def law(self) -> int:
        """Column of P at which the parameters of the spring's law begin."""
        return len(columns(JointConstants)) + self.motors * len(columns(MotorConstants))

    @property
    def goals(self) -> int:
        """Number of columns of an input row, without the columns of sensors."""
        return GOALS + self.motors


def shape_of(drives: Sequence[SteppedJoint], before: RowShape | None = None) -> RowShape:
    """Sizes of the rows that these joints need. before: sizes of the rows of joints with other parameters. The columns of these
    rows keep their places.
    """
    stages = [drive.stages for drive in drives]
    kept = tuple(dict.fromkeys(stage for own in stages for stage in own))
    if before is not None:
        stages = [tuple(dict.fromkeys((*old, *own))) for old, own in zip(before.stages, stages, strict=True)]
        kept = tuple(dict.fromkeys((*before.kept, *kept)))
    ring = max((2 * drive.sensor.memory + 3 for drive in drives if drive.sensor), default=0)
    shape = RowShape(
        motors=max(drive.positions for drive in drives),
        # Keep the earlier size of the ring. With the new parameters the delay of a sensor may be shorter, but the columns must
        # not move.
        ring=ring if before is None else before.ring,
        stages=tuple(stages),
        kept=kept,
        constants=0,
    )
    sizes = (len(drive.elastic) + columns_of_stages(own, drive.motors) for drive, own in zip(drives, stages, strict=True))
    return replace(shape, constants=shape.law + max(sizes))
