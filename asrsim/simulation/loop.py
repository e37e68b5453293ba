"""The plain loop: read the joints, advance every actuator, apply the torques, step the world; every substep is recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from struct import pack
from typing import Any

import numpy as np

from asrsim.engines.base import Engine
from asrsim.samples import Array
from asrsim.simulation.damping import make_damping_law, mean_response
from asrsim.simulation.drives import Drive
from asrsim.simulation.inputs import Block, Piece
from asrsim.simulation.kernels import RECORD, damp, make_substepped
from asrsim.simulation.steppings import Stepping

COLUMNS = ("link_position", "engine_velocity", "actuator_torque", *RECORD)
"""Raw record of a joint and substep: rad, rad/s as the engine has it, N m before the effort limit, then the kernels' record."""
FLUSH = 1_000
"""Floats after which inputs are taken from and the record moved to compact arrays: short lists stay in
the processor's cache."""
REFRESH = 1024
"""Substeps after which the links' response to torques is looked at again."""
CORIOLIS_EVERY = 8
"""Substeps, at most, between evaluations of the Coriolis correction; in between it is what it will be half-way there."""
CORIOLIS_PHASE = 1.0
"""rad of the fastest oscillation, at most, between them."""

UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""What :mod:`math` raises where a law has no finite value."""


class NoValueError(ArithmeticError):
    """A law has no finite value where the run took it; becomes a DivergenceError."""

    def __init__(self, joint: str, substep: int, reason: str) -> None:
        super().__init__(f"its law has no finite value ({reason})")
        self.joint = joint
        self.substep = substep


Hook = Callable[[int, Sequence[Any], Sequence[Any]], None]
"""Called before each substep with its number, the engine's joint states and the actuators' states."""


class Loop:
    """State of a run: engine, joints, and what the scheme remembers between substeps."""

    def __init__(
        self,
        engine: Engine,
        drives: Sequence[Drive],
        stepping: Stepping,
        *,
        substep: float,
        motor_substeps: int,
        omega_h: float = 1.0,
        before_step: Sequence[Hook] = (),
    ) -> None:
        self.engine = engine
        self.drives = tuple(drives)
        self.stepping = stepping
        self.substep = substep
        self.motor_substeps = motor_substeps
        self.before_step = tuple(before_step)
        self.states: list[Any] = [drive.initial_state for drive in drives]
        self._kinds = [drive.advance for drive in drives]
        self._advances = [
            make_substepped(drive.advance, motor_substeps) if motor_substeps > 1 and drive.dynamic_motors else drive.advance
            for drive in drives
        ]
        self._constants: dict[float, list[Any]] = {}
        self._efforts = [float("inf") if drive.joint.effort is None else drive.joint.effort for drive in drives]
        self._brakes = [drive.link_brake for drive in drives]
        self._dampings = [drive.joint.damping + drive.link_brake for drive in drives]
        """N m s/rad on the link: the joint's damping and the derivative action of the link's controller (mode 1)."""
        self._laws = [make_damping_law(drive, stepping.first_drift * substep) for drive in drives]
        self.correction = [0.0] * len(self.drives)
        zero = [0.0] * len(self.drives)
        moves = stepping.staggered and engine.bias_difference(zero, zero, zero) is not None
        self._correct_every = max(1, min(CORIOLIS_EVERY, int(CORIOLIS_PHASE / max(omega_h, 1e-9)))) if moves else 0
        """Substeps between Coriolis corrections; 0: none are needed."""
        self._ahead = 0.5 * max(self._correct_every - 1, 0) / max(self._correct_every, 1)
        """Substeps from a correction to the middle of the time that it is held, as a share of that time."""
        self._bias_difference: list[float] | None = None
        # v = now * v_engine + before * v_engine of the substep before: extrapolation to the whole step.
        self._now, self._before = (1.5, -0.5) if stepping.staggered else (1.0, 0.0)
        self.previous = [0.0] * len(self.drives)
        self.last_torque = [0.0] * len(self.drives)
        self.response = [0.0] * len(self.drives)
        self.lean = [0.0] * len(self.drives)
        self.last_mean = [0.0] * len(self.drives)

    def refresh_response(self) -> None:
        """Look again at how fast the links' velocities answer torques: :func:`asrsim.simulation.damping.mean_response`."""
        if self.stepping.staggered and any(self._dampings):
            self.response[:], self.lean[:] = mean_response(self.engine.mass_matrix(), self._dampings, self.substep)

    def constants(self, step: float) -> list[Any]:
        """Constants of every joint for a motor step of `step` s, kept."""
        key = round(step, 15)
        if key not in self._constants:
            self._constants[key] = [drive.constants(step) for drive in self.drives]
        return self._constants[key]

    def run(self, block: Block) -> Array:
        """All substeps of `block`; returns (n, joints, columns) raw records, columns as :data:`COLUMNS`."""
        n = len(block)
        rows = np.empty((n, len(self.drives), len(COLUMNS)))
        events = {k - block.first for k in block.events}
        position = 0
        for mark in sorted({*events, *range(-block.first % REFRESH, n, REFRESH), n}):
            if mark > position:
                self._smooth(block, position, mark, rows)
                position = mark
            if (block.first + mark) % REFRESH == 0:
                self.refresh_response()
            if mark in events:
                rows[mark] = self._split(block, mark)
                position = mark + 1
        return rows

    def _smooth(self, block: Block, start: int, end: int, rows: Array) -> None:
        """Substeps `start` to `end` of the block, none of which an input jumps in, into `rows`. The hot loop."""
        engine = self.engine
        read, apply, advance_engine = engine.read, engine.apply, engine.advance
        constants = self.constants(self.substep / self.motor_substeps)
        fixed = list(zip(self._advances, constants, self._efforts, self._brakes, strict=True))
        states, dampings, correction = self.states, self._dampings, self.correction
        now, before, previous = self._now, self._before, self.previous
        response, lean, last_torque, last_mean = self.response, self.lean, self.last_torque, self.last_mean
        slow = bool(self.before_step or any(self._laws))
        every = self._correct_every
        chunks: list[bytes] = []
        out: list[float] = []
        append = out.append
        size = max(4, FLUSH // (len(states) * len(COLUMNS)))
        for piece in range(start, end, size):
            stop = min(piece + size, end)
            inputs = zip(*(array[piece:stop].tolist() for array in block.goals), strict=True)
            for k, (first, second, external) in enumerate(inputs, block.first + piece):
                joints = read()
                if slow:
                    for hook in self.before_step:
                        hook(k, joints, states)
                    dampings = self._changed_dampings(joints, first, second)
                if every and not k % every:
                    self._correct_coriolis(joints)
                forces = []
                for j, (q, lagging, _, _) in enumerate(joints):
                    advance, constant, limit, brake = fixed[j]
                    past = previous[j]
                    v = now * lagging + before * past
                    previous[j] = lagging
                    try:
                        torque, states[j], record = advance(states[j], constant, q, v, first[j], second[j])
                    except UNDEFINED as fault:
                        raise NoValueError(self.drives[j].name, k, str(fault)) from fault
                    append(q)
                    append(lagging)
                    append(torque)
                    out += record
                    if torque > limit:
                        torque = limit
                    elif torque < -limit:
                        torque = -limit
                    damping = dampings[j]
                    if damping:
                        was, last_torque[j] = last_torque[j], torque
                        torque, last_mean[j] = damp(
                            torque, v, lagging - past, limit, damping, brake, response[j], lean[j], was, last_mean[j]
                        )
                    forces.append(torque + external[j] - correction[j])
                apply(forces=forces)
                advance_engine()
            chunks.append(pack(f"{len(out)}d", *out))
            out.clear()
        rows[start:end] = np.frombuffer(b"".join(chunks)).reshape(end - start, *rows.shape[1:])

    def _split(self, block: Block, index: int) -> Array:
        """One substep whose kick is cut in pieces, with the inputs of each; the first of a run has no piece before t = 0."""
        k = block.first + index
        pieces = block.events[k]
        joints = self.engine.read()
        for hook in self.before_step:
            hook(k, joints, self.states)
        velocities = [self._now * state[1] + self._before * u for state, u in zip(joints, self.previous, strict=True)]
        if k == 0:
            velocities = [state[1] for state in joints]
        self.previous[:] = [state[1] for state in joints]
        last = pieces[-1].rows
        dampings = self._changed_dampings(joints, last[0], last[1]) if any(self._laws) else self._dampings
        length = sum(piece.fraction for piece in pieces)
        means = [0.0] * len(joints)
        totals = [0.0] * len(joints)
        rows: list[tuple[float, ...]] = []
        sides = np.zeros((2, len(joints), len(COLUMNS) + 1))
        side = 0
        for piece in pieces:
            if piece.on_time:
                rows = self._advance_all(piece, joints, velocities, 0.0)[1]
                side = 1
            torques, looked = self._advance_all(piece, joints, velocities, piece.fraction)
            for j, torque in enumerate(torques):
                sides[side, j] += 2.0 * piece.fraction * np.array([*looked[j][:2], torque, *looked[j][3:], piece.rows[2][j]])
                means[j] += piece.fraction / length * torque
                totals[j] += piece.fraction * (torque + piece.rows[2][j] - self.correction[j])
        for j, mean in enumerate(means):
            half = length * self.response[j]
            drag = half * dampings[j]
            v = (velocities[j] + half * (mean - self.last_torque[j]) + drag * self.last_mean[j]) / (1.0 + drag)
            brake, limit = self._brakes[j], self._efforts[j]
            braked = min(max(mean - brake * v, -limit), limit) - mean if brake else 0.0
            sides[:, j, 2] += braked
            totals[j] += length * (braked - (dampings[j] - brake) * v)
            self.last_torque[j] = mean
            self.last_mean[j] = v if k else velocities[j]
        block.sides[k] = sides
        self.engine.apply(forces=totals)
        if k:
            self.engine.advance()
        else:
            self.engine.half_advance()
            # The velocity half a step before the start, as if the first kick had been a whole one.
            self.previous[:] = [2.0 * u - state[1] for u, state in zip(velocities, self.engine.read(), strict=True)]
        return np.array(rows)

    def _advance_all(
        self, piece: Piece, joints: Sequence[Any], velocities: Sequence[float], fraction: float
    ) -> tuple[list[float], list[tuple[float, ...]]]:
        """Advance all joints by a fraction of a substep; fraction 0 only looks. Returns torques after the limit and rows."""
        constants = self.constants(self.substep * fraction)
        torques, rows = [], []
        for j, state in enumerate(joints):
            goals = piece.rows[0][j], piece.rows[1][j]
            try:
                torque, after, record = self._kinds[j](self.states[j], constants[j], state[0], velocities[j], *goals)
            except UNDEFINED as fault:
                raise NoValueError(self.drives[j].name, piece.substep, str(fault)) from fault
            if fraction:
                self.states[j] = after
            rows.append((state[0], state[1], torque, *record))
            torques.append(min(max(torque, -self._efforts[j]), self._efforts[j]))
        return torques, rows

    def _correct_coriolis(self, joints: Sequence[Any]) -> None:
        """The engine evaluates velocity torques at the lagging velocity; make up for it."""
        positions, lagging, _, _ = zip(*joints, strict=True)
        now, before = self._now, self._before
        centred = [now * v + before * u for v, u in zip(lagging, self.previous, strict=True)]
        difference = self.engine.bias_difference(positions, centred, lagging)
        if difference is not None:
            # Held for a while: its value in the middle of that time keeps the second order.
            ahead = self._ahead
            earlier = self._bias_difference or difference
            self.correction[:] = [new + ahead * (new - old) for new, old in zip(difference, earlier, strict=True)]
            self._bias_difference = difference

    def _changed_dampings(self, joints: Sequence[Any], first: Sequence[float], second: Sequence[float]) -> list[float]:
        return [
            damping if law is None else damping + law(joints[j][0], self.states[j], first[j], second[j])
            for j, (damping, law) in enumerate(zip(self._dampings, self._laws, strict=True))
        ]
