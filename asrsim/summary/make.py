"""The summary of a run, from the run and its samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.summary.data import JointReport, RunSummary

if TYPE_CHECKING:
    from asrsim.metrics import ExpectationResult, JointSummary
    from asrsim.simulation.run import Run


def make_summary(
    run: Run,
    measures: Sequence[JointSummary],
    *,
    samples: int,
    claims: tuple[ExpectationResult, ...] = (),
    files: Mapping[str, Path | tuple[Path, ...]] | None = None,
    replaced: tuple[Path, ...] = (),
) -> RunSummary:
    """Summary of a run. measures: of the joints in the order of its description; samples: how many were logged of each."""
    scenario, info, counts = run.scenario, run.info, run.counts
    # Counts come in the order of the robot's moving joints, the description in that of the arrays.
    index = {joint.name: position for position, joint in enumerate(run.robot.moving_joints)}
    joints = tuple(
        JointReport(
            name=joint.name,
            actuator=joint.actuator,
            mode=joint.mode,
            prismatic=joint.prismatic,
            measures=measure,
            effort=int(counts.effort[index[joint.name]]),
            velocity=int(counts.velocity[index[joint.name]]),
            saturation=int(counts.saturation[index[joint.name]]),
            deflection=int(counts.deflection[index[joint.name]]),
            stop=int(counts.stop[index[joint.name]]),
        )
        for joint, measure in zip(info.joints, measures, strict=True)
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
        seed=scenario.seed,
        joints=joints,
        claims=claims,
        warnings=run.warnings,
        files=dict(files or {}),
        replaced=replaced,
        versions={name: info.metadata[name] for name in ("asrsim", "pybullet", "numpy") if name in info.metadata},
    )
