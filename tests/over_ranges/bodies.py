"""Frames, links and their laws, pictures of bodies."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from over_ranges import NOISE, Asked, T, found, shapes

EXAMPLES = Path(__file__).parents[2] / "examples"
ROWS = NOISE[:60].reshape(4, 15)


def _run(motion: np.ndarray, slope: float) -> Any:
    """A run of a joint that rings about an equilibrium which creeps."""
    rest = 0.2 + slope * T
    series = SimpleNamespace(link_position=rest + motion, equilibrium_position=rest)
    return type("Run", (), {"time": T, "__getitem__": lambda self, joint: series})()


def of_bodies() -> Asked:
    turns = NOISE[:12].reshape(3, 4) / np.linalg.norm(NOISE[:12].reshape(3, 4), axis=1)[:, None]
    yield "quaternions", found("log.frames.multiplied"), [(turns, turns[::-1])]
    yield "rotated", found("log.frames.rotated"), [(turns, NOISE[20:29].reshape(3, 3))]
    for angle in (0.0, 0.4, -2.0):
        yield (
            f"about {angle}",
            found("render.frames.about"),
            [(np.array(axis), angle) for axis in ((0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (1.0, -2.0, 0.5))],
        )
    yield "frames", found("render.frames.pose_frame"), [(np.append(NOISE[30:33], turn),) for turn in turns]
    yield "origins", found("render.frames.rpy_frame"), [(NOISE[33:36], NOISE[k : k + 3]) for k in (36, 39)]
    yield "planes", found("render.raster.plane"), [(NOISE[50:68].reshape(3, 3, 2), NOISE[70:79].reshape(3, 3))]
    q, v, a = ROWS[:, :5], ROWS[:, 5:10], ROWS[:, 10:15]
    yield "five links", found("reproduce.chain.five_links"), [(q, v, a), (0.0 * q, v, a), (q, 0.0 * v, 0.0 * a)]
    for count in (1, 2):
        for law in ("level", "hanging"):
            yield f"{law} {count}", found(f"reproduce.newton.{law}"), [(q[:, :count], v[:, :count], a[:, :count])]
    yield "differences", found("reproduce.newton.differences"), [(ROWS, 0.01)]
    yield (
        "sliding",
        found("reproduce.newton.sliding"),
        [(np.sin(5.0 * T[:60]),), (np.array([1.0, 1.0, 0.001, -1.0, -1.0, -1.0]),)],
    )
    ringing = np.exp(-1.5 * T) * np.cos(25.0 * T)
    yield (
        "ringing",
        lambda s: found("reproduce.ringing.fit_ringing")(T, ringing, start=s),
        [(s,) for s in (-1.0, 0.0, 0.5, 1.9, 1.97)],
    )
    for name in ("arm_steps._frequency", "arm_steps._swings", "arm_steps._overshoot", "arm_steps._settling"):
        one = found(f"reproduce.{name}")
        yield name, lambda slope, one=one: one(_run(0.05 * ringing, slope), "joint"), [(s,) for s in (0.0, 0.02, 0.5)]
    yield "swings", found("reproduce.law.swings"), [(ringing, goal) for goal in (0.0, 0.05, 0.5, -0.2)]
    mass = np.array([[2.0, 0.3], [0.3, 0.5]])
    yield (
        "largest",
        lambda k, lag: found("kinematics.swing._largest")(mass, np.array([k, 5.0]), np.array([0.1, -0.2]), lag),
        [(k, lag) for k in (1.0, 50.0) for lag in (0.0, 0.1)],
    )
    for explicit in (False, True):
        for coupled in (None, True, False):
            how = {"explicit": explicit, "coupled": coupled}
            asked = [([c, 0.1 * c], h) for c in (0.0, 0.1, 10.0, 1e3, 2e4) for h in (1e-4, 1e-3)]
            yield f"response {how}", lambda c, h, how=how: found("simulation.damping.mean_response")(mass, c, h, **how), asked
    yield (
        "between samples",
        found("identification.series.interpolate"),
        [(NOISE[:n], np.array([-1.0, 0.0, 0.4, 1.0, 1.5, 2.9999999, n - 1.2, n + 3.0])) for n in (1, 2, 3, 4, 9)],
    )
    yield "smoothed", found("kinematics.desired.smooth_motion"), [(T, np.column_stack([shapes(T)["ring"], shapes(T)["line"]]))]


def of_robots() -> Asked:
    """What follows from the files of the examples, without an engine."""
    load, scenario = found("robot.load_robot"), np.linspace(-0.5, 0.7, 4)
    for path in sorted((EXAMPLES / "urdf").glob("*.urdf")):
        robot = load(path)
        joints = {joint.name: scenario for joint in robot.moving_joints}
        chain = found("robot.chain.Chain")(robot=robot, base_position=(0.1, 0.2, 0.3), base_rpy=(0.1, -0.2, 0.3))
        yield path.stem, lambda r: found("robot.inertia.zero_pose_inertia")(r).matrix.ravel().tolist(), [(robot,)]
        yield path.stem, lambda r: found("robot.inertia.zero_pose_inertia")(r).effective, [(robot,)]
        yield path.stem, lambda r: [found("robot.inertia.principal_axes")(link) for link in r.links], [(robot,)]
        yield path.stem, lambda r: [astuple(link)[1:5] for link in found("robot.merge.merge_fixed")(r).robot.links], [(robot,)]
        yield path.stem, found("robot.sanity.own_weight"), [(robot,)]
        yield path.stem, lambda r: found("robot.sanity.most_damping")(r), [(robot,)]
        yield (
            path.stem,
            lambda c, j=joints: [np.array(part[-1]).ravel() for pose in c.poses(j).values() for part in pose][-4:],
            [(chain,)],
        )
        yield path.stem, lambda c, j=joints: list(c.gravity_load(j, (0.5, 1.0, -9.81)).values()), [(chain,)]
        yield path.stem, lambda r: [(b.actuator, b.mode, dict(b.values())) for b in r.actuators[:1]], [(robot,)]
        yield (
            path.stem,
            lambda r: [(j.kind, j.axis, j.origin, j.rpy, j.lower, j.upper, j.effort) for j in r.joints[-1:]],
            [(robot,)],
        )


def of_files() -> Asked:
    """Where the keys of the examples' scenarios stand."""
    load = found("scenario.load_scenario")
    for path in sorted((EXAMPLES / "scenarios").glob("*.yaml")):
        yield path.stem, lambda p: np.array(list(load(p)[-1].lines.values())), [(path,)]


def of_waiting() -> Asked:
    lateness = found("live.pace.Lateness")

    def quantiles(*late: float) -> list[float]:
        one = lateness()
        for value in late:
            one.add(value)
        return [one.quantile(share) for share in (0.0, 0.5, 0.9, 1.0)] + [one.worst, one.count]

    yield "waiting", quantiles, [(), (0.0,), (1e-6, 1.1e-6), (1e-3, 2e-3, 5.0), (500.0,), tuple(abs(NOISE[:50]) * 1e-3)]
