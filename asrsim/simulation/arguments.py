"""The arguments of the kernel's loop (`asrsim.simulation.kernel.run`), grouped in named tuples.

Compiled code takes the tables as arrays; plain Python uses lists and records instead of some arrays. The inputs are
`asrsim.simulation.inputs.Given`.
"""

from __future__ import annotations

from typing import Any, NamedTuple


class Stretch(NamedTuple):
    """The worlds and substeps that one call advances."""

    which: Any
    """Rows (m, 4), one for each world to advance: indices of the world, of the world's inputs and references, of its recorded
    values, and of its wrenches, lengths and cuts.
    """
    first: int
    """First row of the inputs."""
    substeps: int
    """Number of substeps."""


class Tables(NamedTuple):
    """Tables with an entry for each world."""

    states: Any
    """States of the joints: table S (worlds, joints, ...) of `asrsim.simulation.fields`."""
    constants: Any
    """Constants of the joints: table P (worlds, joints, ...)."""
    engines: Any
    """States of the engine (worlds, ...)."""
    done: Any
    """Number of completed substeps (worlds,)."""
    fault: Any
    """Health of each world, and number of the faulty joint (worlds, 2)."""
    rows: Any
    """Last recorded row (worlds, joints, columns)."""
    strides: Any
    """Three numbers of each world (worlds, 3): the stride in which the world moves, the number of steps for which a longer
    stride has been possible, and whether the stride may change (0: no, 1: yes, 2: yes, with parameters that differ from the
    scenario's); see `asrsim.simulation.strides`.
    """


class Common(NamedTuple):
    """Tables that all worlds share."""

    kinds: Any
    """Kinds of the joints: table K (joints, ...)."""
    scheme: Any
    """Constants of the stepping: a table with a record `Scheme` for each pair of strides, before and after a kick."""
    sizes: Any
    """Number of substeps in each stride (s,), increasing from 1."""
    deflections: Any
    """Deflection (s, joints) in rad up to which the springs of each joint are soft enough for each stride."""
    stiffest: Any
    """Largest stiffness (s, joints) of the springs of each joint that each stride resolves, N m/rad."""
    shares: Any
    """Length (s, s) of the kick between two strides, as a fraction of the second stride."""


class EngineCall(NamedTuple):
    """The engine for one call of the loop; each thread has a separate `EngineCall`."""

    step: Any
    """Address of the engine's step function."""
    records: Any
    """Address of the engine's record for each stride, which the step function receives."""
    exchange: Any
    """Loads and motions of the links (pieces, joints, 6); see `asrsim.engines.base`."""


class RowSelection(NamedTuple):
    """Quantities and rows that are recorded."""

    every: int
    """Number of substeps between recorded rows."""
    watched: int
    """1 if energies, limits and stiffness are computed, else 0."""
    of_state: Any
    """Columns of S that are recorded; in plain Python, a function that returns the values of these columns from a joint's
    state.
    """
    of_inputs: Any
    """Columns of the references that are recorded; in plain Python, a function that returns the values of these columns from a
    row of references."""


class Corrections(NamedTuple):
    """Corrections by an observer, which moves a simulation towards measured positions. Without an observer, the tables are
    empty."""

    measured: Any
    """Positions (m, steps, joints, 1 + motors) of links and motors at whole steps, rad or m; NaN: not measured. The loop
    replaces the positions by the errors before the correction.
    """
    gains: Any
    """Changes (2,) of the position, and of the velocity in 1/s, per error of the position."""
    coordinates: Any
    """Indices (3, joints) of position, velocity and previous velocity of each link in the state of the engine."""
