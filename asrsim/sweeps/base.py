"""A scenario that stays prepared, for the runs of a study that differ from each other in numbers only."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from asrsim.scenario.data import for_joint
from asrsim.simulation.chunks import LONGEST_NUMBERS
from asrsim.simulation.prepared import EXTERNAL_TORQUE, Prepared
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.worlds import Start, Worlds
from asrsim.summary.claims import check_claims
from asrsim.sweeps.cases import Case
from asrsim.sweeps.study import Study
from asrsim.sweeps.tap import Tap


class Base:
    """A simulation of one scenario, and worlds for runs that are so short that several are looked at together; made when they
    are asked for."""

    def __init__(self, study: Study, case: Case, values: Mapping[str, Any], share: int) -> None:
        """values: of what is read again; share: how many processes share the study's runs. Raises AsrsimError."""
        self._case, self._plan = case, case.plan
        plan = case.plan
        # The same base whichever run comes first: numbers are those of the study's first point.
        first = study.point(0)[1]
        self.prepared = case.prepared({name: (first if name in plan.in_place else values)[name] for name in values})
        scenario = self.prepared.scenario
        check_claims(scenario.expect, self.prepared.info.joints, file=scenario.path)
        self._study = study
        steps = scenario.steps * self.prepared.resolution.substeps
        runs = math.prod(study.grid) * study.draws if not plan.read_again(values) else 1
        self._expected = max(steps, steps * runs // share)
        self.together = min(runs, _fit_together(self.prepared))
        """Runs that are stepped and looked at together."""
        self._alone: tuple[Simulation, Tap] | None = None
        self._many: tuple[Worlds, Tap] | None = None

    def simulation(self) -> tuple[Simulation, Tap]:
        """For one run after the other; its samples go to its tap."""
        if self._alone is None:
            tap = Tap(self.prepared, self._study, checked=True)
            self._alone = Simulation(self.prepared, sinks=[tap], expected_substeps=self._expected), tap
        return self._alone

    def worlds(self) -> tuple[Worlds, Tap]:
        """For `together` runs at once."""
        if self._many is None:
            tap = Tap(self.prepared, self._study, checked=True)
            names = tuple(tap.quantities)
            expected = self._expected // self.together
            self._many = Worlds(self.prepared, self.together, names=names, expected_substeps=expected), tap
        return self._many

    def set(self, simulation: Simulation, values: Mapping[str, Any]) -> bool:
        """Put a simulation at the start of a run; False where the study's values are out of the references' ranges. Raises
        InputError.
        """
        signals = self._case.scenario(self._plan.settings(values)) if self._plan.signals else None
        simulation.reset(parameters=self._plan.changes(values), signals=signals)
        return self._set_references(simulation.set_reference, values)

    def set_world(self, worlds: Worlds, world: int, values: Mapping[str, Any]) -> bool:
        """The same for one of several worlds."""
        references: dict[str, dict[str, Any]] = {}
        if self._plan.signals:
            scenario = self._case.scenario(self._plan.settings(values))
            for drive in self.prepared.drives:
                references[drive.name] = dict(scenario.references_of(drive.name))
                torque = for_joint(scenario.external_torques, drive.name)
                if torque is not None:
                    references[drive.name][EXTERNAL_TORQUE] = torque
        worlds.reset(Start(parameters=self._plan.changes(values), references=references), worlds=[world])

        def set_reference(joint: str, reference: str, value: float) -> float:
            return float(worlds.set_reference(joint, reference, value, worlds=[world])[0])

        return self._set_references(set_reference, values)

    def _set_references(self, set_reference: Callable[[str, str, float], float | None], values: Mapping[str, Any]) -> bool:
        for name, places in sorted(self._plan.references.items(), key=lambda item: "*" not in item[0]):
            for joint, reference in places:
                if set_reference(joint, reference, float(values[name])) != float(values[name]):
                    return False
        return True

    def close(self) -> None:
        """Release the engines."""
        for made in (self._alone, self._many):
            if made is not None:
                made[0].close()
        self._alone = self._many = None


def _fit_together(prepared: Prepared) -> int:
    """How many runs are looked at together: those whose numbers fit into the processor's cache."""
    scenario = prepared.scenario
    if not (scenario.world.empty and scenario.fixed_base) or scenario.task is not None:
        # Poses and contacts are asked of the engine as the run goes on.
        return 1
    return max(1, LONGEST_NUMBERS // (scenario.steps * len(prepared.drives)))
