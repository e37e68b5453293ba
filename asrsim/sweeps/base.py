"""Runs of one kind, which differ in numbers only: worlds of one scenario, run and looked at together."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from asrsim.errors import AsrsimError
from asrsim.samples import Samples, grid
from asrsim.scenario.data import for_joint
from asrsim.simulation.chunks import LONGEST_NUMBERS
from asrsim.simulation.prepared import EXTERNAL_TORQUE
from asrsim.simulation.run import make_run
from asrsim.simulation.worlds import Start, Worlds
from asrsim.summary.claims import check_claims
from asrsim.sweeps.cases import Case
from asrsim.sweeps.study import Study
from asrsim.sweeps.tap import Tap, name_in

LONGEST_RUN = 20 * LONGEST_NUMBERS
"""Numbers of a run's series, above which it is not kept whole."""


class Kind:
    """Worlds for the runs of one kind."""

    def __init__(self, study: Study, case: Case, values: Mapping[str, Any], share: int) -> None:
        """values: of what is read again; share: how many processes share the study's runs. Raises AsrsimError."""
        self._case = case
        # The same whichever run comes first: numbers are those of the study's first point.
        first = study.point(0)[1]
        prepared = case.prepared({name: (first if name in case.plan.in_place else values)[name] for name in values})
        scenario = prepared.scenario
        check_claims(scenario.expect, prepared.info.joints, file=scenario.path)
        numbers = scenario.steps * len(prepared.drives)
        runs = math.prod(study.grid) * study.draws if not case.plan.read_again(values) else 1
        self.size = min(runs, max(1, LONGEST_NUMBERS // numbers))
        """Runs whose numbers fit into the processor's cache together; 0: these runs are done alone."""
        # Poses and contacts are asked of the engine as the run goes on.
        if scenario.task is not None or not (scenario.world.empty and scenario.fixed_base) or numbers > LONGEST_RUN:
            self.size = 0
            return
        self._tap = Tap(prepared, study, checked=True)
        substeps = scenario.steps * prepared.resolution.substeps
        expected = max(substeps, substeps * runs // share) // self.size
        self._worlds = Worlds(prepared, self.size, names=tuple(self._tap.quantities), expected_substeps=expected)

    def run(self, points: Sequence[Mapping[str, Any]]) -> dict[int, Callable[[], dict[str, Any]]]:
        """Place of a run -> its cells, of at most `size` runs; without those that cannot be set or whose motion is not sane."""
        worlds, began = self._worlds, clock.perf_counter()
        ready = [world for world, values in enumerate(points) if self._is_set(world, values)]
        if not ready:
            return {}
        names = worlds.selection.names
        found = worlds.record(names, worlds=ready)
        # Side by side as if they were joints of one robot. No law or sum goes over several joints: all numbers are those of a
        # run alone.
        self._tap.begin(len(ready))
        scenario = worlds.prepared.scenario
        joints = tuple(name_in(place, joint) for place in range(len(ready)) for joint in worlds.joints)
        rows = scenario.steps + 1
        values = {name: table.transpose(1, 0, 2).reshape(rows, -1) for name, table in found.items()}
        self._tap.write(Samples(time=grid(0, rows, scenario.step), joints=joints, values=values))
        more = {
            "wall_time": (clock.perf_counter() - began) / len(points),
            "simulated_time": worlds.prepared.last_substep(None) * worlds.prepared.substep,
            "compiled": worlds.compiled,
        }
        return {
            world: partial(
                self._tap.cells, make_run(worlds.prepared_of(world), worlds.counts(world), "complete", **more), place
            )
            for place, world in enumerate(ready)
            if worlds.sane(world)
        }

    def _is_set(self, world: int, values: Mapping[str, Any]) -> bool:
        """Put a world at the start of a run; False where it cannot be, or where values are out of the references' ranges."""
        plan, worlds = self._case.plan, self._worlds
        references: dict[str, dict[str, Any]] = {}
        try:
            if plan.signals:
                scenario = self._case.scenario(plan.settings(values))
                for joint in worlds.joints:
                    references[joint] = dict(scenario.references_of(joint))
                    torque = for_joint(scenario.external_torques, joint)
                    if torque is not None:
                        references[joint][EXTERNAL_TORQUE] = torque
            worlds.reset(Start(parameters=plan.changes(values), references=references), worlds=[world])
            return all(
                worlds.set_reference(joint, reference, float(values[name]), worlds=[world])[0] == float(values[name])
                for name, places in sorted(plan.references.items(), key=lambda item: "*" not in item[0])
                for joint, reference in places
            )
        except AsrsimError:
            return False

    def close(self) -> None:
        """Release the engines."""
        if self.size:
            self._worlds.close()
