"""Random runs of random robots with every actuator and mode, springs, damping and input jumps.

A run is given as keys of a scenario and as plain numbers for the independent solution (`independent_ode`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators import MODES
from support.random_robots import random_urdf

SPRINGS = {
    "sea": {"spring_stiffness": (5.0, 40.0), "max_deflection": (0.5, 1.5)},
    "qbmove": {"spring_a_1": (4.0, 8.0), "spring_a_2": (4.0, 8.0), "spring_k_1": (0.01, 0.1), "spring_k_2": (0.01, 0.1)},
    "bavs": {"spring_a": (1e-6, 2e-6), "spring_b": (2e-6, 3e-6), "spring_k": (1e5, 2e5), "spring_exponent": (6.0, 9.0)},
    "awas_ii": {"spring_stiffness": (5.0, 15.0), "lever_length": (0.04, 0.06), "pulley_radius": (0.012, 0.018)},
}
"""Smallest and largest value of each randomly drawn parameter."""
PRESETS = {"sea": 0.0, "qbmove": 0.2, "bavs": 0.1, "awas_ii": 0.012}


@dataclass(frozen=True)
class Wave:
    """Signal offset + amplitude sin(2 pi f t) that jumps by `jump` at the time `at` in s (inf: no jump)."""

    offset: float
    amplitude: float
    frequency: float
    at: float
    jump: float

    def __call__(self, t: float, after: bool = True) -> float:
        raised = self.jump if t > self.at or (t == self.at and after) else 0.0
        return self.offset + self.amplitude * float(np.sin(2.0 * np.pi * self.frequency * t)) + raised

    def keys(self) -> Any:
        """Signal as data of a scenario."""
        parts: list[Any] = [{"sinusoid": {"amplitude": self.amplitude, "frequency": self.frequency, "offset": self.offset}}]
        if np.isfinite(self.at):
            parts.append({"step": {"at": self.at, "to": self.jump}})
        return {"sum": parts}


@dataclass(frozen=True)
class JointSpec:
    """Properties of a joint, in SI units."""

    name: str
    kind: str
    damping: float
    effort: float
    spring: float
    rest: float
    start: float
    speed: float
    actuator: str = ""
    mode: int = 0
    parameters: dict[str, float] = field(default_factory=dict)
    references: tuple[Wave, ...] = ()
    external: Wave | None = None
    motors: tuple[tuple[float, float], ...] = ()
    """Start position and velocity of each motor. Empty: motors start at rest at the position of the link."""
    delay: float = 0.0
    """Delay of the commands, s."""
    constant_damping: float = 0.0
    """Damping that the scenario adds to `damping`, N m s/rad."""


@dataclass(frozen=True)
class RandomRun:
    """A robot with its inputs and initial state."""

    urdf: str
    joints: tuple[JointSpec, ...]
    gravity: tuple[float, float, float]
    rpy: tuple[float, float, float]
    fixed: bool
    duration: float
    jumps: tuple[float, ...]

    def keys(self) -> dict[str, Any]:
        """Keys of the scenario."""
        keys: dict[str, Any] = {
            "duration": self.duration,
            "gravity": list(self.gravity),
            "base": {"rpy": list(self.rpy), "fixed": self.fixed},
            "initial": {j.name: _start(j) for j in self.joints},
        }
        if damping := {j.name: {"constant": j.constant_damping} for j in self.joints if j.constant_damping}:
            keys["link_damping"] = damping
        if late := {j.name: {"delay": j.delay} for j in self.joints if j.delay}:
            keys["imperfections"] = {"commands": late}
        driven = [joint for joint in self.joints if joint.actuator]
        if driven:
            keys["actuators"] = {j.name: {"type": j.actuator, "mode": j.mode, "parameters": j.parameters} for j in driven}
            keys["references"] = {
                j.name: {name: wave.keys() for name, wave in zip(MODES[j.mode].references, j.references, strict=False)}
                for j in driven
            }
        keys["external_torques"] = {j.name: j.external.keys() for j in self.joints if j.external is not None}
        return keys

    def write(self, folder: Path) -> Path:
        """Write the robot file, and return its path."""
        path = folder / "robot.urdf"
        path.write_text(self.urdf, encoding="utf-8")
        return path


def random_run(
    seed: int,
    *,
    moving: int = 4,
    fixed: bool = True,
    jumps: bool = True,
    friction: bool = False,
    duration: float = 0.3,
    passive: float = 0.2,
    extras: bool = False,
) -> RandomRun:
    """Random run number `seed`.

    passive: fraction of joints without actuator; friction: whether motors have Dahl friction; extras: see `_with_extras`.
    """
    source = np.random.default_rng([seed, 77])
    text = random_urdf(seed, moving=moving, fixed=3)
    found = re.findall(r'<joint name="(\w+)" type="(\w+)">', text)
    grid = float(source.integers(80, 120)) * 1e-3
    times = (grid, grid + 0.0507 + float(source.uniform(0.0, 0.9)) * 1e-3) if jumps else ()
    joints, extra = [], []
    for name, kind in found:
        if kind == "fixed":
            continue
        joint = _joint(source, name, kind, times, friction=friction, passive=passive)
        if extras and joint.actuator:
            joint = _with_extras(joint, source)
        joints.append(joint)
        extra.append(
            f'<gazebo reference="{name}"><springStiffness>{joint.spring!r}</springStiffness>'
            f"<springReference>{joint.rest!r}</springReference></gazebo>"
            if joint.spring
            else ""
        )
        text = _limits(text, joint)
    tilt = source.uniform(-1.0, 1.0, 3)
    return RandomRun(
        urdf=text.replace("</robot>", "".join(extra) + "</robot>"),
        joints=tuple(joints),
        gravity=(0.0, 0.0, -9.81) if source.random() < 0.7 else tuple(source.uniform(-6.0, 6.0, 3).tolist()),
        rpy=tuple(tilt.tolist()),
        fixed=fixed,
        duration=duration,
        jumps=tuple(sorted({*times, *(at + joint.delay for at in times for joint in joints)})),
    )


def _start(joint: JointSpec) -> dict[str, Any]:
    """Start state of the joint as data of a scenario."""
    start: dict[str, Any] = {"position": joint.start, "velocity": joint.speed}
    if joint.motors:
        start["motor_positions"], start["motor_velocities"] = (list(values) for values in zip(*joint.motors, strict=True))
    return start


def _with_extras(joint: JointSpec, source: np.random.Generator) -> JointSpec:
    """Joint to which random extras are added: electric motors, hysteresis of springs, moving motors at the start, delayed
    commands, additional damping."""
    parameters, mode, count = dict(joint.parameters), joint.mode, len([k for k in joint.parameters if k.endswith("_inertia")])
    changes: dict[str, Any] = {}
    if mode == 4:
        mode = int(source.choice([4, 7, 8]))
    for i in range(1, count + 1) if mode in (7, 8) or source.random() < 0.5 else ():
        volts = mode == 7 or source.random() < 0.5
        ends = {"torque_constant": (0.02, 0.06), "gear_ratio": (20.0, 60.0), "max_current": (1.0, 4.0)}
        if volts:
            ends |= {"resistance": (1.0, 4.0), "max_voltage": (4.0, 12.0)}
        parameters |= _drawn(source, ends, f"motor_{i}_")
        if mode in (5, 6):
            # The gains are in volts or amperes. Some are so high that motors reach their limits.
            gains = {"proportional": (10.0, 40.0), "integral": (0.0, 60.0), "derivative": (0.2, 1.5)}
            parameters |= _drawn(source, gains, f"controller_{i}_")
    if count and source.random() < 0.5:
        parameters |= {"hysteresis_torque": float(source.uniform(0.05, 0.4)), "hysteresis_deflection": 0.1}
    if count and source.random() < 0.5:
        off = source.uniform(-0.1, 0.1, (count, 2)) * (1.0, 10.0)
        changes["motors"] = tuple((joint.start + float(place), float(speed)) for place, speed in off)
    if source.random() < 0.5:
        changes["delay"] = float(source.integers(1, 30)) * 1e-3
    if source.random() < 0.3:
        changes["constant_damping"] = float(source.uniform(0.02, 0.2))
    return replace(joint, parameters=parameters, mode=mode, **changes)


def _drawn(source: np.random.Generator, ends: dict[str, tuple[float, float]], prefix: str = "") -> dict[str, float]:
    """Random number between the ends for each name."""
    return {prefix + name: float(source.uniform(*pair)) for name, pair in ends.items()}


def _limits(text: str, joint: JointSpec) -> str:
    """URDF text with the damping of the joint, and with limits that only its torque reaches."""
    effort = 1e6 if np.isinf(joint.effort) else joint.effort
    ends = "" if joint.kind == "continuous" else 'lower="-60" upper="60" '
    dynamics = f'<limit {ends}effort="{effort!r}" velocity="1000"/><dynamics damping="{joint.damping!r}" friction="0"/>'
    head, tail = text.split(f'<joint name="{joint.name}"')
    body, rest = tail.split("</joint>", 1)
    body = re.sub(r"<limit[^>]*/>", dynamics, body)
    return f'{head}<joint name="{joint.name}"{body}</joint>{rest}'


def _wave(
    source: np.random.Generator, size: float, times: tuple[float, ...], offset: float = 0.0, *, plus: bool = False
) -> Wave:
    """Random signal. plus: whether it stays above zero."""
    at = float(source.choice(times)) if times and source.random() < 0.7 else np.inf
    amplitude = float(source.uniform(0.1, 0.5 if plus else 1.0)) * size
    jump = float(source.uniform(0.1, 0.4) if plus else source.uniform(-0.6, 0.6)) * size
    return Wave(offset, amplitude, float(source.uniform(0.5, 3.0)), at, jump)


def _joint(
    source: np.random.Generator, name: str, kind: str, times: tuple[float, ...], *, friction: bool, passive: float
) -> JointSpec:
    plain: dict[str, Any] = {
        "name": name,
        "kind": kind,
        "damping": float(source.choice([0.0, source.uniform(0.02, 0.3)])),
        "effort": float(source.choice([np.inf, source.uniform(3.0, 10.0)], p=[0.7, 0.3])),
        "spring": float(source.uniform(2.0, 20.0)) if source.random() < 0.3 else 0.0,
        "rest": float(source.uniform(-0.4, 0.4)),
        "start": float(source.uniform(-0.5, 0.5)),
        "speed": float(source.uniform(-1.0, 1.0)) if source.random() < 0.5 else 0.0,
        "external": _wave(source, 1.0, times) if source.random() < 0.3 else None,
    }
    actuator = str(source.choice(list(SPRINGS)))
    mode = int(source.integers(0, 7))
    if source.random() < passive:
        return JointSpec(**plain)
    parameters = _drawn(source, SPRINGS[actuator]) if mode > 1 else {}
    motors = {"sea": 1, "awas_ii": 1}.get(actuator, 2)
    if mode == 1:
        gains = {"proportional": (5.0, 20.0), "integral": (0.0, 30.0), "derivative": (0.0, 1.0)}
        parameters |= _drawn(source, gains, "controller_1_")
    if mode > 3:
        for i in range(1, motors + 1):
            ends = {
                "inertia": (0.01, 0.03),
                "damping": (0.0, 0.4),
                "max_torque": (5.0, 9.0),
                "friction_torque": (0.05, 0.2) if friction else (0.0, 0.0),
            }
            parameters |= _drawn(source, ends, f"motor_{i}_")
            parameters[f"motor_{i}_max_velocity"] = 1e3
            if mode > 4:
                gains = {"proportional": (20.0, 80.0), "integral": (0.0, 100.0), "derivative": (0.5, 3.0)}
                parameters |= _drawn(source, gains, f"controller_{i}_")
    start, preset = plain["start"], PRESETS[actuator]
    first = _wave(source, 1.0, times) if mode in (0, 4) else _wave(source, 0.3, times, start)
    if actuator == "awas_ii":
        second: Wave | None = _wave(source, 0.3 * preset, times, preset, plus=True)
    elif actuator == "sea":
        second = None
    elif mode == 4:
        second = _wave(source, 0.5, times)
    elif mode in (3, 6):
        second = _wave(source, 0.3 * preset, times, preset, plus=True)
    else:
        second = _wave(source, 0.2, times, start)
    references = (first,) if mode < 2 or second is None else (first, second)
    return JointSpec(**plain, actuator=actuator, mode=mode, parameters=parameters, references=references)
