"""What rows need of runs' samples: a collector for their summaries, and the kept signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS, DERIVED_SOURCES
from asrsim.samples import RunInfo, Samples
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.run import Run
from asrsim.summary import Collector, Seen, make_summary
from asrsim.summary.claims import Claims, needs_of
from asrsim.sweeps.rows import summary_cells
from asrsim.sweeps.study import Study


def name_in(run: int, joint: str) -> str:
    """Name of a joint among those of all runs."""
    return f"{run}:{joint}" if run else joint


class Tap:
    """A sink for one run after the other, or for so many that are looked at together."""

    full_rate = True

    def __init__(self, prepared: Prepared, study: Study, *, checked: bool) -> None:
        """checked: the scenario's claims are."""
        scenario, self._study = prepared.scenario, study
        self._info, self._step, self._samples = prepared.info, scenario.step, scenario.steps + 1
        self._needs, self.bodies = needs_of(scenario.expect, self._info.joints)
        self._claims = Claims(scenario.expect, self._info.joints, file=scenario.path, checked=checked)
        self._desired = scenario.desired
        self._many: dict[int, tuple[RunInfo, list[tuple[str, str]]]] = {}
        """Runs -> their description as that of one, and what their claims need."""
        self.begin()

    def begin(self, runs: int = 1) -> None:
        """So many runs begin."""
        if runs not in self._many:
            joints = tuple(replace(one, name=name_in(run, one.name)) for run in range(runs) for one in self._info.joints)
            needs = [(quantity, name_in(run, joint)) for run in range(runs) for quantity, joint in self._needs]
            self._many[runs] = replace(self._info, joints=joints), needs
        info, needs = self._many[runs]
        self._collector = Collector(info.joints, samples=self._samples, needs=(needs, self.bodies))
        self._signals = Signals(self._study, info, self._step)
        self._runs = runs
        self._seen: Seen | None = None

    @property
    def quantities(self) -> frozenset[str]:
        """Names of what it takes from samples."""
        return self._collector.quantities | self._signals.quantities

    def write(self, samples: Samples) -> None:
        """The next chunk."""
        self._collector.write(samples)
        self._signals.write(samples)

    def cells(self, run: Run, number: int = 0) -> dict[str, Any]:
        """Of the row of a run, the number-th of those together. Raises ScenarioError for claims that cannot be judged."""
        claims = self._claims.results(lambda *wanted: self._read(number, *wanted)) if run.status == "complete" else ()
        if self._seen is None:
            desired = {name_in(i, name): signal for name, signal in self._desired.items() for i in range(self._runs)}
            self._seen = self._collector.seen({**self._desired, **desired}, balanced=run.scenario.initial_equilibrium)
        own = slice(number * len(self._info.joints), (number + 1) * len(self._info.joints))
        seen = Seen(self._seen.measures[own], self._seen.tip, self._seen.travels[own])
        summary = make_summary(run, seen, samples=0, claims=claims)
        return {**summary_cells(summary), **self._signals.cells(number)}

    def _read(self, number: int, quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        return replace(self._collector.read(quantities, [name_in(number, joint) for joint in joints]), joints=tuple(joints))


class Signals:
    """A sink that keeps a study's signals at its rate."""

    def __init__(self, study: Study, info: RunInfo, step: float) -> None:
        """step: s between the samples that come."""
        self._names = [tuple(signal.split(".", 1)) for signal in study.signals]
        self.quantities = frozenset(source for _, name in self._names for source in DERIVED_SOURCES.get(name, (name,)))
        """Names of what it takes from samples."""
        self._joints = info.joints
        self._every = max(1, round(1.0 / (study.rate * step)))
        self._seen = 0
        self._kept: list[Samples] = []

    def write(self, samples: Samples) -> None:
        """The next chunk."""
        rows = slice((-self._seen) % self._every, None, self._every)
        self._seen += len(samples.time)
        tables = {}
        for name in dict.fromkeys(name for _, name in self._names):
            table = samples.values.get(name)
            if table is None:
                table = DERIVED_FUNCTIONS[name](samples, self._joints)
            tables[name] = table[rows].copy()
        if tables:
            self._kept.append(Samples(time=samples.time[rows], joints=samples.joints, values=tables))

    def cells(self, number: int = 0) -> dict[str, Any]:
        """Kept signals of the number-th run, float32."""
        found = {}
        for joint, name in self._names:
            place = name_in(number, joint)
            if self._kept and place in self._kept[0].joints:
                column = self._kept[0].joints.index(place)
                whole = np.concatenate([part.values[name][:, column] for part in self._kept])
                found[f"signal:{joint}.{name}"] = whole.astype(np.float32).tolist()
        return found
