"""`asrsim view`: the robot in a browser: a live run, the playback of a log, or a robot file without a scenario."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from asrsim.cli.command import Done, command
from asrsim.cli.console import complain, say
from asrsim.cli.interrupt import Interruption
from asrsim.cli.options import (
    Align,
    Arguments,
    ColumnMap,
    Files,
    Overrides,
    Overwrite,
    Packages,
    Rate,
    Variant,
    argument,
    folders,
    into_folder,
    lag_of,
    option,
    pairs,
)
from asrsim.progress import Stop

PORT = 8080
"""Default network port of the page."""


@command()
def view(
    target: Annotated[
        Path,
        argument(
            "FILE",
            "A scenario (YAML) is simulated, a log or a folder of logs is played back, a URDF or xacro file is posed by "
            "sliders.",
        ),
    ],
    beside: Annotated[Files, argument("[LOG]...", "Logs of other runs, shown as ghosts.")] = None,
    experiment: Annotated[
        Files, option("Recording to show together with the robot; may be repeated.", "--experiment", "-e", metavar="FILE")
    ] = None,
    mapping: ColumnMap = None,
    align: Align = "auto",
    rate: Rate = None,
    variant: Variant = None,
    speed: Annotated[float, option("Simulated seconds per second of real time.", metavar="FACTOR", min=0.01, max=100.0)] = 1.0,
    port: Annotated[int, option("Port of the page; 0: any free port.", min=0, max=65535)] = PORT,
    duration: Annotated[float | None, option("Time after which the view ends, s.", min=0.1, default="until Ctrl-C")] = None,
    browser: Annotated[bool, option("Open the page in the browser.", "--browser/--no-browser")] = True,
    overrides: Overrides = None,
    arguments: Arguments = None,
    packages: Packages = None,
    out: Annotated[Path | None, into_folder("Folder for the log of a live run.", "out/<scenario>/<variant>_view")] = None,
    overwrite: Overwrite = False,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Show the robot in a browser: sliders, pulling with the mouse, pause and step, ghosts, moving plots.

    A live run writes a log with all changes that were made on the page; `asrsim rerun` repeats the run. Only this machine can
    connect. Ctrl-C ends the view. The command needs the extra `view`.

    Example: asrsim view examples/scenarios/step_2dof.yaml --variant soft --duration 10
    """
    from asrsim.plugins import command_line
    from asrsim.viewer.open import maker

    make = maker(
        target, beside or (), variant=variant, overrides=overrides or (), plugins=plugin, experiments=experiment or (),
        lag=lag_of(align), mapping=mapping, rate=rate, speed=speed, out=out, overwrite=overwrite,
        arguments=pairs(arguments, "--arg"), packages=folders(packages, "--package"), tell=complain,
    )  # fmt: skip
    with Interruption("") as interruption:
        end = math.inf if duration is None else clock.monotonic() + duration
        _, summary = show_page(
            make, lambda: interruption.stop() or clock.monotonic() > end, port=port, browser=browser, quiet=quiet
        )
    if summary is None:
        return Done(data={"ok": True})

    def text() -> None:
        say(f"{summary.simulated_time:.2f} s simulated; {summary.live['applied']} changes by hand")
        say(f"repeat it: {command_line('rerun', str(summary.files['log']), plugin)}")

    return Done(data={"ok": summary.ok, "runs": [summary.as_dict()]}, text=text, code=int(not summary.ok))


def show_page(make: Callable[[Any], Any], stop: Stop, *, port: int = 0, browser: bool = True, quiet: bool) -> tuple[Any, Any]:
    """Open a page, print its address, and work until `stop` returns True. Returns the page's content, and the result of the
    work. make: function that returns the page's content.
    """
    from asrsim.viewer.open import View
    from asrsim.viewer.server import PageServer, announcement, open_browser

    page = View(PageServer(port, tell=complain), make)
    for line in () if quiet else announcement(page.server):
        complain(line)
    if browser and not quiet:
        open_browser(page.server)
    return page.show, page.run(stop)
