"""Energy from nowhere, as a share of all that went through: small in stable runs, past 1 in unstable ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from asrsim.errors import DivergenceError
from asrsim.simulation.ledger import SHARE
from asrsim.simulation.run import Run
from asrsim.simulation.substeps import UNSTABLE
from validation.check import Check
from validation.models import LOAD, SETTINGS, chain, column, run


def share(result: Run) -> float:
    """Largest residual of a run's balance over the energy that went through its first joint."""
    work, link = column(result, "motor_work"), column(result, "link_work")
    through = np.sum(np.abs(np.diff(work))) + np.sum(np.abs(np.diff(link)))
    return float(np.max(np.abs(column(result, "energy_residual"))) / through)


def shares() -> Iterator[Check]:
    """The paper's eight settings in the released code's order, which has no substeps, at 1 ms and 2 ms; and the default's."""
    for name, (actuator, preset, parameters) in SETTINGS.items():
        robot = chain(replace(LOAD, actuator=actuator, damping=0.065))
        references = {"equilibrium_position": 0.8, "stiffness_preset": preset}
        for stepping, step in (("leapfrog", 1e-3), ("toolbox", 1e-3), ("toolbox", 2e-3)):
            label = f"{name}, {stepping}, {1e3 * step:g} ms"
            try:
                result = run(
                    robot, mode=3, references=references, parameters=parameters, duration=2.0, step=step, stepping=stepping
                )
            except DivergenceError as error:
                stopped = error.run
                if not isinstance(stopped, Run):
                    raise
                yield Check(
                    name=f"energy from nowhere, {label}: stopped, omega h {stopped.resolution.omega_h:.2g}",
                    figure=share(stopped), bound=SHARE, at_least=True, source="unstable above 2",
                )  # fmt: skip
                continue
            omega_h = result.resolution.omega_h
            if omega_h >= UNSTABLE and any(problem.code == "unresolved-spring" for problem in result.warnings):
                yield Check(
                    name=f"energy from nowhere, {label}: told beforehand, omega h {omega_h:.2g}", figure=share(result),
                    bound=SHARE, at_least=True, source="unstable above 2",
                )  # fmt: skip
                continue
            yield Check(
                name=f"energy from nowhere, {label}: omega h {omega_h:.2g}", figure=share(result), bound=0.3,
                source="stable below 2",
            )  # fmt: skip
