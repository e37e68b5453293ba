"""The claims (`expect:`) of the scenario in a log, evaluated on the log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from asrsim.log import LogReader
from asrsim.metrics import ExpectationResult
from asrsim.samples import RunInfo, Samples
from asrsim.scenario.data import Expectation


def logged_claims(info: RunInfo) -> tuple[Expectation, ...]:
    """Claims of the scenario in a log about its variant; raises ScenarioError if they cannot be read (any more)."""
    data = info.resolved.get("scenario", {})
    if not isinstance(data, dict) or not data.get("expect"):
        return ()
    from asrsim.scenario import scenario_from_data

    with TemporaryDirectory(prefix="asrsim-") as folder:
        robot = Path(folder) / "robot.urdf"
        robot.write_text(info.urdf or "<robot name='none'/>", encoding="utf-8")
        # The claims alone: a log must be judged without the files that its run needed.
        scenario = scenario_from_data(
            {"duration": 1.0, "expect": data["expect"]},
            base_dir=Path(info.scenario_path).parent if info.scenario_path else None,
            robot=robot,
            variant=info.variant,
        )
    return tuple(claim for claim in scenario.expect if claim.variant in (None, info.variant))


def judge(reader: LogReader) -> tuple[ExpectationResult, ...]:
    """Every claim with its verdict; none for a run that did not end. Raises ScenarioError and RecordingError."""
    claims = logged_claims(reader.info) if reader.status == "complete" else ()
    if not claims:
        return ()
    from asrsim.summary.claims import claim_results

    def read(quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        return reader.read(quantities=quantities, joints=joints).samples

    return claim_results(claims, reader.info.joints, read, file=Path(reader.info.scenario_path or reader.path))
