"""One step of a robot without contacts, by MuJoCo's rigid-body routines. The functions run as Python or compiled.

`asrsim.engines.mujoco_library` binds the routines named below: in Python through ctypes to the loaded library, and in compiled
code to the symbols of the library. Threads can share the model, which is only read. Each thread needs a separate record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from asrsim.engines.loops import AnyArray
from asrsim.engines.rigid import Room, aim, finish, kick, reduce, reduce_force
from asrsim.samples import Array
from asrsim.scenario.data import Wrench


def _unbound(*arguments: Any) -> None:
    raise NotImplementedError("bound by asrsim.engines.mujoco_library")


mj_kinematics = mj_comPos = mj_comVel = mj_crb = mj_fullM = mj_rne = mj_applyFT = _unbound  # noqa: N816  (its names)

ROUTINES = {
    "mj_kinematics": "mm",
    "mj_comPos": "mm",
    "mj_comVel": "mm",
    "mj_crb": "mm",
    "mj_fullM": "mmm",
    "mj_rne": "mmim",
    "mj_applyFT": "mmmmmim",
}
"""Routines of the library, with the types of their arguments: `m` a memory address, `i` an int."""


class Hand(NamedTuple):
    """Wrenches that act on bodies in all further steps; see `asrsim.engines.base.Engine.hold`."""

    number: AnyArray
    """Number (1,) of the wrenches; they are in the first rows of the other arrays."""
    body: AnyArray
    """MuJoCo body of each wrench, (b,)."""
    point: AnyArray
    """Point (m) at which each wrench acts, in the frame of its body, (b, 3)."""
    load: AnyArray
    """Force (N) and torque (N m) of each wrench, world frame, (b, 6)."""


def empty_hand(bodies: int) -> Hand:
    """A `Hand` without wrenches, which has room for one wrench on each of `bodies` bodies."""
    return Hand(np.zeros(1, dtype=np.int64), np.zeros(bodies, dtype=np.int64), np.zeros((bodies, 3)), np.zeros((bodies, 6)))


class MujocoRecord(NamedTuple):
    """Work space of a step: MuJoCo's model and data, and a room."""

    room: Room
    model: int
    """Memory address of the model; the next fields are the addresses of the data and of arrays of this record."""
    data: int
    at_matrix: int
    at_bias: int
    at_force: int
    at_vectors: int
    vectors: AnyArray
    """Work space (3, 3); its rows are a force, a torque and the point at which they act."""
    xpos: AnyArray
    xmat: AnyArray
    wrenches: int
    """Number of wrenches of the scenario."""
    wrench_body: AnyArray
    wrench_point: AnyArray
    """Point (m) at which each wrench acts, in the frame of the wrench's body; shape (w, 3)."""
    wrench_turn: AnyArray
    """Rotation of the link of each wrench, in the frame of the link's MuJoCo body; shape (w, 3, 3)."""
    wrench_local: AnyArray
    """Flags (w,): 1 for wrenches that are given in the frame of their link."""
    floats: int
    """Number f of bodies with masses on which gravity does not act."""
    float_body: AnyArray
    """MuJoCo body of each of these masses, (f,)."""
    float_centre: AnyArray
    """Centre (m) of each of these masses, in the frame of its MuJoCo body, (f, 3)."""
    float_force: AnyArray
    """Weight (N) that gravity would exert on each of these masses, world frame, (f, 3)."""
    hand: Hand


