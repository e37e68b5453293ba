"""The sheet of one actuator: numbers, where each comes from, and curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from asrsim.datasheet.bench import MeasuredCurve
from asrsim.datasheet.data import Entry, Sheet
from asrsim.datasheet.linear import Load, position_bandwidth, preset_bandwidth
from asrsim.datasheet.published import PUBLISHED
from asrsim.datasheet.sources import Source
from asrsim.datasheet.statics import Statics
from asrsim.datasheet.trials import BAND, Trials, run_trials, usual_load
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.quantities import shown
from asrsim.robot.tags import parameter_tags
from asrsim.samples import Array

CURVES = 5
"""Number of presets of the curves."""
LAW = "closed form"


def make_sheet(
    source: Source, *, presets: tuple[float, float] | None = None, inertia: float | None = None,
    measured: Sequence[MeasuredCurve] = (),
) -> Sheet:  # fmt: skip
    """Data sheet of an actuator, with simulated trials.

    Args:
        source: The actuator and its values.
        presets: Smallest and largest second reference; None: the actuator's range.
        inertia: Inertia of the test load, kg m^2; None: 3 Hz on the mean stiffness.
        measured: Curves of test benches, drawn beside the law.
    """
    statics = Statics(drive=source.drive, effort=source.effort, given=presets)
    load = usual_load(statics)
    load = load if inertia is None else Load(inertia=inertia, damping=load.damping * math.sqrt(inertia / load.inertia))
    trials = run_trials(source, statics, load)
    actuator = source.drive.actuator
    return Sheet(
        name=source.name, title=actuator.title, source=actuator.source, law=actuator.law, origin=source.origin,
        entries=(*_statics(source, statics), *_dynamics(source, statics, trials), *_unstated(source)),
        rows=(_laws(statics, measured), _limits(statics, trials), _responses(trials)),
        published=PUBLISHED.get(actuator.name, ()), files=trials.files, plugins=source.plugins,
        values=dict(source.drive.values), units={one.name: one.unit for one in actuator.all_parameters()},
    )  # fmt: skip


def _statics(source: Source, statics: Statics) -> Iterator[Entry]:
    unit = source.drive.actuator.reference_2_unit
    low, high = statics.unloaded_stiffness()
    power, torque, speed = statics.best_power() if math.isfinite(statics.top_speed) else (None, None, None)
    within = f"{LAW}: largest value of the law over presets and deflections within the limits of springs, motors and joint"
    yield Entry(key="peak_torque", words="peak torque", unit="N m", value=statics.peak_torque, how=within)
    nominal = statics.nominal_torque
    lasting = "as the peak torque, with every winding at rest below <derating_temperature> for ever"
    unstated = "not stated: <thermal_resistance>, and <winding_heat> or the electric constants"
    yield Entry(
        key="nominal_torque",
        words="nominal (continuous) torque",
        unit="N m",
        value=nominal,
        how=unstated if nominal is None else f"{LAW}: {lasting}",
    )
    yield Entry(
        key="top_speed",
        words="speed without load",
        unit="rad/s",
        value=_finite(statics.top_speed),
        how=f"{LAW}: where the motors' torque less damping and friction ends, or their largest speed",
    )
    how = f"{LAW}: largest product of torque and speed of the third chart"
    yield Entry(key="power", words="largest output power", unit="W", value=power, how=how)
    yield Entry(key="power_torque", words="torque at largest power", unit="N m", value=torque, how=how)
    yield Entry(key="power_speed", words="speed at largest power", unit="rad/s", value=speed, how=how)
    for key, words, value, preset in (
        ("stiffness_min", "least stiffness", low, statics.softest),
        ("stiffness_max", "largest stiffness", high, statics.stiffest),
    ):  # fmt: skip
        at = f" at preset {preset:.4g} {unit}" if statics.adjustable else ""
        yield Entry(key=key, words=words, unit="N m/rad", value=value, how=f"{LAW}: unloaded{at}")
    yield Entry(
        key="stiffness_loaded", words="largest stiffness under load", unit="N m/rad", value=statics.peak_stiffness, how=within
    )
    limited = f"{LAW}: where a spring, a motor or the joint reaches its limit"
    yield from _at_both_ends(statics, "deflection", "largest deflection", "rad", statics.reach, limited)
    yield Entry(key="energy", words="largest elastic energy", unit="J", value=statics.peak_energy, how=within)
    values, tags = source.drive.values, parameter_tags(source.drive.actuator)
    width = 2.0 * values["hysteresis_torque"] * source.drive.actuator.motors
    yield Entry(
        key="hysteresis",
        words="width of the torque's hysteresis",
        unit="N m",
        value=width or None,
        how=f"{LAW}: twice the hysteresis torque of all springs" if width else f"not stated: <{tags['hysteresis_torque']}>",
    )
    ranges = [high - low for low, high in source.drive.motor_ranges]
    stops = [tags[f"motor_1_{name}_position"] for name in ("min", "max")]
    turn = min(ranges) if ranges and math.isfinite(min(ranges)) else None
    yield Entry(
        key="rotation",
        words="active rotation",
        unit="rad",
        value=turn,
        how=f"{LAW}: range of the motors" if turn else f"not stated: <{stops[0]}> and <{stops[1]}>",
    )


def _dynamics(source: Source, statics: Statics, trials: Trials) -> Iterator[Entry]:
    drive, command = source.drive, f"asrsim run {source.name}.yaml"
    for key, words, variant, torque in (
        ("change_free", "time to change stiffness, no load", "stiffness_free", 0.0),
        ("change_loaded", "time to change stiffness, loaded", "stiffness_loaded", trials.torque),
    ):
        value, how = trials.change_time(variant), f"simulation: until within {100 * BAND:g} % of the change"
        if torque:
            how += f", under {torque:g} N m"
        how += f"; {command} --variant {variant}"
        if not statics.adjustable:
            how = "does not apply: one spring"
        elif drive.actuator.adjuster:
            how = "not in the model: the adjuster's motor has no dynamics (section 2.3 of the paper)"
        elif variant in trials.faults:
            how = f"the simulation was refused: {trials.faults[variant]}"
        elif value is None:
            how = f"not settled within the trial; {command} --variant {variant}"
        yield Entry(key=key, words=words, unit="s", value=value, how=how)
    about = f"behind {trials.load.inertia:.3g} kg m^2 and {trials.load.damping:.3g} N m s/rad, without friction"
    yield from _at_both_ends(
        statics, "bandwidth", "bandwidth of position", "Hz", lambda preset: position_bandwidth(drive, preset, trials.load),
        f"{LAW}: linearised, 3 dB, {about}",
    )  # fmt: skip
    two = drive.actuator.motors == 2
    yield Entry(
        key="bandwidth_stiffness", words="bandwidth of stiffness", unit="Hz",
        value=preset_bandwidth(drive, statics.stiffest) if two else None,
        how=f"{LAW}: linearised, 3 dB, motors against each other at the stiffest setting, link locked" if two
        else "not in the model" if drive.actuator.adjuster else "does not apply",
    )  # fmt: skip


def _at_both_ends(
    statics: Statics, key: str, words: str, unit: str, law: Callable[[float], float | None], how: str
) -> Iterator[Entry]:
    """A number that depends on the preset, at the softest and at the stiffest preset."""
    for end, name, preset in (("soft", "softest", statics.softest), ("stiff", "stiffest", statics.stiffest)):
        yield Entry(key=f"{key}_{end}", words=f"{words}, {name}", unit=unit, value=law(preset), how=how)


def _unstated(source: Source) -> Iterator[Entry]:
    values, tags = source.drive.values, parameter_tags(source.drive.actuator)
    yield Entry(
        key="resolution",
        words="resolution of position",
        unit="rad",
        value=source.resolution,
        how=f"stated: imperfections.sensors.{source.drive.joint}.quantum of the scenario"
        if source.resolution
        else "not stated: `imperfections: {sensors: {JOINT: {quantum: ...}}}` in a scenario (`asrsim datasheet FILE.yaml`)",
    )
    for key, words, name, unit in (
        ("voltage", "largest voltage", "motor_1_max_voltage", "V"), ("current", "largest current", "motor_1_max_current", "A"),
    ):  # fmt: skip
        value = _finite(values[name])
        yield Entry(
            key=key,
            words=words,
            unit=unit,
            value=value,
            how=f"stated: <{tags[name]}>" if value else f"not stated: <{tags[name]}>",
        )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _settings(statics: Statics) -> list[tuple[str, float]]:
    """Name and value of the presets of the curves."""
    if not statics.adjustable:
        return [("spring", 0.0)]
    unit = statics.drive.actuator.reference_2_unit
    return [(f"preset {shown(float(one), unit)}", float(one)) for one in np.linspace(*statics.presets, CURVES)]


def _laws(statics: Statics, measured: Sequence[MeasuredCurve]) -> tuple[Chart, ...]:
    torques, stiffnesses = [], []
    for i, (label, preset) in enumerate(_settings(statics)):
        deflection = np.linspace(-(reach := statics.reach(preset)), reach, 201)
        presets = np.full_like(deflection, preset)
        torque = statics.torque(deflection, presets)
        colour, order = style.variant_colour(i), np.argsort(torque)
        torques.append(Line(label=label, x=deflection, y=torque, colour=colour))
        stiffness = statics.stiffness(deflection, presets)
        stiffnesses.append(Line(label=label, x=torque[order], y=stiffness[order], colour=colour))
    torques += [Line(label=one.label, x=one.deflection, y=one.torque, colour=style.BLACK, kind="points") for one in measured]
    return (
        Chart(words="torque", unit="N m", across="deflection", across_unit="rad", lines=torques),
        Chart(words="stiffness", unit="N m/rad", across="torque", across_unit="N m", lines=stiffnesses),
    )


def _limits(statics: Statics, trials: Trials) -> tuple[Chart, ...]:
    fastest = statics.top_speed if math.isfinite(statics.top_speed) else 10.0
    speed = np.linspace(0.0, fastest, 201)
    torque = statics.driving_torque(speed)
    lines = [Line(label="largest torque", x=speed, y=torque, colour=style.BLUE)]
    power = [Line(label="output power", x=speed, y=speed * torque, colour=style.VERMILION)]
    return (
        Chart(
            words="torque", unit="N m", across="speed", across_unit="rad/s", lines=lines, span=(0.0, 1.1 * float(torque.max()))
        ),
        Chart(words="power", unit="W", across="speed", across_unit="rad/s", lines=power),
    )


def _responses(trials: Trials) -> tuple[Chart, ...]:
    def lines(variants: Sequence[tuple[str, str, str]], quantity: str) -> list[Line]:
        found: list[Line] = []
        for variant, label, colour in variants:
            time, values = trials.series(variant, quantity)
            if len(time):
                found.append(Line(label=label, x=_thin(time), y=_thin(values), colour=colour))
        return found

    return (
        Chart(words="link position", unit="rad", lines=lines(
            [("soft", "softest", style.variant_colour(0)), ("stiff", "stiffest", style.variant_colour(4))], "link_position")),
        Chart(words="stiffness", unit="N m/rad", lines=lines(
            [("stiffness_free", "no load", style.variant_colour(1)), ("stiffness_loaded", "loaded", style.variant_colour(2))],
            "stiffness")),
    )  # fmt: skip


def _thin(values: Array, most: int = 1000) -> Array:
    return values[:: max(1, len(values) // most)]
