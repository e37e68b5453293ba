"""The lab: runs example scenarios for a figure, keeps their logs, and counts simulated time."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.runs.examples import examples_folder

if TYPE_CHECKING:
    from asrsim.api import Result
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


@dataclass(kw_only=True)
class Lab:
    """Where a figure's runs happen."""

    folder: Path
    """Takes the logs, one folder a run."""
    examples: Path = field(default_factory=examples_folder)
    simulated: float = 0.0
    """s simulated so far."""
    simulating: float = 0.0
    """s of wall-clock time in simulations so far."""

    def scenario(self, name: str, variant: str | None = None, overrides: Sequence[str] = ()) -> Scenario:
        """A variant of an example scenario. Raises ScenarioError."""
        from asrsim.scenario import load_scenario

        return load_scenario(self.examples / "scenarios" / f"{name}.yaml", variant=variant, overrides=overrides)[0]

    def run(
        self,
        name: str,
        variant: str,
        *,
        overrides: Sequence[str] = (),
        label: str | None = None,
        robot: Robot | None = None,
        log: bool = True,
    ) -> Result:
        """Run a variant of an example scenario.

        label: name of the run's folder after the scenario's, the variant if not given; robot: replaces the scenario's; log:
        write one. Raises what :func:`asrsim.run` raises.
        """
        from asrsim.api import run

        out = self.folder / f"{name}_{label or variant}" if log else None
        began = clock.perf_counter()
        scenario = self.scenario(name, variant, overrides)
        if overrides or robot is not None:
            # The example's claims are about the unchanged example.
            scenario = replace(scenario, expect=())
        result = run(scenario, robot=robot, out=out, overwrite=True)
        self.count(result.run.simulated_time, clock.perf_counter() - began)
        return result

    def pairs(self, name: str, variants: Sequence[str]) -> dict[str, Result]:
        """Several variants, by name."""
        return {variant: self.run(name, variant) for variant in variants}

    def count(self, simulated: float, seconds: float) -> None:
        """Note simulated time and the wall-clock time that it took."""
        self.simulated += simulated
        self.simulating += seconds
