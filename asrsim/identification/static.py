"""Springs on a bench, whose links and motors stand where they are put: torques are laws of these places alone."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from asrsim.errors import RobotError
from asrsim.identification.door import Start, Substeps, over_arrays
from asrsim.identification.track import Track
from asrsim.samples import Array

TORQUES = ("elastic_torque_1", "elastic_torque_2")
PLACES = ("link_position", "motor_1_position", "motor_2_position")


def is_static(track: Track, free: Collection[str]) -> bool:
    """Whether only springs without hysteresis, which may be free, are compared, on a bench, in modes whose motors have no
    dynamics.
    """
    drives = {drive.name: drive for drive in track.door.drives}
    return track.scenario.engine == "bench" and all(
        channel.quantity in TORQUES
        and (drive := drives[channel.joint]).actuator is not None
        and not (drive.dynamic_motors or drive.hysteresis or f"{channel.joint}.hysteresis_torque" in free)
        for channel in track.channels
    )


class StaticTrack(Track):
    """A recording of springs on a bench: simulated once for its places, on which the laws are evaluated as arrays."""

    _places: tuple[object, Array] | None = None

    def simulated(
        self, names: Sequence[tuple[int, str]], starts: Sequence[Start], steps: int | None, substeps: Substeps
    ) -> Iterator[Array | None]:
        """As :meth:`Door.rollout`; places do not depend on steps."""
        for start in starts:
            if self._places is None or self._places[0] is not start.references:
                every = [(j, place) for j in range(len(self.door.joints)) for place in PLACES]
                (found,) = self.door.rollout(every, [replace(start, parameters={})], substeps=self.door.substeps)
                if found is None:
                    yield None
                    continue
                self._places = start.references, found.reshape(len(self.door.joints), len(PLACES), -1)
            try:
                drives = self.door.varied(start.parameters).drives
            except RobotError:
                yield None
                continue
            rows = []
            for j, quantity in names:
                actuator = drives[j].actuator
                assert actuator is not None  # is_static has looked
                torques = over_arrays(actuator.elastic_torques)(*self._places[1][j], drives[j].elastic)
                rows.append(torques[TORQUES.index(quantity)])
            yield np.stack(rows)
