"""The loop over worlds and substeps, as Python or compiled.

In a substep the joints are loaded (`asrsim.simulation.joint`), the engine moves the links, the energy balance is updated
(`asrsim.simulation.ledger`), and rows are recorded. A kick in which an input jumps has several pieces, which act on the links
one after the other.
"""

from __future__ import annotations

from typing import Any

from asrsim.simulation.arguments import Common, Corrections, EngineCall, RowSelection, Stretch, Tables
from asrsim.simulation.fields import Scheme
from asrsim.simulation.inputs import Given
from asrsim.simulation.joint import load_joint, move_on, settle
from asrsim.simulation.laws import engine_step, inputs_of, joint_of, motion_of, motor_of, record, spring_law
from asrsim.simulation.layout import GOALS, HEALTH, TASK
from asrsim.simulation.ledger import update_ledger

FASTEST = 1e4
"""Link speed above which a world counts as diverged, rad/s (m/s)."""
PATIENCE = 100
"""Number of steps in which a longer stride must be possible before a world takes this stride. The world waits, since each
change of stride disturbs the energy.
"""
OTHER = 2
"""Entry of `strides` for a world whose parameters differ from the parameters of the scenario, so that `deflections` do not
apply."""
FASTER = 2.0
"""Safety factor for the speed with which a deflection may grow within a step."""
ENDLESS = 1e300
"""Magnitude above which a torque counts as infinite, N m."""


