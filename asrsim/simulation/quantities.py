"""Quantities that a joint records, and the columns of these quantities in the table S of states and in the rows of inputs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.stages import STAGES
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.records import declared
from asrsim.samples import Array
from asrsim.simulation.drives import EXTERNAL_TORQUE, SteppedJoint
from asrsim.simulation.fields import JOINT, JointState, MotorState, motor_column
from asrsim.simulation.laws import motor_of
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.simulation.shape import RowShape

LOGGED = {path: one["log"] for path, one in declared(JointState).items() if one["log"]}
"""Name in logs of each number of a joint's state that is logged."""
LOGGED_OF_MOTORS = {path: one["log"] for path, one in declared(MotorState).items() if one["log"]}
"""Name in logs of each number of a motor's state that is logged; {} stands for the number of the motor."""
_WATCHED = frozenset(one["log"] for one in declared(JointState).values() if one["watched"])


def is_watched(name: str) -> bool:
    """Whether a quantity is computed only for watched worlds: an energy, or the stiffness of springs."""
    return name in _WATCHED or any(name == stage.lost for stage in STAGES.loaded())


def simulated_quantities(motors: int) -> tuple[str, ...]:
    """Names of all quantities of links, motors and stages that a joint with this number of motors may have."""
    of_stages = [one for stage in STAGES.loaded() for one in declared(stage.Memory).values()]
    each = [*LOGGED_OF_MOTORS.values(), *(one["log"] for one in of_stages if one["log"])]
    names = [*LOGGED.values(), *(name.format(i) for i in range(1, motors + 1) for name in each)]
    return (*names, *(stage.lost for stage in STAGES.loaded() if stage.lost))


class StatePlace(NamedTuple):
    """Place of a number in a joint's state."""

    column: int
    """Column of S."""
    owner: Callable[[JointState], Any]
    """Function that finds the record with this number. The record is the joint itself, or a motor or a stage of the joint."""
    path: str
    """Name of the number in this record."""


def columns_of(shape: RowShape) -> dict[str, StatePlace]:
    """Place of each quantity."""
    found = {name: StatePlace(JOINT[path], _itself, path) for path, name in LOGGED.items()}
    for i in range(shape.motors):
        owner = partial(motor_of, i=i)
        found |= {name.format(i + 1): StatePlace(motor_column(path, i), owner, path) for path, name in LOGGED_OF_MOTORS.items()}
    for index, stage in enumerate(shape.kept):
        first, names = shape.place(stage), {path: one["log"] for path, one in declared(stage.Memory).items()}
        if stage.lost:
            found[stage.lost] = StatePlace(first, partial(_stage_of, index=index), "loss")
        for i in range(shape.motors):
            owner, begin = partial(_memory_of, index=index, i=i), first + 1 + i * len(names)
            places = enumerate(names.items(), start=begin)
            found |= {name.format(i + 1): StatePlace(column, owner, path) for column, (path, name) in places if name}
    return found


def _itself(joint: JointState) -> JointState:
    return joint


def _stage_of(joint: JointState, index: int) -> Any:
    return joint.stages[index]


def _memory_of(joint: JointState, index: int, i: int) -> Any:
    return joint.stages[index].motors[i]


def reader_of(places: Sequence[StatePlace]) -> Callable[[JointState], list[float]]:
    """Function that reads the numbers at these places from a joint's state."""
    parts = [(owner, _getter([place.path for place in own])) for owner, own in groupby(places, key=attrgetter("owner"))]

    def read(joint: JointState) -> list[float]:
        found: list[float] = []
        for owner, get in parts:
            found += get(owner(joint))
        return found

    return read


def _getter(names: Sequence[str]) -> Callable[[Any], Iterable[float]]:
    """Function that returns attributes of an object."""
    get: Callable[[Any], Any] = attrgetter(*names)
    return get if len(names) > 1 else lambda owner: (get(owner),)


def inputs_of(motors: int) -> dict[str, int]:
    """Column of an input row for each quantity."""
    references = {f"reference_{i + 1}": GOALS + i for i in range(motors)}
    sent = {f"sent_{name}": column + motors for name, column in references.items()}
    return {EXTERNAL_TORQUE: EXTERNAL, **references, **sent}


