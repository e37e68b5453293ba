"""asrsim as a library: runs a scenario and returns arrays, by joint and quantity. The library prints nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.errors import SimulationError, did_you_mean
from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.progress import Stop, Tell
from asrsim.runs.execute import execute, write_summary
from asrsim.runs.folder import folder_problems
from asrsim.runs.lock import owned
from asrsim.samples import Array, JointInfo, Samples
from asrsim.scenario import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.examine import Plan, examine, examine_all
from asrsim.simulation.run import Run
from asrsim.summary import RunSummary

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

    from asrsim.robot.model import Robot
    from asrsim.viewer import View


class JointSeries(Mapping[str, Array]):
    """Quantities of one joint by name, each an array (n,) in SI units: `series["link_position"]` or `series.link_position`.

    The mapping contains the recorded quantities and the quantities that are derived from them: `deflection`,
    `equilibrium_position`, `position_error`. Names and units are the names and units in `asrsim.quantities.QUANTITIES` and
    `DERIVED`.
    """

    def __init__(self, samples: Samples, info: JointInfo) -> None:
        self._samples = samples
        self._column = samples.joints.index(info.name)
        self.info = info

    def __getitem__(self, quantity: str) -> Array:
        if quantity in self.info.quantities:
            return self._samples.values[quantity][:, self._column]
        if quantity in tuple(self):
            return DERIVED_FUNCTIONS[quantity](self._samples, [self.info])[:, self._column]
        hint = did_you_mean(quantity, tuple(self)) or f"It has {', '.join(self)}"
        raise KeyError(f"joint '{self.info.name}' has no quantity '{quantity}'. {hint}")

    def __getattr__(self, quantity: str) -> Array:
        if quantity.startswith("_"):
            raise AttributeError(quantity)
        try:
            return self[quantity]
        except KeyError:
            raise AttributeError(f"no quantity '{quantity}'", name=quantity, obj=self) from None

    def __iter__(self) -> Iterator[str]:
        yield from self.info.quantities
        yield from DERIVED_FUNCTIONS if self.info.motors else ()

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"JointSeries({self.info.name}, {len(self._samples.time)} samples: {', '.join(self)})"

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]


@dataclass(frozen=True, repr=False)
class Result:
    """Result of a run: arrays, the summary, and the path of the log."""

    run: Run
    """The finished run, with its scenario, robot, substeps and counts."""
    summary: RunSummary
    log: Path | None = None
    """Path of the log, if a log was written."""

    @property
    def status(self) -> str:
        """Status of the run: `complete` or `interrupted`. A run that diverges has no result, and raises an error."""
        return self.run.status

    @property
    def ok(self) -> bool:
        """Whether the run is complete and satisfies every claim of its scenario."""
        return self.summary.ok

    @cached_property
    def samples(self) -> Samples:
        """All logged samples. They are read from the log if the run has not kept them in memory."""
        if self.run.samples is not None:
            return self.run.samples
        if self.log is None:
            raise SimulationError("the run kept no samples and wrote no log")
        from asrsim.log import read_log

        return read_log(self.log).samples

    @property
    def time(self) -> Array:
        """Times (n,), s."""
        return self.samples.time

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.run.info.joints)

    def joint(self, name: str) -> JointSeries:
        """Quantities of one joint. Raises KeyError for an unknown name."""
        for info in self.run.info.joints:
            if info.name == name:
                return JointSeries(self.samples, info)
        raise KeyError(
            f"no joint is called '{name}'. {did_you_mean(name, self.joints) or 'There are ' + ', '.join(self.joints)}"
        )

    def __getitem__(self, name: str) -> JointSeries:
        return self.joint(name)

    def __repr__(self) -> str:
        what = f"{self.summary.scenario} / {self.summary.variant}: {self.status}, {self.run.simulated_time:g} s"
        return f"Result({what}, {self.summary.samples} samples of {', '.join(self.joints)})"

    def _repr_html_(self) -> str:
        from asrsim.notebook import as_html

        return as_html(self)

    def plot(self, *, joints: Sequence[str] | None = None, quantities: Sequence[str] | None = None) -> Figure:
        """Figure of the given joints or quantities; by default of all joints. A notebook displays it. Raises LogError for
        unknown names."""
        from asrsim.notebook import run_picture

        return run_picture(self, joints=joints, quantities=quantities)

    def render(self, *, frames: int = 6) -> Image:
        """Film strip of the motion; a notebook displays it."""
        from asrsim.notebook import film_strip

        return film_strip(self, count=frames)

    def view(self, *beside: str | Path, port: int = 0) -> View:
        """Page that plays the motion in a browser; a notebook displays it. beside: logs of other runs, shown as ghosts.
        Needs the extra `view`."""
        from asrsim.notebook import page_of

        return page_of(self, beside, port)

    def to_pandas(self) -> Any:
        """Table as a pandas DataFrame: one row per sample with the time as its index, one column per joint and quantity. Needs
        pandas."""
        from asrsim.notebook import as_pandas

        return as_pandas(self)

    @property
    def bodies(self) -> Mapping[str, Array]:
        """Poses (n, 7) of each body, by name: position in m, orientation as quaternion x y z w."""
        return self.samples.bodies

    @property
    def contacts(self) -> Mapping[str, Array]:
        """Contact force (n, 3) in N on the first body of each pair of bodies, by pair."""
        return self.samples.contacts


def run(
    scenario: str | Path | Scenario,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    robot: Robot | str | Path | None = None,
    plugins: Sequence[str | Path] = (),
    out: str | Path | None = None,
    overwrite: bool = False,
    keep: bool = True,
    certify: bool = False,
    cross_check: bool = False,
    progress: Tell | None = None,
    stop: Stop | None = None,
) -> Result:
    """Simulate one variant of a scenario and return its result.

    Args:
        scenario: Scenario file, or a scenario from `asrsim.make_scenario` or `asrsim.load_scenario`.
        variant: Name of the variant; optional if the scenario has only one variant.
        overrides: `key=value` texts, as `--set` of the command line, or a mapping from dotted keys to values.
        robot: Replacement for the scenario's robot: a file, or a loaded robot, possibly changed.
        plugins: Python files that define users' actuators, signals and so on.
        out: Folder for `log.mcap` and `summary.json`; None: no files are written.
        overwrite: Whether the results of another run in this folder may be replaced.
        keep: Whether to keep all samples in memory; if False (only with `out`), they are read from the log when needed.
        certify: Whether to repeat the run with finer steps; the estimated numerical error is in `.summary.certificate`. This
            option includes `cross_check` if another engine is installed and the engine has the masses of the robot's file. An
            engine of your own has these masses only if its `EngineEntry` states `masses_of_file=True`.
        cross_check: Whether to repeat the run in another engine; the differences are in `.summary.cross_check`.
        progress: Function that is called now and then with a `Progress` (`asrsim.progress`), which has the simulated time.
        stop: Function that is called every few thousand substeps; if it returns True, the run ends cleanly.

    Returns:
        Result; results of the claims (`expect:`) are in `.summary.claims`. A claim that does not hold raises no error.

    Raises:
        ScenarioError: The scenario is invalid, or has several variants and `variant` is missing.
        RobotError, ActuatorError, UnresolvedSpringError: The run cannot be built.
        DivergenceError: The motion became physically impossible; the error's `.run` contains the samples so far.
        OutputError: `out` cannot be written.
    """
    plan = examine(
        scenario, robot, variant=variant, overrides=overrides, plugins=plugins,
        beside=None if out is None else lambda own: folder_problems(own, lambda _: Path(out), overwrite=overwrite),
    )  # fmt: skip
    return _run_one(
        plan, out, overwrite=overwrite, keep=keep, certify=certify, cross_check=cross_check, progress=progress, stop=stop
    )


def run_variants(
    scenario: str | Path,
    *,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    out: str | Path | None = None,
    overwrite: bool = False,
    keep: bool = True,
) -> dict[str, Result]:
    """Results of all variants of a scenario file: name -> result, in the file's order. Arguments and errors as in `run`.

    out: Folder in which each variant gets a subfolder.
    """

    def folder(one: Scenario) -> Path:
        return Path(out or "") / one.variant

    plans = examine_all(
        scenario,
        overrides=overrides,
        plugins=plugins,
        beside=None if out is None else lambda own: folder_problems(own, folder, overwrite=overwrite),
    )
    return {
        plan.scenario.variant: _run_one(plan, out and folder(plan.scenario), overwrite=overwrite, keep=keep) for plan in plans
    }


def _run_one(
    plan: Plan, out: str | Path | None, *, overwrite: bool, keep: bool, certify: bool = False,
    cross_check: bool = False, progress: Tell | None = None, stop: Stop | None = None,
) -> Result:  # fmt: skip
    folder = None if out is None else Path(out)
    with nullcontext() if folder is None else owned(folder):
        executed = execute(
            plan, folder, overwrite=overwrite, keep=keep or folder is None, certify=certify,
            cross_check=cross_check, progress=progress, stop=stop,
        )  # fmt: skip
        executed = write_summary(executed)
    if executed.error is not None:
        raise executed.error
    return Result(executed.run, executed.summary, executed.log)
