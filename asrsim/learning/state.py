"""State of a learning run on disk, so that an interrupted one goes on exactly where it was."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np

from asrsim.errors import InputError
from asrsim.outfile import make_folder, written
from asrsim.plain import misfit
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.learning.trial import LearningProblem, Trial
    from asrsim.scenario.learning_keys import Learning

FORMAT = "asrsim learning state 3"
DECIDING = ("law", "joint_gains", "gain_decay", "filter", "first_guess")
"""Keys of `ilc:` that decide how trials follow each other; one may go on with a tighter tolerance or more iterations."""


def fingerprint(problem: LearningProblem, settings: Learning) -> str:
    """A hash of everything that decides how the learning goes, apart from where it stops."""
    deciding = [getattr(settings, name) for name in DECIDING]
    text = json.dumps([deciding, problem.joints, problem.identity], sort_keys=True, default=asdict)
    digest = hashlib.sha256(text.encode())
    for array in (problem.time, problem.reference, problem.first_guess):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save_state(path: Path, digest: str, trials: list[Trial], *, origin: tuple[str, str]) -> None:
    """Write all trials to `path` (NumPy's npz), whole or not at all. digest: :func:`fingerprint` of their problem; origin: its
    scenario file and variant."""
    head = {"format": FORMAT, "fingerprint": digest, "scenario_path": origin[0], "variant": origin[1]}
    scalars = [
        {
            "number": trial.number,
            "largest": trial.largest,
            "norm": trial.norm,
            "rms": trial.rms,
            "seconds": trial.seconds,
            "ratio": trial.ratio,
        }
        for trial in trials
    ]
    make_folder(path.parent)
    with written(path, "learning state") as file:
        np.savez(
            file,
            head=np.array(json.dumps({**head, "trials": scalars})),
            inputs=np.array([trial.inputs for trial in trials]),
            outputs=np.array([trial.outputs for trial in trials]),
        )
        file.flush()
        os.fsync(file.fileno())


def state_origin(path: Path) -> tuple[tuple[str, str], int] | None:
    """Scenario file and variant that a state comes from, and how many trials it holds; None if it is no readable state."""
    try:
        head, _, _ = _stored(path)
    except InputError:
        return None
    return (head["scenario_path"], head["variant"]), len(head["trials"])


def _stored(path: Path) -> tuple[dict[str, Any], Array, Array]:
    """What a state holds, checked: its head, and inputs and outputs (trials, n, joints) in rad. Raises InputError."""
    try:
        with ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > path.stat().st_size:
            raise _no_state(path, f"it would unpack to {size / 2**20:.3g} MiB, and states are not compressed")
        with np.load(path, allow_pickle=False) as stored:
            head = json.loads(str(stored["head"]))
            inputs, outputs = stored["inputs"], stored["outputs"]
        # A damaged file fails in the zip reader, in NumPy or in JSON, each with errors of its own.
    except InputError:
        raise
    except Exception as error:
        raise _no_state(path, str(error) or type(error).__name__) from error
    if wrong := misfit(head, {"scenario_path": str, "variant": str, "trials": [object], "*": object}):
        raise _no_state(path, wrong)
    count = len(head["trials"])
    if inputs.dtype != np.float64 or inputs.ndim != 3 or inputs.shape != outputs.shape or outputs.dtype != np.float64:
        raise _no_state(path, "its arrays are not those of trials")
    if len(inputs) != count or not all(_whole(trial, inputs.shape[2]) for trial in head["trials"]):
        raise _no_state(path, "its trials are not whole")
    return head, inputs, outputs


def _whole(trial: Any, joints: int) -> bool:
    """Whether a trial has a number for each joint where it has several, and numbers or nothing elsewhere."""
    if not isinstance(trial, dict):
        return False
    lists = {name: value if isinstance(value, list) else [value] for name, value in trial.items()}
    if any(len(lists.get(name, ())) != joints for name in ("largest", "rms")):
        return False
    items = [item for part in lists.values() for item in part]
    return all(item is None or (isinstance(item, int | float) and not isinstance(item, bool)) for item in items)


def _no_state(path: Path, why: str) -> InputError:
    message = f"is no state of a learning run, or is damaged ({why})"
    return InputError(message, file=path, hint="Delete it to begin anew", code="state")


def load_state(path: Path, digest: str) -> list[Trial]:
    """The trials of a state file. Raises InputError if it is unreadable or of another problem."""
    from asrsim.learning.trial import Trial

    head, inputs, outputs = _stored(path)
    if head.get("format") != FORMAT or head.get("fingerprint") != digest:
        raise InputError(
            "belongs to another learning run: robot, scenario, a file of theirs, or learning settings have changed",
            file=path,
            hint="Delete it, or leave out --resume, to begin anew",
            code="state-of-another-run",
        )
    try:
        return [
            Trial(
                **{**scalars, "largest": tuple(scalars["largest"]), "rms": tuple(scalars["rms"])},
                inputs=inputs[index],
                outputs=outputs[index],
            )
            for index, scalars in enumerate(head["trials"])
        ]
    except (TypeError, KeyError) as error:
        raise _no_state(path, f"its trials are not whole: {error}") from error
