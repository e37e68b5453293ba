"""The DC motor with friction, controller and winding, as one function (paper sections 3.1.1, 3.1.2; eqs. 7, 8, 11).

The friction follows Dahl: bristles stick to an anchor and slip when the torque reaches the level

    tau_c + c |tau_s| + tau_x exp(-(omega / omega_x)^2)

with the Coulomb level tau_c, the spring's torque tau_s on the motor, the load coefficient c (as in BAM's model M3: Duclusaud et
al. 2025), and the Stribeck excess tau_x with the Stribeck velocity omega_x (Armstrong-Helouvry et al. 1994). The bristles never
return more energy than they have stored, even if the level varies, so friction is passive. The electric motor has no
inductance; its equations refer to the output shaft:

    tau = n k_t i,    u = R i + n k_t omega,    |u| <= max_voltage,  |i| <= max_current
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from asrsim.records import constant


@dataclass(slots=True)
class MotorConstants:
    """Constants of a motor in its mode; the controller's command is a torque, a voltage or a current."""

    proportional: float = constant("proportional gain of the controller; 1 if the reference is the command", "command/rad")
    integral: float = constant("integral gain of the controller", "command/(rad s)")
    derivative: float = constant("derivative gain of the controller, on the negative velocity", "command s/rad")
    hold: float = constant("flag: 1 if a controller compares the reference with the position, else 0", "")
    inertia: float = constant("inertia at the link's side of the gear", "kg m^2")
    damping: float = constant("viscous damping", "N m s/rad")
    gain: float = constant("torque per unit of the command", "N m/command")
    lag: float = constant("damping by the back-EMF if the command is a voltage", "N m s/rad")
    emf: float = constant("damping by the back-EMF at full voltage", "N m s/rad")
    stall: float = constant("torque at full voltage and rest", "N m")
    limit: float = constant("largest torque", "N m")
    coulomb: float = constant("Coulomb level of the friction", "N m")
    excess: float = constant("Stribeck excess: static friction minus Coulomb friction", "N m")
    fade: float = constant("reciprocal of the Stribeck velocity", "s/rad")
    share: float = constant("fraction of the spring's torque that adds to the Coulomb level", "")
    bristles: float = constant("stiffness of the friction's bristles", "N m/rad")
    low: float = constant("lower stop", "rad")
    high: float = constant("upper stop", "rad")
    most: float = constant("speed limit", "rad/s")
    torque_constant: float = constant("torque constant at the output; 0: the motor is not electric", "N m/A")
    resistance: float = constant("resistance of the winding", "ohm")


def motor_kick(
    position: float,
    velocity: float,
    anchor: float,
    integral: float,
    reference: float,
    held: float,
    load: float,
    slowest: float,
    fastest: float,
    limit: float,
    step: float,
    implicitness: float,
    own: MotorConstants,
) -> tuple[float, float, float, float, float, float]:
    """State of a motor after a kick, in which the motor accelerates for `step` s at a fixed position.

    position in rad; velocity in rad/s; anchor in rad: point at which the bristles stick (Dahl's w); integral: integral action
    of the controller in units of the command; reference: desired position in rad, or the command in modes without controller;
    held: torque in N m of the springs and stages against the motor; load: torque in N m between motor and link, which increases
    the friction; slowest, fastest: smallest and largest velocity in rad/s that stops and speed limit allow (`velocity_bounds`);
    limit: largest torque of the motor in N m; own: constants of the motor. Damping, back-EMF and derivative action act on the
    velocity (1 - implicitness) old + implicitness new, where old and new are the velocities before and after the kick: an
    implicitness of 1/2 is the midpoint rule (second order), and 0 is the explicit Euler rule.
    Returns velocity after the kick, mean velocity over the kick, anchor, integral, clipped motor torque, friction torque.
    """
    i, d, damping, gain, lag, emf = own.integral, own.derivative, own.damping, own.gain, own.lag, own.emf
    inertia, excess, fade, stiffness, stall = own.inertia, own.excess, own.fade, own.bristles, own.stall
    error = reference - own.hold * position
    # The controller uses the mean of the integral over the kick, which is its old value plus half of its increase.
    push = (own.proportional + 0.5 * i * step) * error + integral
    level = own.coulomb + own.share * abs(load)
    drag = damping + gain * d + lag
    easy = step / (inertia + implicitness * step * drag)
    bristles = stiffness * (position - anchor)
    mean = velocity
    torque = friction = after = 0.0
    # Friction depends on the mean speed over the kick, which is known only after a first round. Two rounds give an error of
    # second order.
    for _ in range(2 if excess != 0.0 else 1):
        most = level + excess * exp(-(mean * fade) * (mean * fade)) if excess != 0.0 else level
        friction = most if bristles > most else -most if bristles < -most else bristles
        after = velocity + easy * (gain * push - held - friction - drag * velocity)
        after = fastest if after > fastest else slowest if after < slowest else after
        middle = velocity + implicitness * (after - velocity)
        torque = gain * (push - d * middle) - lag * middle
        if abs(torque + emf * middle) > stall:
            torque = stall if torque + emf * middle > 0.0 else -stall
            slow = step / (inertia + implicitness * step * (damping + emf))
            after = velocity + slow * (torque - held - friction - (damping + emf) * velocity)
            after = fastest if after > fastest else slowest if after < slowest else after
            torque -= emf * (velocity + implicitness * (after - velocity))
        if abs(torque) > limit:
            torque = limit if torque > 0.0 else -limit
            slow = step / (inertia + implicitness * step * damping)
            after = velocity + slow * (torque - held - friction - damping * velocity)
            after = fastest if after > fastest else slowest if after < slowest else after
        mean = 0.5 * (velocity + after)
    if friction != bristles:
        anchor = position - friction / stiffness
    return after, mean, anchor, integral + i * step * error, torque, friction


def velocity_bounds(position: float, low: float, high: float, fastest: float, step: float) -> tuple[float, float]:
    """Smallest and largest velocity in rad/s that a motor at `position` may have over the next `step` s.

    low, high: positions of the stops in rad. The stops are inelastic, and the motor never passes a stop. fastest: speed limit
    in rad/s. A motor that is beyond a stop stays there. In a step of 0 s only the speed limit applies.
    """
    slowest, largest = -fastest, fastest
    # Divide only for motors that can reach a stop in this step. Most motors cannot.
    if position - step * fastest < low and step > 0.0:
        slowest = (low - position) / step if low < position else 0.0
    if position + step * fastest > high and step > 0.0:
        largest = (high - position) / step if high > position else 0.0
    return slowest, largest
