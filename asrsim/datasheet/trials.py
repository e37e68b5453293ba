"""Simulations of a sheet: a scenario that the user can run, with a variant for each trial, and the measurements in each
trial.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from asrsim.api import Result, run
from asrsim.datasheet.linear import Load
from asrsim.datasheet.sources import SHEET_MODE, Source
from asrsim.datasheet.statics import Statics
from asrsim.errors import InputError
from asrsim.metrics import measure
from asrsim.samples import Array

FREQUENCY, RATIO = 3.0, 0.2
"""FREQUENCY: natural frequency in Hz of the test load while the motors stand still; RATIO: damping ratio of the test load. The
assumed stiffness is the geometric mean of the softest and the stiffest setting.
"""
SOFTEST = 1e-4
"""Smallest stiffness that enters the mean for the test load, as a fraction of the largest stiffness."""
STEP, LEAST = 0.2, 0.05
"""Size of the step of the equilibrium position. It is the fraction `STEP` of the largest deflection of the softest setting, but
at least `LEAST` rad."""
AT, LASTS = 0.1, 2.0
"""AT: time at which the references step, s; LASTS: duration of a trial, s."""
BAND = 0.1
"""Largest difference from the new stiffness at which the stiffness counts as settled, as a fraction of the change of the
stiffness."""
MEASURE = "settling"
OPTIONS: dict[str, Any] = {"start": AT, "band": BAND}
"""Options of `MEASURE`, the measure that gives the time in which the stiffness changes."""
TOLERANCE = 0.01
"""Relative tolerance of the claims in the scenario that repeats the trials."""
CHANGES = ("stiffness_free", "stiffness_loaded")
"""Variants of the trials' scenario in which the preset steps, to change the stiffness."""
STILL = 1e-9
"""Change of the stiffness, relative to its largest value, below which the stiffness counts as constant."""
LOADED = 0.2
"""Load during a change of stiffness if no nominal torque is stated, as a fraction of the torque that every setting holds."""
JOINT = "joint_1"


@dataclass(frozen=True, kw_only=True)
class Trials:
    """Results of the trials, by variant of the scenario, and a message for each trial that could not be simulated."""

    files: Mapping[str, str]
    results: Mapping[str, Result]
    faults: Mapping[str, str]
    change_times: Mapping[str, float]
    """Time in s after which the stiffness stays within `BAND` of its change, for each variant in which it settles."""
    ends: Mapping[str, tuple[float, float]]
    """Stiffness before and after its change, N m/rad, for each variant of `change_times`."""
    unchanged: Collection[str]
    """Variants in which the preset does not change the stiffness."""
    load: Load
    under: str
    """Load in the variant `stiffness_loaded`, in words for the sheet."""

    def series(self, variant: str, quantity: str) -> tuple[Array, Array]:
        """Times (n,) and values (n,) of a trial; empty without a result."""
        if variant not in self.results:
            return np.empty(0), np.empty(0)
        samples = self.results[variant].samples
        return samples.time, samples.values[quantity][:, 0]


def usual_load(statics: Statics) -> Load:
    """Test load with the natural frequency `FREQUENCY` and the damping ratio `RATIO`."""
    low, high = statics.unloaded_stiffness()
    stiffness = math.sqrt(max(low, SOFTEST * high) * high)
    inertia = float(f"{stiffness / (2.0 * math.pi * FREQUENCY) ** 2:.3g}")
    return Load(inertia=inertia, damping=float(f"{2.0 * RATIO * math.sqrt(stiffness * inertia):.3g}"))


def run_trials(source: Source, statics: Statics, load: Load) -> Trials:
    """Results of all trials of an actuator. load: load on the actuator's joint."""
    step = float(f"{max(LEAST, STEP * statics.reach(statics.softest)):.3g}")
    torque, under = _torque(statics)
    variants, robot = _variants(source, statics, step, torque), f"{source.name}.urdf"
    files = {robot: _robot(source, load), f"{source.name}.yaml": _scenario(source, variants, ())}
    results, faults = {}, {}
    with TemporaryDirectory(prefix="asrsim-") as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        for variant in variants:
            try:
                results[variant] = run(
                    Path(folder) / f"{source.name}.yaml", variant=variant if len(variants) > 1 else None, plugins=source.plugins
                )
            except InputError as error:
                faults[variant] = error.problems[0].message
    times, ends, unchanged = {}, {}, []
    for variant in {*CHANGES} & {*results}:
        samples = results[variant].samples
        stiffness = samples.values["stiffness"][:, 0]
        if np.ptp(stiffness) <= STILL * np.abs(stiffness).max():
            unchanged.append(variant)
        elif not math.isnan(time := measure(MEASURE, samples.time, stiffness, **OPTIONS)):
            times[variant] = time
            ends[variant] = measure("at", samples.time, stiffness, when=AT), measure("steady_state", samples.time, stiffness)
    claims = [_claim(variant, times[variant]) for variant in CHANGES if variant in times]
    files[f"{source.name}.yaml"] = _scenario(source, variants, claims)
    return Trials(
        files=files, results=results, faults=faults, change_times=times, ends=ends, unchanged=unchanged, load=load, under=under
    )


