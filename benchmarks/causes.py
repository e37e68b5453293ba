"""Causes that a fit names: robots with one effect that their model lacks, and right models.

    python benchmarks/causes.py                      every effect, --seeds each, and as many right models
    python benchmarks/causes.py --only backlash --seeds 10
    python benchmarks/causes.py --adopt              the named effect is added, and the model is fitted again

Prints for each robot whether the effect was named first, named at all, and what was named; with --adopt, whether the model fits
with the effect, and how many intervals contain the true value.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
WORDS = {
    "backlash": ("backlash",),
    "cubic spring": ("spring's law", "cubic", "amplitude"),
    "second mode": ("lacks a mode", "second mode"),
    "hysteresis": ("hysteresis",),
    "stribeck": ("static friction",),
    "torque limit": ("max_torque",),
    "speed limit": ("max_velocity",),
    "load": ("mass", "load"),
    "late sensor": ("delay of joint_1.link_position",),
    "spring damper": ("damper parallel",),
    "load friction": ("grows with the load of joint_1",),
}
"""Words of a cause, by effect."""


def main() -> None:
    """Print a row for each robot."""
    from asrsim import identify
    from support.odd_arm import EFFECTS, record, true_effect

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=(*EFFECTS, "right"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--adopt", action="store_true")
    options = parser.parse_args()
    effects = [options.only] if options.only else [*EFFECTS, "right"]
    for effect in effects:
        named, held, intervals, fitted = 0, 0, 0, 0
        for seed in range(options.first, options.first + options.seeds):
            began = time.process_time()
            with tempfile.TemporaryDirectory() as folder:
                scenario, recording, truth = record(effect if effect != "right" else "", seed, Path(folder))
                free = list(truth)
                result = identify(scenario, [recording], free=free, adopt=options.adopt)
                truth |= true_effect(effect, seed) if options.adopt and effect != "right" else {}
            known = [one for one in result.estimates if one.key in truth and one.has_interval]
            held += sum(one.low <= truth[one.key] <= one.high for one in known)
            intervals, fitted = intervals + len(known), fitted + bool(result.fits)
            if options.adopt:
                more = [f"{one.key} {one.value:.4g}" for one in result.estimates if one.key not in free]
                print(f"  {effect} {seed}: fits {result.fits}, {time.process_time() - began:.0f} s; {', '.join(more)}")
                continue
            first = result.causes[0] if result.causes else ""
            right = any(word in first.partition(" would reduce")[0] for word in WORDS.get(effect, ()))
            named += right
            print(f"  {effect} {seed}: fits {result.fits}, {time.process_time() - began:.0f} s; {' | '.join(result.causes)}")
        if options.adopt:
            print(f"{effect}: {fitted} of {options.seeds} fit; {held} of {intervals} intervals contain the truth")
        else:
            print(f"{effect}: {named} of {options.seeds} named first; {held} of {intervals} intervals contain the truth")


if __name__ == "__main__":
    main()
