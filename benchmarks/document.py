"""docs/performance.md: what was measured, with the machine it was measured on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from figure import draw
from machine import machine

if TYPE_CHECKING:
    from run import Row

DOCUMENT = Path(__file__).parents[1] / "docs" / "performance.md"

TEXT = """# Performance

Written by `python benchmarks/run.py --docs`; `python benchmarks/run.py` measures the table anew (`--json`, `--only NAME`,
`--repeats N`).
Figures are ratios of CPU times, medians of rounds in which both sides take turns, where they name no unit:
what a microsecond is differs from machine to machine, and on a busy one from minute to minute.

{table}

Measured on: {machine}.

{notes}

## What is in a step

A step of the loop takes the inputs, reads the joints, advances motors, controllers, friction and springs, applies the torques,
steps the world, and records *everything*: positions, velocities, torques, stiffness, friction and the energies of every joint.

- In MuJoCo a whole stretch of steps is compiled together with the engine's own: nothing goes through Python between two jumps
  of a reference. In PyBullet every step does; its functions then are most of the cost.
- Energies and limits are settled in the substep itself; stiffness and the springs' energy are worked out at the steps that are
  recorded. Many worlds need neither unless somebody asks for them.
- The world is stepped by the automatic number of substeps ([scenario](scenario.md), `substeps`); cost grows with it.
- Without contacts PyBullet is asked for mass matrix and bias, and the step is ours: 8 us a step with one joint, 9 with two.
Wrenches
  cost some 100 us a step with five joints. With contacts the step is Bullet's own, with friction motors set in each: two to
  three times what its bare step takes.

## Memory

A run with 5 joints holds some 290 MB (PyBullet) or 230 MB (MuJoCo) whatever its duration, of which Numba is 160: with the
libraries of both engines imported and one line compiled Python holds 193. Samples go to the log as they come. `--certify` and
`--cross-check` run side by side what they compare and hold 380 MB. From Python, `asrsim.run` keeps all samples instead: 48 MB a
minute with 5 joints at 1 kHz.

## The compiled loop

`compiled: auto` (the default) puts the joints of a robot through [Numba](https://numba.pydata.org), which comes along
where it has
wheels, if the run is long enough to win back its start; `true` forces it, `false` forbids it. Numbers are the same, bit for
bit, since both loops run the same source. A run that stays plain where compiling would have paid says so.

- Your own actuator is compiled with the rest if Numba can (functions of floats, `math`, no tables or strings); where it
  cannot, `auto` stays plain, and `true` says what is in the way. A power with a whole exponent (`x ** 3`) is a product when
  compiled, and may differ in the last bit: write `x * x * x`, and `sqrt(x)` for `x ** 0.5`.
- Kernels are kept in `$XDG_CACHE_HOME/asrsim/kernels` (`~/.cache/asrsim/kernels`), by a hash of all code that goes into them:
  a law that changes, or a helper that it calls, gets a kernel of its own, and parameters need none.
  All robots share the kernel, which takes some 12 s once for an installation; a new actuator adds 1 s. Where the folder
  cannot be written, nothing is kept. It may be deleted at any time.

## How cost grows

![CPU time of a step over joints and over stiffness](images/performance.png)

Left: one substep, chains of qbMoves without gravity. Right: two joints, SEAs; the stiffer the springs, the more substeps keep
`omega h` at 0.2 or below.
"""


def write(rows: Mapping[str, Row], folder: Path, load: float) -> Path:
    """Draw the picture, and write the document; returns where it is. load: of other programs."""
    draw(folder)
    missed = [name for name, row in rows.items() if row.median > row.goal]
    notes = "All goals are met."
    about = machine()
    libraries = ", ".join(f"{key} {about[key]}" for key in ("Python", "PyBullet", "MuJoCo", "NumPy", "Numba"))
    if missed:
        notes = f"Missed: {', '.join(f'`{name}`' for name in missed)}."
    if load > 0.5:
        notes += f" The machine was shared with other programs meanwhile (load average {load:.1f} before)."
    text = TEXT.format(
        table=markdown(rows),
        machine=f"{about['CPU']}, {about['cores']} cores, {libraries}",
        notes=notes,
    )
    DOCUMENT.write_text(text, encoding="utf-8")
    return DOCUMENT


def markdown(rows: Mapping[str, Row]) -> str:
    """The table, as Markdown."""
    lines = ["| | measured | goal | |", "|---|---|---|---|"]
    lines += [f"| `{name}` | **{row.median:.3g}** | {row.goal:g} | {row.what} |" for name, row in rows.items()]
    return "\n".join(lines)
