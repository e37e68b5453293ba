"""State of a learning run on disk, so that an interrupted one goes on exactly where it was."""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from asrsim.errors import InputError, OutputError, Problem

if TYPE_CHECKING:
    from asrsim.learning.settings import LearningSettings
    from asrsim.learning.trial import LearningProblem, Trial

FORMAT = "asrsim learning state 1"
UNREADABLE = (
    OSError, ValueError, LookupError, EOFError, BadZipFile, TypeError, AttributeError, NotImplementedError, RuntimeError,
    SyntaxError, MemoryError, OverflowError, zlib.error,
)  # fmt: skip
"""What a damaged archive may raise."""


def fingerprint(problem: LearningProblem, settings: LearningSettings) -> str:
    """A hash of everything that decides how the learning goes, apart from where it stops."""
    kept = asdict(settings)
    for stop in ("tolerance", "max_iterations", "patience"):
        # A run may go on with a tighter tolerance or more iterations: its trials stay the same.
        del kept[stop]
    digest = hashlib.sha256(json.dumps([kept, problem.joints, problem.identity], sort_keys=True).encode())
    for array in (problem.time, problem.reference, problem.first_guess):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save_state(path: Path, mark: str, trials: list[Trial], *, origin: str = "") -> None:
    """Write all trials to `path` (NumPy's npz) beside it first, then put it in place in one move."""
    scalars = [
        {
            "number": trial.number,
            "largest": trial.largest,
            "norm": trial.norm,
            "rms": trial.rms,
            "seconds": trial.seconds,
            "ratio": trial.ratio,
            "predicted": trial.predicted,
        }
        for trial in trials
    ]
    beside = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            np.savez(
                file,
                head=np.array(json.dumps({"format": FORMAT, "fingerprint": mark, "origin": origin, "trials": scalars})),
                inputs=np.array([trial.inputs for trial in trials]),
                outputs=np.array([trial.outputs for trial in trials]),
            )
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise OutputError(f"cannot write the learning state {path}: {error.strerror}") from error


def state_origin(path: Path) -> tuple[str, int] | None:
    """Where a state comes from and how many trials it holds; None if it is no readable state."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            head = json.loads(str(stored["head"]))
        return str(head["origin"]), len(head["trials"])
    except UNREADABLE:
        return None


def load_state(path: Path, mark: str) -> list[Trial]:
    """The trials of a state file. Raises InputError if it is unreadable or of another problem."""
    from asrsim.learning.trial import Trial

    try:
        with np.load(path, allow_pickle=False) as stored:
            head = json.loads(str(stored["head"]))
            inputs, outputs = stored["inputs"], stored["outputs"]
        known = head["format"] == FORMAT and head["fingerprint"] == mark
        trials = [
            Trial(
                **{**scalars, "largest": tuple(scalars["largest"]), "rms": tuple(scalars["rms"])},
                inputs=inputs[index],
                outputs=outputs[index],
            )
            for index, scalars in enumerate(head["trials"])
        ]
    except UNREADABLE as error:
        raise InputError(
            Problem(message=f"is no state of a learning run ({error})", file=path, hint="Delete it to begin anew", code="state")
        ) from error
    if not known:
        raise InputError(
            Problem(
                message="belongs to another learning run: robot, scenario, a file of theirs, or learning settings have changed",
                file=path,
                hint="Delete it, or leave out --resume, to begin anew",
                code="state-of-another-run",
            )
        )
    return trials
