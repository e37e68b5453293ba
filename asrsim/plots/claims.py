"""Evaluation of a scenario's claims (`expect:`) on the log of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.log import LogReader
from asrsim.metrics import ExpectationResult
from asrsim.recordings import Recording
from asrsim.recordings.align import LagChoice
from asrsim.samples import RunInfo, Samples
from asrsim.scenario.data import Expectation


def logged_claims(info: RunInfo, folder: Path) -> tuple[Expectation, ...]:
    """Claims about the run's variant, from the scenario stored in its log. Recordings stored in the log are written to
    `folder`.

    Raises ScenarioError if this version cannot read the claims.
    """
    data = info.resolved.get("scenario", {})
    if not isinstance(data, dict) or not data.get("expect"):
        return ()
    from asrsim.runs.repeat import unpacked
    from asrsim.scenario import scenario_from_data

    robot = folder / "robot.urdf"
    robot.write_text(info.urdf or "<robot name='none'/>", encoding="utf-8")
    # Read only the claims and the names in the claims: the robot and signal files of the run may be missing.
    world = data.get("world")
    named = world.get("objects") if isinstance(world, dict) else None
    objects = {str(name): {"shape": "sphere", "size": 1.0} for name in named or ()} if isinstance(named, dict) else {}
    scenario = scenario_from_data(
        {"duration": 1.0, "expect": data["expect"], "world": {"objects": objects}, "engine": data.get("engine")},
        base_dir=Path(info.scenario_path).parent if info.scenario_path else None,
        files=unpacked(info.attachments, folder / "files"),
        robot=robot,
        variant=info.variant,
    )
    return tuple(claim for claim in scenario.expect if claim.variant in (None, info.variant))


def claimed_clocks(infos: Sequence[RunInfo], recordings: Sequence[Recording]) -> dict[str, LagChoice]:
    """Lag that the runs' claims state for each recording, by the path of the recording.

    Pictures use the same lag as the claims; with another lag the numbers in a picture would contradict the verdicts.
    """
    found: dict[str, LagChoice] = {}
    for info in infos:
        data = info.resolved.get("scenario", {})
        claims = (data.get("expect") if isinstance(data, dict) else None) or ()
        for claim in claims if isinstance(claims, (list, tuple)) else ():
            options = claim.get("options") if isinstance(claim, dict) else None
            lag: Any = options.get("lag", "auto") if isinstance(options, dict) else "auto"
            content = info.attachments.get(str(claim.get("against"))) if lag != "auto" else None
            for recording in recordings if content is not None else ():
                if recording.path.is_file() and recording.path.read_bytes() == content:
                    found.setdefault(str(recording.path), lag)
    return found


def judge(reader: LogReader) -> tuple[ExpectationResult, ...]:
    """Every claim with its verdict; empty for a run that did not complete. Raises ScenarioError and RecordingError."""

    def read(quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        return reader.read(quantities=quantities, joints=joints).samples

    if reader.status != "complete":
        return ()
    from asrsim.summary.claims import claim_results

    with TemporaryDirectory(prefix="asrsim-") as folder:
        claims = logged_claims(reader.info, Path(folder))
        return claim_results(claims, reader.info.joints, read, file=Path(reader.info.scenario_path or reader.path))
