"""The paper's figures run again: measuring, judging, the page, the command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from asrsim import run
from asrsim.actuators import ACTUATORS
from asrsim.errors import SimulationError
from asrsim.reproduce import Claim, FigurePart, FigurePicture, FigureTable, PaperFigure, Reproduction, near, run_figure
from asrsim.reproduce import figures as paper_figures
from asrsim.robot import load_robot
from asrsim.scenario import apply_to_robot, load_scenario
from paper import statics
from paper.friction import held_by_friction
from paper.law import swings
from paper.ringing import fit_ringing
from paper.statics import ARM, GRAVITY, INERTIA, MASS, SPRINGS, STEP, losses, rest
from support.pages import Page
from support.paths import EXAMPLES

EQUILIBRIA = {
    ("sea", "soft"): (0.79972, 200.0),
    ("awas_ii", "soft"): (0.77988, 2.741),
    ("awas_ii", "stiff"): (0.79998, 3555.6),
    ("bavs", "soft"): (0.79442, 10.05),
    ("bavs", "stiff"): (0.79877, 45.57),
    ("qbmove", "soft"): (0.57767, 0.400),
    ("qbmove", "stiff"): (0.78538, 3.817),
}
"""Position (rad) and stiffness (N m/rad) of figure 8, worked out elsewhere."""


def claim(measured=1.0, **changes):
    return Claim(
        **{"text": "it <moves>", "quantity": "travel", "measured": measured, "bound": near(1.0, 0.1, "rad"), **changes}
    )


def figure(*claims, number=99, error=None):
    def parts(lab):
        if error:
            raise SimulationError(error)
        picture = FigurePicture(
            name=f"dot_{number}", caption="A dot & more", kind="svg", data=b"<svg xmlns='http://www.w3.org/2000/svg'/>"
        )
        table = FigureTable(caption="Numbers", headings=("", "rad"), rows=(("soft", "1.0"),))
        return (FigurePart(title="Part", text="Text", claims=claims, tables=(table,), pictures=(picture,)),)

    return PaperFigure(number=number, title="A figure", section="9", paper="It moves.", parts=parts)


@pytest.mark.parametrize(("measured", "holds"), [(1.0, True), (1.1, True), (1.2, False), (math.nan, False)])
def test_a_claim_of_nan_never_holds(measured, holds):
    assert claim(measured).holds is holds
    judged = Reproduction(name="8", parts=figure(claim(measured)).parts(None))
    (written,) = json.loads(json.dumps(judged.as_dict(), allow_nan=False))["claims"]
    assert written["holds"] is holds


@pytest.mark.parametrize("case", EQUILIBRIA)
def test_equilibria_of_figure_8_follow_from_the_closed_forms(case):
    position, stiffness = EQUILIBRIA[case]
    found = rest(case)
    assert found.position == pytest.approx(position, abs=1e-5)
    assert found.spring == pytest.approx(stiffness, rel=1e-3)


@pytest.mark.parametrize("case", SPRINGS)
def test_the_closed_forms_agree_with_the_simulator(case):
    name, variant = case
    scenario = load_scenario(EXAMPLES / "scenarios" / f"step_1dof_{name}.yaml", variant=variant)[0]
    robot = apply_to_robot(scenario, load_robot(scenario.robot))
    (block,) = robot.actuators
    law = ACTUATORS.get(name)
    values = tuple(block.values()[parameter.name] for parameter in law.parameters)
    preset = float(scenario.references["joint_1"]["stiffness_preset"].value) if name != "sea" else 0.0
    for deflection in (-0.04, 0.01, 0.045):
        motors = law.motor_references(0.3 + deflection, preset)
        assert SPRINGS[case].torque(deflection) == pytest.approx(sum(law.elastic_torques(0.3, *motors, values)), rel=1e-12)
        assert SPRINGS[case].slope(deflection) == pytest.approx(law.stiffness(0.3, *motors, values), rel=1e-12)
    assert "asrsim.actuators" not in Path(statics.__file__).read_text(encoding="utf-8")


def test_friction_widens_the_rest_to_a_band():
    case = ("qbmove", "soft")
    free, held = rest(case), rest(case, damping=0.065, friction=0.025)
    assert free.lowest == free.position == free.highest
    assert held.lowest < held.position < held.highest
    assert held.outside(held.position) == 0.0
    assert held.outside(held.highest + 0.1) == pytest.approx(0.1)
    assert held.outside(held.lowest - 0.2) == pytest.approx(0.2)
    # Small bands are friction over slope.
    small = rest(case, friction=1e-6)
    assert small.highest - small.position == pytest.approx(1e-6 / small.slope, rel=1e-3)


def test_losses_are_read_from_a_motion_that_has_them():
    """Leapfrog of Newton's law with known damping and friction."""
    case, step, damping, friction = ("awas_ii", "soft"), 1e-3, 0.03, 0.01
    q, v, found = 0.6, 0.0, []
    for _ in range(600):
        found.append(q)
        force = float(SPRINGS[case].torque(STEP - q)) - MASS * GRAVITY * ARM * math.sin(q)
        # Viscous and dry losses, implicit: a sum that stops the joint stops it.
        free = v + step * force / INERTIA
        slowed = max(abs(free) - step * friction / INERTIA, 0.0) / (1 + step * damping / INERTIA)
        v = math.copysign(slowed, free)
        q += step * v
    got = losses(case, np.array(found), step)
    assert got.damping == pytest.approx(damping, rel=0.06)
    assert got.friction == pytest.approx(friction, rel=0.06)


