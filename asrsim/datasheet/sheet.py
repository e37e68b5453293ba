"""The sheet of one actuator: numbers with their sources, and curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

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
from asrsim.quantities import linear_unit, shown
from asrsim.robot.tags import parameter_tags
from asrsim.samples import Array

CURVES = 5
"""Number of presets for which curves are drawn."""
WIDE = 50.0
"""Ratio of largest to smallest stiffness above which the stiffness axis of a chart is logarithmic."""
LAW = "closed form"
WITHIN = f"{LAW}: largest value of the law over presets and deflections within the limits of springs, motors and joint"
SOFTEST = 1e-9
"""Fraction of the largest stiffness up to which a setting counts as having no stiffness. A bandwidth from so little stiffness
would be a rounding error.
"""


def make_sheet(
    source: Source,
    *,
    presets: tuple[float, float] | None = None,
    inertia: float | None = None,
    measured: Sequence[MeasuredCurve] = (),
) -> Sheet:
    """Data sheet of an actuator, with simulated trials.

    Args:
        source: The actuator and its values.
        presets: Smallest and largest second reference; None: the range of the actuator.
        inertia: Inertia of the test load, kg m^2; None: the inertia with a natural frequency of 3 Hz on the mean stiffness.
        measured: Curves of test benches, drawn beside the law.

    Raises InputError for presets that the actuator cannot have.
    """
    statics = Statics(drive=source.drive, effort=source.effort, given=presets)
    statics.check()
    load = usual_load(statics)
    load = load if inertia is None else Load(inertia=inertia, damping=load.damping * math.sqrt(inertia / load.inertia))
    trials = run_trials(source, statics, load)
    actuator = source.drive.actuator
    unit = linear_unit if source.prismatic else str
    entries = (*_torques(statics), *_springs(source, statics), *_dynamics(source, statics, trials), *_stated(source))
    rows = (_laws(statics, measured), _limits(statics), _responses(trials))
    return Sheet(
        name=source.name,
        short=source.short,
        title=actuator.title,
        source=actuator.source,
        law=actuator.law,
        origin=source.origin,
        entries=tuple(replace(one, unit=unit(one.unit), how=unit(one.how)) for one in entries),
        rows=tuple(tuple(replace(one, unit=unit(one.unit), across_unit=unit(one.across_unit)) for one in row) for row in rows),
        published=PUBLISHED.get(actuator.name, ()),
        files=trials.files,
        plugins=source.plugins,
        values=dict(source.drive.values),
        units={one.name: unit(one.unit) for one in actuator.all_parameters()},
        doubts=tuple(doubt for curve in measured for doubt in curve.doubts),
    )


def _torques(statics: Statics) -> Iterator[Entry]:
    """Torque, speed and power: the largest values within the motors' limits, and the values that the motors hold
    continuously.
    """
    most, lasting = statics, statics.lasting
    heat = "not stated: <thermal_resistance>, and <winding_heat> or the electric constants"
    if lasting is not None:
        heat = f"{LAW}: with every winding at <derating_temperature> continuously"
    yield Entry(key="peak_torque", words="peak torque", unit="N m", value=most.peak_torque, how=WITHIN)
    at_rest = heat if lasting is None else f"{heat}, at rest"
    held = None if lasting is None else lasting.peak_torque
    yield Entry(key="nominal_torque", words="nominal torque", unit="N m", value=held, how=at_rest)
    yield Entry(
        key="top_speed",
        words="speed without load",
        unit="rad/s",
        value=_finite(most.top_speed),
        how=f"{LAW}: where the motors' torque equals damping and friction, or their largest speed"
        if math.isfinite(most.top_speed)
        else "not limited by the motors' torque, voltage or largest speed",
    )
    product = f"{LAW}: largest product of torque and speed of the third chart"
    largest = (
        ("power", "largest output power"),
        ("power_torque", "torque at largest power"),
        ("power_speed", "speed at largest power"),
    )
    nominal = (
        ("nominal_power", "nominal (continuous) output power"),
        ("nominal_power_torque", "torque at nominal power"),
        ("nominal_speed", "nominal speed, at nominal power"),
    )
    for one, how, names in ((most, product, largest), (lasting, heat, nominal)):
        best = one.best_power() if one is not None and math.isfinite(one.top_speed) else (None, None, None)
        for (key, words), unit, value in zip(names, ("W", "N m", "rad/s"), best, strict=True):
            yield Entry(key=key, words=words, unit=unit, value=value, how=how)


def _springs(source: Source, statics: Statics) -> Iterator[Entry]:
    unit = source.drive.actuator.reference_2_unit
    low, high = statics.unloaded_stiffness()
    for key, words, value, preset in (
        ("stiffness_min", "least stiffness", low, statics.softest),
        ("stiffness_max", "largest stiffness", high, statics.stiffest),
    ):
        at = f" at preset {preset:.4g} {unit}" if statics.adjustable else ""
        yield Entry(key=key, words=words, unit="N m/rad", value=value, how=f"{LAW}: unloaded{at}")
    yield Entry(
        key="stiffness_loaded", words="largest stiffness under load", unit="N m/rad", value=statics.peak_stiffness, how=WITHIN
    )
    limited = f"{LAW}: where a spring, a motor or the joint reaches its limit"
    yield from _at_both_ends(statics, "deflection", "largest deflection", "rad", statics.reach, limited, limited)
    yield Entry(key="energy", words="largest elastic energy", unit="J", value=statics.peak_energy, how=WITHIN)
    values, tags = source.drive.values, parameter_tags(source.drive.actuator)
    width = 2.0 * values["hysteresis_torque"] * statics.moving
    yield Entry(
        key="hysteresis",
        words="width of the torque's hysteresis",
        unit="N m",
        value=width or None,
        how=f"{LAW}: twice the hysteresis torque of all springs" if width else f"not stated: <{tags['hysteresis_torque']}>",
    )
    turn = min(high - low for low, high in (*source.drive.motor_ranges[: statics.moving], source.stops))
    stops = [f"<{tags[f'motor_1_{name}_position']}>" for name in ("min", "max")]
    yield Entry(
        key="rotation",
        words="active rotation",
        unit="rad",
        value=_finite(turn),
        how=f"{LAW}: the smallest range of the motors and the joint"
        if math.isfinite(turn)
        else f"not stated: {' and '.join(stops)}, or the joint's limits",
    )


def _dynamics(source: Source, statics: Statics, trials: Trials) -> Iterator[Entry]:
    drive = source.drive
    for key, words, variant, under in (
        ("change_free", "time to change stiffness, no load", "stiffness_free", ""),
        ("change_loaded", "time to change stiffness, loaded", "stiffness_loaded", f", under {trials.under}"),
    ):
        value = trials.change_times.get(variant)
        trial = f"variant {variant} of {source.name}.yaml"
        how = f"simulation: {trial}: until within {100 * BAND:g} % of the change"
        if variant in trials.ends:
            how += " from {:.3g} to {:.3g} N m/rad".format(*trials.ends[variant])
        how += under
        if not statics.adjustable:
            how = "does not apply: one spring"
        elif drive.actuator.adjuster:
            how = "not in the model: the adjuster's motor has no dynamics (section 2.3 of the paper)"
        elif variant in trials.faults:
            how = f"the simulation was refused: {trials.faults[variant]}"
        elif variant in trials.unchanged:
            how = "does not apply: the preset does not change the stiffness"
        elif value is None:
            how = f"not settled at the end of {trial}"
        yield Entry(key=key, words=words, unit="s", value=value, how=how)
    about = f"with a load of {trials.load.inertia:.3g} kg m^2 and {trials.load.damping:.3g} N m s/rad, without friction"
    yield from _at_both_ends(
        statics,
        "bandwidth",
        "bandwidth of position",
        "Hz",
        lambda preset: _bandwidth(statics, preset, trials.load),
        f"{LAW}: linearised, 3 dB, {about}",
        "does not apply: no stiffness without load, or no controller that moves the link",
    )
    two = drive.actuator.motors == 2
    yield Entry(
        key="bandwidth_stiffness",
        words="bandwidth of stiffness",
        unit="Hz",
        value=preset_bandwidth(drive, statics.stiffest) if two else None,
        how=f"{LAW}: linearised, 3 dB, motors against each other at the stiffest setting, link locked"
        if two
        else "not in the model: the adjuster's motor has no dynamics"
        if drive.actuator.adjuster
        else "does not apply: one spring"
        if drive.actuator.motors == 1
        else "does not apply: more than two motors",
    )


def _bandwidth(statics: Statics, preset: float, load: Load) -> float | None:
    """Bandwidth of the position control in Hz; None where the unloaded link has no stiffness."""
    (stiffness,) = statics.stiffness(np.zeros(1), np.full(1, preset))
    return position_bandwidth(statics.drive, preset, load) if stiffness > SOFTEST * statics.peak_stiffness else None


def _at_both_ends(
    statics: Statics, key: str, words: str, unit: str, law: Callable[[float], float | None], how: str, unknown: str
) -> Iterator[Entry]:
    """Two entries for a number that depends on the preset: at the softest and at the stiffest preset."""
    for end, name, preset in (("soft", "softest", statics.softest), ("stiff", "stiffest", statics.stiffest)):
        value = law(preset)
        yield Entry(key=f"{key}_{end}", words=f"{words}, {name}", unit=unit, value=value, how=unknown if value is None else how)


def _stated(source: Source) -> Iterator[Entry]:
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
        ("voltage", "largest voltage", "motor_1_max_voltage", "V"),
        ("current", "largest current", "motor_1_max_current", "A"),
    ):
        value = _finite(values[name])
        how = "not stated" if value is None else "stated"
        yield Entry(key=key, words=words, unit=unit, value=value, how=f"{how}: <{tags[name]}>")


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _settings(statics: Statics) -> list[tuple[str, float]]:
    """Name and value of each preset for which curves are drawn, from the softest to the stiffest."""
    if not statics.adjustable:
        return [("spring", 0.0)]
    unit = statics.drive.actuator.reference_2_unit
    return [(f"preset {shown(float(one), unit)}", float(one)) for one in np.linspace(statics.softest, statics.stiffest, CURVES)]


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
    low, high = statics.unloaded_stiffness()
    logarithmic = "y" if high > WIDE * low > 0.0 else ""
    return (
        Chart(words="torque", unit="N m", across="deflection", across_unit="rad", lines=torques),
        Chart(
            words="stiffness", unit="N m/rad", across="torque", across_unit="N m", lines=stiffnesses, logarithmic=logarithmic
        ),
    )


def _limits(statics: Statics) -> tuple[Chart, ...]:
    fastest = statics.top_speed if math.isfinite(statics.top_speed) else 10.0
    speed = np.linspace(0.0, fastest, 201)
    both = [("largest", statics, style.BLUE), ("nominal", statics.lasting, style.VERMILION)]
    torques = [
        Line(label=label, x=speed, y=np.maximum(one.driving_torque(speed), 0.0), colour=colour)
        for label, one, colour in both
        if one is not None
    ]
    powers = [replace(one, y=speed * one.y) for one in torques]
    motors = np.maximum(statics.motor_torque(speed), 0.0)
    if (motors > 1.001 * statics.peak_torque).any():
        torques.append(Line(label="motors without springs", x=speed, y=motors, colour=style.GREY, dash=1))
    top = 1.1 * max(float(one.y.max()) for one in torques)
    return (
        Chart(words="torque", unit="N m", across="speed", across_unit="rad/s", lines=torques, span=(0.0, top)),
        Chart(words="power", unit="W", across="speed", across_unit="rad/s", lines=powers),
    )


def _responses(trials: Trials) -> tuple[Chart, ...]:
    def lines(variants: Sequence[tuple[str, str, str]], quantity: str) -> list[Line]:
        found: list[Line] = []
        for variant, label, colour in variants:
            time, values = trials.series(variant, quantity)
            if len(time):
                found.append(Line(label=label, x=_thin(time), y=_thin(values), colour=colour))
        return found

    charts = (
        Chart(words="link position", unit="rad", lines=lines(
            [("soft", "softest", style.variant_colour(0)), ("stiff", "stiffest", style.variant_colour(4))], "link_position")),
        Chart(words="stiffness", unit="N m/rad", lines=lines(
            [("stiffness_free", "no load", style.variant_colour(1)), ("stiffness_loaded", "loaded", style.variant_colour(2))],
            "stiffness")),
    )  # fmt: skip
    return tuple(one for one in charts if not one.empty)


def _thin(values: Array, most: int = 1000) -> Array:
    return values[:: max(1, len(values) // most)]
