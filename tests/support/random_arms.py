"""Seeded random soft arms with motions to learn, as robot text and scenario, for tests and for the benchmark of learning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

KINDS = ("sea", "qbmove", "bavs")
MOTIONS = ("slow", "reach", "out_and_back", "multisine")
DURATIONS = {"slow": 20.0, "reach": 5.0, "out_and_back": 4.0, "multisine": 6.0}


@dataclass(frozen=True)
class Arm:
    """A random arm and a motion that it is to learn."""

    seed: int
    kind: str
    joints: int
    motion: str
    gravity: bool
    urdf: str
    scenario: dict

    @property
    def name(self) -> str:
        gravity = "gravity" if self.gravity else "flat"
        return f"arm {self.seed}: {self.joints} x {self.kind}, {self.motion}, {gravity}"

    def make(self, folder: Path, **ilc):
        """Write the robot and make the scenario. ilc: keys that are added to the block `ilc`."""
        from asrsim.scenario import make_scenario

        path = Path(folder) / f"arm_{self.seed}.urdf"
        path.write_text(self.urdf)
        keys = {**self.scenario, "ilc": {**self.scenario["ilc"], **ilc}}
        return make_scenario(path, **keys)


def spring(generator, kind: str, load: float) -> tuple[dict, float, float]:
    """Spring for a load in N m: its tags, its preset, and the torque that the motors need in N m."""
    if kind == "sea":
        k = max(load, 0.3) * generator.uniform(4.0, 30.0)
        return {"spring_k": k, "def_max": 0.8}, 0.0, 4.0 * load + 6.0
    if kind == "qbmove":
        a, scale = generator.uniform(5.0, 11.0), generator.uniform(0.01, 0.06)
        preset = generator.uniform(0.1, 0.35)
        tags = {}
        for motor in (1, 2):
            tags[f"spring_a{motor}"] = a * generator.uniform(0.9, 1.1)
            tags[f"spring_k{motor}"] = max(load, 0.3) * scale * generator.uniform(0.8, 1.2)
        pretension = max(load, 0.3) * scale * math.sinh(a * preset)
        return tags, preset, 4.0 * load + 6.0 + pretension
    scale = max(load, 0.3) * generator.uniform(0.5, 2.0)
    return {"spring_k": 1.6e5 * scale}, generator.uniform(0.05, 0.15), 4.0 * load + 8.0


def random_arm(seed: int, *, friction: bool = True) -> Arm:
    """Arm number `seed`: 1 to 5 joints with one actuator type, links of 0.3 to 2 kg, one of four motions, some friction."""
    generator = np.random.default_rng([2021, seed])
    kind = KINDS[generator.integers(len(KINDS))]
    motion = MOTIONS[seed % len(MOTIONS)]
    count = int(generator.integers(1, 6)) if motion != "slow" else int(generator.integers(1, 4))
    gravity = bool(generator.random() < 0.6)
    masses = generator.uniform(0.3, 2.0, count) * np.linspace(1.0, 0.5, count)
    lengths = generator.uniform(0.1, 0.3, count)
    weak = generator.random() < 0.15
    parts, joints, presets, trajectory = ['<link name="world"/>'], [], {}, {}
    parent, origin = "world", "0 0 1"
    for index in range(count):
        name, link = f"joint_{index + 1}", f"link_{index + 1}"
        mass, length = masses[index], lengths[index]
        # Largest joint torque under gravity, or in a swing of 0.5 rad within a second.
        beyond = sum(masses[j] * (sum(lengths[index:j]) + 0.5 * lengths[j]) for j in range(index, count))
        inertia = sum(masses[j] * (sum(lengths[index:j]) + 0.5 * lengths[j]) ** 2 for j in range(index, count))
        load = max(9.81 * 0.7 * beyond * gravity, 4.0 * inertia, 0.1)
        tags, preset, torque = spring(generator, kind, load)
        if weak:
            torque *= 0.2
        own = mass * length**2 / 12.0
        axis = "0 1 0" if index == 0 or generator.random() < 0.7 else ("1 0 0" if generator.random() < 0.7 else "0 0 1")
        joints.append(name)
        parts.append(
            f'<joint name="{name}" type="revolute"><origin xyz="{origin}"/><parent link="{parent}"/><child link="{link}"/>'
            f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="500" velocity="100"/>'
            f'<dynamics damping="{10 ** generator.uniform(math.log10(0.002), math.log10(0.2)):.6g}" '
            f'friction="{generator.choice([0.0, generator.uniform(0.0, 0.05)]) * friction:.6g}"/></joint>'
            f'<link name="{link}"><inertial><origin xyz="0 0 {-0.5 * length:.6g}"/><mass value="{mass:.6g}"/>'
            f'<inertia ixx="{own:.6g}" iyy="{own:.6g}" izz="{0.3 * own:.6g}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        motors = "".join(
            f"<mot_{motor}_tauMax>{torque:.6g}</mot_{motor}_tauMax>" for motor in ((1,) if kind == "sea" else (1, 2))
        )
        values = "".join(f"<{tag}>{value:.8g}</{tag}>" for tag, value in tags.items() if tag != "def_max")
        parts.append(
            f'<gazebo><plugin name="drive_{index}" filename="lib{kind}_plugin.so"><joint>{name}</joint>'
            f"<operation_mode>6</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state>"
            f"<sub_ext_tau>false</sub_ext_tau>{values}{motors}</plugin></gazebo>"
        )
        presets[name] = {} if kind == "sea" else {"stiffness_preset": float(preset)}
        trajectory[name] = _motion(generator, motion)
        parent, origin = link, f"0 0 {-length:.6g}"
    scenario = {
        "duration": DURATIONS[motion],
        "gravity": [0.0, 0.0, -9.81] if gravity else [0.0, 0.0, 0.0],
        "references": presets,
        "ilc": {"trajectory": trajectory, "tolerance": 0.005, "max_iterations": 15},
    }
    urdf = f'<?xml version="1.0"?>\n<robot name="arm_{seed}">' + "\n".join(parts) + "</robot>\n"
    return Arm(seed=seed, kind=kind, joints=count, motion=motion, gravity=gravity, urdf=urdf, scenario=scenario)


def _motion(generator, motion: str) -> dict:
    goal = float(generator.uniform(0.2, 0.8) * generator.choice([-1.0, 1.0]))
    if motion in ("slow", "reach"):
        return {"minimum_jerk": {"duration": DURATIONS[motion], "to": goal}}
    if motion == "out_and_back":
        return {
            "sum": [
                {"minimum_jerk": {"duration": 2.0, "to": goal}},
                {"minimum_jerk": {"start": 2.0, "duration": 2.0, "to": -goal}},
            ]
        }
    frequencies = np.sort(generator.choice([0.25, 0.5, 0.75, 1.0, 1.25], 3, replace=False))
    amplitudes = 0.5 * goal * generator.dirichlet(np.ones(3)) / np.maximum(frequencies / 0.5, 1.0)
    return {
        "multisine": {
            "frequencies": [float(f) for f in frequencies],
            "amplitude": [float(a) for a in amplitudes],
            "phase": [-0.5 * math.pi] * 3,
            "offset": float(amplitudes.sum()),
        }
    }
