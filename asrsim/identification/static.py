"""Springs on a bench, whose links and motors stand where they are put: torques are laws of these places alone."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.identification.data import Data
from asrsim.identification.track import Track
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal

TORQUES = ("elastic_torque_1", "elastic_torque_2")


def is_static(track: Track, free: Collection[str]) -> bool:
    """Whether only springs without hysteresis, which may be free, are compared, on a bench, in modes whose motors have no
    dynamics.
    """
    drives = {drive.name: drive for drive in track.prepared.drives}
    return track.scenario.engine == "bench" and all(
        channel.quantity in TORQUES
        and (drive := drives[channel.joint]).actuator is not None
        and not drive.dynamic_motors
        and not drive.hysteresis
        and f"{channel.joint}.hysteresis_torque" not in free
        for channel in track.channels
    )


class StaticTrack(Track):
    """A recording of springs on a bench: simulated once for its places, on which the laws are evaluated as arrays."""

    def __init__(self, scenario: Scenario, robot: Robot, data: Data) -> None:
        super().__init__(scenario, robot, data)
        self._places: tuple[object, Array] | None = None

    def resolve(self, substeps: int, motor_substeps: int) -> None:
        """Places do not depend on steps."""

    def simulated(
        self, robot: Mapping[str, Mapping[str, float]], positions: Sequence[float], velocities: Sequence[float],
        references: Mapping[str, Mapping[str, Signal]], steps: int | None,
    ) -> Array:  # fmt: skip
        """As :meth:`Track.simulated`."""
        if self._places is None or self._places[0] is not references:
            joints = list(dict.fromkeys(j for j, _ in self.wanted))
            names = ("link_position", "motor_1_position", "motor_2_position")
            wanted = [(j, name) for j in joints for name in names]
            found = self.evaluation.run({}, wanted, references=references, motors=self.motors)
            table = np.zeros((len(self.evaluation.joints), 3, found.shape[1]))
            for (j, name), series in zip(wanted, found, strict=True):
                table[j, names.index(name)] = series
            self._places = references, table
        drives = self.prepared.vary(robot).drives
        rows = []
        for j, quantity in self.wanted:
            actuator = drives[j].actuator
            assert actuator is not None  # is_static has looked
            torques = over_arrays(actuator.elastic_torques)(*self._places[1][j], drives[j].elastic)
            rows.append(torques[TORQUES.index(quantity)])
        return np.stack(rows)
