"""Evaluation of a scenario's claims (`expect:`) on the log of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.log import LogReader
from asrsim.metrics import ExpectationResult
from asrsim.metrics.expect import RECORDING_OPTIONS
from asrsim.recordings import Recording, read_recording
from asrsim.recordings.align import LagChoice
from asrsim.samples import RunInfo, Samples
from asrsim.scenario.carried import advising
from asrsim.scenario.data import Expectation


def logged_claims(info: RunInfo, folder: Path) -> tuple[Expectation, ...]:
    """Claims about the run's variant, from the scenario stored in its log. Recordings stored in the log are written to
    `folder`.

    Raises ScenarioError if this version cannot read the claims.
    """
    data = info.resolved.get("scenario", {})
    if not isinstance(data, dict) or not data.get("expect"):
        return ()
    from asrsim.runs.rerun import unpacked
    from asrsim.scenario import scenario_from_data

    robot = folder / "robot.urdf"
    robot.write_text(info.urdf or "<robot name='none'/>", encoding="utf-8")
    # Read only the claims and the names in them, since the robot and signal files of the run may be missing.
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


def claimed_readings(infos: Sequence[RunInfo], paths: Sequence[Path]) -> dict[Path, Mapping[str, Any]]:
    """Options `lag`, `map` and `rate` that the runs' claims state for each recording, by path.

    Pictures read a recording with the same options as the claims; otherwise the numbers in a picture would contradict the
    verdicts.
    """
    found: dict[Path, Mapping[str, Any]] = {}
    contents = {path: path.read_bytes() for path in paths if path.is_file()} if any(map(_claims, infos)) else {}
    for info in infos:
        for claim in _claims(info):
            options: Any = claim.get("options") or {}
            content = info.attachments.get(str(claim.get("against"))) if options else None
            for path in (path for path, known in contents.items() if content is not None and known == content):
                found.setdefault(path, {name: options[name] for name in RECORDING_OPTIONS if name in options})
    return found


def _claims(info: RunInfo) -> list[dict[str, Any]]:
    """Claims of a run, as plain data."""
    data = info.resolved.get("scenario", {})
    claims = data.get("expect") if isinstance(data, dict) else None
    return [claim for claim in claims if isinstance(claim, dict)] if isinstance(claims, (list, tuple)) else []


def claimed_clocks(infos: Sequence[RunInfo], recordings: Sequence[Recording]) -> dict[str, LagChoice]:
    """Lag that the runs' claims state for each recording, by the path of the recording."""
    readings = claimed_readings(infos, [recording.path for recording in recordings])
    return {str(path): options["lag"] for path, options in readings.items() if options.get("lag", "auto") != "auto"}


def claimed_recording(
    path: Path, infos: Sequence[RunInfo], *, mapping: Sequence[str] | Path | None = None, rate: float | None = None
) -> Recording:
    """Recording that is read with the options that the runs' claims state, unless `mapping` or `rate` are given. Raises
    RecordingError."""
    joints = [joint.name for joint in infos[0].joints] if infos else None
    if mapping is None and rate is None:
        options = claimed_readings(infos, [path]).get(path, {})
        items = options.get("map") or None
        mapping, rate = [items] if isinstance(items, str) else items, options.get("rate")
    return read_recording(path, mapping=mapping, joints=joints, rate=rate)


def judge(reader: LogReader) -> tuple[ExpectationResult, ...]:
    """Every claim with its verdict; empty for a run that did not complete. Raises ScenarioError and RecordingError."""

    def read(quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        return reader.read(quantities=quantities, joints=joints).samples

    if reader.status != "complete":
        return ()
    from asrsim.summary.claims import claim_results

    with TemporaryDirectory(prefix="asrsim-") as folder, advising(reader.info.attachments):
        claims = logged_claims(reader.info, Path(folder))
        return claim_results(claims, reader.info.joints, read, file=Path(reader.info.scenario_path or reader.path))
