"""File with the trials of a learning run. From this file learning continues, in simulation or on the real robot."""

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

from asrsim.engines.libraries import numeric_versions
from asrsim.errors import InputError
from asrsim.outfile import make_folder, written
from asrsim.plain import misfit
from asrsim.robot.findings import LARGEST_NUMBER
from asrsim.samples import Array
from asrsim.scenario.digest import input_hashes

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant
    from asrsim.learning.trial import LearningProblem, Trial

FORMAT = "asrsim learning state 6"
STOPPING = ("tolerance", "max_iterations", "patience")
"""Keys of `ilc:` that only determine when learning ends. They may change before simulated learning is resumed."""


def motion_basis(problem: LearningProblem) -> dict[str, str]:
    """Hash of the motion. Only the motion must be unchanged, since trials of the real robot stay valid if the model of the
    robot or the law changes.
    """
    digest = hashlib.sha256(json.dumps(problem.joints).encode())
    for array in (problem.time, problem.reference):
        digest.update(np.ascontiguousarray(array).tobytes())
    return {"the motion (joints, times or desired positions)": digest.hexdigest()}


def simulation_basis(plant: Plant) -> dict[str, str]:
    """Hashes of all data that determine simulated trials: the versions of asrsim and its libraries, and all inputs."""
    versions = hashlib.sha256(json.dumps(numeric_versions()).encode()).hexdigest()
    inputs = input_hashes(plant.scenario, plant.robot, without={"ilc": STOPPING})
    return {"the version of asrsim or a library": versions, **inputs}


@dataclass(frozen=True, kw_only=True)
class LearningState:
    """State of a learning run: its trials in simulation or on the real robot. For the real robot, the state also contains the
    recordings and the fit of the last twin.
    """

    trials: tuple[Trial, ...] = ()
    recordings: tuple[str, ...] = ()
    """Hash value of each trial's recording; empty in simulation."""
    start: Mapping[str, float] = field(default_factory=dict)
    """Relative changes of parameters at which the fit of the last twin started, as in `LearningTwin.changes`."""
    changes: Mapping[str, float] = field(default_factory=dict)
    """Relative changes of parameters that the last twin has, as in `LearningTwin.changes`."""


def save_state(path: Path, basis: Mapping[str, str], state: LearningState) -> None:
    """Write a state to `path` in NumPy's npz format. An earlier file is replaced only when the new file is complete.

    basis: hashes of all inputs that must be unchanged when learning continues, by name of the input.
    """
    head = {
        "format": FORMAT,
        "basis": dict(basis),
        "recordings": state.recordings,
        "start": dict(state.start),
        "changes": dict(state.changes),
        "seconds": [trial.seconds for trial in state.trials],
    }
    make_folder(path.parent)
    with written(path, "learning state") as file:
        np.savez(
            file,
            head=np.array(json.dumps(head)),
            inputs=np.array([trial.inputs for trial in state.trials]),
            outputs=np.array([trial.outputs for trial in state.trials]),
        )
        file.flush()
        os.fsync(file.fileno())


def load_state(path: Path, basis: Mapping[str, str], problem: LearningProblem) -> LearningState:
    """State from a file; an empty state if the file does not exist. Raises InputError if the file is unreadable, or if its
    basis differs from `basis`.
    """
    if not path.exists():
        return LearningState()
    head, inputs, outputs = _stored(path)
    before = head["basis"]
    changed = [name for name in {**before, **basis} if before.get(name) != basis.get(name)]
    if changed:
        message = f"learning cannot continue, because these inputs have changed: {', '.join(changed)}"
        raise InputError(message, file=path, hint=f"Delete {path.name} to start again", code="state-of-another-run")
    if inputs.shape[1:] != problem.reference.shape:
        raise _fault(path, "its arrays of inputs have another size than the motion")
    rows = enumerate(zip(inputs, outputs, head["seconds"], strict=True))
    trials = (problem.trial(number, *row) for number, row in rows)
    return LearningState(
        trials=tuple(trials), recordings=tuple(head["recordings"]), start=head["start"], changes=head["changes"]
    )


def _fault(path: Path, why: str) -> InputError:
    message = f"is not the state of a learning run, or is damaged ({why})"
    return InputError(message, file=path, hint="Delete it to start again", code="state")


def _stored(path: Path) -> tuple[dict[str, Any], Array, Array]:
    """Checked contents of a state file: header, inputs (trials, n, joints) and outputs (trials, n, joints), rad. Raises
    InputError.
    """
    try:
        with ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > path.stat().st_size:
            raise _fault(path, f"it would unpack to {size / 2**20:.3g} MiB, and states are not compressed")
        with np.load(path, allow_pickle=False) as stored:
            head = json.loads(str(stored["head"]))
            inputs, outputs = stored["inputs"], stored["outputs"]
        # For a damaged file, the zip reader, NumPy or JSON raise errors of many types.
    except InputError:
        raise
    except Exception as error:
        raise _fault(path, str(error) or type(error).__name__) from error
    changes = {"*": float}
    shape = {
        "format": str,
        "basis": {"*": str},
        "recordings": [str],
        "start": changes,
        "changes": changes,
        "seconds": [float],
        "*": object,
    }
    if wrong := misfit(head, shape):
        raise _fault(path, wrong)
    if head["format"] != FORMAT:
        raise _fault(path, f"its format is '{head['format']}', which this version of asrsim cannot read")
    if inputs.dtype != np.float64 or inputs.ndim != 3 or inputs.shape != outputs.shape or outputs.dtype != np.float64:
        raise _fault(path, "its arrays have wrong shapes or types")
    if not 0 < len(inputs) == len(head["seconds"]) or len(head["recordings"]) not in (0, len(inputs)):
        raise _fault(path, "its trials are incomplete")
    # Ignore NaN in outputs, since the outputs of a trial that diverged are NaN.
    if not (np.abs(inputs).max(initial=0.0) <= LARGEST_NUMBER and np.nanmax(np.abs(outputs), initial=0.0) <= LARGEST_NUMBER):
        raise _fault(path, "its numbers are too large for a robot")
    return head, inputs, outputs
