"""Closed chains against an equation of one freedom; the gap stays closed; what cannot be closed is refused in words."""

import re

import numpy as np
import pytest

import asrsim
from asrsim.cli.findings import robot_report
from asrsim.errors import AsrsimError, RobotError
from asrsim.exports import export
from asrsim.robot import read_robot
from support import four_bar
from support import parallelogram as pair
from validation.models import INSTALLED

LOOP, TORQUE = four_bar.LOOPS[0], 0.2


def run(folder, engine, *, step=1e-3, compiled=None, text=None, **keys):
    path = folder / "four_bar.urdf"
    path.write_text(text or four_bar.urdf())
    keys = {
        "duration": 1.0,
        "loops": four_bar.LOOPS,
        "initial": {"crank": 1.0, "coupler": -2.25, "rocker": -2.4},
        "substeps": 1,
        "external_torques": {"crank": TORQUE},
        **keys,
    }
    return asrsim.run(asrsim.make_scenario(path, engine=engine, step=step, compiled=compiled, **keys)).run.samples.values


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_four_bar_moves_at_second_order(tmp_path, engine):
    times, errors = np.linspace(0.0, 1.0, 11), []
    truth = four_bar.solve(times, TORQUE)
    for step in (2e-3, 1e-3):
        q = run(tmp_path, engine, step=step)["link_position"]
        errors.append(np.abs(q[np.round(times / step).astype(int), 0] - truth).max())
    assert np.ptp(truth) > 1.5
    assert errors[1] < 2e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def test_both_engines_and_the_compiled_loop_move_a_four_bar_equally(tmp_path):
    ends = [
        run(tmp_path, engine, compiled=compiled, duration=0.5)["link_position"]
        for engine in INSTALLED
        for compiled in (False, True)
    ]
    for k in range(0, len(ends), 2):
        np.testing.assert_array_equal(ends[k], ends[k + 1])
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-11)


def test_the_gap_of_a_loop_stays_closed(tmp_path):
    """For a minute: 60,000 steps."""
    q = run(tmp_path, "mujoco", duration=60.0, compiled=True, external_torques={})["link_position"]
    assert np.ptp(q[:, 0]) > 1.0
    assert four_bar.gap(q).max() < 1e-12


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_spring_drives_a_loop_through_its_master(tmp_path, engine):
    keys = {"actuators": {"crank": {"type": "sea", "mode": 6}}, "references": {"crank": {"equilibrium_position": 1.0}}}
    effort = '<limit effort="100" velocity="100"/>'
    values = run(tmp_path, engine, text=four_bar.urdf(effort), external_torques={}, substeps=None, duration=3.0,
                 link_damping={"crank": {"constant": 0.3}}, **keys)  # fmt: skip
    q = values["link_position"]
    assert np.abs(q[-1] - q[-200]).max() < 1e-3
    assert 0.0 < abs(q[-1, 0] - 1.0) < 0.1
    assert four_bar.gap(q).max() < 1e-12


@pytest.mark.parametrize("engine", INSTALLED)
def test_each_of_two_linkages_moves_as_if_it_were_alone(tmp_path, engine):
    """The second linkage has twice the torque of the first."""
    first = four_bar.urdf()
    second = re.sub(r'"(A|B|C|crank|coupler|rocker)"', r'"\1_2"', first.split('<link name="base"/>')[1])
    names, start = ("crank", "coupler", "rocker"), (1.0, -2.25, -2.4)
    both = run(
        tmp_path, engine, text=first.replace("</robot>", second), duration=0.1,
        loops=[LOOP, LOOP | {"links": ["B_2", "C_2"]}],
        initial=dict(zip((*names, *(f"{name}_2" for name in names)), start * 2, strict=True)),
        external_torques={"crank": TORQUE, "crank_2": 2.0 * TORQUE},
    )["link_position"]  # fmt: skip
    assert four_bar.gap(both[:, :3]).max() < 1e-12
    alone = run(tmp_path, engine, duration=0.1, external_torques={"crank": 2.0 * TORQUE})["link_position"]
    np.testing.assert_allclose(both[:, 3:], alone, rtol=0.0, atol=1e-11)