def _torque(statics: Statics) -> tuple[float, str]:
    """Load in N m during the change of stiffness, and its description. It is the nominal torque if every setting holds this
    torque."""
    nominal = None if statics.lasting is None else statics.lasting.peak_torque
    if nominal is not None and nominal <= statics.held_torque:
        torque, words = nominal, "the nominal torque"
    else:
        torque, words = LOADED * statics.held_torque, f"{100 * LOADED:g} % of the torque that every setting holds"
        words += (
            ": no nominal torque is stated"
            if nominal is None
            else f", {statics.held_torque:.3g} N m: less than the nominal torque"
        )
    torque = float(f"{torque:.3g}")
    return torque, f"{torque:g} N m ({words})"


def _claim(variant: str, time: float) -> dict[str, Any]:
    """Claim that the stiffness settles within the measured time, so that a run of the sheet's scenario checks this time."""
    value = float(f"{time:.5g}")
    return {
        "variant": variant,
        "joint": JOINT,
        "quantity": "stiffness",
        "measure": MEASURE,
        "value": value,
        "tolerance": float(f"{TOLERANCE * value:.2g}"),
        "options": OPTIONS,
    }


def _robot(source: Source, load: Load) -> str:
    inertia = " ".join(f'{name}="{load.inertia:g}"' for name in ("ixx", "iyy", "izz"))
    effort = f"{source.effort:g}" if math.isfinite(source.effort) else "1e9"
    kind, mass, stops = (
        ("prismatic", f"{load.inertia:g}", ' lower="-1e3" upper="1e3"') if source.prismatic else ("continuous", "1", "")
    )
    return f"""<?xml version="1.0"?>
<!-- Test load of the data sheet of {source.name}: an inertia without weight. -->
<robot name="test_load">
  <link name="base"/>
  <joint name="{JOINT}" type="{kind}">
    <parent link="base"/><child link="load"/><axis xyz="0 1 0"/>
    <limit effort="{effort}" velocity="1e9"{stops}/>
    <dynamics damping="{load.damping:g}" friction="0"/>
  </joint>
  <link name="load"><inertial><mass value="{mass}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""


def _variants(source: Source, statics: Statics, step: float, torque: float) -> dict[str, dict[str, Any]]:
    """Keys of the scenario for each trial."""

    def trial(reference: object, preset: object, **more: Any) -> dict[str, Any]:
        references = {"equilibrium_position": reference, **({"stiffness_preset": preset} if statics.adjustable else {})}
        return {"references": {JOINT: references}, **more}

    moved = {"step": {"at": AT, "to": step}}
    changed = {"step": {"at": AT, "from": statics.softest, "to": statics.stiffest}}
    variants = {"soft": trial(moved, statics.softest)}
    if statics.adjustable:
        variants["stiff"] = trial(moved, statics.stiffest)
        if not source.drive.actuator.adjuster:
            variants["stiffness_free"] = trial(0.0, changed)
            variants["stiffness_loaded"] = trial(0.0, changed, external_torques={JOINT: torque})
    return variants


def _scenario(source: Source, variants: Mapping[str, Mapping[str, Any]], claims: Sequence[Mapping[str, Any]]) -> str:
    import yaml

    data: dict[str, Any] = {
        "robot": f"{source.name}.urdf",
        "duration": LASTS,
        "gravity": [0, 0, 0],
        "initial": "equilibrium",
        "actuators": {JOINT: {"type": source.drive.actuator.name, "mode": SHEET_MODE}},
        **({"parameters": {JOINT: dict(source.stated)}} if source.stated else {}),
        **({"variants": variants} if len(variants) > 1 else variants["soft"]),
        **({"expect": claims} if claims else {}),
    }
    settings = " at the softest and at the stiffest setting" if len(variants) > 1 else ""
    head = f"# Trials of the data sheet of {source.name}: steps of the equilibrium{settings}.\n"
    if claims:
        head += (
            "# Steps from the softest to the stiffest setting, without and with a load: the claims are the sheet's numbers.\n"
        )
    # Copy the data through JSON, since YAML would write shared parts as aliases, which are harder to read.
    return head + yaml.safe_dump(json.loads(json.dumps(data)), sort_keys=False, default_flow_style=None, width=100)
