"""Learning on the real robot, trial by trial. The input of the next trial is computed from the recording of the last trial.
Files store the state between trials.

A twin of the robot is fitted to the best trial and the last trial. The law `auto` first tries its updates on the twin. The twin
and plants drawn from the posterior of the fit predict the error of the next trial. The part of the recordings that the twin
does not explain gives a bound of the prediction error. This bound is added to the predicted error. The change of the input is
halved until the sum is at most 1.2 times the error of the best trial so far. If the sum exceeds this limit even with the
smallest change, the user is warned before the trial. With the law `paper` the change is not halved, and the user is only
warned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asrsim.errors import InputError, Problem
from asrsim.learning.optimal import NormOptimal, rehearsed, standing
from asrsim.learning.plant import Plant
from asrsim.learning.prepared import PreparedLearning, learning_model, prepare_learning
from asrsim.learning.recorded import recorded
from asrsim.learning.session import INPUTS, trial_data, write_inputs, write_playback
from asrsim.learning.state import LearningState, load_state, motion_basis, save_state
from asrsim.learning.trial import Trial, best_of, verdict
from asrsim.learning.twin import LearningTwin, fit_twin, largest
from asrsim.outfile import write_json
from asrsim.recordings.align import LagChoice
from asrsim.recordings.data import Recording
from asrsim.runs.lock import owned
from asrsim.samples import Array
from asrsim.scenario.digest import digest_of

WORSE = 1.2
"""A trial counts as worse if its largest error exceeds this multiple of the best trial's largest error."""
SHARES = (1.0, 0.5, 0.25, 0.125)
"""Fractions of the input's change. They are tried in this order until the predicted trial is not worse."""
SMOOTH = 0.02
"""Length of the window over which recorded positions are averaged, s. Averaging reduces the noise, which would otherwise count
as an error.
"""
PEAK = 3.3
"""Typical largest deviation among a thousand normally distributed samples, in standard deviations."""
ABOVE = 1.5
"""If a trial's largest error is at most this multiple of the largest deviation that noise causes, noise hides whether the next
trial is better. A growth of the true error by the factor `WORSE` is then only a few tenths of that deviation.
"""
STATE, NEXT, PLAYBACK, NUMBERS = "hardware.npz", "next.csv", "next.yaml", "hardware.json"


@dataclass(frozen=True, kw_only=True)
class HardwareStep:
    """Result of processing a recording."""

    prepared: PreparedLearning
    trials: tuple[Trial, ...]
    """All trials on the robot."""
    outcome: str | None
    """Reason why learning ended; None: learning continues."""
    converged: bool
    twin: LearningTwin | None
    """Twin that was fitted to the robot; None after learning has ended."""
    foretold: float
    """Ratio of the largest predicted error of the next trial to the largest error of the best trial so far."""
    noise: float
    """Largest deviation of an averaged position that the recording's noise causes, rad."""
    recording: Recording
    clock: str
    """Method by which the recording's clock was aligned with the motion, as text."""
    findings: tuple[Problem, ...]
    """Notes about the recording."""

    @property
    def warning(self) -> str | None:
        """Warning that the next trial may be worse than the best trial so far; None if it will probably not be worse."""
        best = best_of(self.trials).worst
        if self.foretold <= WORSE:
            if best > ABOVE * self.noise or self.outcome is not None:
                return None
            return (
                f"the next trial may be worse: the largest error of the best trial so far, {best:.2g}, is hardly above the "
                f"noise of the recording, {self.noise:.2g}"
            )
        much = (
            f"predicted to reach {self.foretold:.3g} times the largest error of the best trial so far"
            if np.isfinite(self.foretold)
            else "unbounded, since the twin diverges"
        )
        return f"the next trial may be worse: its largest error is {much}"


