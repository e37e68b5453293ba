"""A fit as an immutable problem with recordings, free parameters and weights. Functions of the problem compute residuals and
derivatives, and search for the solution. `dataclasses.replace` makes a changed problem.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import InputError, RobotError, UnresolvedSpringError
from asrsim.identification.data import Channel, read_data
from asrsim.identification.door import examine
from asrsim.identification.noise import size_of
from asrsim.identification.parameters import FitParameter, Layout, free_parameters, make_layout, numbers_of, parameters_of
from asrsim.identification.task import Task
from asrsim.identification.track import Playing, Track
from asrsim.robot.inertia import nearest_possible
from asrsim.robot.model import INERTIAS, Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

STEP = 1e-6
"""Step of finite differences, in units of the parameter vector (logarithms, or typical sizes). The rounding error of a
simulation is much smaller, about 1e-13 of the motion. Residuals are nearly linear in the parameters over steps that are much
larger than this step.
"""
FAR = 1e3
"""Least residual of a diverged simulation, in standard deviations of the noise."""
REACH, ROUNDS = 0.3, 60
"""REACH: initial trust region of a search, relative to a parameter's size. Start values are often wrong by about a third.
ROUNDS: largest number of evaluations of a search. It is several times the usual number, 5 to 15.
"""
LINEAR, TRUSTED = 0.3, 0.05
"""Derivatives are used again if they predicted the latest change of the residuals within a relative error. The relative error
is LINEAR in a search, since the next step of the search reveals the error. It is TRUSTED for intervals, which may then be wrong
by 5 %.
"""
SLIGHT = 0.01
"""If the predicted change of the residuals has a norm below this number of standard deviations of the noise, the change
contains no information about the derivatives.
"""
RIDGE = 1e-4
"""Weight of each parameter's change in a search, in standard deviations of the noise per unit of the vector. It keeps the
Jacobian at full rank, since SciPy's trust-region method takes wrong steps if a parameter has no effect yet. The weight reduces
the change of a logarithm that is known within 1 % only by the fraction 1e-12.
"""
HUBER = 3.0
"""The Huber loss is linear for residuals above this number of standard deviations of the noise. Noise alone exceeds it once in
370 samples, so that without outliers the loss is nearly the square.
"""
INSIDE = 1e-5
"""Smallest second moment of an estimated inertia, as a fraction of the sum of the three second moments. It is ten times `STEP`,
so that inertias with a step of finite differences are still physically possible.
"""


def weigh(values: Array, noise: float, quantum: float) -> Array:
    """Weighted residuals (n,) or (n, k) of a channel, in standard deviations of its noise. values: predicted minus recorded
    values.

    The zero of an encoder is uncertain by its step `quantum`, so the weight of the mean residual is reduced.
    """
    sizes = values / noise
    zero = len(values) * (quantum / noise) ** 2 / 12.0
    return sizes - (1.0 - (1.0 + zero) ** -0.5) * sizes.mean(axis=0) if zero else sizes


@dataclass(frozen=True, eq=False)
class Part:
    """Position of a channel in the vector of residuals."""

    rows: slice
    track: int
    channel: Channel
    noise: float
    """Standard deviation by which the channel's residuals are divided."""
    time: Array
    """Times (n,) of the residuals, s."""
    recorded: Array
    """Recorded values (n,)."""

    @cached_property
    def far(self) -> float:
        """Residual of a diverged simulation. It exceeds the residuals of any model that follows the motion."""
        return max(FAR, float(np.ptp(self.recorded)) / self.noise)

    def weighted(self, differences: Array) -> Array:
        """Weighted residuals (n,). differences: predicted minus recorded values. Residuals of a diverged simulation are
        `far`.
        """
        found = np.clip(weigh(differences, self.noise, self.channel.quantum), -1e8, 1e8)
        found[np.isnan(found)] = self.far
        return found