def make_record(
    model: Any,
    data: Any,
    room: Room,
    wrenches: Sequence[Wrench],
    places: Mapping[str, tuple[int, Array, Array]],
    floats: Sequence[tuple[int, Array, Array]],
    hand: Hand,
) -> MujocoRecord:
    """Work space of a step. places: for each link, its MuJoCo body, and the position (3,) in m and rotation (3, 3) of the link
    in that body. floats: for each mass on which gravity does not act, its MuJoCo body, centre (3,) in m and weight (3,) in
    N."""
    pushed = [places[wrench.link] for wrench in wrenches]
    points = [offset + turn @ np.array(w.point) for w, (_, offset, turn) in zip(wrenches, pushed, strict=True)]
    vectors = np.zeros((3, 3))
    return MujocoRecord(
        room=room,
        model=model._address,
        data=data._address,
        at_matrix=room.full_matrix.ctypes.data,
        at_bias=room.full_bias.ctypes.data,
        at_force=room.full_force.ctypes.data,
        at_vectors=vectors.ctypes.data,
        vectors=vectors,
        xpos=data.xpos,
        xmat=data.xmat,
        wrenches=len(wrenches),
        wrench_body=np.array([place[0] for place in pushed], dtype=np.int64),
        wrench_point=np.array(points).reshape(len(wrenches), 3),
        wrench_turn=np.array([turn for _, _, turn in pushed]).reshape(len(wrenches), 3, 3),
        wrench_local=np.array([wrench.frame != "world" for wrench in wrenches], dtype=np.int64),
        floats=len(floats),
        float_body=np.array([body for body, _, _ in floats], dtype=np.int64),
        float_centre=np.array([centre for _, centre, _ in floats], dtype=float).reshape(len(floats), 3),
        float_force=np.array([force for _, _, force in floats], dtype=float).reshape(len(floats), 3),
        hand=hand,
    )


def sizes(record: MujocoRecord) -> tuple[int, int, int]:
    """Sizes of the other arguments of `step`; see `asrsim.compiled.compiling.compile_packed`."""
    return record.room.joints, record.wrenches, 6


def step(record: MujocoRecord, state: Any, exchange: Any, wrenches: Any, lengths: Any) -> None:
    """Advance by one step; see `asrsim.engines.base.Native`."""
    room, model, data = record.room, record.model, record.data
    aim(room, state)
    mj_kinematics(model, data)
    mj_comPos(model, data)
    mj_crb(model, data)
    mj_fullM(model, data, record.at_matrix)
    mj_comVel(model, data)
    mj_rne(model, data, 0, record.at_bias)
    if record.floats:
        carry(record)
    if room.reduced:
        reduce(room)
    for piece in range(len(lengths)):
        if record.wrenches or record.hand.number[0]:
            push(record, wrenches, piece)
            if room.reduced:
                reduce_force(room)
        kick(room, exchange, piece, lengths)
    finish(room, state, exchange, lengths)


def carry(record: MujocoRecord) -> None:
    """Remove from the bias the weight of the masses on which gravity does not act."""
    vectors = record.vectors
    for index in range(record.floats):
        for row in range(3):
            vectors[0, row], vectors[1, row] = record.float_force[index, row], 0.0
        apply(record, record.float_body[index], record.float_centre, index, record.at_bias)


def apply(record: MujocoRecord, body: int, points: Any, index: int, target: int) -> None:
    """Add the generalised forces of the force and the torque in `vectors` to the array at the address `target`.

    points: points (m) in the frame of the body; the force acts at the point with the index `index`.
    """
    vectors, xmat = record.vectors, record.xmat
    for row in range(3):
        point = record.xpos[body, row]
        for column in range(3):
            point += xmat[body, 3 * row + column] * points[index, column]
        vectors[2, row] = point
    at = record.at_vectors
    mj_applyFT(record.model, record.data, at, at + 24, at + 48, int(body), target)


def push(record: MujocoRecord, wrenches: Any, piece: int) -> None:
    """Compute the generalised forces of the wrenches (p, w, 6) on links in a piece of the kick, and of the wrenches that are
    held, at the positions in MuJoCo's data."""
    force, vectors, xmat, hand = record.room.full_force, record.vectors, record.xmat, record.hand
    for i in range(record.room.speeds):
        force[i] = 0.0
    for index in range(record.wrenches):
        body = record.wrench_body[index]
        for row in range(3):
            for kind in range(2):
                if record.wrench_local[index]:
                    value = 0.0
                    for column in range(3):
                        part = 0.0
                        for axis in range(3):
                            part += record.wrench_turn[index, column, axis] * wrenches[piece, index, 3 * kind + axis]
                        value += xmat[body, 3 * row + column] * part
                    vectors[kind, row] = value
                else:
                    vectors[kind, row] = wrenches[piece, index, 3 * kind + row]
        apply(record, body, record.wrench_point, index, record.at_force)
    for index in range(hand.number[0]):
        for row in range(3):
            vectors[0, row], vectors[1, row] = hand.load[index, row], hand.load[index, 3 + row]
        apply(record, hand.body[index], hand.point, index, record.at_force)
