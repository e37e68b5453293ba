"""Quantities that a joint records, and their columns in the tables."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.base import MOST_MOTORS
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint, references_of
from asrsim.simulation.layout import EXTERNAL, FIRST_MOTOR, GOALS, LINK_WORK, LOGGED, LOGGED_OF_MOTORS, PER_MOTOR

EXTERNAL_TORQUE = "external_torque"
"""Name under which callers set the external torque on a link, like a reference."""
WATCHED = frozenset(name for column, name in LOGGED.items() if column >= LINK_WORK)
"""Quantities that are computed only for watched worlds: energies, and the stiffness of springs."""


def columns_of(motors: int) -> dict[str, int]:
    """Column of S for each quantity, in rows with this number of motor blocks."""
    found = {name: column for column, name in LOGGED.items()}
    for i in range(motors):
        found |= {name.format(i + 1): FIRST_MOTOR + i * PER_MOTOR + column for column, name in LOGGED_OF_MOTORS.items()}
    return found


def inputs_of(motors: int) -> dict[str, int]:
    """Column of an input row for each quantity."""
    return {EXTERNAL_TORQUE: EXTERNAL, **{f"reference_{i + 1}": GOALS + i for i in range(motors)}}


def recorded_quantities(drive: SteppedJoint) -> tuple[str, ...]:
    """Names of the quantities that this joint records."""
    names = ["link_position", "link_velocity", "link_torque", EXTERNAL_TORQUE]
    mode, actuator = drive.mode, drive.actuator
    damped = bool(drive.joint.damping or drive.link_damping)
    if damped:
        names.append("damping_torque")
    if mode is None or actuator is None:
        return tuple(names)
    # A series elastic actuator has one reference in every mode.
    references = len(references_of(drive)) if actuator.motors + actuator.adjuster > 1 else 1
    names += [f"reference_{i}" for i in range(1, references + 1)]
    if mode.spring:
        names += [f"elastic_torque_{i}" for i in range(1, actuator.motors + 1)] + ["stiffness"]
        names += [f"motor_{i}_position" for i in range(1, actuator.motors + actuator.adjuster + 1)]
    for i in range(1, drive.dynamic_motors + 1):
        names += [f"motor_{i}_velocity", f"motor_{i}_torque", f"friction_torque_{i}"]
    names += [f"motor_{i}_{what}" for i in drive.electric_motors for what in ("voltage", "current")]
    names += ["motor_work", "link_work"]
    if mode.spring:
        names += ["spring_energy", "energy_residual"]
        names += ["limit_loss"] if drive.joint.effort is not None else []
    names += ["friction_loss"] if drive.dynamic_motors else []
    names += ["winding_loss"] if any(drive.values[f"motor_{i}_resistance"] for i in drive.electric_motors) else []
    names += ["hysteresis_loss"] if drive.hysteresis is not None else []
    names += ["damping_loss"] if damped else []
    return tuple(names)


def unknown_quantity(name: str, choices: Sequence[str]) -> Problem:
    """Problem for the name of a quantity that no joint records."""
    hint = did_you_mean(name, choices)
    return Problem(f"no joint records '{name}'", choices=tuple(choices), hint=hint, code="unknown-quantity")


class QuantitySelection:
    """Quantities of several joints, taken from rows of the state and from inputs."""

    def __init__(self, drives: Sequence[SteppedJoint], motors: int, names: Sequence[str] | None = None) -> None:
        """motors: number of motor blocks in a row. names: selected quantities; None: all quantities that any joint records."""
        recorded = [recorded_quantities(drive) for drive in drives]
        places, given = columns_of(motors), inputs_of(motors)
        known = dict.fromkeys(name for own in recorded for name in own)
        possible = columns_of(MOST_MOTORS) | inputs_of(MOST_MOTORS)
        problems = [unknown_quantity(name, tuple(known)) for name in names or () if name not in possible]
        if problems:
            raise InputError(problems)
        self.names = tuple(known) if names is None else tuple(name for name in names if name in places or name in given)
        stated = [name for name in self.names if name in places]
        self.columns: NDArray[np.int64] = np.array([places[name] for name in stated], dtype=np.int64)
        """Selected columns of S."""
        self._stated = {name: place for place, name in enumerate(stated)}
        self._given = {name: given[name] for name in self.names if name in given}
        self._find_absent(recorded)

    def _find_absent(self, recorded: Sequence[Sequence[str]]) -> None:
        """Find the joints that do not record all quantities. recorded: quantities that each joint records."""
        self.lacking = {name: [j for j, own in enumerate(recorded) if name not in own] for name in self.names}
        """Numbers of the joints that do not record a quantity, by quantity."""
        absent = [(j, column) for name, column in self._stated.items() for j in self.lacking[name]]
        self._absent = np.array(absent, dtype=np.int64).reshape(-1, 2).T
        """Cells of a row that hold no recorded quantity, shape (2, n): numbers of the joints, then of the columns."""

    def of(self, drives: Sequence[SteppedJoint]) -> QuantitySelection:
        """This selection for joints with other parameters; such joints may record other quantities."""
        other = copy.copy(self)
        other._find_absent([recorded_quantities(drive) for drive in drives])
        return other

    def check(self, names: Sequence[str]) -> None:
        """Raise InputError for names that are not selected."""
        problems = [unknown_quantity(name, self.names) for name in names if name not in self.names]
        if problems:
            raise InputError(problems)

    def values(self, out: Array, references: Array, names: Sequence[str] | None = None) -> dict[str, Array]:
        """Quantities (rows, joints) by name, all or only the named quantities; NaN where a joint does not record a quantity.
        The arrays may be views of `out` (rows, joints, columns) and `references` (input columns, joints, rows)."""
        wanted = self.names if names is None else names
        if any(self.lacking[name] for name in wanted):
            joints, columns = self._absent
            out = out.copy()
            out[:, joints, columns] = np.nan
        return {name: self._values_of(name, out, references) for name in wanted}

    def _values_of(self, name: str, out: Array, references: Array) -> Array:
        if name in self._stated:
            return out[:, :, self._stated[name]]
        given: Array = references[self._given[name]].T
        if self.lacking[name]:
            given = given.copy()
            given[:, self.lacking[name]] = np.nan
        return given
