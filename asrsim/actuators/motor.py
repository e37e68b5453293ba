"""The DC motor with Dahl friction and position controller, as one pure law (paper sections 3.1.1, 3.1.2; eqs. 7, 8, 11)."""

from __future__ import annotations

from collections.abc import Mapping

from asrsim.actuators.parameters import FRICTION_STIFFNESS


def motor_kick(
    position: float,
    velocity: float,
    anchor: float,
    integral: float,
    reference: float,
    load: float,
    slowest: float,
    fastest: float,
    coefficients: tuple[float, ...],
) -> tuple[float, float, float, float, float, float]:
    """Accelerate a motor over one kick at a fixed position.

    position in rad, velocity in rad/s, anchor in rad (Dahl's w: where the bristles stick), integral (of the controller's
    integral action) in N m; reference: desired position in rad (or the
    torque in N m, mode 4); load: torque of the spring on the motor in N m; slowest, fastest: the velocities in rad/s
    between which its stops and its speed limit keep it (:func:`velocity_bounds`). Coefficients: :func:`motor_coefficients`.
    Returns velocity after the kick, mean velocity over it, anchor, integral, motor torque after its limit, friction torque.
    """
    p, hold, i_step, d_old, d_new, keep, gain, keep_limited, gain_limited, slip, limit = coefficients
    stretch = position - anchor
    if abs(stretch) > slip:
        stretch = slip if stretch > 0.0 else -slip
        anchor = position - stretch
    friction = FRICTION_STIFFNESS * stretch
    load = load + friction
    error = reference - hold * position
    push = p * error + integral
    after = keep * velocity + gain * (push - load)
    torque = push - d_old * velocity - d_new * after
    if abs(torque) > limit:
        torque = limit if torque > 0.0 else -limit
        after = keep_limited * velocity + gain_limited * (torque - load)
    if after > fastest or after < slowest:
        # A limit takes the rest of the torque; damping and back-EMF are those of the velocity that is left.
        after = fastest if after > fastest else slowest
        torque = push - d_old * velocity - d_new * after
        if abs(torque) > limit:
            torque = limit if torque > 0.0 else -limit
    return after, 0.5 * (velocity + after), anchor, integral + i_step * error, torque, friction


def velocity_bounds(position: float, low: float, high: float, fastest: float, step: float) -> tuple[float, float]:
    """Least and largest velocity in rad/s over the next `step` s of a motor at `position`.

    low, high: its stops in rad, which are inelastic: it reaches them at most. fastest: its speed limit in rad/s. A motor
    beyond a stop stays where it is. A step of 0 s moves nothing, and only the speed limit counts.
    """
    if step == 0.0:
        return -fastest, fastest
    slowest, largest = (low - position) / step, (high - position) / step
    slowest = slowest if slowest < 0.0 else 0.0
    largest = largest if largest > 0.0 else 0.0
    return (slowest if slowest > -fastest else -fastest), (largest if largest < fastest else fastest)


def motor_coefficients(
    values: Mapping[str, float], index: int, *, step: float, implicitness: float, controlled: bool
) -> tuple[float, ...]:
    """Constants of :func:`motor_kick` for a kick of `step` s of motor `index`.

    The velocity in damping and derivative action is (1 - implicitness) old + implicitness new: 1/2 is the midpoint
    rule (second order), 0 the explicit Euler rule. `controlled`: modes 5 and 6; else the reference is the torque.
    """
    inertia = values[f"motor_{index}_inertia"]
    damping = values[f"motor_{index}_damping"]
    p = i = d = 0.0
    if controlled:
        p = values[f"controller_{index}_proportional"]
        i = values[f"controller_{index}_integral"]
        d = values[f"controller_{index}_derivative"]
    explicitness = 1.0 - implicitness
    total = damping + d
    denominator = inertia + implicitness * step * total
    denominator_limited = inertia + implicitness * step * damping
    return (
        # Half of what the integral gains in the kick acts in it; in mode 4 the reference itself is the push.
        p + 0.5 * i * step if controlled else 1.0,
        1.0 if controlled else 0.0,
        i * step,
        explicitness * d,
        implicitness * d,
        (inertia - explicitness * step * total) / denominator,
        step / denominator,
        (inertia - explicitness * step * damping) / denominator_limited,
        step / denominator_limited,
        values[f"motor_{index}_friction_torque"] / FRICTION_STIFFNESS,
        values[f"motor_{index}_max_torque"],
    )
