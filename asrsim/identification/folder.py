"""Reads the folder of a fit, with the file fit.json and the file of curves. Other programs can also call `read_fit`."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError
from asrsim.identification.curves import CURVES, SHAPE, ChannelCurves, curves_of
from asrsim.identification.profiles import Profile
from asrsim.identification.replay import SHAPE as REPLAY
from asrsim.identification.replay import FitReplay, from_plain
from asrsim.identification.result import Estimate
from asrsim.identification.task import Tie
from asrsim.plain import PlainShape, misfit
from asrsim.samples import Array

FIT = "fit.json"
MOST_BYTES = 200_000_000
"""Largest size of a file that is read, in bytes."""
_NUMBER = (float, None)
_SHAPE: PlainShape = {
    "name?": str, "status": str, "fits": (bool, None), "accepted?": bool, "misfit": [str], "causes": [str], "remarks": [str],
    "next?": [str], "scenario": str, "experiments": [str], "variant?": (str, None),
    "overrides?": [str], "replay?": REPLAY, "ties?": [{"key": str, "to": str, "factor": float}],
    "evaluations": int, "seconds": float, "bandwidth?": float,
    "estimates": [
        {
            "key": str, "name": str, "unit": str, "start": float, "value": _NUMBER, "low": _NUMBER, "high": _NUMBER,
            "verdict": str, "reason": str, "track": (int, None), "is_place?": bool, "*": object,
        }
    ],
    "predictions?": [{"text": str, "*": object}],
    "channels": [{"recording": str, "key": str, "unit": str, "explained?": _NUMBER, "*": object}],
    "combinations?": [{"text": str, "value": _NUMBER, "margin": _NUMBER, "*": object}],
    "correlations?": [[_NUMBER]],
    "profiles?": [{"name": str, "values": [float], "rise": [_NUMBER]}],
    "*": object,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class FitFolder:
    """Contents of the folder of a fit."""

    folder: Path
    name: str
    status: str
    """Status of the fit: `complete`, `unfinished`, `interrupted` or `checked`."""
    fits: bool | None
    """Whether the model explains the recordings within their noise; None if the fit was not judged."""
    accepted: bool
    misfit: tuple[str, ...]
    """Reasons why the model does not fit."""
    causes: tuple[str, ...]
    """Sentences on effects that the model may lack, with the error that would remain if they were added."""
    predictions: tuple[str, ...]
    """Sentences on the errors of recordings that were predicted but not fitted."""
    remarks: tuple[str, ...]
    next: tuple[str, ...]
    """Proposals for the next recording."""
    scenario: str
    experiments: tuple[str, ...]
    variant: str | None
    overrides: tuple[str, ...]
    replay: FitReplay | None
    """Settings with which the fitted simulation repeats the first recording; None for a fit by an earlier version."""
    ties: tuple[Tie, ...]
    estimates: tuple[Estimate, ...]
    combinations: tuple[Mapping[str, Any], ...]
    correlations: Array
    """Correlations (n, n) of the estimates' errors. An unknown correlation is nan. The array is empty if the file lacks the
    correlations.
    """
    profiles: tuple[Profile, ...]
    channels: tuple[Mapping[str, Any], ...]
    """Errors of each channel, as in fit.json."""
    curves: tuple[ChannelCurves, ...]
    evaluations: int
    seconds: float


def read_fit(folder: str | os.PathLike[str]) -> FitFolder:
    """The fit in a folder, or in a file fit.json. Raises InputError if there is no fit, or if its file is damaged."""
    place = Path(folder)
    path = place if place.is_file() else place / FIT
    data = _read(path, _SHAPE, "fit.json of asrsim identify")
    curves: tuple[ChannelCurves, ...] = ()
    if (path.parent / CURVES).is_file():
        curves = curves_of(_read(path.parent / CURVES, SHAPE, "curves of asrsim identify"))
    known = {one.name for one in fields(Estimate)}
    estimates = tuple(_estimate({key: value for key, value in one.items() if key in known}) for one in data["estimates"])
    rows = data.get("correlations", [])
    square = len(rows) == len(estimates) and all(len(row) == len(rows) for row in rows)
    profiles = [one for one in data.get("profiles", ()) if len(one["values"]) == len(one["rise"])]
    texts = {name: tuple(data.get(name, ())) for name in ("misfit", "causes", "remarks", "next", "experiments", "overrides")}
    return FitFolder(
        folder=path.parent, name=data.get("name") or path.parent.parent.name, status=data["status"], fits=data["fits"],
        accepted=data.get("accepted", False), scenario=data["scenario"], estimates=estimates, **texts,
        predictions=tuple(one["text"] for one in data.get("predictions", ())),
        variant=data.get("variant"), replay=from_plain(data["replay"]) if "replay" in data else None,
        ties=tuple(Tie(**one) for one in data.get("ties", ())),
        combinations=tuple(data.get("combinations", ())), channels=tuple(data["channels"]), curves=curves,
        correlations=np.array([[_number(v) for v in row] for row in rows]) if square else np.empty((0, 0)),
        profiles=tuple(
            Profile(one["name"], np.array(one["values"]), np.array([_number(v) for v in one["rise"]])) for one in profiles
        ),
        evaluations=data["evaluations"], seconds=data["seconds"],
    )  # fmt: skip


def _estimate(data: dict[str, Any]) -> Estimate:
    return Estimate(**data | {name: _number(data[name]) for name in ("value", "low", "high")})


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _read(path: Path, shape: PlainShape, what: str) -> Any:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"is larger than {MOST_BYTES / 1e6:g} MB", file=path, code="too-large")
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot be read: {error}", file=path, hint=f"Expected {what}", code="unreadable-fit") from error
    if fault := misfit(data, shape):
        raise InputError(fault, file=path, hint=f"Expected {what}", code="unreadable-fit")
    return data