@dataclass(frozen=True, eq=False)
class Slopes:
    """A Jacobian, with the parameter vector at which it was computed."""

    problem: FitProblem
    x: Array
    left: Array
    """Residuals (m,) at x."""
    matrix: Array
    """Derivatives (m, n) of the residuals."""

    def seen_by(self, problem: FitProblem) -> Slopes | None:
        """This Jacobian with the weights of another problem. None if the other problem has other recordings, parameters or
        simulations.
        """
        own = self.problem
        same = (problem.tracks, problem.playing, problem.ends, problem.own) == (own.tracks, own.playing, own.ends, own.own)
        if not same or problem.layout is not own.layout:
            return None
        if problem.weights == own.weights:
            return self
        left, matrix = self.left.copy(), self.matrix.copy()
        for part, was in zip(problem.parts, own.parts, strict=True):
            if part.noise == was.noise:
                continue
            if part.channel.quantum:
                # This Jacobian cannot be used, since the residuals of encoders do not scale with the weights.
                return None
            left[part.rows] *= was.noise / part.noise
            matrix[part.rows] *= was.noise / part.noise
        return replace(self, problem=problem, left=left, matrix=matrix)

    def moved(self, x: Array, left: Array, trust: float) -> Slopes | None:
        """This Jacobian at another parameter vector x, by Broyden's update. None if the derivatives predict the change of the
        residuals with a relative error above `trust`. left: residuals (m,) at x.
        """
        move = x - self.x
        foretold = self.matrix @ move
        size, surprise = float(np.linalg.norm(foretold)), left - self.left - foretold
        if size < SLIGHT:
            return self
        if float(np.linalg.norm(surprise)) > trust * size:
            return None
        matrix = self.matrix + np.outer(surprise, move / float(move @ move))
        return Slopes(self.problem, x.copy(), left, matrix)


@dataclass
class Meter:
    """Counter of the evaluations of a fit. It also stores the latest derivatives."""

    evaluations: int = 0
    cost: float = np.inf
    """Smallest mean Huber loss that the present search has found."""
    latest: Slopes | None = None
    """The latest Jacobian with respect to all parameters."""

    def count(self) -> None:
        """Count an evaluation."""
        self.evaluations += 1


