"""Stages of actuators in the kernel: the values that the kernel stores for stages, and the composition of their laws to
functions of a joint.

The laws of a stage are functions of the stage's memory and constants at one motor (`asrsim.actuators.stages`). `compose` nests
the laws, stage in stage, into functions of the records of a joint. Only the stages of this joint appear in these functions.
Plain Python, compiled code and Warp compose the same source, with their own access to the records.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from asrsim.actuators.stages import STAGES, Stage
from asrsim.simulation.fields import JointConstants, JointKind, JointState, Scheme
from asrsim.simulation.laws import drive_of, motor_of

STEADY = 2.0
"""Number of kicks without a jump after which the speed of a motor without dynamics is computed from its positions."""
SLOPE = 1e-6
"""Half of the distance in rad between the two link positions from which the stiffness is computed, if a stage is in series with
springs.
"""


def begin_stages(joint: JointState, velocity: float, jumped: bool, first: bool) -> None:
    """Store the values that the stages of a joint need in a kick. velocity: velocity of the link at the kick, rad/s; jumped:
    whether an input jumps in the kick; first: whether this is the first kick, which is half a kick.
    """
    joint.kick_velocity = velocity
    joint.steady = 1.0 if first else 0.0 if jumped else min(joint.steady + 1.0, STEADY)


def lead_stages(joint: JointState, kind: JointKind, scheme: Scheme, step: float) -> None:
    """Store the length `step` in s of the next kick of the motors, and the speeds of motors without dynamics. While its
    reference jumps, such a motor keeps its speed.
    """
    joint.kick_lead = scheme.first_drift * step
    for i in range(kind.dynamic, kind.springs):
        motor = motor_of(joint, i)
        if joint.steady >= STEADY:
            speed = (motor.theta - motor.position) / scheme.step
            motor.velocity = scheme.weight_now * speed + scheme.weight_last * motor.last_velocity


def note_kick(joint: JointState, kind: JointKind, step: float, noted: bool) -> None:
    """Store the accelerations in a kick of `step` s. noted: whether the values of this kick are recorded."""
    for i in range(kind.springs):
        motor = motor_of(joint, i)
        if i < kind.dynamic and step > 0.0:
            motor.acceleration = (motor.velocity - motor.last_velocity) / step
        if noted:
            motor.kick_parallel = motor.parallel


def end_stages(joint: JointState, kind: JointKind, scheme: Scheme, first: bool) -> None:
    """Store the times from the last kick and to the next kick, before the stages update their memories. first: whether this is
    the first kick.
    """
    joint.kick_since, joint.kick_lead = 0.0 if first else scheme.step, scheme.step
    for i in range(kind.dynamic, kind.springs):
        motor = motor_of(joint, i)
        if joint.steady >= STEADY:
            motor.last_velocity = (motor.kick_position - motor.position) / scheme.step
        motor.position, motor.mean_velocity = motor.kick_position, motor.velocity


class StageAccess(NamedTuple):
    """Functions that find the parts of a stage in the records of a joint."""

    acts: Callable[..., Any]
    """acts(link, kind, i): whether the stage acts at motor i = 0, 1, ..."""
    own: Callable[..., Any]
    """own(link, kind, i): constants at motor i."""
    memory: Callable[..., Any]
    """memory(joint, kind, i): memory at motor i."""
    lose: Callable[..., Any]
    """lose(joint, kind, energy): add an energy in J to the loss of the stage."""


class Composed(NamedTuple):
    """Laws of the stages of a joint, as functions of its records."""

    place: Callable[..., None] | None
    """place(joint, link, kind, q): set the `end` of each motor, for a link at q rad; None without a stage in series."""
    add: Callable[..., None]
    """add(joint, link, kind, q): add the torques of the stages to the `pull` of each motor; set its `ground` and `limit`."""
    remember: Callable[..., None]
    """remember(joint, link, kind): update the memories to the recorded kick."""
    store: Callable[..., None]
    """store(joint, link, kind): compute `stage_energy`."""
    lose: Callable[..., None]
    """lose(joint, link, kind): compute `stage_lost`, and add it to the losses of the stages."""


def compose(stages: Sequence[type[Stage]], access: Callable[[int, type[Stage]], StageAccess]) -> Composed:
    """Composition of stages, in the order of the registry. access: function of a stage's index and the stage, which returns its
    `StageAccess`.
    """
    order = list(STAGES.loaded())
    pairs = sorted(enumerate(stages), key=lambda pair: order.index(pair[1]))
    place, pull, hold, bound, keep, store, lose = _same, _nothing, _no_ground, _same, _no_memory, _no_energy, _no_energy
    for number, stage in pairs:
        at = access(number, stage)
        if stage.has("place"):
            place = _changed(stage.place, at.acts, at.own, at.memory, place)
        if stage.has("torque"):
            pull = _pulled(stage.torque, at.acts, at.own, at.memory, pull)
        if stage.has("ground"):
            hold = _held(stage.ground, at.acts, at.own, at.memory, hold)
        if stage.has("limit"):
            bound = _changed(stage.limit, at.acts, at.own, at.memory, bound)
        if stage.has("remember"):
            keep = _kept(stage.remember, at.acts, at.own, at.memory, keep)
        if stage.has("energy"):
            store = _stored(stage.energy, at.acts, at.own, at.memory, store)
        if stage.has("loss"):
            lose = _lost(stage.loss, at, lose)
    return Composed(
        _ends(place) if place is not _same else None,
        _adding(pull, hold, bound),
        _remembering(keep),
        _storing(store),
        _losing(lose),
    )


def _same(joint: Any, link: Any, kind: Any, i: int, number: float) -> float:
    return number


def _nothing(joint: Any, link: Any, kind: Any, i: int, deflection: float, velocity: float) -> float:
    return 0.0


def _no_ground(joint: Any, link: Any, kind: Any, i: int, position: float, velocity: float, load: float) -> float:
    return 0.0


def _no_memory(joint: Any, link: Any, kind: Any, i: int, kick: Any) -> None:
    pass


def _no_energy(joint: Any, link: Any, kind: Any) -> None:
    pass


def _changed(law: Any, acts: Any, own: Any, memory: Any, inner: Any) -> Any:
    """A law that changes a number, such as a deflection or a torque limit."""

    def changed(joint: Any, link: Any, kind: Any, i: int, number: float) -> float:
        found = inner(joint, link, kind, i, number)
        if acts(link, kind, i):
            found = law(memory(joint, kind, i), own(link, kind, i), found)
        return found  # type: ignore[no-any-return]

    return changed


def _pulled(law: Any, acts: Any, own: Any, memory: Any, inner: Any) -> Any:
    def pulled(joint: Any, link: Any, kind: Any, i: int, deflection: float, velocity: float) -> float:
        found = inner(joint, link, kind, i, deflection, velocity)
        if acts(link, kind, i):
            found += law(memory(joint, kind, i), own(link, kind, i), deflection, velocity)
        return found  # type: ignore[no-any-return]

    return pulled


def _held(law: Any, acts: Any, own: Any, memory: Any, inner: Any) -> Any:
    def held(joint: Any, link: Any, kind: Any, i: int, position: float, velocity: float, load: float) -> float:
        found = inner(joint, link, kind, i, position, velocity, load)
        if acts(link, kind, i):
            found += law(memory(joint, kind, i), own(link, kind, i), position, velocity, load)
        return found  # type: ignore[no-any-return]

    return held


def _kept(law: Any, acts: Any, own: Any, memory: Any, inner: Any) -> Any:
    def kept(joint: Any, link: Any, kind: Any, i: int, kick: Any) -> None:
        inner(joint, link, kind, i, kick)
        if acts(link, kind, i):
            law(memory(joint, kind, i), own(link, kind, i), kick)

    return kept


def _stored(law: Any, acts: Any, own: Any, memory: Any, inner: Any) -> Any:
    def stored(joint: Any, link: Any, kind: Any) -> None:
        inner(joint, link, kind)
        total = 0.0
        for i in range(kind.springs):
            if acts(link, kind, i):
                total += law(memory(joint, kind, i), own(link, kind, i))
        joint.stage_energy += total

    return stored


def _lost(law: Any, at: StageAccess, inner: Any) -> Any:
    acts, own, memory, lose = at

    def lost(joint: Any, link: Any, kind: Any) -> None:
        inner(joint, link, kind)
        total = 0.0
        for i in range(kind.springs):
            if acts(link, kind, i):
                total += law(memory(joint, kind, i), own(link, kind, i))
        joint.stage_lost += total
        lose(joint, kind, total)

    return lost


def _ends(place: Any) -> Any:
    def ends(joint: JointState, link: JointConstants, kind: JointKind, q: float) -> None:
        for i in range(kind.positions):
            motor = motor_of(joint, i)
            motor.end = motor.theta
            if i < kind.springs:
                motor.end = q + place(joint, link, kind, i, motor.theta - q)

    return ends


def _adding(pull: Any, hold: Any, bound: Any) -> Any:
    def add(joint: JointState, link: JointConstants, kind: JointKind, q: float) -> None:
        for i in range(kind.springs):
            motor = motor_of(joint, i)
            rate = motor.velocity - joint.kick_velocity
            if i < kind.dynamic:
                rate += joint.kick_lead * motor.acceleration
                motor.limit = bound(joint, link, kind, i, drive_of(link, i).limit)
            motor.parallel = pull(joint, link, kind, i, motor.theta - q, rate)
            motor.pull += motor.parallel
            if i < kind.dynamic:
                speed = motor.velocity + joint.kick_lead * motor.acceleration
                motor.ground = hold(joint, link, kind, i, motor.theta, speed, motor.pull)

    return add


def _remembering(keep: Any) -> Any:
    def remember(joint: JointState, link: JointConstants, kind: JointKind) -> None:
        for i in range(kind.springs):
            motor = motor_of(joint, i)
            kick = motor.kick
            kick.motor_position, kick.motor_velocity = motor.kick_position, motor.mean_velocity
            # A motor on the housing has no spring to the link.
            kick.deflection = motor.kick_position - joint.position if i < kind.pulling else 0.0
            kick.velocity = motor.mean_velocity - joint.velocity if i < kind.pulling else 0.0
            kick.motor_torque, kick.elastic_torque = motor.torque, motor.load
            kick.step, kick.next_step = joint.kick_since, joint.kick_lead
            keep(joint, link, kind, i, kick)

    return remember


def _storing(store: Any) -> Any:
    def energies(joint: JointState, link: JointConstants, kind: JointKind) -> None:
        joint.stage_energy = 0.0
        store(joint, link, kind)

    return energies


def _losing(lose: Any) -> Any:
    def losses(joint: JointState, link: JointConstants, kind: JointKind) -> None:
        joint.stage_lost = 0.0
        lose(joint, link, kind)

    return losses