def test_swings_are_counted_beyond_their_floor():
    time = np.linspace(0, 1, 1001)
    ringing = 1.0 - np.exp(-3 * time) * np.cos(2 * np.pi * 4 * time)
    assert swings(ringing, 1.0) == 8
    assert swings(np.minimum(ringing, 1.0 + 0.01), 1.0) == 0


@pytest.mark.parametrize("decay", [2.0, 30.0, 200.0])
def test_a_ringing_has_its_natural_frequency_and_decay(decay):
    """Natural frequency 40 Hz, damping ratio up to 0.8."""
    time = np.arange(4001) * 1e-3
    omega = np.sqrt((2 * np.pi * 40.0) ** 2 - decay**2)
    velocity = np.where(time > 0.1, np.exp(-decay * (time - 0.1)) * np.sin(omega * (time - 0.1)), 0.0)
    found = fit_ringing(time, velocity, start=0.1)
    assert found.frequency == pytest.approx(40.0, rel=1e-6)
    assert found.decay == pytest.approx(decay, rel=1e-5)
    assert np.isnan(fit_ringing(time[:100], np.eye(1, 100, 50)[0], start=-1.0).natural)


def test_a_joint_held_by_friction_is_named():
    scenario = EXAMPLES / "scenarios" / "chirp_1dof_qbmove.yaml"
    short = ["duration=2", "references.joint_1.equilibrium_position.chirp.duration=2"]
    (held,) = held_by_friction(run(scenario, variant="nominal_soft", overrides=short))
    assert held.friction == 0.025
    assert 0.015 < held.torque < 0.0213
    assert "friction holds joint_1" in str(held)
    assert held_by_friction(run(scenario, variant="nominal_stiff", overrides=short)) == ()


@pytest.fixture
def figures(monkeypatch):
    """Figures of our own in place of the paper's, by name."""
    own = {}
    for module in ("asrsim.reproduce", "asrsim.reproduce.data"):
        monkeypatch.setattr(f"{module}.figures", lambda: own)
    return own


def test_the_page_needs_nothing_else_and_says_everything(asrsim_command, figures, tmp_path):
    figures["99"] = figure(claim(), claim(2.0, text="it moves far"))
    figures["7"] = figure(claim(), number=7)
    result = asrsim_command("reproduce", "--out", "here", "--workers", "1")
    assert result.code == 1
    assert "FAIL figure 99: it moves far: travel is 2 rad, expected 1 ± 0.1 rad" in result.err
    found = Page(tmp_path / "here" / "reproduce.html")
    assert found.addresses
    assert all(address.startswith(("data:", "#")) for address in found.addresses)
    assert "url(" not in found.source
    assert "@import" not in found.source
    assert "it <moves>" in found.text
    assert "does not hold" in found.text
    assert found.source.index("figure-7") < found.source.index("figure-99")
    data = json.loads((tmp_path / "here" / "reproduce.json").read_text())
    assert [one["holds"] for one in data["figures"]] == [True, False]
    assert (tmp_path / "here" / "pictures" / "dot_99.svg").is_file()


def test_a_figure_that_fails_does_not_stop_the_others(asrsim_command, figures):
    figures["7"] = figure(number=7, error="the box is gone")
    figures["99"] = figure(claim())
    result = asrsim_command("reproduce", "--out", "here", "--workers", "1", "--json")
    assert result.code == 1
    data = json.loads(result.out)
    assert data["ok"] is False
    assert [(one["figure"], one["holds"]) for one in data["figures"]] == [(7, False), (99, True)]
    assert "the box is gone" in data["figures"][0]["error"]


def test_the_command_ends_well_if_all_claims_hold(asrsim_command, figures):
    figures["99"] = figure(claim())
    result = asrsim_command("reproduce", "99", "--out", "here", "--quiet")
    assert (result.code, result.out, result.err) == (0, "", "")


def test_an_unknown_figure_is_refused_with_the_known_ones(asrsim_command):
    result = asrsim_command("reproduce", "9", "--out", "here")
    assert result.code == 1
    assert "choose from" in result.err
    assert "11" in result.err


def test_the_paper_s_figures_are_there():
    assert [*paper_figures()] == ["8", "11", "12", "13", "14", "15"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["8", "11", "12", "13", "14", "15"])
def test_every_claim_of_the_figure_holds(name, tmp_path):
    found = run_figure(name, tmp_path)
    assert found.error == ""
    assert found.claims
    assert [(c.text, c.found, str(c.bound)) for c in found.claims if not c.holds] == []
