"""The folder of a learning run: its files, and the rule that keeps the results of other runs.

It is the rule of `asrsim run`: results of the same scenario file and variant are replaced, and the caller says so; those
of another one are kept unless asked for.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from asrsim.errors import OutputError
from asrsim.learning.state import state_origin
from asrsim.scenario.data import Scenario

STATE, INPUTS, DESIRED, PLAYBACK, NUMBERS, PICTURE, TRANSFER, LOG = (
    "state.npz", "learned.csv", "desired.csv", "learned.yaml", "ilc.json", "ilc.png", "transfer.png", "learned.mcap",
)  # fmt: skip
GUESS, GUESS_PLAYBACK = "guess.csv", "guess.yaml"
TRIALS = "trial_*.mcap"


@dataclass(frozen=True, kw_only=True)
class Earlier:
    """What a folder holds of an earlier learning run."""

    files: tuple[Path, ...] = ()
    trials: int = 0
    """In its state."""
    finished: bool = True
    """False: it was interrupted, and could be resumed."""

    def __str__(self) -> str:
        if not self.files:
            return ""
        what = "learning run" if self.finished else f"interrupted learning run with {self.trials} trials"
        return f"replaced {len(self.files)} file{'s' * (len(self.files) != 1)} of an earlier {what} of this scenario"


def origin_of(scenario: Scenario) -> str:
    """Scenario file and variant, as the state and the numbers keep it."""
    return json.dumps([str(scenario.path.resolve()) if scenario.path else "", scenario.variant])


def open_folder(folder: Path, scenario: Scenario, *, resume: bool = False, overwrite: bool = False) -> Earlier:
    """Make the folder and look what it holds; with `resume` nothing is to be replaced.

    Raises OutputError if it cannot be made, or holds what another scenario or variant learned.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {folder}: {error.strerror}") from error
    if resume:
        return Earlier()
    names = (STATE, INPUTS, DESIRED, PLAYBACK, NUMBERS, PICTURE, TRANSFER, LOG)
    files = (*(folder / name for name in names if (folder / name).is_file()), *sorted(folder.glob(TRIALS)))
    origin, trials = state_origin(folder / STATE) or (_recorded_origin(folder / NUMBERS), 0)
    if files and not overwrite and origin != origin_of(scenario):
        raise OutputError(
            f"{folder}: holds {_words(origin)}; nothing was written. Choose another folder with --out, or replace it with "
            f"--overwrite"
        )
    return Earlier(files=files, trials=trials, finished=(folder / NUMBERS).is_file())


def clear(earlier: Earlier) -> None:
    """Take away an earlier run's files, so that none of them stands beside the new run's. Raises OutputError."""
    for path in earlier.files:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"cannot replace {path}: {error.strerror}") from error


def _recorded_origin(path: Path) -> str:
    """The origin that `ilc.json` names; empty if there is none."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        data = json.loads(path.read_text(encoding="utf-8"))
        return json.dumps([data["scenario_path"], data["variant"]])
    return ""


def _words(origin: str) -> str:
    with suppress(ValueError, TypeError):
        path, variant = json.loads(origin)
        return f"what was learned from another scenario (variant '{variant}' of {path or 'a scenario without file'})"
    return "files of a learning run that names no scenario"
