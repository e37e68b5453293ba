"""Gravity compensation: the equilibrium at which a spring holds a given load at a given link position.

The elastic law is inverted numerically, so it works for every registered actuator: at a fixed preset the torque on the
link grows with the equilibrium, up to what the spring can hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.detailed_motor import electric_of
from asrsim.errors import InputError, Problem
from asrsim.robot.model import ActuatorBlock

SEARCH = 16.0
"""rad (or m) from the link's position within which an equilibrium is looked for: some turns of a motor."""
ROOT_TOLERANCE = 1e-14


@dataclass(frozen=True, kw_only=True)
class JointDrive:
    """What gravity compensation and learning must know of a joint's actuator; unlike the simulation's, it steps nothing."""

    joint: str
    actuator: type[Actuator]
    mode: int
    spring: tuple[float, ...]
    """Parameters of the actuator's law, in its order."""
    proportional: tuple[float, ...] = ()
    """N m/rad, controller gain of each motor; empty where there is no controller."""
    integral: tuple[float, ...] = ()
    max_torque: tuple[float, ...] = ()
    """N m, of each motor; empty where motors are ideal."""
    derivative: tuple[float, ...] = ()
    """N m s/rad, controller gain of each motor."""
    motor_inertia: tuple[float, ...] = ()
    """kg m^2, of each motor; empty where motors are ideal."""
    motor_damping: tuple[float, ...] = ()
    """N m s/rad."""
    motor_friction: tuple[float, ...] = ()
    """N m."""
    max_velocity: tuple[float, ...] = ()
    """rad/s, of each motor; empty where motors are ideal."""

    @property
    def max_deflection(self) -> float:
        """rad beyond which the springs' torques stay constant; infinite for a law without that parameter."""
        names = [parameter.name for parameter in self.actuator.parameters]
        return self.spring[names.index("max_deflection")] if "max_deflection" in names else math.inf


class LoadError(InputError):
    """A spring or motor cannot hold a load; `largest` is what it can hold in N m."""

    def __init__(self, problem: Problem, largest: float) -> None:
        super().__init__(problem)
        self.largest = largest


def drive_of(block: ActuatorBlock) -> JointDrive:
    """The drive of an actuator block, with the parameters that it resolved."""
    actuator = ACTUATORS.get(block.actuator)
    values = block.values()
    motors = range(1, actuator.motors + 1)
    mode = MODES[block.mode]
    # Of electric motors, whose controllers give voltage or current, what they come to in torque.
    electric = [electric_of(values, i, mode) for i in motors]

    def of_controllers(name: str) -> tuple[float, ...]:
        gains = zip(motors, electric, strict=True)
        return tuple(one.gain * values[f"controller_{i}_{name}"] for i, one in gains) if mode.controller else ()

    def of_motors(name: str) -> tuple[float, ...]:
        return tuple(values[f"motor_{i}_{name}"] for i in motors) if mode.motor else ()

    return JointDrive(
        joint=block.joint,
        actuator=actuator,
        mode=block.mode,
        spring=tuple(values[parameter.name] for parameter in actuator.parameters),
        proportional=of_controllers("proportional"),
        integral=of_controllers("integral"),
        derivative=of_controllers("derivative"),
        max_torque=tuple(min(one.limit, one.stall) for one in electric) if mode.motor else (),
        motor_inertia=of_motors("inertia"),
        motor_damping=tuple(d + one.lag for d, one in zip(of_motors("damping"), electric, strict=False)),
        motor_friction=of_motors("friction_torque"),
        max_velocity=of_motors("max_velocity"),
    )


def resting_motors(drive: JointDrive, position: float, equilibrium: float, preset: float) -> tuple[float, float]:
    """Where the motors come to rest under load, rad: a controller without integral term droops by tau_el / P.

    position: of the link, rad. Motor friction is left out. For ideal motors these are the references themselves.
    """
    law, spring = drive.actuator.elastic_torques, drive.spring
    references = list(drive.actuator.motor_references(equilibrium, preset))
    resting = list(references)
    for _ in range(50):
        before = tuple(resting)
        for motor, (gain, integral) in enumerate(zip(drive.proportional, drive.integral, strict=True)):
            if integral > 0.0 or gain <= 0.0:
                continue

            def lag(theta: float, motor: int = motor, gain: float = gain) -> float:
                at = [*resting]
                at[motor] = theta
                return theta - references[motor] + law(position, at[0], at[1], spring)[motor] / gain

            resting[motor] = _droop(lag, references[motor])
        if tuple(resting) == before or drive.actuator.motors < 2:
            break
    return resting[0], resting[1]