@dataclass(frozen=True, eq=False)
class FitProblem:
    """The least-squares problem of a fit. The residuals cover the training parts of the fitted recordings.

    `tracks`, `weights` and `ends` have an element for each recording. Fitted recordings come first.
    """

    tracks: tuple[Track, ...]
    layout: Layout
    playing: Playing
    weights: tuple[tuple[float, ...], ...]
    """Standard deviation of the noise of each channel, by recording."""
    ends: tuple[float, ...]
    """End of each training part, s; 0 for recordings that are predicted but not fitted."""
    meter: Meter
    own: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    """Values of parameters, by key, that replace the values of the parameter vector in recordings that are predicted but not
    fitted, by the index of the recording. An example is the recording's initial state.
    """

    def table(self, x: Array, track: int) -> dict[str, float]:
        """Values by key with which a recording is simulated. Inertias are changed to physically possible ones."""
        values = {**self.layout.table(x, track), **self.own.get(track, {})}
        for link in self._tensors:
            values |= self._possible(link, values, 0.0)
        return values

    @cached_property
    def _tensors(self) -> tuple[str, ...]:
        """Links whose three moments of inertia are free or tied. `asrsim.robot.vary.physical` adapts the inertias of the other
        links.
        """
        owners = dict.fromkeys(key.rpartition(".")[0] for key in self.layout.keys if key.endswith(".ixx"))
        return tuple(one for one in owners if {f"{one}.iyy", f"{one}.izz"} <= self.layout.keys)

    def _possible(self, link: str, values: Mapping[str, float], least: float) -> dict[str, float]:
        """Free numbers of a link's inertia by key, changed to a physically possible inertia. least: as in
        `asrsim.robot.inertia.nearest_possible`.
        """
        keys = [f"{link}.{name}" for name in INERTIAS]
        xx, xy, xz, yy, yz, zz = (values[key] if key in values else self.known[key].start for key in keys)
        found = nearest_possible((xx, xy, xz, yy, yz, zz), least)
        return {key: value for key, value in zip(keys, found, strict=True) if key in values}

    def possible(self, x: Array) -> Array:
        """Parameter vector in which the inertias are physically possible."""
        values = self.layout.table(x, 0)
        found = {key: value for link in self._tensors for key, value in self._possible(link, values, INSIDE).items()}
        moved = [
            entry.place(found[entry.key]) if found.get(entry.key, values.get(entry.key)) != values.get(entry.key) else place
            for entry, place in zip(self.layout.entries, x.tolist(), strict=True)
        ]
        return np.array(moved)

    def at_limit(self, x: Array) -> list[str]:
        """Links whose inertia is at the limit of what is physically possible."""
        values = self.table(x, 0)
        return [
            link for link in self._tensors if self._possible(link, values, 2.0 * INSIDE) != self._possible(link, values, 0.0)
        ]

    @property
    def fitted(self) -> tuple[int, ...]:
        """Indices of the fitted recordings."""
        return tuple(number for number, end in enumerate(self.ends) if end > 0.0)

    @cached_property
    def known(self) -> dict[str, FitParameter]:
        """All parameters of the robot and of the recordings, by key. Their start values are the values before the fit."""
        data = [track.data for track in self.tracks]
        commands = {command.key: command.unit for one in data for command in one.commands}
        channels = {channel.key: channel.unit for one in data for channel in one.channels}
        return parameters_of(self.tracks[0].door.robot, tuple(commands), commands | channels)

    @property
    def fixed(self) -> dict[str, FitParameter]:
        """Parameters that are neither free nor tied, by key."""
        taken = self.layout.keys
        return {key: one for key, one in self.known.items() if key not in taken}

    @property
    def whole(self) -> FitProblem:
        """Problem in which the held-out parts are fitted, too."""
        return replace(self, ends=tuple(0.0 if track.data.predicted_only else track.data.duration for track in self.tracks))

    @property
    def everything(self) -> FitProblem:
        """Problem in which all recordings are fitted to their ends, including recordings that are only predicted."""
        return replace(self, ends=tuple(track.data.duration for track in self.tracks))

    @property
    def motion(self) -> float:
        """Bandwidth of the motion in the fitted recordings, rad/s."""
        return max(self.tracks[i].motion for i in self.fitted)

    def can_rise(self, level: float) -> bool:
        """Whether an observer can have this bandwidth. The samples must be close enough, and no sensor may be an encoder.
        level: bandwidth of the observer in units of the bandwidth of the motion.
        """
        return all(self.tracks[i].measured.shows(level * self.motion) for i in self.fitted)

    def played(self, staircases: frozenset[str]) -> FitProblem:
        """Problem in which the commands with these keys are played as staircases."""
        return replace(self, playing=replace(self.playing, staircases=staircases))

    @property
    def observes(self) -> bool:
        """Whether an observer can correct the simulations towards recorded positions."""
        return all(self.tracks[i].observes for i in self.fitted)

    def observed(self, level: float) -> FitProblem:
        """Problem with an observer. level: bandwidth of the observer in units of the bandwidth of the motion; 0: no observer.
        The sampling interval limits the bandwidth.
        """
        fastest = min(self.tracks[i].measured.fastest for i in self.fitted)
        return replace(self, playing=replace(self.playing, bandwidth=min(level * self.motion, fastest)))

    def distinct(self, levels: Sequence[float]) -> list[float]:
        """Levels of bandwidth. A level is left out if its observer would have the same bandwidth as the observer of the
        previous level. levels: in falling order.
        """
        found = {self.observed(level).playing.bandwidth: level for level in reversed(levels)}
        return [*found.values()][::-1]

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Positions of all channels in the vector of residuals."""
        found: list[Part] = []
        first = 0
        for track in self.fitted:
            for channel, noise in zip(self.tracks[track].channels, self.weights[track], strict=True):
                count = channel.until(self.ends[track])
                rows = slice(first, first + count)
                found.append(Part(rows, track, channel, noise, channel.time[:count], channel.values[:count]))
                first += count
        return tuple(found)

    def rows(self, track: int) -> slice:
        """Rows of a recording in the vector of residuals."""
        mine = [part.rows for part in self.parts if part.track == track]
        return slice(mine[0].start, mine[-1].stop)

    def blocks(self, count: int) -> NDArray[np.intp]:
        """Index of the time block of each residual, (m,). Each recording has `count` blocks."""
        numbers = []
        for part in self.parts:
            inside = np.minimum(np.floor(part.time / self.ends[part.track] * count), count - 1)
            numbers.append(part.track * count + inside)
        return np.concatenate(numbers).astype(np.intp)


@dataclass(frozen=True, eq=False)
class Setup:
    """A task with its scenario, robot, recordings and problem."""

    task: Task
    scenario: Scenario
    robot: Robot
    problem: FitProblem
    adopted: tuple[str, ...] = ()
    """Names of the parameters of effects that were added to the original model."""


def read_scenario(task: Task) -> tuple[Scenario, Robot, Robot]:
    """Scenario of a task, robot of the robot file, and robot with the changes of the scenario. Loads the plugins. Raises
    InputError.
    """
    plan = examine(task.scenario, variant=task.variant, overrides=task.overrides, plugins=task.plugins)
    return plan.scenario, plan.source, plan.robot


def set_up(task: Task, stack: ExitStack, meter: Meter | None = None) -> Setup:
    """Prepared fit of a task. stack: closes the engines of the simulations; meter: counts the evaluations. Raises InputError
    with all problems.
    """
    scenario, given, robot = read_scenario(task)
    data = read_data(task, scenario, robot)
    commands = {command.key: command.unit for one in data for command in one.commands}
    known = parameters_of(robot, tuple(commands), commands | {c.key: c.unit for one in data for c in one.channels})
    free, ties = free_parameters(task, known)
    named = {parameter.key for parameter in free}
    zeros = {key: zero for one in reversed(data) for key, zero in one.zeros.items()}
    free += [replace(known[key], start=zero) for key, zero in zeros.items() if key not in named]
    freed, tracks = {parameter.key for parameter in free}, list[Track]()
    for one in data:
        tracks.append(Track(scenario, given, one, freed))
        stack.callback(tracks[-1].close)
    # Only fitted recordings get separate values of parameters. The other recordings keep the start values.
    fitted = [track for track in tracks if not track.data.predicted_only]
    # The initial state of a link is free if the recording begins in motion, or at another position than the scenario.
    free += [known[key] for key in dict.fromkeys(key for track in fitted for key in track.uncertain)]
    names, starts, within = [one.name for one in data], [one.initial for one in fitted], [one.within for one in fitted]
    layout = make_layout(free, ties, names, starts, within)
    share = 0.0 if task.validate else task.hold_out
    ends = tuple(0.0 if t.data.predicted_only else t.onset + (t.data.duration - t.onset) * (1.0 - share) for t in tracks)
    weights = tuple(tuple(channel.floor for channel in track.channels) for track in tracks)
    playing = Playing(max(track.door.substeps for track in tracks))
    problem = FitProblem(tuple(tracks), layout, playing, weights, ends, meter or Meter())
    count = problem.parts[-1].rows.stop
    if count <= len(layout):
        message = f"{count} samples are too few for {len(layout)} parameters"
        raise InputError(message, file=task.experiments[0].file, key="experiments", code="few-samples")
    return Setup(task, scenario, robot, problem)


Differences = list[tuple[Part, Array]]
"""Parts with their predicted minus recorded values (n,)."""


def differences(problem: FitProblem, x: Array) -> Differences:
    """Parts with their predicted minus recorded values (n,); NaN if the simulation diverges."""
    predicted: list[Array] = []
    for track in problem.fitted:
        values = problem.table(x, track)
        predicted += problem.tracks[track].predict(values, problem.playing, problem.ends[track])
        problem.meter.count()
    return [(part, values - part.recorded) for part, values in zip(problem.parts, predicted, strict=True)]


def residuals(problem: FitProblem, x: Array) -> Array:
    """Weighted residuals (m,) of all fitted recordings."""
    return np.concatenate([part.weighted(values) for part, values in differences(problem, x)])


def jacobian(problem: FitProblem, x: Array, trust: float = TRUSTED, *, base: Array | None = None) -> Array:
    """Jacobian (m, n) of the residuals: the latest Jacobian with Broyden's update if it still holds, otherwise a Jacobian by
    finite differences. trust: largest relative error with which the latest Jacobian may predict the change of the residuals;
    base: residuals (m,) at x.
    """
    meter, left = problem.meter, residuals(problem, x) if base is None else base
    latest = meter.latest and meter.latest.seen_by(problem)
    moved = latest and latest.moved(x, left, trust)
    meter.latest = moved or Slopes(problem, x.copy(), left, slopes_along(problem, x, range(len(x)), base=left))
    return meter.latest.matrix


def slopes_along(
    problem: FitProblem, x: Array, columns: Sequence[int], step: float | Array = STEP, *, base: Array | None = None
) -> Array:
    """Columns (m, k) of the Jacobian, by one-sided differences within the bounds.

    step: step of all entries, or (n,) of each, in the vector's units; base: residuals (m,) at x.
    """
    at = residuals(problem, x) if base is None else base
    matrix, moves = np.zeros((len(at), len(columns)), order="F"), np.where(x + step <= problem.layout.bounds[1], step, -step)
    for track in problem.fitted:
        touched = [column for column, i in enumerate(columns) if problem.layout.entries[i].track in (None, track)]
        points = [x + moves * (np.arange(len(x)) == columns[column]) for column in touched]
        rows, parts = problem.rows(track), [part for part in problem.parts if part.track == track]
        far = np.concatenate([np.full(len(part.time), part.far) for part in parts])
        for column, there in zip(touched, _at(problem, points, track), strict=True):
            # If one of the two simulations diverged, its residuals have no derivative, and their entries remain 0.
            valid = (there != far) & (at[rows] != far)
            matrix[rows, column] = np.where(valid, (there - at[rows]) / moves[columns[column]], 0.0)
    return matrix


def residuals_at(problem: FitProblem, points: Sequence[Array]) -> Array:
    """Weighted residuals (k, m) at several parameter vectors. One rollout simulates all of them."""
    return np.concatenate([np.stack([*_at(problem, points, track)]) for track in problem.fitted], axis=1)


def _at(problem: FitProblem, points: Iterable[Array], track: int) -> Iterator[Array]:
    tables, parts = [problem.table(point, track) for point in points], [p for p in problem.parts if p.track == track]
    for predicted in problem.tracks[track].predictions(tables, problem.playing, problem.ends[track]):
        problem.meter.count()
        pairs = zip(predicted, parts, strict=True)
        yield np.concatenate([part.weighted(values - part.recorded) for values, part in pairs])


def huber(values: Array) -> float:
    """Mean Huber loss of the residuals. The loss is quadratic up to `HUBER` and linear above."""
    size = np.abs(values)
    return float(np.mean(np.where(size <= HUBER, size**2, HUBER * (2.0 * size - HUBER))))


def robust_mean_square(problem: FitProblem, x: Array) -> float:
    """Mean square of the residuals, in which outliers count less: the mean Huber loss. The loss of a channel is linear above
    `HUBER` times the typical size of the channel's residuals, or of its noise if that is larger. If errors of the model are far
    above the noise, they are therefore no outliers.
    """
    left = residuals(problem, x)
    return robust_mean([left[part.rows] for part in problem.parts])


def robust_mean(channels: Sequence[Array]) -> float:
    """Mean square of the residuals (n,) of several channels, in which outliers count less; 0 without residuals."""
    count = sum(map(len, channels))
    return sum(len(own) * robust_square(own) for own in channels if len(own)) / count if count else 0.0


def robust_square(left: Array) -> float:
    """Mean square of the residuals (n,) of a channel, in which outliers count less, as in `robust_mean_square`."""
    size = max(float(np.median(np.abs(left))) / 0.6745, 1.0)
    return size**2 * huber(left / size)


def mean_square(problem: FitProblem, x: Array) -> float:
    """Mean square of the residuals."""
    return float(np.mean(residuals(problem, x) ** 2))


def with_own_substeps(problem: FitProblem, x: Array) -> FitProblem:
    """Problem with the number of substeps that a simulation with the parameters x needs, multiplied by `Playing.finer`. The
    problem is unchanged if it already has this number.
    """
    needed, finer = [], problem.playing.finer
    for number, track in enumerate(problem.tracks):
        with suppress(RobotError, UnresolvedSpringError):
            own, motor_substeps = track.door.substeps_of(numbers_of(problem.table(x, number)))
            needed.append((own * finer, motor_substeps))
    substeps = max(needed, default=problem.playing.substeps)
    if substeps == problem.playing.substeps:
        return problem
    return replace(problem, playing=replace(problem.playing, substeps=substeps))


def with_finer_substeps(problem: FitProblem) -> FitProblem:
    """Problem with twice the number of substeps."""
    playing, (substeps, motor_substeps) = problem.playing, problem.playing.substeps
    return replace(problem, playing=replace(playing, substeps=(2 * substeps, motor_substeps), finer=2 * playing.finer))


def weighed(problem: FitProblem, x: Array) -> FitProblem:
    """Problem in which the residuals of each channel are divided by their own size, or by the rounding error if this is larger.
    A recording whose simulation diverges keeps its divisors.
    """
    found: dict[int, list[float]] = {}
    for part, left in differences(problem, x):
        size = max(size_of(left), 1e-12) if np.isfinite(left).all() else part.noise
        found.setdefault(part.track, []).append(size)
    return replace(problem, weights=tuple(tuple(found.get(track, known)) for track, known in enumerate(problem.weights)))


def solve(problem: FitProblem, x: Array, *, robust: bool = False, rounds: int = ROUNDS, tolerance: float = 1e-6) -> Array:
    """Solution of bounded least squares by a trust-region method that starts at x. Each prior of a parameter adds a residual.
    robust: whether to use the Huber loss; rounds: largest number of evaluations; tolerance: relative change of the cost or of x
    at which the search ends.
    """
    from scipy.optimize import least_squares

    (low, high), priors = problem.layout.bounds, problem.layout.priors
    # The start vector must lie inside the bounds. The first trust region around it has the width REACH.
    span = np.minimum(high - low, 1.0)
    inside = np.clip(x, low + 1e-6 * span, high - 1e-6 * span)
    # The search does not use the logarithm of this parameter, so that its value may now be much larger than its start value.
    grown = [not entry.logarithmic for entry in problem.layout.entries]
    scale = REACH * np.where(grown, np.maximum(np.abs(inside), 1.0), 1.0)
    rows = np.diag(priors)[priors > 0.0]

    def left(move: Array) -> Array:
        found = residuals(problem, inside + move)
        problem.meter.cost = min(problem.meter.cost, huber(found))
        return np.concatenate([found, rows @ (inside + move), RIDGE * move])

    def slopes(move: Array) -> Array:
        there = inside + move
        at = residuals(problem, there)
        costs.append(huber(at) if robust else float(np.mean(at**2)))
        # The search ends after a step that hardly reduces the error. Compute no new derivatives then.
        ends = costs[-2] - costs[-1] < tolerance * costs[-1]
        matrix = jacobian(problem, there, np.inf if ends else LINEAR, base=at)
        return np.vstack([matrix, rows, RIDGE * np.eye(len(x))])

    costs = [np.inf]
    found = least_squares(
        left, np.zeros(len(x)), jac=slopes, bounds=(low - inside, high - inside),
        method="trf", x_scale=scale, loss="huber" if robust else "linear", f_scale=HUBER,
        ftol=tolerance, xtol=tolerance, gtol=1e-12, max_nfev=rounds,
    )  # fmt: skip
    return np.asarray(inside + found.x, dtype=np.float64)


def posterior_draws(problem: FitProblem, x: Array, count: int) -> Array:
    """Random parameter vectors (count, n) from the normal approximation of the posterior at the solution x, clipped to the
    bounds. Parameters without effect need priors.
    """
    slopes, priors = jacobian(problem, x), problem.layout.priors
    root = np.linalg.inv(np.linalg.cholesky(np.asarray(slopes.T @ slopes + np.diag(priors**2 + RIDGE**2))))
    return np.clip(x + np.random.default_rng(0).standard_normal((count, len(x))) @ root, *problem.layout.bounds)
