"""A start at static equilibrium: links where springs carry them, motors where the first references put them under that load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators.detailed_motor import Electric
from asrsim.engines.base import Model
from asrsim.errors import Problem, ScenarioError
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import Drive
from asrsim.simulation.inputs import Inputs

BALANCED = 1e-10
"""N m (N): what may be left of a joint's balance."""
NUDGE = 1e-6
"""rad (m) of the differences that give slopes."""
LONGEST = 0.2
"""rad (m) of a step towards the equilibrium: springs are steep, and gravity turns over."""
ROUNDS = 200


def at_equilibrium(scenario: Scenario, drives: Sequence[Drive], model: Model) -> tuple[Drive, ...]:
    """The drives with their start at rest, everything in balance under the references at t = 0.

    Newton's method on the links' positions; motors follow, each where its controller's torque is the spring's. Joints without a
    spring stay where they are, as modes 0 and 1 do. Raises ScenarioError naming the joint that finds no balance.
    """
    sampled = Inputs(scenario, drives, substep=scenario.step, staggered=False).sample(np.zeros(1))
    goals = []
    for j, drive in enumerate(drives):
        first, second = drive.goals(sampled[0][:, j], sampled[1][:, j])
        goals.append((float(first[0]), float(second[0])))
    external = sampled[2][0]
    sprung = [
        j
        for j, drive in enumerate(drives)
        if drive.passive_stiffness or (drive.mode and drive.mode.spring and not drive.mode.direct)
    ]
    q = np.array([drive.initial_position for drive in drives])
    still = np.zeros(len(drives))

    def balance(positions: Array) -> Array:
        held = -np.asarray(model.bias(positions, still)) + external
        for j in sprung:
            held[j] += link_torque(drives[j], float(positions[j]), goals[j])
        return np.asarray(held[sprung])

    left = balance(q)
    for _ in range(ROUNDS):
        if not len(sprung) or np.abs(left).max() < BALANCED:
            break
        slopes = np.empty((len(sprung), len(sprung)))
        for column, j in enumerate(sprung):
            moved = q.copy()
            moved[j] += NUDGE
            slopes[:, column] = (balance(moved) - left) / NUDGE
        step = np.linalg.lstsq(slopes, -left, rcond=None)[0]
        step *= min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-300))
        q[sprung] += step
        left = balance(q)
    if len(sprung) and not np.abs(left).max() < 1e3 * BALANCED:
        worst = drives[sprung[int(np.argmax(np.abs(left)))]].name
        message = f"joint '{worst}' finds no equilibrium: its spring cannot hold it"
        raise ScenarioError(
            Problem(message=message, key="initial", hint="Give initial positions instead", code="no-equilibrium")
        )
    found = []
    for j, drive in enumerate(drives):
        positions = None
        if j in sprung and drive.dynamic_motors:
            positions = motors_at_rest(drive, float(q[j]), goals[j])
        found.append(replace(drive, initial_position=float(q[j]), motor_positions=positions))
    return tuple(found)


def link_torque(drive: Drive, q: float, goals: tuple[float, float]) -> float:
    """N m of spring (and passive spring) on the link that stands at q, motors at rest."""
    passive = drive.passive_stiffness * (drive.joint.spring_reference - q)
    if drive.actuator is None or drive.mode is None or not drive.mode.spring:
        return passive
    places = motors_at_rest(drive, q, goals) if drive.dynamic_motors else goals
    second = places[1] if len(places) > 1 else goals[1]
    return passive + sum(drive.actuator.elastic_torques(q, places[0], second, drive.elastic))


def motors_at_rest(drive: Drive, q: float, goals: tuple[float, float]) -> tuple[float, ...]:
    """rad of each motor where its controller's torque balances its spring's; friction and integral action at 0."""
    actuator = drive.actuator
    if actuator is None:
        return ()
    places = []
    for i in range(actuator.motors):
        gain = drive.values[f"controller_{i + 1}_proportional"]
        electric = drive.electric(i + 1)
        stops = drive.values[f"motor_{i + 1}_min_position"], drive.values[f"motor_{i + 1}_max_position"]

        def surplus(theta: float, i: int = i, gain: float = gain, electric: Electric = electric) -> float:
            pair = (theta, goals[1]) if actuator.motors == 1 else ((theta, q) if i == 0 else (q, theta))
            push = float(electric.torque_of(gain * (goals[i] - theta)))
            return push - actuator.elastic_torques(q, *pair, drive.elastic)[i]

        places.append(min(max(_root(surplus, goals[i], q), stops[0]), stops[1]))
    return tuple(places)


def _root(falling: object, goal: float, q: float) -> float:
    """Where a falling function is 0: between the goal and the link, or beyond."""
    from scipy.optimize import brentq

    low, high = min(goal, q), max(goal, q)
    reach = 1e-6
    while falling(low) < 0.0 and reach < 1e6:  # type: ignore[operator]
        low, reach = low - reach, 2.0 * reach
    reach = 1e-6
    while falling(high) > 0.0 and reach < 1e6:  # type: ignore[operator]
        high, reach = high + reach, 2.0 * reach
    return float(brentq(falling, low, high, xtol=1e-15, rtol=1e-15)) if low < high else low
