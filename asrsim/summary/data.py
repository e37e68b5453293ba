"""Data of a run's summary, for the terminal and for `summary.json`."""

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
"""Entries of a claim that `summary.json` contains unchanged, in this order."""


@dataclass(frozen=True, kw_only=True)
class JointReport:
    """Measures of a joint's motion, and the number of substeps at each limit."""

    name: str
    actuator: str
    """Registry name of the actuator; `rigid` for a joint without plugin."""
    mode: int | None
    prismatic: bool
    measures: JointSummary
    effort: int
    """Substeps in which the torque on the link was clipped at the URDF's effort limit."""
    velocity: int
    """Substeps in which the link was faster than the URDF's velocity limit (reported, not enforced)."""
    saturation: int
    """Substeps in which a motor was at its torque limit."""
    motor_stop: int
    """Substeps in which a motor was at its position stop."""
    motor_speed: int
    """Substeps in which a motor was at its speed limit."""
    deflection: int
    """Substeps in which a spring was beyond its largest deflection."""
    stop: int
    """Substeps in which the link was at its position limit; the energy dissipated by a stop appears in no other entry."""

    @property
    def limits(self) -> dict[str, int]:
        """Substeps at each limit of `asrsim.quantities.LIMITS`."""
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
    """Status: complete, interrupted or diverged."""
    message: str
    """Reason for a divergence."""
    duration: float
    """Requested duration, s."""
    simulated_time: float
    """Simulated time, s."""
    wall_time: float
    """Wall-clock time of the simulation loop, s."""
    step: float
    """Time step, s."""
    log_every: int
    substeps: int
    """Number of world substeps per step."""
    motor_substeps: int
    """Number of motor-and-spring substeps per world substep."""
    total_substeps: int
    """Total number of substeps in the run, to which the counts of the limits refer."""
    samples: int
    """Number of logged samples per joint."""
    stepping: str
    engine: str
    loop: str
    """Kind of the simulation loop: compiled or plain."""
    seed: int
    joints: tuple[JointReport, ...]
    claims: tuple[ExpectationResult, ...] = ()
    """Results of the scenario's `expect:`; empty for a run that did not complete."""
    tip: Mapping[str, float] = field(default_factory=dict)
    """Cartesian tasks: distance of the tip from its path in m: `largest`, `rms`, `last` (mean over the last tenth)."""
    warnings: tuple[Problem, ...] = ()
    files: Mapping[str, Path | tuple[Path, ...]] = field(default_factory=dict)
    """Files written, by kind: log, summary, plots, report."""
    replaced: tuple[Path, ...] = ()
    """Files of an earlier run that this run replaced."""
    certificate: Mapping[str, Any] = field(default_factory=dict)
    """Estimated numerical error of a certified run."""
    cross_check: Mapping[str, Any] = field(default_factory=dict)
    """Differences from a run in another engine, if requested (`asrsim.simulation.accuracy.cross_check`)."""
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
        """Whether the run completed, every claim holds, and no cross-check contradicts."""
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
