"""Which loop steps a run: compiled where that can be had and pays. Every run asks, so nothing heavy is imported for it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from asrsim.errors import SimulationError
from asrsim.simulation.loop import Loop

if TYPE_CHECKING:
    from asrsim.engines.base import Engine
    from asrsim.simulation.prepared import Prepared
    from asrsim.simulation.recording import Recording

SECONDS_SAVED = 6e-6
"""What the compiled loop saves for a joint and motor substep, s: measured 4 to 30, 2 for each further substep of the motors;
what matters is the order of magnitude."""
SECONDS_TO_LOAD = 0.6
"""Import of Numba and a kept kernel, s; a kernel that is not kept yet costs 2 s more once, and an installation's
first one another 6 s: the engine's own part, which all robots share."""
SECONDS_WHEN_LOADED = 0.05
"""The same where Numba is imported already."""


def pays(joints: int, substeps: int) -> bool:
    """The run is long enough for the compiled loop to win back its start; `substeps`: of the motors, in the whole run."""
    start = SECONDS_WHEN_LOADED if "numba" in sys.modules else SECONDS_TO_LOAD
    return joints * substeps * SECONDS_SAVED > start


def make_loop(
    prepared: Prepared, engine: Engine, recording: Recording, *, compiled: bool | None, substeps: int
) -> tuple[Loop, str]:
    """The loop, and why it is the plain one where the compiled one would pay; empty where it would not.

    compiled: whether it is; None: the scenario's choice, else where it pays in a run of so many substeps. Raises
    SimulationError where it cannot be had and is asked for.
    """
    from asrsim.compiling import available

    scenario = prepared.scenario
    options: dict[str, Any] = {
        "substep": prepared.substep,
        "motor_substeps": prepared.resolution.motor_substeps,
        "sensings": [None if sensor is None else sensor.sensing for sensor in prepared.sensors],
        "cut": prepared.velocity_cutoff,
        "floating": not scenario.fixed_base,
        "every": recording.every,
        "watch": recording.watch,
    }
    wanted, slow_because = scenario.compiled if compiled is None else compiled, ""
    if wanted or (wanted is None and pays(len(engine.joints), substeps * prepared.resolution.motor_substeps)):
        try:
            if not available():
                raise SimulationError("Numba is not installed")
            loop = Loop(engine, prepared.drives, prepared.stepping, compiled=True, **options)
            recording.quicken()
            return loop, ""
        except SimulationError as error:
            if wanted:
                raise
            slow_because = str(error)
    return Loop(engine, prepared.drives, prepared.stepping, compiled=False, **options), slow_because