def next_input(
    plant: Plant,
    folder: Path,
    path: Path,
    *,
    mapping: Sequence[str] | Path | None = None,
    lag: LagChoice = "off",
) -> HardwareStep:
    """Process the recording of the last input, and write the next input to `folder`.

    The first input is learned.csv, if `asrsim ilc` wrote this file to the folder. Otherwise it is the first guess of the
    scenario. If the last recording is given again with another lag or mapping, its trial is replaced. Raises InputError if the
    recording does not fit, and OutputError.

    mapping: as for `read_recording`; lag: alignment of the recording's clock with the desired motion.
    """
    from asrsim.recordings import read_recording

    with owned(folder):
        recording = read_recording(path, mapping=mapping, joints=plant.joints)
        prepared = prepare_learning(plant)
        problem, settings = prepared.problem, prepared.settings
        basis, digest = motion_basis(problem), digest_of(path)
        state = load_state(folder / STATE, basis, problem)
        # If the user gives the last recording again, asrsim read this recording wrongly before, and fitted the last twin to
        # wrong numbers. Therefore start from the twin before the last one.
        again = digest in state.recordings[-1:]
        trials, recordings, begin = list(state.trials), list(state.recordings), state.start if again else state.changes
        if again:
            recordings.pop()
            played = trials.pop().inputs
        else:
            played = _pending(folder, prepared, trials)
        if digest in recordings:
            message = f"was already used as trial {recordings.index(digest)}; record the motion under {folder / NEXT} instead"
            raise InputError(message, file=path, code="recording-taken")
        found = recorded(recording, plant, lag)
        trials.append(problem.trial(len(trials), played, smoothed(found.outputs, problem.step)))
        ended = verdict(problem, trials, settings, prepared.law)
        twin, ratio = None, 0.0
        if ended is None:
            inputs, twin, ratio = _proposed(prepared, trials, begin)
        else:
            inputs = best_of(trials).inputs
        changes = {} if twin is None else twin.changes
        state = LearningState(trials=tuple(trials), recordings=(*recordings, digest), start=begin, changes=changes)
        # Save the state first: if the next input cannot be written, the user may give the same recording again.
        save_state(folder / STATE, basis, state)
        what = "the next input for the robot" if ended is None else f"the learned input: {ended[1]}"
        write_inputs(folder / NEXT, plant.time, plant.headings(), inputs, comment=f"asrsim ilc --experiment: {what}")
        write_playback(folder / PLAYBACK, plant, folder / NEXT)
        data: dict[str, object] = {"trials": [trial_data(t, plant.joints) for t in trials], "best": best_of(trials).number}
        if twin is not None:
            data["identified"] = {"changes": changes, "residual": twin.residual, "residual_before": twin.before}
        write_json(folder / NUMBERS, data)
        return HardwareStep(
            prepared=prepared,
            trials=tuple(trials),
            outcome=None if ended is None else ended[1],
            converged=ended is not None and ended[0] == "converged",
            twin=twin,
            foretold=ratio,
            noise=PEAK * found.noise * min(found.interval / SMOOTH, 1.0) ** 0.5,
            recording=recording,
            clock=found.clock,
            findings=found.findings,
        )


def _proposed(
    prepared: PreparedLearning, trials: Sequence[Trial], start: Mapping[str, float]
) -> tuple[Array, LearningTwin, float]:
    """Next inputs (n, joints), fitted twin, and ratio of the next trial's largest predicted error to the best trial's largest
    error.
    """
    problem = prepared.problem
    best, rho, _ = standing(trials)
    twin = fit_twin(prepared.plant, [best, *trials[-1:]] if trials[-1] is not best else [best], start)
    forecasts, unexplained = twin.forecasts(best), twin.unexplained(best, trials)

    def foretold(inputs: Array) -> float:
        outputs = [forecast(inputs) for forecast in forecasts]
        worst = max(largest(problem.reference - one) for one in outputs)
        return (worst + unexplained.of_change(largest(outputs[0] - best.outputs))) / best.worst

    if not isinstance(prepared.law, NormOptimal):
        inputs = prepared.law.propose(trials)
        return inputs, twin, foretold(inputs)
    lifted = learning_model(twin.plant).lifted
    change = rehearsed(problem, lifted, best, rho, forecasts[0]) - best.inputs
    for share in SHARES:
        inputs = best.inputs + share * change
        ratio = foretold(inputs)
        if ratio <= WORSE:
            break
    return inputs, twin, ratio


def _pending(folder: Path, prepared: PreparedLearning, trials: Sequence[Trial]) -> Array:
    """Inputs (n, joints) that the robot played in the recorded trial, from the file that was written last."""
    from asrsim.signals.recorded import read_column

    path = folder / (NEXT if trials else INPUTS)
    if not path.is_file():
        return prepared.problem.first_guess
    columns = [read_column(path, joint)[1] for joint in prepared.plant.joints]
    if len(columns[0]) != len(prepared.problem.time):
        samples = f"has {len(columns[0])} samples, but the motion has {len(prepared.problem.time)}"
        message = f"{samples}: the file belongs to another scenario"
        raise InputError(message, file=path, hint="Choose another folder with --out", code="input-of-another-run")
    return np.column_stack(columns)


def smoothed(outputs: Array, step: float) -> Array:
    """Recorded positions (n, joints), averaged over windows of `SMOOTH` s."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(outputs, 2 * round(0.5 * SMOOTH / step) + 1, axis=0, mode="nearest"))
