"""What an environment sees of a simulation, quantity by quantity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.samples import Array
from asrsim.simulation.groups import spring_groups
from asrsim.simulation.recorder import COLUMN, recorded_quantities
from asrsim.simulation.simulation import Simulation

Row: TypeAlias = "tuple[Array, Array]"
"""As :attr:`asrsim.simulation.simulation.Simulation.row`."""
_STATES = (
    "link_position", "link_velocity", "motor_1_position", "motor_1_velocity", "motor_2_position", "motor_2_velocity",
)  # fmt: skip
"""State at the present time; of ideal motors, positions of the last substep."""
_RECORD = {
    "link_torque": "link_torque", "damping_torque": "damping_torque", "elastic_torque_1": "torque_1",
    "elastic_torque_2": "torque_2", "motor_1_torque": "drive_1", "motor_2_torque": "drive_2",
    "friction_torque_1": "friction_1", "friction_torque_2": "friction_2",
}  # fmt: skip
"""Quantity -> column of the raw record: means over the last substep; at the start of an episode, over the first."""
_INPUTS = ("reference_1", "reference_2", "external_torque")
TIP = "tip"
KNOWN = (*_STATES, *_RECORD, *_INPUTS, "stiffness", TIP)


class Readings:
    """Reads quantities of the joints that have them."""

    def __init__(self, simulation: Simulation, names: Sequence[str], tip: tuple[str, Sequence[float]] | None) -> None:
        self._simulation = simulation
        self._tip = tip
        self._seen: tuple[list[float], list[float]] | None = None
        self._first: Row | None = None
        drives = simulation.prepared.drives
        recorded = [recorded_quantities(drive) for drive in drives]
        problems = []
        self._readers: dict[str, Callable[[], Array]] = {}
        for name in names:
            joints = [j for j, own in enumerate(recorded) if name in own]
            if name not in KNOWN or (name == TIP and tip is None) or not (joints or name == TIP):
                why = "is what no joint has in its mode" if name in KNOWN else "cannot be observed here"
                why = "needs the argument tip" if name == TIP else why
                hint = None if name in KNOWN else did_you_mean(name, KNOWN)
                problems.append(Problem(f"'{name}' {why}", choices=KNOWN, hint=hint, code="unknown-quantity"))
                continue
            self._readers[name] = self._reader(name, np.array(joints), everyone=len(joints) == len(drives))
        if tip is not None and simulation.engine.model is None:
            problems.append(Problem("the engine has no model that knows where a tip is", code="no-model"))
        elif tip is not None and simulation.engine.model is not None and tip[0] not in simulation.engine.model.links:
            links = simulation.engine.model.links
            problems.append(Problem(f"no link is called '{tip[0]}'", choices=links, code="unknown-link"))
        if tip is not None and not _is_point(tip[1]):
            problems.append(Problem("a tip's point is three finite numbers, in m", value=tip[1], code="tip"))
        if not names:
            problems.append(Problem("nothing is observed", choices=KNOWN, code="no-quantity"))
        if problems:
            raise InputError(problems)
        self.size = sum(len(values) for values in self.read().values())
        """Numbers in all."""

    def read(self) -> dict[str, Array]:
        """Quantity -> (n,), SI."""
        self._seen = self._first = None
        return {name: reader() for name, reader in self._readers.items()}

    def _reader(self, name: str, joints: Array, *, everyone: bool) -> Callable[[], Array]:
        pick = slice(None) if everyone else joints
        if name in ("link_position", "link_velocity"):
            place = 0 if name == "link_position" else 1
            return lambda: np.array(self._links()[place])[pick]
        if name == TIP:
            return self._tip_position
        if name == "stiffness":
            return lambda: self._stiffness()[pick]
        if name in _INPUTS:
            slot = _INPUTS.index(name)
            return lambda: self._row()[1][slot][pick]
        if name in _RECORD:
            column = COLUMN[_RECORD[name]]
            return lambda: self._row()[0][pick, column]
        return lambda: self._motor(name)[pick]

    def _links(self) -> tuple[list[float], list[float]]:
        if self._seen is None:
            self._seen = self._simulation.loop.joint_states()
        return self._seen

    def _row(self) -> Row:
        """Of the last substep; at the start of an episode of the first one, which is taken back."""
        simulation = self._simulation
        row = simulation.row or self._first
        if row is None:
            start = simulation.snapshot()
            simulation.advance_to(1)
            row = self._first = simulation.row
            simulation.restore(start)
        if row is None:
            raise RuntimeError("a substep leaves its record")
        return row

    def _motor(self, name: str) -> Array:
        values = np.array(getattr(self._simulation.observe(), name))
        ideal = np.isnan(values)
        if ideal.any():
            column = COLUMN[f"position_{name[6]}"]
            values[ideal] = 0.0 if name.endswith("velocity") else self._row()[0][ideal, column]
        return values

    def _stiffness(self) -> Array:
        drives = self._simulation.prepared.drives
        found = np.zeros(len(drives))
        table = self._row()[0]
        places = (COLUMN["link_position"], COLUMN["position_1"], COLUMN["position_2"])
        for group in spring_groups(drives):
            law = over_arrays(group.actuator.stiffness)
            found[group.pick] = law(*(table[group.pick, place, None] for place in places), group.elastic)[:, 0]
        return found

    def _tip_position(self) -> Array:
        model, tip = self._simulation.engine.model, self._tip
        if model is None or tip is None:
            raise RuntimeError("the tip was checked before")
        x, y, z = tip[1]
        return np.asarray(model.link_point(tip[0], (x, y, z), self._links()[0])[0], dtype=float)


def _is_point(values: Any) -> bool:
    """Whether these are three finite numbers."""
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return False
    return found.shape == (3,) and bool(np.isfinite(found).all())
