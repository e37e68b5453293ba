"""Resumes a finished fit. The file fit.json contains its numbers, so that the robot can be accepted and written without a new
fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from asrsim.errors import InputError, Problem
from asrsim.identification.data import PlayedCommand, read_data
from asrsim.identification.folder import FIT, FitFolder
from asrsim.identification.problem import read_scenario
from asrsim.identification.replay import FitReplay
from asrsim.identification.result import COMPLETE, Estimate, accepts
from asrsim.identification.task import Task, Tie
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class Resumed:
    """Data for writing a robot file: the numbers of an earlier fit, and the robot and the scenario of its task."""

    estimates: tuple[Estimate, ...]
    ties: tuple[Tie, ...]
    misfit: tuple[str, ...]
    accepted: bool
    """Whether a model that does not fit is accepted."""
    explained: float
    """Smallest explained fraction of a channel's variance."""
    replay: FitReplay
    """Settings with which the fitted simulation repeats the first recording."""
    played: tuple[PlayedCommand, ...]
    """Commands of the first recording."""
    robot: Robot
    scenario: Scenario

    @property
    def fits(self) -> bool:
        """Whether the model explains the recordings within the noise."""
        return not self.misfit


def resumed(fit: FitFolder, task: Task, *, accept: bool = False) -> Resumed:
    """An earlier fit of the same task. accept: whether an explained fraction of 90 % of the variance is enough, instead of
    95 %.

    Raises InputError if the fit is not complete, or if it is a fit of another scenario, of other recordings or of other
    parameters.
    """
    path = fit.folder / FIT
    if fit.replay is None:
        hint = "Fit again without --resume"
        raise InputError("was made by an earlier version of asrsim", file=path, key="replay", hint=hint, code="resume")
    if fit.status != COMPLETE:
        raise InputError(f"the fit is {fit.status}", file=path, key="status", hint="Fit again without --resume", code="resume")
    faults = [
        Problem(
            f"was made with another value of `{name}`", file=path, key=name, value=there,
            hint="Give the options of that fit, or fit again without --resume", code="resume",
        )
        for name, there, here in (
            ("scenario", fit.scenario, str(task.scenario.absolute())),
            ("experiments", list(fit.experiments), [str(one.file.absolute()) for one in task.experiments]),
            ("variant", fit.variant, task.variant), ("overrides", list(fit.overrides), list(task.overrides)),
        )
        if there != here
    ]  # fmt: skip
    keys = {one.key for one in fit.estimates} | {tie.key for tie in fit.ties}
    faults += [
        Problem("is not a parameter of this fit", file=path, key="free", value=key, choices=tuple(sorted(keys)), code="resume")
        for key in task.free
        if not any(fnmatchcase(one, key) for one in keys)
    ]
    if faults:
        raise InputError(faults)
    scenario, _, robot = read_scenario(task)
    data = read_data(replace(task, experiments=task.experiments[:1], validate=()), scenario, robot)[0]
    explained = min((one["explained"] or 0.0 for one in fit.channels), default=0.0)
    return Resumed(
        estimates=fit.estimates, ties=fit.ties, misfit=fit.misfit,
        replay=fit.replay, played=data.commands, robot=robot, scenario=scenario,
        explained=explained, accepted=bool(fit.misfit) and accepts(explained, accept=accept),
    )  # fmt: skip
