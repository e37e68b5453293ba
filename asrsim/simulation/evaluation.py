"""The same run again and again with other numbers, for chosen channels only: what identification and tuning evaluate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators.vectorised import equilibrium_over_arrays
from asrsim.engines.base import Engine
from asrsim.errors import DivergenceError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.simulation.divergence import not_finite
from asrsim.simulation.groups import spring_groups
from asrsim.simulation.inputs import Inputs
from asrsim.simulation.prepared import Prepared, make_engine
from asrsim.simulation.recorder import COLUMN, DIRECT
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.stretches import NoValueError

OFTEN = 10**7
"""Substeps that evaluations of one scenario come to at least: compiling pays."""
EXTERNAL = "external_torque"
"""Among a joint's references: the torque on its link."""
ELECTRIC = {f"motor_{i}_{what}": i for i in (1, 2) for what in ("voltage", "current")}
"""Quantity of an electric motor -> the motor's number."""
DERIVED = ("link_velocity", "equilibrium_position", "deflection", *ELECTRIC)


class Evaluation(Simulation):
    """A prepared scenario that is run from its start under other parameters, states and references; nothing is recorded.

    Substeps stay as they were chosen, so that results are smooth in the parameters.
    """

    def __init__(self, prepared: Prepared, *, compiled: bool | None = None) -> None:
        super().__init__(prepared, compiled=compiled, expected_substeps=OFTEN)
        self.home = prepared
        self._signals: Mapping[str, Mapping[str, Signal]] = {}

    @property
    def steps(self) -> int:
        """Steps of a whole run; a channel has one sample more."""
        return self.scenario.steps

    def run(
        self,
        parameters: Mapping[str, Mapping[str, float]],
        channels: Sequence[tuple[int, str]],
        *,
        steps: int | None = None,
        references: Mapping[str, Mapping[str, Signal]] | None = None,
        positions: Sequence[float] | None = None,
        velocities: Sequence[float] | None = None,
        motors: Mapping[str, Sequence[float]] | None = None,
    ) -> Array:
        """Channels (joint's number, quantity) at whole steps from 0 on, (channels, steps + 1).

        parameters: as :meth:`Prepared.vary` takes them, differences from the scenario; references: joint -> name -> signal
        without jumps; positions, velocities: of the links at the start; motors: joint -> positions of its motors there.
        Raises RobotError for unphysical numbers, DivergenceError where the motion is no longer sane.
        """
        varied = self.home.vary(parameters) if parameters else self.home
        if positions is not None or motors:
            varied = _started(varied, positions or varied.initial_positions, motors or {})
        self.substep = 0
        self._take_over(varied)
        self.engine.set_state(varied.initial_positions, velocities or varied.initial_velocities)
        self.loop.reset()
        self.loop.refresh_response(0)
        count = (self.steps if steps is None else min(steps, self.steps)) * self.substeps + 2
        if self._first is None or len(self._first) < count or (references is not None and references is not self._signals):
            self._renew_inputs(references or {}, self.steps * self.substeps + 2)
        assert self._first is not None  # it was made just now
        try:
            raw = self.loop.run(self._first, 0, count, self.recording.room(count))
        except NoValueError as fault:
            raise DivergenceError(str(fault), joint=fault.joint, time=fault.substep * self.prepared.substep) from fault
        bad = not_finite(raw)
        if bad is not None:
            time = bad * self.prepared.substep
            message = f"the motion is no longer finite or sane at {time:.4g} s"
            raise DivergenceError(message, joint=self.joints[0], time=time)
        return np.stack([self._channel(raw, joint, quantity) for joint, quantity in channels])

    def engine_of(self, robot: Robot) -> Engine:
        """The engine with other inertials: for its model; runs take their own again."""
        if not self.engine.vary(robot):
            self.engine.close()
            self.engine = make_engine(self.home.scenario, robot)[0]
        return self.engine

    def _renew_inputs(self, references: Mapping[str, Mapping[str, Signal]], count: int) -> None:
        own = {joint: {k: v for k, v in table.items() if k != EXTERNAL} for joint, table in references.items()}
        torques = {joint: table[EXTERNAL] for joint, table in references.items() if EXTERNAL in table}
        prepared = self.home.with_references(own) if own else self.home
        if torques:
            torques = {**prepared.scenario.external_torques, **torques}
            prepared = replace(prepared, scenario=replace(prepared.scenario, external_torques=torques))
        self._inputs = Inputs(
            prepared.scenario, prepared.drives, substep=prepared.substep, staggered=prepared.stepping.staggered,
            sensors=prepared.sensors,
        )  # fmt: skip
        self._signals = references
        self._first = self._inputs.block(0, count)

    def _channel(self, raw: Array, joint: int, quantity: str) -> Array:
        """(steps + 1,) of one quantity from the raw record (n, joints, columns)."""
        every = slice(0, len(raw) - 1, self.substeps)
        if quantity in DIRECT:
            return np.asarray(raw[every, joint, COLUMN[DIRECT[quantity]]])
        if quantity == "link_velocity":
            speeds = raw[:, joint, COLUMN["engine_velocity"]]
            if not self.prepared.stepping.staggered:
                return np.asarray(speeds[every])
            # Velocities live between the steps.
            centred = 0.5 * (speeds[:-1] + speeds[1:])
            centred[0] = speeds[0]
            return np.asarray(centred[:: self.substeps])
        if quantity in ELECTRIC:
            return self._electric(raw[every, joint], joint, quantity)
        motors = [raw[every, joint, COLUMN[f"position_{i}"]] for i in (1, 2)]
        actuator = self.prepared.drives[joint].actuator
        position = motors[0] if actuator is None else equilibrium_over_arrays(actuator)(*motors)
        return np.asarray(position - raw[every, joint, COLUMN["link_position"]] if quantity == "deflection" else position)

    def _electric(self, raw: Array, joint: int, quantity: str) -> Array:
        """(steps + 1,) A or V of raw rows (steps + 1, columns); NaN where the motor is not electric."""
        drive = self.prepared.drives[joint]
        if ELECTRIC[quantity] not in drive.electric_motors:
            return np.full(len(raw), np.nan)
        (group,) = spring_groups([drive])
        return np.asarray(group.electricity(raw.T[:, None])[quantity][0])


def _started(prepared: Prepared, positions: Sequence[float], motors: Mapping[str, Sequence[float]]) -> Prepared:
    """The same, begun at other positions of links and motors; motors that are not named begin where their link is."""
    drives = list(prepared.drives)
    for j, (drive, q) in enumerate(zip(prepared.drives, positions, strict=True)):
        if drive.initial_position != q or drive.name in motors:
            motor_positions = tuple(motors.get(drive.name, ())) or drive.motor_positions
            drives[j] = replace(drive, initial_position=float(q), motor_positions=motor_positions)
    return replace(prepared, drives=tuple(drives), initial_positions=tuple(map(float, positions)))