def beside(gap):
    """The loop of the four-bar linkage, with one point beside the plane of the linkage by a gap in m."""
    return {"loops": [LOOP | {"points": [[four_bar.COUPLER, gap, 0], [four_bar.ROCKER, 0, 0]]}]}


STOPS = "the joint stops where the gap would be larger"


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_gap_of_rounded_numbers_does_not_change_the_motion(tmp_path, engine):
    """No motion of a planar linkage moves its points across the plane, so a gap across the plane stays as it is."""
    exact, rounded = (run(tmp_path, engine, duration=0.5, **keys)["link_position"] for keys in ({}, beside(2e-5)))
    np.testing.assert_allclose(rounded, exact, rtol=0.0, atol=1e-9)
    scenario = asrsim.make_scenario(tmp_path / "four_bar.urdf", duration=0.1, **beside(2e-5))
    found = [problem for problem in asrsim.prepare(scenario).warnings if problem.code == "loop-gap"]
    assert [(problem.key, problem.value) for problem in found] == [("crank", "up to 0.02 mm")]
    assert STOPS not in found[0].message


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_linkage_stops_where_its_gap_would_exceed_rounding(tmp_path, engine):
    """A ratio of gears that contradicts the parallelogram by 5 % opens a gap that grows with the angle."""
    gears = 'lower="-9" upper="9" effort="100" velocity="99"/><mimic joint="crank" multiplier="1.05" offset="-0.06"'
    q = swing(tmp_path, engine, pair.BALL, limit=gears)
    ends = [pair.A * np.exp(1j * q[:, 0]) + pair.B * np.exp(1j * (q[:, 0] + q[:, 1])), pair.B + pair.A * np.exp(1j * q[:, 2])]
    gaps = np.abs(ends[0] - ends[1])
    assert 0.8e-4 < gaps.max() < 1.001e-4
    assert 1.21 < q[-1, 0] < turned(pair.INERTIA) - 0.03
    assert np.abs(q[-20:, 0] - q[-1, 0]).max() < 1e-9
    scenario = asrsim.make_scenario(tmp_path / "parallelogram.urdf", initial=pair.START, duration=0.1)
    assert any(problem.code == "loop-gap" and STOPS in problem.message for problem in asrsim.prepare(scenario).warnings)


def test_a_chain_that_is_open_at_the_usual_start_is_said_to_start_elsewhere(tmp_path):
    """With a crank at 0, the coupler of 0.35 m passes over the ends of the rocker of 0.05 m, 0.25 m away."""
    path = tmp_path / "four_bar.urdf"
    path.write_text(four_bar.urdf())
    loops = [LOOP | {"points": [[0.35, 0, 0], [0.05, 0, 0]]}]
    ready = asrsim.prepare(asrsim.make_scenario(path, duration=0.1, loops=loops))
    (found,) = [problem for problem in ready.warnings if problem.code == "loop-start"]
    assert f"crank: {ready.initial_positions[0]:.4g}" in found.value


def test_check_of_a_robot_file_warns_of_its_loops(tmp_path):
    """A coupler of 0.2 m is too short for the crank to turn fully, and the rocker's limits exclude its place at the start."""
    path = tmp_path / "four_bar.urdf"
    bar = '<loop_joint name="pin" type="revolute"><link1 link="B" xyz="0.2 0 0"/><link2 link="C" xyz="0.3 0 0"/></loop_joint>'
    path.write_text(
        four_bar.urdf('<limit lower="9" upper="9.1" effort="9" velocity="9"/>').replace("</robot>", f"{bar}</robot>")
    )
    path.write_text(path.read_text().replace('name="rocker" type="continuous"', 'name="rocker" type="revolute"'))
    found = {problem.code: problem for problem in robot_report(path).warnings}
    assert found["loop-limits"].key == "rocker"
    assert found["dead-centre"].key == "crank"
    assert found["dead-centre"].file == path


