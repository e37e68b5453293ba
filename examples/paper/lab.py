"""Runs of the example scenarios for the figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.api import run
from asrsim.runs.examples import examples_folder
from asrsim.scenario import load_scenario

if TYPE_CHECKING:
    from asrsim.api import Result
    from asrsim.robot.model import Robot
    from asrsim.scenario import Scenario


@dataclass(frozen=True)
class Lab:
    """Runs variants of example scenarios for a figure."""

    folder: Path
    """Folder for the logs, with one subfolder per run."""

    def scenario(self, name: str, variant: str | None = None, overrides: Sequence[str] = ()) -> Scenario:
        """Variant of an example scenario. Raises ScenarioError."""
        return load_scenario(examples_folder() / "scenarios" / f"{name}.yaml", variant=variant, overrides=overrides)[0]

    def run(
        self, name: str, variant: str, *, overrides: Sequence[str] = (), label: str | None = None, robot: Robot | None = None,
        log: bool = True,
    ) -> Result:  # fmt: skip
        """Result of a run of an example scenario's variant.

        label: name of the run's folder inside the folder of the scenario, by default the variant; robot: replaces the robot
        of the scenario; log: write a log. Raises the errors of `asrsim.run`.
        """
        scenario = self.scenario(name, variant, overrides)
        if overrides or robot is not None:
            # The claims in the example hold for the unchanged example only.
            scenario = replace(scenario, expect=())
        return run(scenario, robot=robot, out=self.folder / f"{name}_{label or variant}" if log else None, overwrite=True)

    def pairs(self, name: str, variants: Sequence[str]) -> dict[str, Result]:
        """Result of the run of each variant."""
        return {variant: self.run(name, variant) for variant in variants}
