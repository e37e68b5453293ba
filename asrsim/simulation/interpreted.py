"""Laws and steps of joints as Python functions, which the kernel calls. For the compiled kernel, `asrsim.simulation.native`
compiles the laws and steps."""

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
    """Function that `spring_law` calls to evaluate the laws of an actuator and of the stages of its joint. If a law has no
    finite value, the torque is NaN.

    motors: number of positions that the laws take, at least 2.
    """
    if stages:
        return _staged_law(actuator, motors, stages)
    springs = _springs(actuator, motors)

    def laws(joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
        try:
            springs(joint, link, kind, q, task)
        except UNDEFINED:
            joint.motors[0].pull = math.nan

    return laws


def _staged_law(actuator: Any, motors: int, stages: tuple[type[Stage], ...]) -> Callable[..., None]:
    """Function as in `bound_law`, for a joint with stages."""
    staged = compose(stages, access)
    springs = _springs(actuator, motors) if staged.place is None else _placed_springs(actuator, motors, staged.place)

    def laws(joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
        try:
            if task == TASK.remember:
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
                # The torques of this kick have already been used, so make the torque of the next kick NaN.
                joint.motors[0].position = math.nan

    return laws


def _springs(actuator: Any, motors: int) -> Callable[..., None]:
    """Function that evaluates the laws of springs whose ends are the motors."""
    torques, stiffness, energy = actuator.elastic_torques, actuator.stiffness, energy_law(actuator)
    end = attrgetter("theta")

    def springs(joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
        own = joint.motors[:motors]
        given = q, *map(end, own), link.law
        found = torques(*given)
        if task == TASK.whole:
            joint.stiffness, joint.law_energy = stiffness(*given), energy(*given)
        for motor, torque in zip(own, found, strict=False):
            motor.pull = torque

    return springs


def _placed_springs(actuator: Any, motors: int, place: Callable[..., None]) -> Callable[..., None]:
    """Function that evaluates the laws of springs behind stages in series. The stiffness is the slope of the torque with these
    stages. place: function that finds the ends of the springs for a position of the link."""
    torques, energy = actuator.elastic_torques, energy_law(actuator)
    end = attrgetter("end")

    def springs(joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
        own = joint.motors[:motors]

        def torques_at(position: float) -> Any:
            place(joint, link, kind, position)
            return torques(position, *map(end, own), link.law)

        if task == TASK.whole:
            least = sum(torques_at(q + SLOPE)[: kind.pulling])
            joint.stiffness = 0.5 / SLOPE * (sum(torques_at(q - SLOPE)[: kind.pulling]) - least)
        found = torques_at(q)
        if task == TASK.whole:
            joint.law_energy = energy(q, *map(end, own), link.law)
        for motor, torque in zip(own, found, strict=False):
            motor.pull = torque

    return springs


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
