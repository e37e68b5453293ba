"""Makes the summary of a run from the run and the data that were collected during the run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.errors import Problem
from asrsim.quantities import LIMITS
from asrsim.summary.data import JointReport, RunSummary

if TYPE_CHECKING:
    from asrsim.metrics import ExpectationResult
    from asrsim.simulation.run import Run
    from asrsim.summary.collect import Seen

NEAR = 1e-2
"""Distance up to which a joint counts as resting on a stop or at its reference, rad or m. For a joint whose stops are less than
1 rad or m apart, this number is a fraction of this range.
"""
STILL = 1e-6
"""Range of a joint's motion below which the joint counts as stuck, rad or m."""


def make_summary(
    run: Run,
    seen: Seen,
    *,
    samples: int,
    claims: tuple[ExpectationResult, ...] = (),
    files: Mapping[str, Path | tuple[Path, ...]] | None = None,
    replaced: tuple[Path, ...] = (),
) -> RunSummary:
    """Summary of a run. seen: data collected during the run; samples: number of logged samples."""
    scenario, info, counts = run.scenario, run.info, run.counts
    # Find the counts of each joint by its name. The counts are in the order of the robot's moving joints, but the joints in the
    # run's description are in the order of the samples.
    index = {joint.name: position for position, joint in enumerate(run.robot.moving_joints)}
    joints = tuple(
        JointReport(
            name=joint.name,
            actuator=joint.actuator,
            mode=joint.mode,
            prismatic=joint.prismatic,
            measures=measure,
            **{kind: int(getattr(counts, kind)[index[joint.name]]) for kind in LIMITS},
        )
        for joint, measure in zip(info.joints, seen.measures, strict=True)
    )
    return RunSummary(
        scenario=scenario.name,
        scenario_path=info.scenario_path,
        variant=scenario.variant,
        robot=info.robot,
        robot_path=info.urdf_path,
        status=run.status,
        message=run.message,
        duration=scenario.duration,
        simulated_time=run.simulated_time,
        wall_time=run.wall_time,
        step=scenario.step,
        log_every=scenario.log_every,
        substeps=run.resolution.substeps,
        motor_substeps=run.resolution.motor_substeps,
        total_substeps=counts.substeps,
        samples=samples,
        stepping=scenario.stepping,
        engine=scenario.engine,
        loop="compiled" if run.compiled else "plain",
        seed=scenario.seed,
        joints=joints,
        claims=claims,
        tip=seen.tip,
        warnings=(*run.warnings, *_on_stops(run, joints), *_stuck(run, joints, seen)),
        files=dict(files or {}),
        replaced=replaced,
        versions={name: info.metadata[name] for name in ("asrsim", "engine_version", "numpy") if name in info.metadata},
    )


def _on_stops(run: Run, joints: tuple[JointReport, ...]) -> Iterator[Problem]:
    """Warnings about joints that come to rest on a stop although their reference is elsewhere."""
    for joint in joints:
        limits = run.robot.joint(joint.name)
        rest, error = joint.measures.steady_state, joint.measures.steady_state_error
        near = NEAR * min(1.0, limits.stops[1] - limits.stops[0])
        stops = [stop for stop in limits.stops if abs(rest - stop) < near]
        if joint.stop and stops and not abs(error) < near:
            unit = "m" if joint.prismatic else "rad"
            message = f"comes to rest on its joint stop at {stops[0]:g} {unit}"
            message += f", {abs(error):.2g} {unit} from its reference" if math.isfinite(error) else ""
            hint = "`asrsim check` shows whether springs and motors can carry the arm's own weight"
            yield Problem(message, key=joint.name, hint=hint, code="on-stop")


def _stuck(run: Run, joints: tuple[JointReport, ...], seen: Seen) -> Iterator[Problem]:
    """Warnings about joints that never move because friction holds them away from their reference. A run that starts in
    equilibrium causes no such warnings.
    """
    if run.scenario.initial_equilibrium:
        return
    for joint, travel in zip(joints, seen.travels, strict=True):
        friction, error = run.robot.joint(joint.name).friction, joint.measures.steady_state_error
        if friction and not joint.stop and travel < STILL and abs(error) > NEAR:
            force, length = ("N", "m") if joint.prismatic else ("N m", "rad")
            message = (
                f"never moves, {abs(error):.2g} {length} from its reference: its friction of {friction:g} {force} holds it"
            )
            hint = "Choose stiffer springs, stronger motors, or less friction"
            yield Problem(message, key=joint.name, hint=hint, code="stuck")
