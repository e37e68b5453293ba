"""Symmetries of physics: a mirrored robot, exchanged motors, another unit of torque.

Every recorded quantity is compared, with springs, limits and losses all enabled. A missing term, or a wrong sign for one
motor or one side, breaks the symmetry.
"""

import re

import numpy as np
import pytest

import asrsim
from asrsim.quantities import LIMITS, QUANTITIES
from asrsim.simulation.run import simulate
from support.paths import ROOT

ROBOT = (ROOT / "examples/urdf/dof2_horizontal.urdf").read_text()
JOINTS = ("joint_1", "joint_2")
ENERGIES = [name for name, quantity in QUANTITIES.items() if quantity.unit == "J"]
EVEN = {"stiffness", *ENERGIES, "resolution", "foreseen stiffness", *(f"rows at its limit of {kind}" for kind in LIMITS)}
"""Quantities that keep their sign in the mirror image."""


def motor(draw, *, released):
    """Random parameters of a motor with losses and with limits that it reaches."""
    found = {
        "inertia": draw.uniform(0.01, 0.03),
        "damping": draw.uniform(0.1, 0.3),
        "max_torque": draw.uniform(2.0, 4.0),
        "min_position": -draw.uniform(0.1, 0.2),
        "max_position": draw.uniform(0.1, 0.2),
        "friction_torque": draw.uniform(0.05, 0.2),
        "friction_stiffness": draw.uniform(300.0, 900.0),
    }
    if not released:
        found |= {
            "max_velocity": draw.uniform(3.0, 6.0),
            "stribeck_friction": draw.uniform(0.02, 0.06),
            "stribeck_velocity": draw.uniform(0.05, 0.2),
            "load_friction": draw.uniform(0.01, 0.05),
            "torque_constant": draw.uniform(0.05, 0.1),
            "gear_ratio": 30.0,
            "resistance": draw.uniform(1.0, 2.0),
            "max_voltage": draw.uniform(5.0, 9.0),
            "max_current": draw.uniform(0.5, 2.0),
        }
    return {name: float(value) for name, value in found.items()}


def drawn(mode, stepping, actuator="qbmove", sensed=False):
    """Random case with two joints in a mode. sensed: sensors have a delay and a low rate, and motors have substeps."""
    draw, released = np.random.default_rng(10 * mode), stepping == "toolbox"
    size = {0: 3.0, 4: 3.0, 7: 8.0, 8: 1.5}.get(mode, 0.3)
    joints = {}
    for joint in JOINTS:
        parameters = {"max_deflection": 0.15}
        for i in (1, 2):
            parameters |= {f"motor_{i}_{name}": value for name, value in motor(draw, released=released).items()}
            gains = {"proportional": (40.0, 90.0), "integral": (5.0, 40.0), "derivative": (0.5, 2.0)}
            parameters |= {f"controller_{i}_{name}": float(draw.uniform(*ends)) for name, ends in gains.items()}
            parameters |= {f"spring_a_{i}": float(draw.uniform(6.0, 9.0)), f"spring_k_{i}": float(draw.uniform(0.01, 0.04))}
        if actuator == "sea":
            parameters = {name: value for name, value in parameters.items() if not re.search(r"_2(_|$)|spring_[ak]", name)}
            parameters["spring_stiffness"] = float(draw.uniform(2.0, 6.0))
        if not released:
            parameters |= {"hysteresis_torque": 0.03, "hysteresis_deflection": 0.02}
        references = [[size * float(x) for x in draw.uniform(-1.0, 1.0, 3)] for _ in (1, 2)]
        if mode in (3, 6):
            references[1] = [abs(x) + 0.05 for x in references[1]]
        start = {"position": float(draw.uniform(-0.05, 0.05)), "velocity": float(draw.uniform(-1.0, 1.0))}
        motors = [float(x) for x in draw.uniform(-0.05, 0.05, 1 if actuator == "sea" else 2)] if mode > 3 else []
        push = [float(x) for x in draw.uniform(-0.5, 0.5, 3)]
        joints[joint] = {"parameters": parameters, "references": references, "start": start, "motors": motors, "push": push}
    limits = {"lower": -0.12, "upper": 0.07, "effort": 0.06, "damping": 0.065, "friction": 0.025}
    case = {"mode": mode, "stepping": stepping, "actuator": actuator, "sensed": sensed}
    return {**case, "joints": joints, "limits": limits, "unit": 1.0}


def mirrored(case):
    """Mirror image of a case: signs of positions and torques change, and lower and upper limits are exchanged."""
    found = {}
    for joint, one in case["joints"].items():
        parameters = dict(one["parameters"])
        for i in (1, 2)[: 1 if case["actuator"] == "sea" else 2]:
            low, high = (f"motor_{i}_{end}_position" for end in ("min", "max"))
            parameters[low], parameters[high] = -parameters[high], -parameters[low]
        keeps = (False, case["mode"] in (3, 6))
        references = [x if kept else [-value for value in x] for x, kept in zip(one["references"], keeps, strict=True)]
        start = {name: -value for name, value in one["start"].items()}
        other = {"parameters": parameters, "references": references, "start": start, "motors": [-x for x in one["motors"]]}
        found[joint] = {**other, "push": [-x for x in one["push"]]}
    limits = {**case["limits"], "lower": -case["limits"]["upper"], "upper": -case["limits"]["lower"]}
    return {**case, "joints": found, "limits": limits}


