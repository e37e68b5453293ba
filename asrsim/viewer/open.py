"""Opens a page that shows a scenario, a log or a robot file."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from asrsim.errors import InputError
from asrsim.live.session import Settings
from asrsim.log import open_log
from asrsim.progress import Stop
from asrsim.recordings.align import LagChoice
from asrsim.runs.folder import find_logs
from asrsim.samples import RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.examine import Plan, examine_all
from asrsim.viewer.events import events_of
from asrsim.viewer.live import LiveView
from asrsim.viewer.page import Page
from asrsim.viewer.player import Player
from asrsim.viewer.pose import PoseView
from asrsim.viewer.recorded import recorded
from asrsim.viewer.server import PageServer
from asrsim.viewer.subject import Companion, as_companion, logged

if TYPE_CHECKING:
    from asrsim.viewer.events import Event

ROBOTS = (".urdf", ".xacro", ".xml")
"""Suffixes of robot files, by which a target is recognised as a robot."""
SCENARIOS = (".yaml", ".yml")
SLOWEST, FASTEST = 0.01, 100.0
"""Smallest and largest speed, in simulated seconds per wall-clock second."""
HEIGHT = 640
"""Height of a page that a notebook displays, pixels."""


class Show(Protocol):
    """Content of a page, such as a live run or a playback."""

    def run(self, stop: Stop) -> Any:
        """Show the content until `stop` returns True."""


class View:
    """Open page. It is a context manager, which closes the page. Notebooks display the page."""

    def __init__(self, server: PageServer, make: Callable[[Page], Show]) -> None:
        """make: function that puts content on a page, and returns this content."""
        self.server, self._page = server, Page(server)
        self._stopped, self._thread = threading.Event(), threading.Thread(target=self._work, daemon=True)
        self.error: BaseException | None = None
        """Error that ended the thread in which the page works; None without an error."""
        try:
            self.show = make(self._page)
        except BaseException:
            server.close()
            raise

    @property
    def address(self) -> str:
        """Address of the page."""
        return self.server.address

    def run(self, stop: Stop) -> Any:
        """Show the content in the caller's thread until `stop` returns True, and close the page."""
        with self.server:
            return self.show.run(stop)

    def start(self) -> View:
        """Show the content in a separate thread until `close` is called."""
        self._thread.start()
        return self

    def _work(self) -> None:
        try:
            self.run(self._stopped.is_set)
        except BaseException as error:
            self.error = error

    def close(self) -> None:
        """Close the page. Raises the error that ended the page's thread, if there was one."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        self.server.close()
        if self.error is not None:
            raise self.error

    def __enter__(self) -> View:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"View({self.address})"

    def _repr_html_(self) -> str:
        return f'<iframe src="{html.escape(self.address)}" width="100%" height="{HEIGHT}" style="border:0"></iframe>'


def view(
    target: str | Path | Scenario,
    *beside: str | Path,
    variant: str | None = None,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    experiments: Sequence[str | Path] = (),
    lag: LagChoice = "auto",
    speed: float = 1.0,
    port: int = 0,
    out: str | Path | None = None,
    overwrite: bool = False,
) -> View:
    """Open a page. It shows a scenario, which runs live, or a log, which is played back, or the robot in a robot file.

    Args:
        target: Scenario file or scenario, log or folder of logs, or robot file (URDF, xacro).
        beside: Logs of other runs, shown as ghosts.
        variant, overrides, plugins: As for `asrsim.run`. All variants can be chosen on the page.
        experiments: Recordings, shown as ghosts and as dashed curves.
        lag: Alignment of the recordings' clock with the run's clock, as for `asrsim plot --align`.
        speed: Simulated seconds per wall-clock second.
        port: Port of the page; 0: any free port.
        out: Folder for the log of a live run, with a subfolder for each of several variants; None:
            `out/<scenario>/<variant>_view`.
        overwrite: Whether results of another scenario or variant in this folder are replaced.

    Returns: The page, whose content is shown by a separate thread until `close` is called.

    Raises:
        InputError: viser is missing, the port is taken, or a file cannot be read.
    """
    make = maker(
        target,
        beside,
        variant=variant,
        overrides=overrides,
        plugins=plugins,
        experiments=experiments,
        lag=lag,
        speed=speed,
        out=out,
        overwrite=overwrite,
    )
    return View(PageServer(port), make).start()


def maker(
    target: str | Path | Scenario, beside: Sequence[str | Path] = (), *, variant: str | None = None, overrides: Overrides = (),
    plugins: Sequence[str | Path] = (), experiments: Sequence[str | Path] = (), lag: LagChoice = "auto",
    mapping: Sequence[str] | Path | None = None, rate: float | None = None, speed: float = 1.0,
    settings: Settings | None = None, out: str | Path | None = None, overwrite: bool = False,
    arguments: dict[str, str] | None = None, packages: dict[str, Path] | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> Callable[[Page], Show]:  # fmt: skip
    """Function that puts the content on a page, and returns this content. All files are read here, before the page opens.
    Arguments and errors as for `view`.
    """
    if not SLOWEST <= speed <= FASTEST:
        message = f"must be from {SLOWEST:g} to {FASTEST:g}"
        raise InputError(message, key="speed", value=speed, code="speed")
    recordings: dict[str, Any] = {"lag": lag, "mapping": mapping, "rate": rate}
    others = [as_companion(logged(path), _name_of(path)) for file in beside for path in find_logs(Path(file))[0]]
    if not isinstance(target, Scenario):
        path = Path(target)
        if path.suffix in ROBOTS:
            return lambda page: PoseView(page, path, xacro_arguments=arguments, package_paths=packages)
        if path.suffix not in SCENARIOS:
            return _playback(path, others, experiments, speed, recordings)
    plans = examine_all(target, overrides=overrides, plugins=plugins)
    if variant is not None and variant not in (known := tuple(plan.scenario.variant for plan in plans)):
        raise InputError(f"no variant is called '{variant}'", choices=known, meant=variant, code="unknown-variant")
    first = next(plan for plan in plans if variant in (None, plan.scenario.variant))
    others += _recorded_beside(first, experiments, recordings)
    settings = replace(settings or Settings(), speed=speed)
    return lambda page: LiveView(
        page,
        plans,
        variant=first.scenario.variant,
        out=None if out is None else Path(out),
        overwrite=overwrite,
        settings=settings,
        companions=others,
        tell=tell,
    )


def _playback(
    path: Path, others: list[Companion], experiments: Sequence[str | Path], speed: float, recordings: dict[str, Any]
) -> Callable[[Page], Show]:
    """Function that makes the playback of a log, or of the first log in a folder. The folder's other logs become ghosts."""
    logs = find_logs(path)[0]
    subject = logged(logs[0])
    others = [*(as_companion(logged(log), _name_of(log)) for log in logs[1:]), *others]
    reader = open_log(logs[0])

    def read(quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        return reader.read(quantities=quantities, joints=joints).samples

    others += [recorded(Path(file), reader.info, read, **recordings) for file in experiments]
    samples = subject.history.rows(*_open(subject.history.span))
    assert samples is not None
    events: list[Event] = events_of(logs[0], samples, subject.joints, subject.scene.model.robot)
    return lambda page: Player(page, subject, companions=others, events=events, speed=speed)


def _recorded_beside(plan: Plan, experiments: Sequence[str | Path], recordings: dict[str, Any]) -> list[Companion]:
    """Recordings beside a live run. Their clocks are aligned with a run of the scenario that is simulated without a user."""
    if not experiments:
        return []
    from asrsim.recordings.align import SampleReader
    from asrsim.simulation.run import simulate

    run = simulate(plan)
    samples, info = run.samples, run.info
    assert samples is not None

    def read(quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        columns = [samples.joints.index(name) for name in joints]
        values = {name: samples.values[name][:, columns] for name in quantities}
        return replace(samples, joints=tuple(joints), values=values)

    reader: SampleReader = read
    described: RunInfo = info
    return [recorded(Path(file), described, reader, **recordings) for file in experiments]


def _name_of(log: Path) -> str:
    """Label of a run: the names of the last two folders of its log, which are usually the scenario and the variant."""
    return "/".join(log.absolute().parts[-3:-1])


def _open(span: tuple[float, float]) -> tuple[float, float]:
    """Interval that begins 1 s before and ends 1 s after a span, so that samples at the ends of the span are inside."""
    return span[0] - 1.0, span[1] + 1.0