def recorded_quantities(drive: SteppedJoint) -> tuple[str, ...]:
    """Names of the quantities that this joint records."""
    names = ["link_position", "link_velocity", "link_torque", EXTERNAL_TORQUE]
    damped = bool(drive.joint.damping or drive.link_damping)
    if damped:
        names.append("damping_torque")
    if drive.drive is None:
        return tuple(names)
    sprung = drive.drive.mode.spring
    references = [f"reference_{i}" for i in range(1, len(drive.acting_references) + 1)]
    names += [*references, *(f"sent_{name}" for name in references if drive.command_imperfections)]
    if sprung:
        names += [f"elastic_torque_{i}" for i in range(1, drive.motors + 1)] + ["stiffness"]
        names += [f"motor_{i}_position" for i in range(1, drive.placed + 1)]
    for i in range(1, drive.dynamic_motors + 1):
        names += [f"motor_{i}_velocity", f"motor_{i}_torque", f"friction_torque_{i}"]
    names += [f"motor_{i}_{what}" for i in drive.electric_motors for what in ("voltage", "current")]
    names += ["motor_work", "link_work"]
    if sprung:
        names += ["spring_energy", "energy_residual"]
        names += ["limit_loss"] if drive.joint.effort is not None else []
    names += ["friction_loss"] if drive.dynamic_motors else []
    names += ["winding_loss"] if any(drive.values[f"motor_{i}_resistance"] for i in drive.electric_motors) else []
    for stage in drive.stages:
        names += [stage.lost] if stage.lost else []
        acting = [i for i in range(1, drive.motors + 1) if drive.stage_constants(stage, i) is not None]
        names += [one["log"].format(i) for one in declared(stage.Memory).values() if one["log"] for i in acting]
    names += ["damping_loss"] if damped else []
    return tuple(names)


def all_recorded(drives: Sequence[SteppedJoint]) -> tuple[str, ...]:
    """Quantities that any joint records."""
    return tuple(dict.fromkeys(name for drive in drives for name in recorded_quantities(drive)))


def _picker(columns: Sequence[int]) -> Callable[[Sequence[float]], Sequence[float]]:
    """Function that returns the entries of a row in these columns."""
    return itemgetter(*columns) if len(columns) > 1 else lambda row: [row[column] for column in columns]


def require_recorded(names: Sequence[str], columns: Collection[str], choices: tuple[str, ...]) -> None:
    """Raise InputError for names of quantities without a column. choices: valid names, which the message states."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError("must be a list of quantities", key="names", value=names, choices=choices, code="not-a-list")
    problems = [
        Problem(f"no joint records '{name}'", choices=choices, hint=did_you_mean(name, choices), code="unknown-quantity")
        for name in names
        if name not in columns
    ]
    if problems:
        raise InputError(problems)


def without_energies(drives: Sequence[SteppedJoint], names: Sequence[str] | None) -> tuple[str, ...]:
    """The names of quantities; by default, all quantities that the joints record, except energies. Raises InputError for names
    of energies.
    """
    possible = tuple(name for name in all_recorded(drives) if name == LOGGED["stiffness"] or not is_watched(name))
    require_recorded(possible if names is None else names, possible, possible)
    return possible if names is None else tuple(names)


class RowColumns:
    """Columns of a recorded row: quantities of the state, then quantities of the inputs."""

    def __init__(self, drives: Sequence[SteppedJoint], shape: RowShape, names: Sequence[str] | None = None) -> None:
        """shape: sizes of the rows of joints. names: recorded quantities; None: all quantities that any joint records."""
        known = all_recorded(drives)
        of_state, of_inputs = columns_of(shape), inputs_of(shape.motors)
        self.names = known if names is None else tuple(names)
        """Recorded quantities."""
        require_recorded(self.names, of_state.keys() | of_inputs.keys(), known)
        first, second = ([name for name in self.names if name in table] for table in (of_state, of_inputs))
        # Sort the names by their columns, so that neighbouring numbers of a record are read together.
        first.sort(key=lambda name: of_state[name].column)
        self.of_state: NDArray[np.int64] = np.array([of_state[name].column for name in first], dtype=np.int64)
        """Columns of S that are recorded."""
        self.read_state = reader_of([of_state[name] for name in first])
        """Function that returns the numbers in these columns from a joint's state."""
        self.of_inputs: NDArray[np.int64] = np.array([of_inputs[name] for name in second], dtype=np.int64)
        """Columns of the references that are recorded."""
        self.read_inputs = _picker(self.of_inputs.tolist())
        """Function that returns the numbers in these columns from a row of references."""
        self.place = {name: place for place, name in enumerate((*first, *second))}
        """Column of each quantity in a recorded row."""

    def absent(self, drives: Sequence[SteppedJoint]) -> NDArray[np.bool_]:
        """Mask (joints, columns) of the quantities that the joints do not record."""
        recorded = [recorded_quantities(drive) for drive in drives]
        mask = [[name not in own for name in self.place] for own in recorded]
        return np.array(mask, dtype=bool)

    def check(self, names: Sequence[str]) -> None:
        """Raise InputError for names that are not recorded."""
        require_recorded(names, self.place, self.names)

    def values(self, rows: Array, names: Sequence[str] | None = None) -> dict[str, Array]:
        """Views of rows (..., columns), by quantity."""
        return {name: rows[..., self.place[name]] for name in (self.names if names is None else names)}
