"""Recordings with their simulations: initial states, effects of sensors, and derivatives on several threads."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from asrsim.identification import door, task_of
from asrsim.identification.problem import jacobian, set_up

LINK = """<link name="link_{i}"><inertial><mass value="0.5"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.009"/></inertial></link>
<joint name="joint_{i}" type="revolute"><parent link="world"/><child link="link_{i}"/><axis xyz="0 0 1"/>
<limit effort="1000" velocity="10000" lower="-10" upper="10"/><dynamics damping="0.02" friction="0.0"/></joint>
<gazebo><plugin name="c{i}" filename="lib{actuator}_plugin.so"><joint>joint_{i}</joint>
<operation_mode>{mode}</operation_mode>{tags}</plugin></gazebo>"""


def setup_of(
    stack, folder, columns, free, *, actuator = "sea", mode = 3,
    joints = 1, tags = "", keys = "",
):  # fmt: skip
    """A fit to a table of joints that stand on the world side by side, before it begins."""
    links = "".join(LINK.format(i=i, actuator=actuator, mode=mode, tags=tags) for i in range(1, joints + 1))
    (folder / "lab.urdf").write_text(f'<robot name="lab"><link name="world"/>{links}</robot>')
    table = np.column_stack(list(columns.values()))
    text = f"robot: lab.urdf\nduration: {table[-1, 0]}\nengine: mujoco\ncompiled: false\n{keys}"
    (folder / "lab.yaml").write_text(text)
    np.savetxt(folder / "a.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    return set_up(task_of(folder / "lab.yaml", [folder / "a.csv"], free=free), stack).problem


def noise(*shape, seed=0):
    return 1e-4 * np.random.default_rng(seed).normal(size=shape)


TIME = np.arange(0.0, 0.8005, 1e-3)
"""s."""


def test_predictions_include_the_effects_of_the_sensor(tmp_path):
    """Delay of sensor and clock, gain and zero; a shorter prediction equals the beginning of a longer one."""
    goal = 0.3 * np.sin(9.0 * TIME)
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": goal, "joint_1.link_position [rad]": goal**2 + noise(len(TIME))}
    with ExitStack() as stack:
        problem = setup_of(stack, tmp_path, columns, ["joint_1.damping"])
        predict = partial(problem.tracks[0].predict, playing=problem.playing, until=1.0)
        (base,) = predict({}) or ()
        assert np.ptp(base) > 0.3
        place = "joint_1.link_position"
        (found,) = predict({f"{place}.gain": 2.0, f"{place}.offset": 0.1}) or ()
        np.testing.assert_allclose(found, base / 2.0 + 0.1, rtol=1e-12)
        for keys in ({f"{place}.delay": 0.02}, {"clock": 0.02}, {f"{place}.delay": 0.05, "clock": -0.03}):
            (found,) = predict(keys) or ()
            np.testing.assert_allclose(found[20:], base[:-20], rtol=0.0, atol=1e-12)
            assert found[:20].tolist() == [base[0]] * 20
        (ahead,) = predict({"clock": -0.2}) or ()
        np.testing.assert_allclose(ahead[:-200], base[200:], rtol=0.0, atol=1e-12)
        for keys in ({}, {"clock": -0.2}):
            (whole,), (part,) = predict(keys) or (), predict(keys, until=0.3) or ()
            assert part.tolist() == whole[TIME <= 0.3 + 1e-9].tolist()


@pytest.mark.parametrize("place", [0.3, -0.4])
@pytest.mark.parametrize("speed", [-3.0, 0.0, 3.0])
def test_a_link_starts_with_the_recorded_position_and_velocity(tmp_path, place, speed):
    moved = np.stack([place + speed * TIME - 5.0 * TIME**2 * np.sign(speed), 0.2 + 0.0 * TIME]) + noise(2, len(TIME))
    moved[1] += 0.1 * np.sin(20.0 * np.maximum(TIME - 0.2, 0.0))
    columns = {"time [s]": TIME}
    for i in (1, 2):
        columns |= {f"joint_{i}.reference_1 [rad]": 0.0 * TIME, f"joint_{i}.link_position [rad]": moved[i - 1]}
    keys = "initial: {joint_1: 0.15, joint_2: 0.1}\n"
    if not speed:
        columns["joint_1.link_position [rad]"] += 0.1 * np.sin(20.0 * np.maximum(TIME - 0.2, 0.0))
    with ExitStack() as stack:
        setup = setup_of(stack, tmp_path, columns, ["joint_1.damping"], joints=2, keys=keys)
        (track,) = setup.tracks
        initial = [track.initial[f"joint_{i}.initial_{what}"] for what in ("position", "velocity") for i in (1, 2)]
        assert initial[:2] == pytest.approx([place, 0.2], abs=1e-3)
        assert initial[2:] == pytest.approx([speed, 0.0], abs=0.05)
        wanted = ["joint_1.initial_position", *(["joint_1.initial_velocity"] if speed else []), "joint_2.initial_position"]
        assert [entry.key for entry in setup.layout.entries[1:]] == wanted
        # If the zero of a link's sensor is free, the link starts as in the scenario; other links start as before.
        free = ["joint_1.link_position.offset"]
        (track,) = setup_of(stack, tmp_path, columns, free, joints=2, keys=keys).tracks
        assert [track.initial[f"joint_{i}.initial_position"] for i in (1, 2)] == pytest.approx([0.15, 0.2], abs=1e-3)
        assert list(track.uncertain) == wanted[1:]


@pytest.mark.parametrize("seen", [True, False])
def test_a_link_without_a_recording_begins_with_its_motors(tmp_path, seen):
    swing = 0.2 * np.sin(10.0 * np.maximum(TIME - 0.2, 0.0))
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": 0.7 + swing, "joint_1.reference_2 [rad]": 0.1 + swing}
    columns |= {
        f"joint_1.motor_{i}_position [rad]": home + swing**2 + noise(len(TIME), seed=i) for i, home in ((1, 0.7), (2, 0.1))
    }
    if seen:
        columns["joint_1.link_position [rad]"] = 0.33 + swing**3 + noise(len(TIME))
    keys = "initial: {joint_1: {position: 0.25, motor_positions: [0.4, -0.2]}}\n"
    with ExitStack() as stack:
        (track,) = setup_of(stack, tmp_path, columns, ["joint_1.damping"], actuator="qbmove", mode=5, keys=keys).tracks
        assert track.motors == {"joint_1": pytest.approx([0.7, 0.1], abs=1e-3)}
        assert track.initial["joint_1.initial_position"] == pytest.approx(0.33 if seen else 0.25 + 0.3, abs=1e-3)


def test_derivatives_on_many_threads_equal_those_on_one(tmp_path, monkeypatch):
    goal = 0.3 * np.sin(9.0 * TIME)
    columns = {"time [s]": TIME, "joint_1.reference_1 [rad]": goal + noise(len(TIME)), "joint_1.link_position [rad]": goal**2}
    found: dict[int | None, list[np.ndarray]] = {None: [], 3: [], 4: []}
    for threads in (1, 2):
        monkeypatch.setattr(door, "AT_ONCE", threads)
        with ExitStack() as stack:
            problem = setup_of(stack, tmp_path, columns, ["link_1.izz", "joint_1.damping"])
            for draw, matrices in found.items():
                drawn = replace(problem, playing=replace(problem.playing, draw=draw))
                matrices.append(jacobian(drawn, np.zeros(len(problem.layout))))
    for one, two in found.values():
        np.testing.assert_array_equal(one, two)
    assert len({one.tobytes() for one, _ in found.values()}) == 3
