"""What a compiled loop runs: a substep, or a whole stretch of them with the engine's. Ordinary code; the loop binds the
names."""

from __future__ import annotations

from typing import Any, NamedTuple

from asrsim.simulation.substep import BOUND, FORCE


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("bound by asrsim.simulation.loop")


laws = look = move = give = unpack = as_tuple = borrow = _unbound
"""Names that the loop binds to functions before it compiles what follows. laws: the joints' step
(:data:`asrsim.simulation.substep.Step`); look, move: the engine's step (:class:`asrsim.engines.base.EngineKernel`); give:
:func:`give_forces` or :func:`give_friction`; unpack: position and velocity of one joint out of the engine's states;
as_tuple: an array of the joints' numbers as a tuple; borrow: the same arrays without counting references to them, which costs
time."""


class Joints(NamedTuple):
    """What `move` is given of an engine that has no kernel."""

    positions: Any
    velocities: Any
    forces: Any
    friction: Any


def give_forces(joints: Any, world: Any) -> None:
    """Torques on the links."""
    for j in range(len(world.forces)):
        world.forces[j] = joints[j][FORCE]


def give_friction(joints: Any, world: Any) -> None:
    """The same, and the joints' friction, where that of any varies."""
    for j in range(len(world.forces)):
        world.forces[j] = joints[j][FORCE]
        world.friction[j] = joints[j][BOUND]


def leave(world: Any) -> None:
    """`move` of an engine that has no kernel: the forces are what they are."""


def substep(k: int, states: Any, joints: Any, inputs: Any, rows: Any, world: Any) -> Any:
    """One substep of the joints; gives the torques on the links, completed by the engine."""
    joints, inputs, rows, world = borrow((joints, inputs, rows, world))
    laws(k, states, joints, inputs, rows)
    for j in range(len(world.forces)):
        world.positions[j], world.velocities[j] = unpack(states, j)
    give(joints, world)
    move(world)
    return as_tuple(world.forces)


def stretch(first: int, last: int, joints: Any, inputs: Any, rows: Any, wrenches: Any, world: Any) -> None:
    """Substeps `first` to `last` of a block; wrenches: (n, w, 6) N, N m."""
    joints, inputs, rows, wrenches, world = borrow((joints, inputs, rows, wrenches, world))
    for k in range(first, last):
        for w in range(len(world.wrench)):
            for i in range(6):
                world.wrench[w][i] = wrenches[k][w][i]
        look(world)
        laws(k, (world.positions, world.velocities), joints, inputs, rows)
        give(joints, world)
        move(world)
