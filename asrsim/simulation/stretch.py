"""What a compiled loop runs: a substep, or a whole stretch of them with the engine's. Ordinary code; the loop binds the
names."""

from __future__ import annotations

from typing import Any

from asrsim.simulation.substep import FORCE


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("bound by asrsim.simulation.loop")


laws = look = move = as_tuple = borrow = _unbound
"""The joints' step (:data:`asrsim.simulation.substep.Step`); the engine's (:class:`asrsim.engines.base.EngineKernel`); the
forces of a row of joints as the engine takes them; arrays without their count of references."""


def substep(k: int, states: Any, joints: Any, inputs: Any, rows: Any) -> Any:
    """One substep of the joints; gives the torques on the links."""
    joints, inputs, rows = borrow((joints, inputs, rows))
    laws(k, states, joints, inputs, rows)
    return as_tuple(joints)


def stretch(first: int, last: int, joints: Any, inputs: Any, rows: Any, wrenches: Any, world: Any) -> None:
    """Substeps `first` to `last` of a block; wrenches: (n, w, 6) N, N m."""
    joints, inputs, rows, wrenches, world = borrow((joints, inputs, rows, wrenches, world))
    for k in range(first, last):
        for w in range(len(world.wrench)):
            for i in range(6):
                world.wrench[w][i] = wrenches[k][w][i]
        look(world)
        laws(k, (world.positions, world.velocities), joints, inputs, rows)
        for j in range(len(world.forces)):
            world.forces[j] = joints[j][FORCE]
        move(world)
