"""Trials on the real robot as a file, from which learning continues with the next recording."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.errors import InputError
from asrsim.outfile import make_folder, written
from asrsim.plain import misfit
from asrsim.robot.meshes import usable_shapes
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant
    from asrsim.learning.trial import LearningProblem, Trial
    from asrsim.scenario.blocks import Learning

FORMAT = "asrsim learning state 5"
DECIDING = ("law", "gain", "joint_gains", "gain_decay", "filter", "first_guess")
"""Keys of `ilc:` that determine the next trial. Other keys, such as the tolerance, may change between trials."""
NOT_OF_THE_PLANT = ("ilc", "expect", "log_rate")
"""Keys of a scenario that may change between trials."""


def identity_of(plant: Plant) -> str:
    """Hash of everything that the plant depends on: robot, scenario, contents of the files that they use, and laws of the
    actuators.
    """
    kept = {key: value for key, value in plant.scenario.resolved.items() if key not in NOT_OF_THE_PLANT}
    digest = hashlib.sha256(json.dumps(kept, sort_keys=True, default=str).encode())
    digest.update(plant.robot.text.encode())
    laws = [inspect.getsourcefile(ACTUATORS.get(drive.actuator.name)) for drive in plant.drives if drive.actuator]
    for path in (*sorted(_files(plant)), *(Path(law) for law in dict.fromkeys(laws) if law)):
        digest.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing")
    return digest.hexdigest()


def _files(plant: Plant) -> Iterator[Path]:
    """Files of the scenario (such as playbacks and meshes of objects), and collision meshes of the robot."""
    scenario = plant.scenario
    robot, _ = usable_shapes(plant.robot, package_paths=scenario.package_paths)
    meshes = [Path(shape.mesh) for link in robot.links for shape in link.collisions if shape.mesh]
    for path in (*scenario.attachments.values(), *meshes):
        # A ROS 2 bag is a folder.
        yield from path.rglob("*") if path.is_dir() else [path]


def fingerprint(problem: LearningProblem, settings: Learning) -> str:
    """Hash of everything that determines the trials, except the conditions that stop learning."""
    deciding = [getattr(settings, name) for name in DECIDING]
    text = json.dumps([deciding, problem.joints, problem.identity], sort_keys=True, default=asdict)
    digest = hashlib.sha256(text.encode())
    for array in (problem.time, problem.reference, problem.first_guess):
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


def save_state(path: Path, problem: LearningProblem, settings: Learning, state: State) -> None:
    """Write a state to `path` in NumPy's npz format; the file is replaced only when it is complete."""
    head = {
        "format": FORMAT, "fingerprint": fingerprint(problem, settings), "recordings": state.recordings,
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


def load_state(path: Path, problem: LearningProblem, settings: Learning) -> State:
    """State from a file; an empty state if the file is missing. Raises InputError if the file is unreadable or belongs to
    another problem.
    """
    if not path.exists():
        return State()
    head, inputs, outputs = _stored(path)
    if head["fingerprint"] != fingerprint(problem, settings) or inputs.shape[1:] != problem.reference.shape:
        message = "belongs to another learning run: robot, scenario, a file of theirs, or learning settings have changed"
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
