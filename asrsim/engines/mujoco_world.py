"""What MuJoCo's stages work on: the engine's live state, as arrays that are views of MuJoCo's own or work space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Wrench

Numbers = NDArray[Any]

STEP, NOW, BEFORE, FRACTION = range(4)
"""Places in `World.scheme`: s; weights of the last two velocities in that of the whole step; part of the kick."""


class World(NamedTuple):
    """The engine's live state; arrays are views of MuJoCo's own, or work space. n joints, v degrees of freedom."""

    model: int
    data: int
    scheme: Numbers
    """(4,): see STEP, NOW, BEFORE, FRACTION."""
    qpos: Numbers
    qvel: Numbers
    previous: Numbers
    """(v,) velocities before the last kick."""
    velocity: Numbers
    """(v,) at the whole step."""
    bias: Numbers
    """(v,) N m: gravity, Coriolis and centrifugal torques at the whole step's velocity."""
    lag: Numbers
    """(v,) N m: those at the lagging velocity, less `bias`."""
    impulse: Numbers
    change: Numbers
    positions: Numbers
    """(n,) of the joints: rad, rad/s, and the mean torques (N m) of the next move."""
    velocities: Numbers
    forces: Numbers
    joint_q: Numbers
    """(n,) places of the joints in qpos, and in qvel:"""
    joint_v: Numbers
    free: int
    """1 if the base floats."""
    friction: Numbers
    """(n,) N m, Coulomb."""
    lower: Numbers
    upper: Numbers
    held: Numbers
    """(n,) integers: the joints' states, see :mod:`asrsim.engines.exact_friction`."""
    most: Numbers
    """(n,) largest impulse of friction in this step."""
    slowest: Numbers
    """(n,) velocities with which a joint reaches its lower and its upper stop at the end of this step; 0 at the stop."""
    fastest: Numbers
    columns: Numbers
    """(n, v) velocities that a unit impulse at a joint gives, where `known` is 1."""
    mass: Numbers
    """(v, v) kg m^2, where `known` says so."""
    known: Numbers
    """(n + 2,) integers."""
    pick: Numbers
    loose: Numbers
    """(v,) integers, and numbers: work space for what no friction holds."""
    rest: Numbers
    square: Numbers
    """(n, n) work space."""
    push: Numbers
    xpos: Numbers
    xmat: Numbers
    wrench: Numbers
    """(w, 6) N, N m: the next step's."""
    wrench_body: Numbers
    wrench_point: Numbers
    """(w, 3) m, in the body's frame."""
    wrench_turn: Numbers
    """(w, 3, 3): the frame of the wrench's link in that of its body, which other links may be fixed to."""
    wrench_local: Numbers
    """(w,) 1 where the wrench is given in the link's frame."""
    vectors: Numbers
    """(3, 3) work space: force, torque, point."""
    at_qpos: int
    """Addresses of arrays above."""
    at_qvel: int
    at_bias: int
    at_lag: int
    at_impulse: int
    at_change: int
    at_push: int
    at_columns: int
    at_mass: int
    at_vectors: int


def make_world(
    model: Any,
    data: Any,
    robot: Robot,
    *,
    at_q: Numbers,
    at_v: Numbers,
    free: bool,
    wrenches: Sequence[Wrench],
    places: Mapping[str, tuple[int, Array, Array]],
) -> World:
    """The state of MuJoCo's `data`, with friction and stops of the robot's joints.

    at_q, at_v: (n,) places of the joints in qpos and qvel; places: link -> body, position (3,) m and rotation (3, 3) of the
    link in it.
    """
    n, size = len(at_q), model.nv
    moving = robot.moving_joints
    pushed = [places[wrench.link] for wrench in wrenches]
    points = [offset + turn @ np.array(w.point) for w, (_, offset, turn) in zip(wrenches, pushed, strict=True)]
    arrays: dict[str, Any] = {
        name: np.zeros(size) for name in ("previous", "velocity", "bias", "lag", "impulse", "change", "push", "rest")
    }
    arrays |= {"columns": np.zeros((n, size)), "mass": np.zeros((size, size)), "vectors": np.zeros((3, 3))}
    addresses = {f"at_{name}": array.ctypes.data for name, array in arrays.items() if f"at_{name}" in World._fields}
    arrays |= {name: np.zeros(n) for name in ("positions", "velocities", "forces", "most", "slowest", "fastest")}
    arrays |= {name: np.zeros(n, dtype=np.int64) for name in ("held", "pick")}
    arrays |= {"known": np.zeros(n + 2, dtype=np.int64), "loose": np.zeros(size, dtype=np.int64)}
    return World(
        model=model._address, data=data._address, scheme=np.array([1e-3, 1.5, -0.5, 1.0]),
        qpos=data.qpos, qvel=data.qvel, joint_q=at_q, joint_v=at_v, free=int(free),
        friction=np.array([joint.friction for joint in moving]),
        lower=np.array([joint.stops[0] for joint in moving]), upper=np.array([joint.stops[1] for joint in moving]),
        square=np.zeros((n, n)), xpos=data.xpos, xmat=data.xmat, wrench=np.zeros((len(wrenches), 6)),
        wrench_body=np.array([place[0] for place in pushed], dtype=np.int64),
        wrench_point=np.array(points).reshape(len(wrenches), 3),
        wrench_turn=np.array([turn for _, _, turn in pushed]).reshape(len(wrenches), 3, 3),
        wrench_local=np.array([wrench.frame != "world" for wrench in wrenches], dtype=np.int64),
        at_qpos=data.qpos.ctypes.data, at_qvel=data.qvel.ctypes.data, **arrays, **addresses,
    )  # fmt: skip


def plain_world(world: World) -> World:
    """The same memory for plain Python, whose floats reckon several times faster one by one than NumPy's."""
    return World._make(field.data if isinstance(field, np.ndarray) else field for field in world)
