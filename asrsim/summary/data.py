"""Data of the summary of a run, which the terminal shows and `summary.json` contains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.errors import Problem
from asrsim.plain import finite_or_none
from asrsim.quantities import LIMITS

if TYPE_CHECKING:
    from asrsim.metrics import ExpectationResult, JointSummary

FORMAT = 1
"""Version of the layout of `summary.json`."""
_OF_CLAIM = ("joint", "body", "quantity", "measure", "engine", "reference", "comparison", "value", "tolerance")
"""Fields of a claim that `summary.json` contains unchanged, in this order."""


@dataclass(frozen=True, kw_only=True)
class JointReport:
    """Measures of a joint's motion, and the number of substeps in which the joint was at each of its limits."""

    name: str
    actuator: str
    """Name of the joint's actuator in the registry; `rigid` for a joint whose URDF names no actuator plugin."""
    mode: int | None
    prismatic: bool
    measures: JointSummary
    effort: int
    """Number of substeps in which the torque on the link was limited to the effort limit in the URDF."""
    velocity: int
    """Number of substeps in which the link was faster than the velocity limit in the URDF, which is not enforced."""
    saturation: int
    """Number of substeps in which a motor of the joint was at its largest torque, current or voltage."""
    motor_stop: int
    """Number of substeps in which a motor of the joint was at its position stop."""
    motor_speed: int
    """Number of substeps in which a motor of the joint was at its speed limit."""
    deflection: int
    """Number of substeps in which a spring of the joint was beyond its largest deflection."""
    stop: int
    """Number of substeps in which the link was at a stop. The energy that a stop dissipates is in no entry of the summary."""

    @property
    def limits(self) -> dict[str, int]:
        """Number of substeps at each limit, by the names of the limits in `asrsim.quantities.LIMITS`."""
        return {kind: getattr(self, kind) for kind in LIMITS}

    def as_dict(self) -> dict[str, Any]:
        """The report as plain values for JSON."""
        about = {name: getattr(self, name) for name in ("name", "actuator", "mode", "prismatic")}
        return {**about, **self.measures.as_dict(), "limits": self.limits}


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """Summary of one run of one variant."""

    scenario: str
    """Name of the scenario."""
    scenario_path: str
    variant: str
    robot: str
    robot_path: str
    status: str
    """State in which the run ended: complete, interrupted or diverged."""
    message: str
    """Reason why the run diverged; empty for other runs."""
    duration: float
    """Duration that the scenario requests, s."""
    simulated_time: float
    """Time that the run has simulated, s."""
    wall_time: float
    """Wall-clock time of the simulation loop, s."""
    step: float
    """Time step of the scenario, s."""
    log_every: int
    substeps: int
    """Number of world substeps per step."""
    motor_substeps: int
    """Number of motor-and-spring substeps per world substep."""
    total_substeps: int
    """Number of substeps in the whole run. The reports on the joints count how many of these substeps were at each limit."""
    samples: int
    """Number of logged samples per joint."""
    stepping: str
    engine: str
    loop: str
    """Simulation loop that the run used: compiled or plain."""
    seed: int
    joints: tuple[JointReport, ...]
    claims: tuple[ExpectationResult, ...] = ()
    """Results of the scenario's `expect:`; empty for a run that did not complete."""
    tip: Mapping[str, float] = field(default_factory=dict)
    """For a Cartesian task: distance of the tip from its path in m: `largest`, `rms`, `last` (mean over the last tenth)."""
    warnings: tuple[Problem, ...] = ()
    files: Mapping[str, Path | tuple[Path, ...]] = field(default_factory=dict)
    """Files that the command has written, by kind: log, summary, plots, report."""
    replaced: tuple[Path, ...] = ()
    """Files of an earlier run that this run replaced."""
    certificate: Mapping[str, Any] = field(default_factory=dict)
    """Estimated numerical error, if the run was certified; else empty."""
    cross_check: Mapping[str, Any] = field(default_factory=dict)
    """Differences from a run in another engine, if the user requested them (`asrsim.simulation.accuracy.cross_check`)."""
    live: Mapping[str, Any] = field(default_factory=dict)
    """Data of a real-time run: lateness, load and commands (`asrsim.live.session.Session`)."""
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def speed(self) -> float:
        """Simulated seconds per wall-clock second."""
        return self.simulated_time / self.wall_time if self.wall_time > 0 else math.inf

    @property
    def failed_claims(self) -> tuple[ExpectationResult, ...]:
        """Claims that do not hold."""
        return tuple(claim for claim in self.claims if not claim.holds)

    @property
    def ok(self) -> bool:
        """Whether the run completed, every claim holds, and a cross-check, if there was one, does not contradict the run."""
        return self.status == "complete" and not self.failed_claims and not self.cross_check.get("finding")

    def joint(self, name: str) -> JointReport:
        """Report on the joint with this name; KeyError for an unknown name."""
        return {joint.name: joint for joint in self.joints}[name]

    def as_dict(self) -> dict[str, Any]:
        """Summary as data for JSON; undefined numbers are null."""
        return {
            "generator": f"asrsim {self.versions.get('asrsim', '')}",
            "format": FORMAT,
            "ok": self.ok,
            **{name: value for name, value in vars(self).items() if isinstance(value, str | int | float)},
            "speed": finite_or_none(self.speed),
            "joints": [joint.as_dict() for joint in self.joints],
            "expect": [_claim(claim) for claim in self.claims],
            **({"tip": dict(self.tip)} if self.tip else {}),
            "warnings": [warning.as_dict() for warning in self.warnings],
            "files": {
                kind: [str(path) for path in entry] if isinstance(entry, tuple) else str(entry)
                for kind, entry in self.files.items()
            },
            "replaced": [str(path) for path in self.replaced],
            "certificate": dict(self.certificate),
            "cross_check": dict(self.cross_check),
            **({"live": dict(self.live)} if self.live else {}),
            "versions": dict(self.versions),
        }


def _claim(result: ExpectationResult) -> dict[str, Any]:
    claim = result.expectation
    items: dict[str, Any] = {
        **{name: getattr(claim, name) for name in _OF_CLAIM},
        "against": str(claim.against) if claim.against is not None else None,
        "line": claim.line,
        "measured": finite_or_none(result.measured),
        "moving": result.moving or None,
        "unit": result.unit,
        "holds": result.holds,
        "reading": result.reading or None,
        "text": result.text,
    }
    return {key: value for key, value in items.items() if value is not None or key == "measured"}