def run(
    stretch: Stretch,
    worlds: Tables,
    common: Common,
    given: Given,
    engine: EngineCall,
    recorded: RowSelection,
    corrections: Corrections,
    out: Any,
) -> None:
    """Advance worlds by some substeps. out: recorded values (m, rows, joints, columns of the state and of the references)."""
    kinds, exchange, fault, sizes = common.kinds, engine.exchange, worlds.fault, common.sizes
    first, every, watched = stretch.first, recorded.every, recorded.watched
    last = first + stretch.substeps
    of_state, of_inputs = recorded.of_state, recorded.of_inputs
    observed = len(corrections.measured) > 0
    for chosen in range(len(stretch.which)):
        row = stretch.which[chosen]
        w, own_set, place, timing = row[0], row[1], row[2], row[3]
        kept = cut = 0
        states, constants, x = worlds.states[w], worlds.constants[w], worlds.engines[w]
        inputs, references = given.inputs[own_set], given.references[own_set]
        pushes, lengths, cuts = given.wrenches[timing], given.lengths[timing], given.cuts[timing]
        while cut < len(cuts) and 0 <= cuts[cut][0] < first:
            cut += 1
        before, step, adaptive = worlds.strides[w, 0], first, worlds.strides[w, 2] != 0
        substep, sound = worlds.done[w], fault[w, 0] == HEALTH.healthy
        while step < last and sound:
            after = before
            asked, begins = substep % every == 0, substep == 0
            if adaptive and asked and not begins:
                after = stride_of(states, constants, common, inputs, worlds.strides, w, step, step + every <= last)
            scheme = common.scheme[before * len(sizes) + after]
            if observed and asked:
                observe(states, constants, kinds, scheme, x, corrections, place, substep // every)
            begin, end, on_time = step, step + 1, -1
            while cut < len(cuts) and 0 <= cuts[cut][0] <= step:
                # Split a kick only if it is as long as a substep, since the lengths of pieces are fractions of a substep.
                if cuts[cut][0] == step and before == 0 and after == 0:
                    begin, end, on_time = cuts[cut][1], cuts[cut][2], cuts[cut][3]
                cut += 1
            kicks = lengths[begin:end] if before == after else common.shares[before, after : after + 1]
            jumped, whole = on_time >= 0, watched != 0 and asked
            for j in range(len(kinds)):
                joint, link, kind = joint_of(states, constants, kinds, j)
                total = load_joint(
                    joint, link, kind, scheme, inputs, lengths, exchange, j, step, begin, end, on_time, begins, whole
                )
                if not abs(total) < ENDLESS:
                    fault[w, 0], fault[w, 1], sound = HEALTH.no_value, j, False
                    break
            if not sound:
                break
            engine_step(engine.step, engine.records[after], x, exchange, pushes[begin:end], kicks, end - begin)
            for j in range(len(kinds)):
                joint, link, kind = joint_of(states, constants, kinds, j)
                position, velocity, at_time = motion_of(exchange, end - begin - 1, j)
                if before != after:
                    # Interpolate the velocity, since between two different strides the time of the substep is not the middle of
                    # the kick.
                    at_time = joint.engine_velocity + scheme.first_drift * (velocity - joint.engine_velocity)
                settle(joint, link, kind, scheme, velocity, at_time, begins, jumped)
                if watched:
                    update_ledger(joint, link, kind, scheme, begins, jumped, asked)
                if asked:
                    record(out, place, kept, j, joint, of_state, inputs_of(references, step, j), of_inputs)
                start = joint.engine_velocity
                move_on(joint, scheme, position, velocity, begins)
                if before != after:
                    # Store the velocity from which a kick over the complete new stride would have led to the new velocity.
                    joint.last_engine_velocity = velocity - (velocity - start) / kicks[0]
                if not abs(velocity) <= FASTEST:
                    fault[w, 0], fault[w, 1], sound = HEALTH.ran_away, j, False
            if asked:
                kept += 1
            if after != before:
                worlds.strides[w, 0] = after
            substep, step, before = substep + sizes[after], step + sizes[after], after
            worlds.done[w] = substep
        for j in range(len(kinds) if kept else 0):
            for c in range(out.shape[3]):
                worlds.rows[w, j, c] = out[place, kept - 1, j, c]


def stride_of(states: Any, constants: Any, common: Common, inputs: Any, strides: Any, w: int, step: int, whole: bool) -> int:
    """Stride of a world after a whole step. If a spring may become too stiff for the present stride, the world takes a shorter
    stride at once. The world takes a longer stride after `PATIENCE` steps in which the longer stride was possible.

    whole: whether the call of the loop contains the whole step that follows.
    """
    longest = len(common.sizes) - 1 if whole else 0
    for j in range(len(common.kinds)):
        joint, link, kind = joint_of(states, constants, common.kinds, j)
        if not kind.sprung:
            continue
        speed = abs(joint.engine_velocity)
        for i in range(kind.dynamic):
            speed = max(speed, abs(joint.engine_velocity) + abs(motor_of(joint, i).velocity))
        way, most = FASTER * speed * common.scheme[0].step * common.sizes[longest], 0.0
        for i in range(kind.positions):
            motor = motor_of(joint, i)
            place = motor.position if i < kind.dynamic else inputs_of(inputs, step, j)[GOALS + i]
            motor.theta = place + way if place > joint.position else place - way
            most = max(most, abs(motor.theta - joint.position))
        if strides[w, 2] == OTHER or not most <= common.deflections[longest, j]:
            # Compute the stiffness at the largest deflections that the springs can reach in the step.
            spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.whole)
            while longest > 0 and not joint.stiffness <= common.stiffest[longest, j]:
                longest -= 1
    now: int = strides[w, 0]
    strides[w, 1] = strides[w, 1] + 1 if longest > now else 0
    if now < longest and strides[w, 1] <= PATIENCE:
        return now
    strides[w, 1] = 0
    return longest


def observe(
    states: Any, constants: Any, kinds: Any, scheme: Scheme, x: Any, corrections: Corrections, place: int, step: int
) -> None:
    """Move positions and velocities of a world towards measured positions at a whole step, and replace the measured positions
    by the errors before the correction. x: state of the engine; place: number of the world in the measured positions.
    """
    measured, gains, coordinates = corrections.measured[place], corrections.gains, corrections.coordinates
    for j in range(len(kinds)):
        joint, _, _ = joint_of(states, constants, kinds, j)
        for c in range(measured.shape[2]):
            motor = motor_of(joint, max(c - 1, 0))
            there = joint.position if c == 0 else motor.position + scheme.first_drift * scheme.step * motor.velocity
            error = measured[step, j, c] - there
            measured[step, j, c] = error
            if not abs(error) < ENDLESS:
                continue
            near, fast = gains[0] * error, gains[1] * error
            if c > 0:
                motor.position += near
                motor.velocity += fast
                motor.anchor += near
                continue
            joint.position += near
            joint.engine_velocity += fast
            joint.last_engine_velocity += fast
            x[coordinates[0, j]] += near
            x[coordinates[1, j]] += fast
            x[coordinates[2, j]] += fast
