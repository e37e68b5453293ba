"""`asrsim live`: simulates in real time, with the toolbox's topics in ROS 2 or a browser."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.console import say
from asrsim.cli.interrupt import Interruption
from asrsim.cli.options import Overrides, Overwrite, Scenario, Texts, Variant, View, into_folder, option
from asrsim.progress import Stop

if TYPE_CHECKING:
    from asrsim.scenario import Scenario as LoadedScenario


@command("Print errors and warnings only.")
def live(
    scenario: Scenario,
    variant: Variant = None,
    on: Annotated[
        Texts,
        option("Transport: ros, foxglove, none; may be repeated.", "--on", metavar="NAME", default="all installed"),
    ] = None,
    speed: Annotated[str, option("Simulated seconds per second of real time, or max.", metavar="FACTOR")] = "1",
    duration: Annotated[float | None, option("Simulated time, s.", min=1e-3, max=1e9, default="until Ctrl-C")] = None,
    publish_rate: Annotated[float, option("Highest publishing rate of the topics, Hz.", min=1e-3, max=1e6)] = 1000.0,
    namespace: Annotated[str, option("Prefix of the topics' names.")] = "",
    domain: Annotated[int | None, option("ROS domain.", min=0, max=232, default="ROS_DOMAIN_ID, else 0")] = None,
    port: Annotated[int, option("Port of the WebSocket; 0: any free port.", min=0, max=65535)] = 8765,
    network: Annotated[bool, option("Also accept connections from other machines.", "--network")] = False,
    allow_origin: Annotated[
        Texts,
        option("Web pages that may use the WebSocket; may be repeated.", "--allow-origin", metavar="URL"),
    ] = None,
    twin: Annotated[bool, option("Follow a robot: read its topics, publish external torques and alarms.", "--twin")] = False,
    view: View = False,
    overrides: Overrides = None,
    out: Annotated[
        Path | None,
        into_folder("Folder for log and summary.", "out/<scenario>/<variant>_live"),
    ] = None,
    overwrite: Overwrite = False,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Run a scenario in real time; a reference follows the scenario's signal until a command on a topic replaces it.

    Topics have the toolbox's names. The log contains every step and applied command, so `asrsim rerun` can repeat the run.
    Only this machine can connect unless --network is given. Ctrl-C ends the run. Exit code: 0; 1 if the run failed or diverged.

    Example: asrsim live examples/scenarios/step_2dof.yaml --variant soft --on none --duration 2
    """
    pace = _speed(speed)
    from asrsim.cli.live_status import StatusLine, print_live
    from asrsim.extras import install
    from asrsim.live import TRANSPORTS, Access
    from asrsim.live.origin import origin_of
    from asrsim.live.session import Session, Settings
    from asrsim.runs.folder import folder_problems
    from asrsim.simulation.examine import examine

    names = [name for name in TRANSPORTS.names() if TRANSPORTS.get(name).available] if on is None else list(dict.fromkeys(on))
    for name in names:
        if name != "none":
            TRANSPORTS.get(name)
    names = [name for name in names if name != "none"]

    def folder_of(one: LoadedScenario) -> Path:
        return out or Path("out") / one.name / f"{one.variant}_live"

    plan = examine(
        scenario,
        variant=variant,
        overrides=overrides or (),
        plugins=plugin,
        beside=None if twin else lambda own: folder_problems(own, folder_of, overwrite=overwrite),
    )
    access = Access(network=network, port=port, domain=domain, origins=tuple(map(origin_of, allow_origin or ())))
    if twin:
        return _follow(plan, names, access, namespace, duration, view=view, quiet=quiet)
    settings = Settings(speed=pace, duration=duration, rate=publish_rate, namespace=namespace, transports=names, access=access)
    with StatusLine(show=not quiet) as line:
        for problem in TRANSPORTS.broken() if on is None else ():
            line.tell(str(problem))
        if not names and on is None:
            line.tell(f"no transport is installed, so clients cannot connect ({install('ros')}, or with 'asrsim[foxglove]')")
        folder = folder_of(plan.scenario)
        with Interruption("") as interruption:
            if view:
                session, summary = _shown(
                    plan, folder, settings, interruption.stop, overwrite=overwrite, line=line, quiet=quiet
                )
            else:
                session = Session(plan, folder, settings, overwrite=overwrite, tell=line.tell)

                def stop() -> bool:
                    line.show(session)
                    return interruption.stop()

                summary = session.run(stop=stop)
    return Done(
        data={"ok": summary.ok, "runs": [summary.as_dict()]},
        always=lambda: print_live(session, summary, plugin, quiet=quiet),
        code=int(not summary.ok),
    )


def _shown(plan: Any, folder: Path, settings: Any, stop: Stop, *, overwrite: bool, line: Any, quiet: bool) -> tuple[Any, Any]:
    """Run the scenario in real time on a page in the browser. Returns the last run and its summary."""
    from asrsim.cli.view import show_page
    from asrsim.viewer.live import LiveView

    show, summary = show_page(
        lambda page: LiveView(page, [plan], out=folder, overwrite=overwrite, settings=settings, tell=line.tell),
        stop,
        quiet=quiet,
    )
    return show.session, summary


def _follow(
    plan: Any, transports: list[str], access: Any, namespace: str, duration: float | None, *, view: bool, quiet: bool
) -> Done:
    """Run a twin that follows a running robot in real time."""
    from asrsim.twin.live import LiveTwin

    twin = LiveTwin(
        plan,
        transports=transports,
        access=access,
        namespace=namespace,
        duration=duration,
        tell=(lambda text: None) if quiet else say,
    )
    with Interruption("") as interruption:
        if view:
            from asrsim.cli.view import show_page
            from asrsim.viewer.twin import TwinView

            show_page(lambda page: TwinView(page, twin), interruption.stop, quiet=quiet)
        else:
            twin.run(stop=interruption.stop)
    return Done(
        data={"ok": True, "followed": twin.time, "alarms": twin.alarms},
        text=lambda: say(f"{twin.time:.1f} s followed, {twin.alarms} alarms"),
    )


def _speed(text: str) -> float:
    if text == "max":
        return math.inf
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 1e-3 <= speed <= 1e3:
        raise typer.BadParameter(f"'{text}' must be a number from 0.001 to 1000, or max", param_hint="--speed")
    return speed
