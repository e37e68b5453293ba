"""A scenario that stays prepared, for the runs of a study that differ from each other in numbers only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from asrsim.simulation.simulation import Simulation
from asrsim.simulation.together import deferred, fit_together
from asrsim.summary.claims import check_claims
from asrsim.sweeps.cases import Case
from asrsim.sweeps.study import Study
from asrsim.sweeps.tap import Tap


class Base:
    """Two simulations of one scenario, made when they are asked for: one is looked at as it runs, of the other many runs
    together, where they are short."""

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
        self.together = min(runs, fit_together(self.prepared, steps))
        """Runs that are looked at together."""
        self._made: dict[bool, tuple[Simulation, Tap]] = {}

    def simulation(self, *, later: bool = False) -> tuple[Simulation, Tap]:
        """That whose samples go to its tap as it runs; later: that whose tracks are looked at when there are enough."""
        if later not in self._made:
            tap, expected = Tap(self.prepared, self._study, checked=True), self._expected
            if later:
                made = deferred(self.prepared, tap.quantities, expected_substeps=expected)
            else:
                made = Simulation(self.prepared, sinks=[tap], expected_substeps=expected)
            self._made[later] = made, tap
        return self._made[later]

    def set(self, simulation: Simulation, values: Mapping[str, Any]) -> bool:
        """Put a simulation at the start of a run; False where the study's values are out of the references' ranges. Raises
        InputError.
        """
        signals = self._case.scenario(self._plan.settings(values)) if self._plan.signals else None
        simulation.reset(parameters=self._plan.changes(values), signals=signals)
        for name, places in sorted(self._plan.references.items(), key=lambda item: "*" not in item[0]):
            for joint, reference in places:
                if simulation.set_reference(joint, reference, float(values[name])) != float(values[name]):
                    return False
        return True

    def close(self) -> None:
        """Release the engines."""
        for simulation, _ in self._made.values():
            simulation.close()
        self._made = {}
