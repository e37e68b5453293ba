"""Kicks of motors and links, and signals."""

from __future__ import annotations

import numpy as np

from over_ranges import Asked, found

STATES = [
    (0.1, v, w, 0.02, r, load)
    for v in (-3.0, 0.0, 2.0)
    for w in (0.0999, 0.0, 0.3)
    for r in (-0.5, 0.3)
    for load in (-1.0, 0.4)
]
"""Position, velocity, bristles' anchor, integral, reference, load."""
SIGNALS = {
    "step": {"at": 0.4, "from": 0.1, "to": -0.5},
    "ramp": {"start": 0.3, "duration": 0.5, "from": 0.1, "to": 0.7},
    "minimum_jerk": {"start": 0.1, "duration": 1.2, "from": -0.1, "to": 0.4},
    "sinusoid": {"amplitude": 0.3, "frequency": 1.7, "phase": 0.4, "offset": 0.1, "start": 0.25},
    "chirp": {"amplitude": 0.2, "from": 0.5, "to": 4.0, "duration": 1.1, "start": 0.2, "offset": -0.1},
    "multisine": {"amplitude": 0.3, "frequencies": [1.0, 2.5, 4.0], "start": 0.1},
    "multisine random": {"amplitude": [0.3, 0.1], "frequencies": [1.0, 2.5], "phase": "random", "seed": 4},
    "multisine flat": {"amplitude": 0.3, "frequencies": [1.0, 2.5, 4.0], "phase": "schroeder", "offset": 0.1},
    "pulse_train count": {"high": 1.0, "width": 0.1, "period": 0.2, "count": 3},
    "pulse_train flat": {"low": 0.2, "high": 0.2, "width": 0.1, "period": 0.2},
    "pulse_train": {"low": -0.1, "high": 0.4, "width": 0.11, "period": 0.37, "start": 0.13},
    "waypoints": {"points": [[0.0, 0.1], [0.5, -0.2], [1.2, 0.3]], "interpolation": "cubic"},
    "sum": [0.1, {"step": {"at": 0.3, "to": 1.0}}, {"ramp": {"duration": 1.0, "to": 0.5}}],
    "scale": {"by": -2.0, "of": {"step": {"at": 0.3, "to": 1.0}}},
    "delay": {"by": 0.35, "of": {"pulse_train": {"high": 1.0, "width": 0.2, "period": 0.5}}},
}


def kicks() -> Asked:
    from asrsim.actuators import ACTUATORS, MODES

    sea = ACTUATORS.get("sea")
    plain = {one.name: one.default for one in sea.all_parameters()} | {"motor_1_max_torque": 2.0, "motor_1_max_velocity": 4.0}
    electric = {
        "motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 30.0, "motor_1_resistance": 1.5, "motor_1_max_voltage": 12.0,
        "motor_1_max_current": 2.0, "motor_1_stribeck_friction": 0.1, "motor_1_load_friction": 0.2,
    }  # fmt: skip
    told = "actuators.motor.motor_coefficients"
    for controlled, implicitness in ((True, 0.5), (True, 0.0), (False, 0.5)):
        how = {"step": 0.002, "implicitness": implicitness, "controlled": controlled}
        constants = found(told)(plain | {"controller_1_integral": 3.0}, 1, **how)
        yield f"coefficients {how}", lambda c=constants: np.array(c), [()]
        yield f"kick {how}", lambda *state, c=constants: found("actuators.motor.motor_kick")(*state, c), STATES
    for number in (4, 5, 6, 7, 8):
        for more in ({}, electric, electric | {"motor_1_resistance": 0.0}, electric | {"motor_1_max_current": 0.3}):
            values, mode = plain | more, MODES[number]
            yield f"electric {number}", lambda v, m: found("actuators.detailed_motor.electric_of")(v, 1, m), [(values, mode)]
            yield f"largest {number}", lambda v, m: found("actuators.detailed_motor.largest_command")(v, 1, m), [(values, mode)]
            yield (
                f"missing {number}",
                lambda v, m: found("actuators.detailed_motor.missing_constants")(v, 1, m),
                [(values, mode)],
            )
            how = {"step": 0.002, "implicitness": 0.5, "mode": mode}
            constants = found("actuators.detailed_motor.detailed_coefficients")(values, 1, **how)
            yield (
                f"detailed {number}",
                lambda *state, c=constants: found("actuators.detailed_motor.detailed_kick")(*state, c),
                STATES[::5],
            )
    constants = (0.02, 0.3, 1.5, -0.4, 0.11, 0.05)
    yield (
        "released",
        lambda p, v, w, i, r, load: found("simulation.toolbox.toolbox_motor")(p, v, w, 4 * r, load, 0.002, constants),
        STATES,
    )


def of_signals() -> Asked:
    time = np.concatenate([np.linspace(-0.2, 2.0, 45), [0.3, 0.35, 0.4, 0.13, 0.24, 0.8]])
    for name, data in SIGNALS.items():
        signal = found("signals.parse.parse_signal")({name.split()[0]: data})
        yield name, lambda t, s=signal: s.values(np.array([t])), [(t,) for t in time.tolist()]
        yield f"{name} jumps", signal.jumps, [(0.0, 2.0), (0.3, 0.5), (0.4, 0.4), (0.13, 0.24)]