def exchanged(case, *, references=True):
    """Case in which motors, springs and controllers 1 and 2 are exchanged."""
    found = {}
    for joint, one in case["joints"].items():
        order = -1 if references else 1
        parameters = {other_motor(name): value for name, value in one["parameters"].items()}
        found[joint] = {
            **one,
            "parameters": parameters,
            "references": one["references"][::order],
            "motors": one["motors"][::-1],
        }
    return {**case, "joints": found}


def other_motor(name):
    """Name of the same quantity of the other motor."""
    return re.sub(r"(motor_|torque_|controller_|spring_[ak]_|reference_)([12])", lambda m: f"{m[1]}{3 - int(m[2])}", name)


def recorded(case, folder):
    """Recorded values (n, joints) of each quantity."""
    limits = case["limits"]
    text = re.sub(r"<limit [^>]*/>", '<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="20"/>', ROBOT)
    text = re.sub(r"<dynamics [^>]*/>", '<dynamics damping="{damping}" friction="{friction}"/>', text)
    text = re.sub(r"<((?:spring|mot)_\w+)>[^<]*</\1>", "", text).replace("libqbmove", f"lib{case['actuator']}")
    for name, value in limits.items():
        text = text.replace(f"{{{name}}}", repr(value))
    grown = r'(mass value|ixx|ixy|ixz|iyy|iyz|izz)="([^"]*)"'
    text = re.sub(grown, lambda m: f'{m[1]}="{case["unit"] * float(m[2])!r}"', text)
    (folder / "arm.urdf").write_text(text)
    names = asrsim.actuators.MODES.get(case["mode"]).references
    joints, mode = case["joints"], case["mode"]
    scenario = asrsim.make_scenario(
        folder / "arm.urdf", duration=0.06, step=1e-3, engine="mujoco", compiled=False, stepping=case["stepping"],
        imperfections={"sensors": {"*": {"delay": 0.0021, "rate": 400}}} if case["sensed"] else {},
        motor_substeps=3 if case["sensed"] else 1, substeps=2 if case["sensed"] else None,
        modes=dict.fromkeys(JOINTS, mode), parameters={joint: one["parameters"] for joint, one in joints.items()},
        references={
            joint: {
                name: {"sinusoid": {"amplitude": a, "angular_frequency": 90.0, "offset": b}}
                for name, (a, b, _) in zip(names, one["references"], strict=False)
            }
            for joint, one in joints.items()
        },
        initial={
            joint: {**one["start"], **({"motor_positions": one["motors"]} if one["motors"] else {})}
            for joint, one in joints.items()
        },
        external_torques={
            joint: {"pulse_train": {"low": a, "high": b, "period": 0.0231, "width": 0.0107, "start": 0.0043}}
            for joint, (a, b, _) in ((joint, one["push"]) for joint, one in joints.items())
        },
    )  # fmt: skip
    made = simulate(scenario)
    assert made.samples is not None
    resolution = made.resolution
    # The resolution uses the smallest inertia of random postures, so it is accurate to three digits only.
    chosen = np.array([[resolution.substeps, resolution.motor_substeps, float(f"{resolution.omega_h:.3g}")]])
    met = {f"rows at its limit of {kind}": np.array([getattr(made.counts, kind)], float) for kind in LIMITS}
    return {**made.samples.values, **met, "resolution": chosen, "foreseen stiffness": np.array([resolution.stiffness])}


MODES = {"leapfrog": range(9), "euler": (1, 2, 5, 8), "toolbox": range(7)}
CASES = [(mode, stepping, "qbmove", False) for stepping, modes in MODES.items() for mode in modes]
CASES += [(mode, "leapfrog", "sea", False) for mode in range(1, 9)] + [(5, "toolbox", "sea", False)]
CASES += [
    (mode, stepping, actuator, True)
    for mode, stepping in ((1, "leapfrog"), (3, "leapfrog"), (5, "leapfrog"), (6, "leapfrog"), (8, "leapfrog"), (5, "euler"))
    for actuator in ("qbmove", "sea")
]
KINDS = ("mode", "stepping", "actuator", "sensed")


def alike(found, expected, what):
    """Assert that all defined values agree up to rounding. Toolbox stepping leaves some torques undefined."""
    size = float(np.nanmax(np.abs(expected), initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * size + 1e-300, err_msg=what)


@pytest.mark.parametrize(KINDS, CASES)
def test_mirrored_robot_moves_as_the_mirror_image(tmp_path, mode, stepping, actuator, sensed):
    """In modes whose references are equilibrium and preset, the mirror image also exchanges the motors."""
    case, exchanges = drawn(mode, stepping, actuator, sensed), mode in (3, 6) and actuator != "sea"
    even = EVEN | ({"reference_2"} if exchanges else set())
    turned = mirrored(case)
    if exchanges:
        turned = exchanged(turned, references=False)
    own, other = recorded(case, tmp_path), recorded(turned, tmp_path)
    assert own.keys() == other.keys()
    for name, values in own.items():
        image = other_motor(name) if exchanges and not name.startswith("reference") else name
        alike(other[image], values if name in even else -values, name)


@pytest.mark.parametrize(KINDS, [case for case in CASES if case[0] in (2, 4, 5, 7, 8) and case[2] != "sea"])
def test_exchanging_the_motors_of_a_joint_changes_nothing(tmp_path, mode, stepping, actuator, sensed):
    case = drawn(mode, stepping, actuator, sensed)
    own, other = recorded(case, tmp_path), recorded(exchanged(case), tmp_path)
    for name, values in own.items():
        alike(other[other_motor(name)], values, name)


# In toolbox stepping, the stiffness of the bristles is fixed.
