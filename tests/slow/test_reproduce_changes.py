"""Claims of the figures are sensitive: every changed law, mass or loss makes at least one claim fail."""

from pathlib import Path

import numpy as np
import pytest

from asrsim import run
from asrsim.errors import ScenarioError
from asrsim.reproduce import figures
from asrsim.robot import load_robot
from asrsim.robot.model import INERTIAS
from asrsim.robot.vary import varied_robot
from asrsim.scenario import load_scenario
from paper import chain, motors, newton
from paper.chain import five_links
from paper.lab import Lab
from paper.motors import departure
from paper.newton import ALTEREGO, hanging, level, read_motion
from support.paths import ROOT
from support.pinocchio_model import PinocchioModel

SCENARIOS = ROOT / "examples" / "scenarios"

FACTORS = (1.25, 0.75)


def scaled(robot, factor, *names):
    """Robot in which numbers of joints, links and actuators with these names are multiplied."""
    actuators = {block.joint: block.values() for block in robot.actuators}
    values = {
        joint.name: {"damping": joint.damping, "friction": joint.friction, **actuators.get(joint.name, {})}
        for joint in robot.moving_joints
    } | {
        link.name: {"mass": link.mass, **dict(zip(INERTIAS, link.inertia, strict=True))}
        for link in robot.links
        if link.mass and link.inertia
    }
    changes = {owner: {name: factor * given[name] for name in names if name in given} for owner, given in values.items()}
    return varied_robot(robot, changes)


def failing(figure, monkeypatch, folder, change, overrides=()):
    """Claims of a figure that fail if every robot is changed, or with overrides, without compilation and pictures."""
    original, changes = Lab.run, overrides

    def run(self, name, variant, **keywords):
        robot = keywords.pop("robot", None)
        overrides = [*keywords.pop("overrides", ()), *changes, "compiled=false"]
        if change is not None:
            robot = change(robot or load_robot(self.scenario(name, variant, overrides).robot))
        return original(self, name, variant, robot=robot, overrides=overrides, **keywords)

    monkeypatch.setattr(Lab, "run", run)
    monkeypatch.setattr(f"paper.figure_{figure}.picture", lambda *_, **__: None)
    monkeypatch.setattr("paper.figure_14.films", lambda *_, **__: ())
    parts = figures()[figure].parts(folder)
    return [claim.text for part in parts for claim in part.claims if not claim.holds]


CHANGES = {
    "masses": ("mass", *INERTIAS),
    "damping": ("damping",),
    "friction": ("friction",),
    "springs": ("spring_k_1", "spring_k_2"),
    "shape of the springs": ("spring_a_1", "spring_a_2"),
}
"""Numbers of arms that are changed together."""
MOTORS = {
    "inertia": ("motor_1_inertia", "motor_2_inertia"),
    "motor damping": ("motor_1_damping", "motor_2_damping"),
    "motor friction": ("motor_1_friction_torque", "motor_2_friction_torque"),
    "proportional gain": ("controller_1_proportional", "controller_2_proportional"),
    "derivative gain": ("controller_1_derivative", "controller_2_derivative"),
}
ARMS = ("11", "12", "13", "14")
CASES = [
    *(("8", names, "") for names in CHANGES.values()),
    *(("8", (name,), "") for name in ("spring_stiffness", "lever_length", "spring_k", "spring_exponent")),
    *((figure, names, "the links move") for figure in ARMS for names in CHANGES.values()),
    *((figure, names, "the motors move") for figure in ARMS for names in MOTORS.values()),
]
"""Figure, names of the changed numbers, and a part of the text of the claim that must fail."""


@pytest.mark.parametrize(
    ("what", "masses", "damping", "friction"),
    [
        ("none", 1.0, 0.065, 0.025),
        ("masses", 1.25, 0.065, 0.025),
        ("damping", 1.0, 0.08125, 0.025),
        ("friction", 1.0, 0.065, 0.03125),
        ("springs", 0.8, 0.052, 0.02),
    ],
)
@pytest.mark.parametrize("hangs", [True, False])
def test_newtons_law_recovers_masses_and_losses(what, masses, damping, friction, hangs):
    """The fit of Newton's law recovers the parameters of the arm. Stronger springs appear as smaller masses and losses."""
    name = "sine_2dof" if hangs else "step_2dof"
    scenario = load_scenario(
        SCENARIOS / f"{name}.yaml", variant="soft", overrides=["duration=2", "compiled=false", "expect=[]"]
    )[0]
    robot = load_robot(scenario.robot)
    result = run(scenario, robot=robot if what == "none" else scaled(robot, 1.25, *CHANGES[what]))
    motion = read_motion(result.samples, [ALTEREGO] * 2, hanging if hangs else level)
    assert (motion.masses, motion.damping, motion.friction) == pytest.approx((masses, damping, friction), rel=0.01)
    # Changed link masses do not affect the fitted motor parameters; changed springs do.
    assert (departure(result.samples, [ALTEREGO] * 2) <= 1e-6) == (what != "springs")


def test_five_link_dynamics_are_those_of_the_robot_file():
    robot = load_robot(ROOT / "examples" / "urdf" / "dof5_arm.urdf")
    model = PinocchioModel(robot.text, [joint.name for joint in robot.moving_joints])
    for q, v, a in np.random.default_rng(14).normal(size=(20, 3, 5)):
        assert five_links(*np.array([[q], [v], [a]]))[0] == pytest.approx(
            model.mass_matrix(q) @ a + model.bias(q, v), abs=1e-12
        )


def test_newtons_law_uses_no_simulator_code():
    text = "".join(Path(module.__file__).read_text(encoding="utf-8") for module in (newton, chain, motors))
    assert not [module for module in ("actuators", "robot", "engines", "kinematics") if f"asrsim.{module}" in text]
    assert "link_torque" not in text


@pytest.mark.slow
@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize(("figure", "names", "claim"), CASES)
def test_changed_numbers_fail_a_claim(figure, names, claim, factor, monkeypatch, tmp_path):
    try:
        found = failing(figure, monkeypatch, tmp_path, lambda robot: scaled(robot, factor, *names))
    except ScenarioError:
        # With some springs, the motors are too weak. A figure that cannot be run counts as failed.
        return
    assert [text for text in found if claim in text]


@pytest.mark.slow
@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("what", ["mass", "friction"])
def test_changed_box_fails_a_claim(what, factor, monkeypatch, tmp_path):
    value = factor * {"mass": 2.0, "friction": 0.23}[what]
    found = failing("14", monkeypatch, tmp_path, None, overrides=(f"world.objects.box.{what}={value}",))
    assert [text for text in found if "sliding box" in text]
