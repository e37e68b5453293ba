"""Reads recordings for claims that compare a run with a recording. The recordings are read, mapped and aligned as in `asrsim
plot`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.align import SampleReader, align_recording, simulated_sources
from asrsim.recordings.compare import Series, compare
from asrsim.recordings.data import Recording
from asrsim.recordings.matching import match_joints
from asrsim.recordings.read import read_cached
from asrsim.recordings.reading import modified
from asrsim.samples import JointInfo

if TYPE_CHECKING:
    from asrsim.scenario.data import Expectation


NO_OVERLAP = "`options: {lag: start}` of the claim aligns the first samples; `options: {lag: SECONDS}` states the lag"
"""Hint for a claim whose recording and run have no time in common."""


class RecordedSeries:
    """Recordings to which the claims about a run refer. A recording is aligned once for all claims with the same options."""

    def __init__(self, infos: Sequence[JointInfo], read: SampleReader) -> None:
        self._infos = infos
        self._read = read
        self._lags: dict[tuple[str, ...], float] = {}

    def series(self, claim: Expectation, joint: JointInfo) -> Series:
        """Series of the claim's quantity for a joint, in the run and in the recording, aligned by the claim's option `lag`. The
        text `reading` of the series ends with the doubts about the recording.

        Raises RecordingError if the file cannot be read, lacks the quantity, or does not overlap in time.
        """
        recording, pairing = require_columns(claim, self._infos, (joint,))
        options = claim.options
        key = (str(claim.against), *(str(options.get(name)) for name in ("lag", "map", "rate")))
        try:
            if key not in self._lags:
                lag = options.get("lag", "auto")
                self._lags[key] = align_recording(recording, pairing, self._read, lag=lag, infos=self._infos).lag
            samples = self._read(simulated_sources([claim.quantity], [joint]), (joint.name,))
            found = compare(samples, recording, infos=self._infos, quantities=(claim.quantity,), lag=self._lags[key])
        except RecordingError as error:
            raise RecordingError(
                replace(one, hint=NO_OVERLAP) if one.code == "no-overlap" else one for one in error.problems
            ) from None
        return replace(found.series[0], reading="; ".join((found.series[0].reading, *recording.doubts)))


def require_columns(
    claim: Expectation, infos: Sequence[JointInfo], about: Sequence[JointInfo]
) -> tuple[Recording, Mapping[str, str]]:
    """Recording that the claim's `against` names, and the joint of the run for each joint of the recording.

    The claim's options `map` and `rate` apply. Raises RecordingError if the file cannot be read, or lacks the claim's quantity
    for one of the joints in `about`.
    """
    path = Path(str(claim.against))
    joints, given = tuple(info.name for info in infos), claim.options.get("map", ())
    mapping = tuple(map(str, given if isinstance(given, list | tuple) else [given]))
    _, recording = read_cached(path, modified(path), mapping=mapping, joints=joints, rate=claim.options.get("rate"))
    pairing = match_joints(joints, recording)
    found = tuple(
        f"{pairing[str(column.joint)]}.{column.quantity}"
        for column in recording.channels.values()
        if column.quantity and column.joint in pairing
    )
    missing = [joint.name for joint in about if f"{joint.name}.{claim.quantity}" not in found]
    if missing:
        raise RecordingError(
            Problem(
                f"{path.name} has no column for {name}.{claim.quantity}, which `expect` compares",
                line=claim.line,
                key="expect",
                choices=found,
                code="no-such-quantity",
                hint=f"Its columns: {', '.join(list(recording.channels)[:30])}. Map a column with "
                f"options: {{map: ['COLUMN={name}.{claim.quantity}']}}",
            )
            for name in missing
        )
    return recording, pairing