REFUSED = {
    "a gap above rounding": (beside(2e-4), "no positions of its joints close the loop; a gap of 0.0002 m"),
    "no start closes it": ({"loops": [LOOP | {"points": [[3, 0, 0], [0.3, 0, 0]]}]}, "positions of its joints close the loop"),
    "dead centre": (
        {
            "initial": {"crank": np.pi / 2, "coupler": -np.pi / 2, "rocker": 0.0},
            "loops": [{"links": ["A", "C"], "points": [[0.15, 0, 0], [-0.25, 0, 0]]}],
        },
        "dead centre|close the loop",
    ),
    "unknown master": ({"loops": [LOOP | {"master": "elbow"}]}, "is not a joint of the loop|no moving joint|elbow"),
    "one link twice": ({"loops": [{"links": ["B", "B"], "points": [[0, 0, 0], [0.1, 0, 0]]}]}, "no joints lie between"),
    "two masters": ({"loops": [LOOP | {"master": "crank"}, LOOP | {"master": "rocker"}]}, "two masters"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_loops_that_cannot_be_simulated_are_refused_in_words(tmp_path, case):
    keys, words = REFUSED[case]
    with pytest.raises(AsrsimError, match=words):
        run(tmp_path, "mujoco", duration=0.01, **keys)


def swing(folder, engine, words, *, limit=None, **keys):
    """Run of a parallelogram without gravity under a torque of .02 N m on its crank."""
    path = folder / "parallelogram.urdf"
    path.write_text(pair.urdf(words, **({"limit": limit} if limit else {})))
    keys = {"duration": 0.5, "gravity": [0, 0, 0], "initial": pair.START, "external_torques": {"crank": TORQUE / 10}, **keys}
    return asrsim.run(asrsim.make_scenario(path, engine=engine, **keys)).run.samples.values["link_position"]


def turned(inertia, torque=TORQUE / 10, time=0.5):
    return 1.2 + torque * time**2 / (2 * inertia)


@pytest.mark.parametrize("words", [pair.BALL, pair.HINGE, pair.SDF], ids=["ball", "hinge", "sdf"])
@pytest.mark.parametrize("engine", INSTALLED)
def test_a_loop_that_the_file_states_is_closed(tmp_path, engine, words):
    """q = T t^2 / (2 I): the links of a parallelogram turn by equal angles, and its inertia is constant."""
    q = swing(tmp_path, engine, words)
    np.testing.assert_allclose(q[-1], turned(pair.INERTIA) * np.array([1.0, -1.0, 1.0]), rtol=0.0, atol=1e-6)


THIRD = (
    pair.joint("third", "base", "D", 2 * pair.B)
    + pair.link("D", pair.ARM, pair.A)
    + f'<loop_joint name="more" type="spherical"><link1 link="bar" xyz="{2 * pair.B} 0 0"/>'
    f'<link2 link="D" xyz="{pair.A} 0 0"/></loop_joint>'
)
HALF = (
    pair.joint("hand", "C", "half", pair.A)
    + pair.link("half", 0.3, 0.0)
    + f'<loop_joint name="glue" type="fixed"><link1 link="bar" xyz="{pair.B} 0 0"/><link2 link="half"/></loop_joint>'
)
GEARED = pair.joint("gear", "base", "G", 0.0, '<mimic joint="rocker" multiplier="-2" offset="0.3"/>') + pair.link("G", 0.0, 0.0)
MORE = {
    "two loops that share two joints": (pair.BALL + THIRD, pair.INERTIA + pair.CRANK, {"third": 1.2}),
    "a coupler of two parts that are fixed to each other": (HALF, pair.INERTIA + 0.3 * pair.A**2, {"hand": -1.2}),
    "a wheel geared to a follower": (pair.BALL + GEARED, pair.INERTIA + 4 * pair.TURN, {}),
}


@pytest.mark.parametrize("case", MORE)
@pytest.mark.parametrize("engine", INSTALLED)
def test_loops_that_share_joints_and_couplings_move_as_one(tmp_path, engine, case):
    words, inertia, more = MORE[case]
    q = swing(tmp_path, engine, words, initial=pair.START | more)
    end = turned(inertia)
    assert q[-1, [0, 2]] == pytest.approx([end, end], abs=1e-6)
    assert "duplicate-tag" not in {problem.code for problem in read_robot(tmp_path / "parallelogram.urdf").findings}
    if "geared" in case:
        assert q[-1, 3] == pytest.approx(0.3 - 2 * end, abs=1e-6)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("engine", INSTALLED)
def test_the_limit_of_a_follower_stops_the_master(tmp_path, engine, compiled):
    """The rocker of a parallelogram turns with the crank: at its limit both stop."""
    limit = 'lower="0" upper="1.3" effort="100" velocity="99"'
    q = swing(tmp_path, engine, pair.BALL, limit=limit, duration=1.0, external_torques={"crank": 0.2}, compiled=compiled)
    assert q[-1] == pytest.approx([1.3, -1.3, 1.3], abs=1e-9)
    assert q[:, 2].max() < 1.3 + 1e-9


def test_the_limit_of_a_follower_that_turns_back_stops_the_master_just_before(tmp_path):
    """The largest angle of the rocker of a crank-rocker is that of a triangle; a limit just below it stops the crank."""
    g, a, b, c = four_bar.GROUND, four_bar.CRANK, four_bar.COUPLER, four_bar.ROCKER
    farthest = np.pi - np.arccos((g * g + c * c - (b + a) ** 2) / (2 * g * c))
    limit = f'lower="-9" upper="{-farthest - 1e-4}" effort="99" velocity="99"'
    text = four_bar.urdf()
    head, tail = text.split('<joint name="rocker" type="continuous">')
    text = head + '<joint name="rocker" type="revolute">' + tail.replace("<dynamics", f"<limit {limit}/><dynamics", 1)
    keys = {"external_torques": {"crank": 2.0}, "gravity": [0, 0, 0], "duration": 2.0}
    q = run(tmp_path, "mujoco", text=text, **keys)["link_position"]
    assert q[:, 2].max() <= -farthest - 1e-4 + 1e-9
    assert q[-1, 0] == pytest.approx(q[-200, 0], abs=1e-9)


def energy(q):
    """Potential energy in J of the four-bar linkage at joint positions (3,)."""
    t, b, c = q[0], q[0] + q[1], q[2]
    heights = (
        four_bar.CRANK / 2 * np.sin(t),
        four_bar.CRANK * np.sin(t) + four_bar.COUPLER / 2 * np.sin(b),
        four_bar.ROCKER / 2 * np.sin(c),
    )
    return -four_bar.G * sum(mass * height for mass, height in zip(four_bar.MASSES.values(), heights, strict=True))


@pytest.mark.parametrize("master", ["crank", "rocker"])
def test_a_closed_chain_starts_at_equilibrium(tmp_path, master):
    """The weight of all links, by the derivative of their energy along the linkage, balances the spring, and nothing moves."""
    keys = {
        "actuators": {master: {"type": "sea", "mode": 6, "parameters": {"spring_stiffness": 20.0}}},
        "duration": 0.2,
        "references": {master: {"equilibrium_position": 1.0 if master == "crank" else -2.4}},
    }
    loops = [four_bar.LOOPS[0] | {"master": master}]
    path = tmp_path / "four_bar.urdf"
    path.write_text(four_bar.urdf('<limit effort="100" velocity="100"/>'))
    values = asrsim.run(asrsim.make_scenario(path, loops=loops, initial="equilibrium", **keys)).run.samples.values
    q, j = values["link_position"], ["crank", "coupler", "rocker"].index(master)
    assert np.ptp(q, axis=0).max() < 1e-9
    ends = []
    for nudge in (-1e-5, 1e-5):
        crank = q[0, 0] + nudge
        (b, c), _ = four_bar.closed(crank, np.array([q[0, 0] + q[0, 1], q[0, 2]]))
        ends.append(np.array([crank, b - crank, c]))
    slope = (energy(ends[1]) - energy(ends[0])) / (ends[1][j] - ends[0][j])
    assert values["elastic_torque_1"][-1, j] == pytest.approx(slope, abs=1e-6)


def test_inverse_dynamics_of_a_closed_chain_gives_back_the_motion(tmp_path):
    """Torque along the motion of the equation of one freedom: that which drove it."""
    path = tmp_path / "four_bar.urdf"
    path.write_text(four_bar.urdf())
    start = {"crank": 1.0, "coupler": -2.25, "rocker": -2.4}
    ready = asrsim.prepare(asrsim.make_scenario(path, duration=1.0, loops=four_bar.LOOPS, initial=start))
    times = np.linspace(0.0, 1.0, 2001)
    crank = four_bar.solve(times, TORQUE)
    q = np.column_stack([crank, 0 * crank, 0 * crank])
    v, a = (
        np.column_stack([rate, 0 * crank, 0 * crank])
        for rate in (np.gradient(crank, times), np.gradient(np.gradient(crank, times), times))
    )
    model = ready.model
    torque = model.inverse_dynamics(q, v, a)[:, 0]
    full = model.couplings.expand(q)
    assert four_bar.gap(full).max() < 1e-12
    loss = four_bar.DAMPING * np.square(model.couplings.ratios(full)).sum(axis=1) * v[:, 0]
    np.testing.assert_allclose((torque + loss)[5:-5], TORQUE, rtol=0.0, atol=1e-4)


def test_a_loop_in_a_world_with_contacts_is_closed_at_second_order(tmp_path):
    """MuJoCo's own step has an equality constraint for each loop; the gap falls with the square of the step."""
    times, gaps, errors = np.linspace(0.0, 0.5, 6), [], []
    truth = four_bar.solve(times, TORQUE)
    for step in (2e-3, 1e-3):
        q = run(tmp_path, "mujoco", step=step, duration=0.5, world={"ground": True}, base={"position": [0, 0, 5]})
        errors.append(np.abs(q["link_position"][np.round(times / step).astype(int), 0] - truth).max())
        gaps.append(four_bar.gap(q["link_position"]).max())
    assert gaps[1] < 1e-5
    assert errors[1] < 1e-4
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.1)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


@pytest.mark.skipif("bullet" not in INSTALLED, reason="PyBullet has no wheel here")
def test_pybullet_refuses_loops_in_a_world_with_contacts(tmp_path):
    with pytest.raises(RobotError, match="PyBullet cannot simulate a closed chain in a world with contacts"):
        run(tmp_path, "bullet", world={"ground": True})


def test_an_exported_closed_chain_moves_in_mujoco_as_in_asrsim(tmp_path):
    path = tmp_path / "four_bar.urdf"
    path.write_text(four_bar.urdf('<limit effort="100" velocity="100"/>'))
    scenario = asrsim.make_scenario(
        path,
        duration=0.5,
        loops=four_bar.LOOPS,
        initial={"crank": 1.0, "coupler": -2.25, "rocker": -2.4},
        actuators={"crank": {"type": "sea", "mode": 6}},
        link_damping={"crank": {"constant": 0.3}},
        references={"crank": {"equilibrium_position": {"step": {"at": 0.1, "to": 1.5}}}},
    )
    replay = export(scenario, tmp_path / "four_bar.xml", plot=False).replay
    assert np.abs(replay.error).max() < 2.5  # mrad
    assert np.ptp(asrsim.run(scenario).run.samples.values["link_position"][:, 0]) > 0.3
