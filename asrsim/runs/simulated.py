"""A simulation whose samples hold what follows from them and from the scenario: the tip of a Cartesian task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from asrsim.errors import DivergenceError
from asrsim.samples import RunInfo, Samples
from asrsim.simulation.run import Run, Sink, simulate

if TYPE_CHECKING:
    from asrsim.kinematics.tip import TipPoses
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


class _WithTip:
    """Hands samples on with the tip's pose in them."""

    def __init__(self, sink: Sink, tip: TipPoses) -> None:
        self._sink = sink
        self._tip = tip

    def write(self, samples: Samples) -> None:
        """Take a chunk."""
        self._sink.write(self._tip.added(samples))


def simulated(
    scenario: Scenario,
    robot: Robot | None = None,
    *,
    sinks: Callable[[RunInfo], Sequence[Sink]],
    keep: bool,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Run:
    """:func:`asrsim.simulation.run.simulate`, with the tip's pose among the bodies of sinks and samples."""
    if scenario.task is None:
        return simulate(scenario, robot, sinks=sinks, keep=keep, progress=progress, stop=stop)
    from asrsim.kinematics.tip import TipPoses
    from asrsim.scenario import checked_robot

    known = robot if robot is not None else checked_robot(scenario)[0]
    tip = TipPoses(scenario, known)

    def with_tip(run: Run) -> Run:
        return run if run.samples is None else replace(run, samples=tip.added(run.samples))

    def ready(info: RunInfo) -> Sequence[Sink]:
        return [_WithTip(sink, tip) for sink in sinks(info)]

    try:
        return with_tip(simulate(scenario, known, sinks=ready, keep=keep, progress=progress, stop=stop))
    except DivergenceError as error:
        if isinstance(error.run, Run):
            error.run = with_tip(error.run)
        raise
