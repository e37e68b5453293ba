"""Laws and steps of joints as Python functions, which the kernel calls; `asrsim.simulation.native` compiles them instead."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from operator import attrgetter
from typing import Any

from asrsim.actuators.stages import Stage
from asrsim.actuators.vectorised import energy_law
from asrsim.simulation.fields import JointConstants, JointKind, JointState, Scheme
from asrsim.simulation.layout import TASK
from asrsim.simulation.staged import SLOPE, StageAccess, compose

UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""Errors that `math` raises if a law has no finite value."""


def scheme_table(schemes: Sequence[Scheme]) -> list[Scheme]:
    """Table with the constants of steppings."""
    return list(schemes)


def bound_step(function: Callable[..., None]) -> Any:
    """The function of a stepping in the form that `joint_step` calls."""
    return function


@cache
def bound_law(actuator: Any, motors: int, stages: tuple[type[Stage], ...] = ()) -> Callable[..., None]:
    """Function that `spring_law` calls to evaluate an actuator's laws, and those of the stages of its joint. If a law has no
    finite value, the torque is NaN.

    motors: number of positions that the laws take, at least 2.
    """
    torques, stiffness, energy = actuator.elastic_torques, actuator.stiffness, energy_law(actuator)
    staged = compose(stages, access) if stages else None
    place = staged.place if staged is not None else None
    end = attrgetter("theta" if place is None else "end")

    def springs(joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
        own = joint.motors[:motors]
        parameters = tuple(link.law)
        if place is not None:
            if task == TASK.whole:
                place(joint, link, kind, q + SLOPE)
                least = sum(torques(q + SLOPE, *map(end, own), parameters))
                place(joint, link, kind, q - SLOPE)
                joint.stiffness = 0.5 / SLOPE * (sum(torques(q - SLOPE, *map(end, own), parameters)) - least)
            place(joint, link, kind, q)
        positions = [end(motor) for motor in own]
        found = torques(q, *positions, parameters)
        if task == TASK.whole:
            if place is None:
                joint.stiffness = stiffness(q, *positions, parameters)
            joint.law_energy = energy(q, *positions, parameters)
        for motor, torque in zip(own, found, strict=False):
            motor.pull = torque

    def laws(joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
        try:
            if staged is None:
                springs(joint, link, kind, q, task)
            elif task == TASK.remember:
                staged.remember(joint, link, kind)
            elif task == TASK.store:
                staged.store(joint, link, kind)
            elif task == TASK.lose:
                staged.lose(joint, link, kind)
            else:
                springs(joint, link, kind, q, task)
                staged.add(joint, link, kind, q)
        except UNDEFINED:
            joint.motors[0].pull = math.nan
            if task >= TASK.remember:
                # The kick is over: the next torque has no value.
                joint.motors[0].position = math.nan

    return laws


def access(number: int, stage: type[Stage]) -> StageAccess:
    """Functions that find the parts of stage `number` of a joint; see `asrsim.simulation.staged`."""

    def acts(link: JointConstants, kind: JointKind, i: int) -> bool:
        return link.stages[number][i] is not None

    def own(link: JointConstants, kind: JointKind, i: int) -> Any:
        return link.stages[number][i]

    def memory(joint: JointState, kind: JointKind, i: int) -> Any:
        return joint.stages[kind.places[number]].motors[i]

    def lose(joint: JointState, kind: JointKind, energy: float) -> None:
        joint.stages[kind.places[number]].loss += energy

    return StageAccess(acts, own, memory, lose)
