"""Trials on the real robot as a file, from which learning continues with the next recording."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
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

FORMAT = "asrsim learning state 5"


def fingerprint(problem: LearningProblem) -> str:
    """Hash of the motion. Trials of the real robot stay valid if the model of the robot or the law changes."""
    digest = hashlib.sha256(json.dumps(problem.joints).encode())
    for array in (problem.time, problem.reference):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@dataclass(frozen=True, kw_only=True)
class State:
    """Trials on the real robot, and the fit of the last twin."""

    trials: tuple[Trial, ...] = ()
    recordings: tuple[str, ...] = ()
    """Hash value of each trial's recording."""
    start: Mapping[str, float] = field(default_factory=dict)
    """Changes of parameters at which the fit of the last twin started."""
    changes: Mapping[str, float] = field(default_factory=dict)
    """Changes of parameters of the last twin."""


def save_state(path: Path, problem: LearningProblem, state: State) -> None:
    """Write a state to `path` in NumPy's npz format; the file is replaced only when it is complete."""
    head = {
        "format": FORMAT, "fingerprint": fingerprint(problem), "recordings": state.recordings,
        "start": dict(state.start), "changes": dict(state.changes),
    }  # fmt: skip
    make_folder(path.parent)
    with written(path, "learning state") as file:
        np.savez(
            file, head=np.array(json.dumps(head)), inputs=np.array([trial.inputs for trial in state.trials]),
            outputs=np.array([trial.outputs for trial in state.trials]),
        )  # fmt: skip
        file.flush()
        os.fsync(file.fileno())


def load_state(path: Path, problem: LearningProblem) -> State:
    """State from a file; an empty state if the file is missing. Raises InputError if the file is unreadable or belongs to
    another motion.
    """
    if not path.exists():
        return State()
    head, inputs, outputs = _stored(path)
    if head["fingerprint"] != fingerprint(problem) or inputs.shape[1:] != problem.reference.shape:
        message = "belongs to another motion: its joints, times or desired positions are others"
        raise InputError(message, file=path, hint="Delete it to start again", code="state-of-another-run")
    trials = (problem.trial(number, *row) for number, row in enumerate(zip(inputs, outputs, strict=True)))
    return State(
        trials=tuple(trials), recordings=tuple(head["recordings"]), start=head["start"], changes=head["changes"]
    )  # fmt: skip


def _stored(path: Path) -> tuple[dict[str, Any], Array, Array]:
    """Validated contents of a state: header, and inputs and outputs (trials, n, joints) in rad. Raises InputError."""

    def fault(why: str) -> InputError:
        message = f"is no state of a learning run, or is damaged ({why})"
        return InputError(message, file=path, hint="Delete it to start again", code="state")

    try:
        with ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > path.stat().st_size:
            raise fault(f"it would unpack to {size / 2**20:.3g} MiB, and states are not compressed")
        with np.load(path, allow_pickle=False) as stored:
            head = json.loads(str(stored["head"]))
            inputs, outputs = stored["inputs"], stored["outputs"]
        # A damaged file raises errors of the zip reader, of NumPy or of JSON.
    except InputError:
        raise
    except Exception as error:
        raise fault(str(error) or type(error).__name__) from error
    changes = {"*": float}
    shape = {"format": str, "fingerprint": str, "recordings": [str], "start": changes, "changes": changes, "*": object}
    if wrong := misfit(head, shape):
        raise fault(wrong)
    if head["format"] != FORMAT:
        raise fault(f"its format is {head['format']}")
    if inputs.dtype != np.float64 or inputs.ndim != 3 or inputs.shape != outputs.shape or outputs.dtype != np.float64:
        raise fault("its arrays are not those of trials")
    if not 0 < len(inputs) == len(head["recordings"]):
        raise fault("its trials are not whole")
    return head, inputs, outputs
