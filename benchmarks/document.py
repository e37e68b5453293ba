"""docs/performance.md: what was measured, with the machine it was measured on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from figure import draw
from machine import machine
from memory import peak

if TYPE_CHECKING:
    from run import Row

DOCUMENT = Path(__file__).parents[1] / "docs" / "performance.md"

TEXT = """# Performance

Written by `python benchmarks/run.py --docs`; `python benchmarks/run.py` measures the table anew (`--json`, `--only NAME`,
`--repeats N`). All figures are ratios of CPU times, medians of rounds in which both sides take turns in one process:
what a microsecond is differs from machine to machine, and on a busy one from minute to minute.

{table}

Measured on: {machine}.

{notes}

## What is in a step

A step of the loop takes the inputs, reads the joints, advances motors, controllers, friction and springs, applies the torques,
steps the world, and records *everything*: positions, velocities, torques, stiffness, friction and the energies of every
joint. The reference is PyBullet's `stepSimulation` alone, in the same world: the same robot moving, its joints' own motors off.
Reading joints and applying torques through PyBullet, which nobody can do without, takes that to about 2.0 (2 joints) and
1.8 (5 joints) already.

- Laws run on plain floats: below some twelve joints NumPy is slower. What is recorded is worked out afterwards, a block of up
  to 8192 steps at a time, in NumPy, all joints of a kind together.
- The world is stepped by the automatic number of substeps ([scenario](scenario.md), `substeps`); cost grows with it.
- PyBullet holds Python's lock while it steps: run side by side in processes, not threads.

## The compiled loop

`compiled: auto` (the default) puts the joints of a robot through [Numba](https://numba.pydata.org) where it is installed
(`pip install 'asrsim[fast]'`) and the run is long enough to win back its start; `true` forces it, `false` forbids it.
Numbers are the same, bit for bit, since both loops run the same source. With sensor effects, wrenches, contacts or damping
that follows the stiffness, and in toolbox stepping, the plain loop runs.

- Your own actuator is compiled with the rest if Numba can (functions of floats, `math`, no tables or strings); where it
  cannot, `auto` stays plain, and `true` says what is in the way. A power with a whole exponent (`x ** 3`) is a product when
  compiled, and may differ in the last bit: write `x * x * x`.
- Kernels are kept in `$XDG_CACHE_HOME/asrsim/kernels` (`~/.cache/asrsim/kernels`), by a hash of all code that goes into them:
  a law that changes, or a helper that it calls, gets a kernel of its own, and parameters need none. Where the folder cannot be
  written, nothing is kept. It may be deleted at any time.

## Memory

Peak resident memory of a run with 5 joints, 1 kHz, log written:

| simulated | memory | log |
|---|---|---|
{memory}

It does not grow with the duration: samples go to the log as they come. From Python, `asrsim.run` keeps all samples instead:
{kept} MB a minute with 5 joints at 1 kHz.

## How cost grows

![CPU time of a step over joints and over stiffness](images/performance.png)

Left: one substep, chains of qbMoves without gravity. Right: two joints, SEAs; the stiffer the springs, the more substeps keep
`omega h` at 0.2 or below.
"""


def write(rows: Mapping[str, Row], folder: Path, load: float) -> Path:
    """Measure memory, draw the picture, and write the document; returns where it is. load: of other programs."""
    memory = [(duration, *peak(folder, duration)) for duration in (10.0, 1000.0)]
    draw(folder)
    missed = [name for name, row in rows.items() if row.median > row.goal]
    notes = "All goals are met."
    about = machine()
    libraries = ", ".join(f"{key} {about[key]}" for key in ("Python", "PyBullet", "NumPy", "Numba"))
    if missed:
        notes = f"Missed: {', '.join(f'`{name}`' for name in missed)}."
    if "start" in missed:
        notes += (
            " Of the start, Python, NumPy and PyBullet take 1 by definition; the command line's library (Typer, and Pydantic "
            "that its newer versions import to read a path) takes 0.8; YAML, XML and MCAP 0.2."
        )
    if load > 0.5:
        notes += (
            f" The machine was shared with other programs meanwhile (load average {load:.1f} before), which costs "
            "`processes` most."
        )
    text = TEXT.format(
        table=markdown(rows),
        machine=f"{about['CPU']}, {about['cores']} cores, {libraries}",
        notes=notes,
        memory="\n".join(f"| {duration:g} s | {used:.0f} MB | {size:.0f} MB |" for duration, used, size in memory),
        # 60 000 rows of 5 joints with 20 quantities.
        kept=round(60_000 * 5 * 20 * 8 / 1e6),
    )
    DOCUMENT.write_text(text, encoding="utf-8")
    return DOCUMENT


def markdown(rows: Mapping[str, Row]) -> str:
    """The table, as Markdown."""
    lines = ["| | measured | goal | |", "|---|---|---|---|"]
    lines += [f"| `{name}` | **{row.median:.2f}** | {row.goal:g} | {row.what} |" for name, row in rows.items()]
    return "\n".join(lines)
