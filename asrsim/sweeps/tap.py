"""What a row needs of a run's samples: a collector for the summary, and the kept signals."""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.runs.execute import steps_of
from asrsim.samples import Array, RunInfo, Samples
from asrsim.simulation.prepared import Prepared
from asrsim.summary import Collector
from asrsim.summary.claims import needs_of
from asrsim.sweeps.study import Study


class Tap:
    """A sink that serves one run after the other."""

    full_rate = True

    def __init__(self, prepared: Prepared, study: Study) -> None:
        self._prepared, self._study = prepared, study
        self.bodies = needs_of(prepared.scenario.expect, prepared.info.joints)[1]
        self.begin()

    def begin(self) -> None:
        """A run begins."""
        scenario, info = self._prepared.scenario, self._prepared.info
        self.collector = Collector(info.joints, samples=steps_of(scenario) + 1, claims=scenario.expect)
        self.signals = Signals(self._study, info, scenario.step)

    def write(self, samples: Samples) -> None:
        """The next chunk."""
        self.collector.write(samples)
        self.signals.write(samples)


class Signals:
    """A sink that keeps a study's signals at its rate."""

    def __init__(self, study: Study, info: RunInfo, step: float) -> None:
        """step: s between the samples that come."""
        self._names = [tuple(signal.split(".", 1)) for signal in study.signals]
        self._joints = info.joints
        self._every = max(1, round(1.0 / (study.rate * step)))
        self._seen = 0
        self._kept: dict[str, list[Array]] = {}

    def write(self, samples: Samples) -> None:
        """The next chunk."""
        rows = slice((-self._seen) % self._every, None, self._every)
        self._seen += len(samples.time)
        for joint, name in self._names:
            if joint not in samples.joints:
                continue
            column = samples.joints.index(joint)
            table = samples.values.get(name)
            if table is None:
                table = DERIVED_FUNCTIONS[name](samples, self._joints)
            self._kept.setdefault(f"{joint}.{name}", []).append(table[rows, column].astype(np.float32))

    def cells(self) -> dict[str, Any]:
        """Kept signals, float32."""
        return {f"signal:{name}": np.concatenate(parts).tolist() for name, parts in self._kept.items()}