def _droop(lag: Callable[[float], float], reference: float) -> float:
    """Where a motor's lag is 0: it lies between the reference and the droop that the torque there would make."""
    full = lag(reference)
    # The torque grows with theta, so the droop at the reference itself bounds the droop.
    far = reference - full
    rest = lag(far)
    # A spring at its deflection limit gives the same torque at both ends: the far one is then the root, but for rounding.
    if rest == 0.0 or math.copysign(1.0, rest) == math.copysign(1.0, full):
        return far
    return _root(lag, reference, far)


def equilibrium_for_load(
    drive: JointDrive, position: float, load: float, preset: float, *, droop: bool = False, guess: float | None = None
) -> float:
    """Equilibrium position in rad at which the springs put `load` (N m) on a link at `position` (rad).

    preset: the second reference (stiffness preset, or adjuster in m). droop: with the motors' steady-state error
    under their load. guess: an equilibrium nearby, which saves time. Raises LoadError where the springs or the motors
    cannot hold the load.
    """
    law, spring = drive.actuator.elastic_torques, drive.spring

    def motors(equilibrium: float) -> tuple[float, float]:
        if droop:
            return resting_motors(drive, position, equilibrium, preset)
        return drive.actuator.motor_references(equilibrium, preset)

    def surplus(equilibrium: float) -> float:
        try:
            return sum(law(position, *motors(equilibrium), spring)) - load
        except OverflowError:
            return math.copysign(math.inf, equilibrium - position)

    centre = position if guess is None else guess
    here = surplus(centre)
    if here == 0.0:
        found = centre
    else:
        direction = -math.copysign(1.0, here)
        found = _search(surplus, centre, here, direction, drive, position, load)
    torques = law(position, *motors(found), spring)
    for motor, (torque, limit) in enumerate(zip(torques, drive.max_torque, strict=False), start=1):
        if abs(torque) > limit:
            raise LoadError(
                Problem(
                    message=f"motor {motor} would have to hold {abs(torque):.4g} N m at position {position:.4g} rad under a "
                    f"load of {load:.4g} N m and preset {preset:.4g}, but its limit is {limit:.4g} N m",
                    key=drive.joint,
                    hint="raise the motor's maximum torque or lower the stiffness preset",
                    code="motor-too-weak",
                ),
                largest=limit,
            )
    return found


def _search(
    surplus: Callable[[float], float],
    centre: float,
    here: float,
    direction: float,
    drive: JointDrive,
    position: float,
    load: float,
) -> float:
    """Walk outwards until the sign changes, then find the root between the last two places."""
    near, reach, best = centre, 1e-3, here
    while reach <= SEARCH:
        far = centre + direction * reach
        there = surplus(far)
        if math.copysign(1.0, there) != math.copysign(1.0, here) or there == 0.0:
            return _root(surplus, near, far)
        best = there if abs(there) < abs(best) else best
        near, reach = far, 2.0 * reach
    largest = best + load
    raise LoadError(
        Problem(
            message=f"the spring cannot hold {load:.4g} N m at position {position:.4g} rad: "
            f"the most it can hold that way is {largest:.4g} N m",
            key=drive.joint,
            hint="choose a stiffer preset or spring, or another posture",
            code="spring-too-weak",
        ),
        largest=largest,
    )


def _root(function: Callable[[float], float], one: float, other: float) -> float:
    """A root between two places of opposite sign, to rounding."""
    from scipy.optimize import brentq

    low, high = min(one, other), max(one, other)
    if function(low) == 0.0:
        return low
    if function(high) == 0.0:
        return high
    if math.isinf(function(low)) or math.isinf(function(high)):
        return _bisect(function, low, high)
    return float(brentq(function, low, high, xtol=ROOT_TOLERANCE, rtol=1e-15))


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Bisection, for laws that overflow on the way."""
    sign = math.copysign(1.0, function(low))
    while high - low > ROOT_TOLERANCE * max(1.0, abs(low)):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if math.copysign(1.0, function(middle)) == sign:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
