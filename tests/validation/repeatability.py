"""The same numbers, bit for bit: again in this process, in another one, and through the compiled loop; contacts included."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from asrsim.samples import Samples
from asrsim.signals import Ramp, Sinusoid, Step
from validation.check import Check, engine
from validation.contacts import push
from validation.models import Body, chain, run

LINK = Body(actuator="qbmove", mass=0.5, reach=0.08, inertia=6e-4, damping=0.02, friction=0.01)


def digest(samples: Samples | None) -> str:
    """Hash of all numbers of a run."""
    if samples is None:
        raise ValueError("the run kept no samples")
    total = hashlib.sha256(np.ascontiguousarray(samples.time).tobytes())
    for group in (samples.values, samples.bodies, samples.contacts):
        for name, values in sorted(group.items()):
            total.update(name.encode())
            total.update(np.ascontiguousarray(values).tobytes())
    return total.hexdigest()


def arm(*, compiled: bool | None = False) -> str:
    """Three joints with motors, dry friction, damping and a jump off the grid."""
    result = run(
        chain(*[LINK] * 3), mode=6, duration=0.5, compiled=compiled,
        references={
            "equilibrium_position": Step(at=0.2003, after=0.4),
            "stiffness_preset": Sinusoid(amplitude=0.1, frequency=2.0),
        },
    )  # fmt: skip
    return digest(result.samples)


def contact() -> str:
    """A ball that pushes a box over the ground."""
    return digest(push(Ramp(final=8.0, start=0.1, duration=0.5), duration=0.6).samples)


def here() -> dict[str, str]:
    """Digests of all motions, in this process."""
    return {"arm with motors, friction and jumps": arm(), "pushed box": contact()}


def elsewhere(seed: str) -> dict[str, str]:
    """Digests of all motions, in a fresh process."""
    code = (
        "import json; from validation.check import on; from validation.repeatability import here\n"
        f"with on({engine()!r}): print(json.dumps(here()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=_environment(seed))
    return dict(json.loads(done.stdout.strip().splitlines()[-1]))


def _environment(seed: str) -> dict[str, str]:
    return {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}


def repeatability() -> Iterator[Check]:
    """Runs that differ in any bit: there are none."""
    first, again = here(), here()
    others = [elsewhere(seed) for seed in ("1", "2")]
    for name, value in first.items():
        yield Check(
            name=f"again in the same process, {name}", figure=float(again[name] != value), bound=0.0, source="equal bits"
        )
        different = sum(other[name] != value for other in others)
        yield Check(name=f"in two other processes, {name}", figure=float(different), bound=0.0, source="equal bits")


def compiled() -> Iterator[Check]:
    """The compiled loop gives the plain one's bits."""
    for label, bodies, mode in (
        ("motors, mode 6", [LINK] * 3, 6),
        ("ideal motors, mode 3", [replace(LINK, actuator="bavs")] * 2, 3),
    ):
        runs = [
            run(
                chain(*bodies), mode=mode, duration=0.3, compiled=flag,
                references={"equilibrium_position": Step(at=0.1003, after=0.3), "stiffness_preset": 0.1},
            ).samples
            for flag in (False, True)
        ]  # fmt: skip
        figure = float(digest(runs[0]) != digest(runs[1]))
        yield Check(name=f"compiled loop against the plain one, {label}", figure=figure, bound=0.0, source="equal bits")
