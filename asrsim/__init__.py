"""asrsim simulates articulated soft robots: joints driven through springs (SEA) or variable-stiffness actuators (VSA).

The library in a few lines::

    import asrsim

    result = asrsim.run("scenario.yaml", variant="soft")
    result.time, result["joint_1"].link_position

Names are imported when they are used, so that `import asrsim` takes hardly any time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from asrsim.api import JointSeries, Result, run, run_variants
    from asrsim.designs import Design, design
    from asrsim.errors import AsrsimError, DivergenceError, InputError, OutputError, SimulationError
    from asrsim.exports import Export, export
    from asrsim.identification import identify
    from asrsim.learning import LearningSession, learn
    from asrsim.log import Log, open_log, read_log
    from asrsim.recordings import Recording, read_recording
    from asrsim.robot import Robot, load_robot
    from asrsim.runs.rerun import Repetition, rerun
    from asrsim.scenario import Scenario, load_scenario, make_scenario
    from asrsim.simulation.observation import Observation
    from asrsim.simulation.prepare import prepare
    from asrsim.simulation.prepared import Prepared
    from asrsim.simulation.simulation import Simulation
    from asrsim.simulation.start import Start
    from asrsim.simulation.worlds import Worlds
    from asrsim.summary import RunSummary
    from asrsim.sweeps import sweep
    from asrsim.twin import Twin
    from asrsim.viewer import View, view

_HOMES = {
    "asrsim.api": ("JointSeries", "Result", "run", "run_variants"),
    "asrsim.designs": ("Design", "design"),
    "asrsim.environment": ("make_env", "make_vec_env"),
    "asrsim.errors": ("AsrsimError", "DivergenceError", "InputError", "OutputError", "SimulationError"),
    "asrsim.exports": ("Export", "export"),
    "asrsim.identification": ("identify",),
    "asrsim.learning": ("LearningSession", "learn"),
    "asrsim.log": ("Log", "open_log", "read_log"),
    "asrsim.recordings": ("Recording", "read_recording"),
    "asrsim.robot": ("Robot", "load_robot"),
    "asrsim.runs.rerun": ("Repetition", "rerun"),
    "asrsim.scenario": ("Scenario", "load_scenario", "make_scenario"),
    "asrsim.simulation.observation": ("Observation",),
    "asrsim.simulation.prepare": ("prepare",),
    "asrsim.simulation.prepared": ("Prepared",),
    "asrsim.simulation.simulation": ("Simulation",),
    "asrsim.simulation.start": ("Start",),
    "asrsim.simulation.worlds": ("Worlds",),
    "asrsim.summary": ("RunSummary",),
    "asrsim.sweeps": ("sweep",),
    "asrsim.twin": ("Twin",),
    "asrsim.viewer": ("View", "view"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "AsrsimError",
    "Design",
    "DivergenceError",
    "Export",
    "InputError",
    "JointSeries",
    "LearningSession",
    "Log",
    "Observation",
    "OutputError",
    "Prepared",
    "Recording",
    "Repetition",
    "Result",
    "Robot",
    "RunSummary",
    "Scenario",
    "Simulation",
    "SimulationError",
    "Start",
    "Twin",
    "View",
    "Worlds",
    "__version__",
    "design",
    "export",
    "identify",
    "learn",
    "load_robot",
    "load_scenario",
    "make_env",
    "make_scenario",
    "make_vec_env",
    "open_log",
    "prepare",
    "read_log",
    "read_recording",
    "rerun",
    "run",
    "run_variants",
    "sweep",
    "view",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        from asrsim.renamed import new_name

        new = new_name("asrsim", name)
        return globals().get(new) or __getattr__(new)
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
