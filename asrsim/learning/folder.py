"""The folder of a learning run: its files, and the rule that keeps the results of other runs.

It is the rule of `asrsim run`: results of the same scenario file and variant are replaced, and the caller says so; those
of another one are kept unless asked for.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from asrsim.learning.state import state_origin
from asrsim.outfile import check_output, remove_ours
from asrsim.runs.folder import inputs_of, recorded_origin, require_same
from asrsim.scenario.data import Scenario

STATE, INPUTS, DESIRED, PLAYBACK, NUMBERS, PICTURE, TRANSFER, LOG = (
    "state.npz", "learned.csv", "desired.csv", "learned.yaml", "ilc.json", "ilc.png", "transfer.png", "learned.mcap",
)  # fmt: skip
GUESS, GUESS_PLAYBACK = "guess.csv", "guess.yaml"
TRIALS = "trial_*.mcap"
NAMES = {
    STATE: "learning state", INPUTS: "learned input", DESIRED: "learned input", PLAYBACK: "learned scenario",
    NUMBERS: "json", PICTURE: "picture", TRANSFER: "picture", LOG: "log",
}  # fmt: skip
"""Files of a learning run, beside its trials' logs, and their kinds."""


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


def open_folder(folder: Path, scenario: Scenario, *, resume: bool = False, overwrite: bool) -> Earlier:
    """Look what the folder, which must be ours, holds; with `resume` nothing is to be replaced.

    Raises OutputError if it holds what another scenario or variant learned, what asrsim did not write, or what is read here.
    """
    there = {folder / name: kind for name, kind in NAMES.items()} | dict.fromkeys(sorted(folder.glob(TRIALS)), "log")
    for path, kind in there.items():
        check_output(path, kind, inputs=inputs_of(scenario))
    if resume:
        return Earlier()
    files = tuple(path for path in there if path.is_file())
    origin, trials = state_origin(folder / STATE) or (recorded_origin(folder / NUMBERS), 0)
    if files and not overwrite:
        require_same(folder, scenario, origin, "of learning that names no scenario")
    return Earlier(files=files, trials=trials, finished=(folder / NUMBERS).is_file())


def clear(earlier: Earlier, *, but: Collection[Path] = ()) -> None:
    """Take away an earlier run's files, so that none of them stands beside the new run's, which are `but` these.

    Raises OutputError.
    """
    for path in earlier.files:
        if path not in but:
            remove_ours(path, NAMES.get(path.name, "log"))
