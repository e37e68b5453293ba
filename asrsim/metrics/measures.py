"""Registry of measures: numbers that `expect:` in a scenario, the comparison and the summary compute from a series."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from asrsim.document.kinds import Kind, Number, attempt
from asrsim.document.node import node_from_data
from asrsim.document.reading import DocumentReading
from asrsim.errors import InputError, Problem
from asrsim.metrics import difference, motion, oscillation, response, step, values
from asrsim.metrics.rest import SHARE, motion_left
from asrsim.metrics.values import last_part, mean
from asrsim.plugins import plugin_fault
from asrsim.registry import Registry, result_fault
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Number computed from one series, from two series on a common time base, or from a body's poses."""

    name: str
    function: Callable[..., float]
    """Function with the arguments (time, values, [reference], *, options) that returns a number; NaN if undefined."""
    unit: str
    """Unit of the number: `series` (unit of the series), a unit such as `s`, or "1" for a pure number."""
    needs: str
    """Required input: `series`, `pair` (series and reference), `either` (series, and a reference or an option), `poses` of a
    body.
    """

    def __post_init__(self) -> None:
        given = {"series": 2, "pair": 3, "either": 3, "poses": 2}
        if self.needs not in given:
            message = f"the measure '{self.name}' states an unknown input"
            raise InputError(message, key="needs", value=self.needs, choices=tuple(given), code="measure")
        parameters = inspect.signature(self.function).parameters.values()
        plain = [one.name for one in parameters if one.kind is one.POSITIONAL_OR_KEYWORD]
        if len(plain) != given[self.needs] or len(plain) + len(self.options) != len(parameters):
            takes = "(time, values, reference)" if given[self.needs] == 3 else "(time, values)"
            message = f"the function of the measure '{self.name}' must take {takes}, and options after a `*`"
            raise InputError(message, key="function", value=", ".join(one.name for one in parameters), code="measure")

    @property
    def doc(self) -> str:
        """Definition of the measure: first paragraph of the function's docstring."""
        return " ".join((inspect.getdoc(self.function) or "").split("\n\n")[0].split())

    @property
    def options(self) -> dict[str, object]:
        """Names and defaults of the options; `inspect.Parameter.empty` for a required option."""
        return dict(_options_of(self.function))

    def unit_of(self, series_unit: str) -> str:
        """Unit of the result for a series with the given unit; "" for a pure number."""
        return {"series": series_unit, "1": ""}.get(self.unit, self.unit)


@lru_cache
def _options_of(function: Callable[..., float]) -> dict[str, object]:
    parameters = inspect.signature(function).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}


MEASURES: Registry[Measure] = Registry("measure", "asrsim.measures", instance=Measure, label="name")
"""All measures by name. Installed packages add measures with the entry point group `asrsim.measures`."""

for _function, _unit, _needs in (
    (difference.rmse, "series", "pair"),
    (difference.nrmse, "1", "pair"),
    (difference.maximum_error, "series", "pair"),
    (difference.bias, "series", "pair"),
    (difference.delay, "s", "pair"),
    (difference.r2, "1", "pair"),
    (step.rise, "s", "series"),
    (step.overshoot, "1", "series"),
    (step.settling, "s", "series"),
    (step.peak_time, "s", "series"),
    (values.steady_state, "series", "series"),
    (values.steady_state_error, "series", "either"),
    (values.peak, "series", "series"),
    (values.amplitude, "series", "series"),
    (values.mean, "series", "series"),
    (values.rms, "series", "series"),
    (values.maximum, "series", "series"),
    (values.minimum, "series", "series"),
    (values.final, "series", "series"),
    (values.at, "series", "series"),
    (oscillation.frequency, "Hz", "series"),
    (response.gain, "1", "pair"),
    (response.largest_gain, "1", "pair"),
    (response.resonance, "Hz", "pair"),
    (response.bandwidth, "Hz", "pair"),
    (response.coherence, "1", "pair"),
    (motion.displacement, "m", "poses"),
    (motion.maximum_displacement, "m", "poses"),
    (motion.distance, "m", "poses"),
):
    MEASURES.own(_function.__name__, Measure(name=_function.__name__, function=_function, unit=_unit, needs=_needs))

PAIR_MEASURES = ("rmse", "nrmse", "maximum_error", "bias", "delay", "r2")
"""Measures of the difference between run and recording, which a comparison reports once. It reports all other measures for the
run and for the recording.
"""
AT_REST = ("rise", "overshoot", "settling", "peak_time", "steady_state", "steady_state_error")
"""Measures that are undefined unless the series is at rest at its end."""
STEP_MEASURES = ("rise", "overshoot", "settling", "steady_state")
"""Measures that a comparison reports for each series if the reference steps."""


def measure(
    name: str,
    time: Array,
    series: Array,
    reference: Array | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
    **options: Any,
) -> float:
    """Value of a measure for a series; NaN if undefined.

    Args:
        name: Name of a measure in `MEASURES`.
        time: Times (n,), s.
        series: Values (n,), or (n, 3) or (n, 7) for poses. Samples with NaN are omitted.
        reference: Reference (n,) at the same times, for measures of a difference.
        start: Time before which samples are omitted, s.
        end: Time after which samples are omitted, s.
        options: Options of the measure.

    Raises:
        InputError: For an unknown measure or option, or if a reference is missing.
    """
    found, time, arguments = _chosen(name, time, series, reference, start, end, options)
    if not len(time):
        return math.nan
    # Pass read-only arrays, since other measures get the same arrays and a function must not write to them.
    lacking = [None] if found.needs == "either" and len(arguments) == 1 else []
    result = found.function(*map(_read_only, (time, *arguments)), *lacking, **options)
    with suppress(TypeError, ValueError):
        if np.isrealobj(result):
            return float(result)
    kind = type(result).__name__
    raise result_fault(found.function, f"a measure must return a number; this measure returns a value of type {kind}")


def _read_only(values: Array) -> Array:
    """A view of an array that cannot be written."""
    view = np.asarray(values).view()
    view.flags.writeable = False
    return view


def unrest(
    name: str,
    time: Array,
    series: Array,
    reference: Array | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
    **options: Any,
) -> float:
    """Motion that remains at the end of the series, in the unit of the series. 0 if the series is at rest, or if the measure
    does not require rest. The arguments are the arguments of `measure`.
    """
    if name not in AT_REST or np.ndim(series) != 1:
        return 0.0
    _, time, (values, *others) = _chosen(name, time, series, reference, start, end, options)
    if not len(time):
        return 0.0
    extent = float(np.ptp(values))
    if name == "steady_state_error" and others and options.get("target") is None:
        values = others[0] - values
    return motion_left(time, values, share=options.get("share", SHARE), extent=extent)


def rest_of(time: Array, series: Array) -> tuple[float, float]:
    """Steady state of a series (n,), and the motion that is left at the end of the series; see `measure` and `unrest`."""
    _, time, (values,) = _chosen("steady_state", time, series, None, None, None, {})
    if not len(time):
        return math.nan, 0.0
    left = motion_left(time, values)
    return math.nan if left else mean(*last_part(time, values, SHARE)), left


def _chosen(
    name: str,
    time: Array,
    series: Array,
    reference: Array | None,
    start: float | None,
    end: float | None,
    options: dict[str, Any],
) -> tuple[Measure, Array, list[Array]]:
    """The measure, and the times and series to which it applies. Raises InputError."""
    found = MEASURES.get(name)
    problems = option_problems(found, options)
    if found.needs == "pair" and reference is None:
        message = "needs a second series to compare with (`against`, or `reference: QUANTITY`)"
        problems.append(Problem(message, key=name, code="no-reference"))
    if (found.needs == "poses") != (np.ndim(series) == 2):
        what = "the poses of a body" if found.needs == "poses" else "a scalar series"
        problems.append(Problem(f"is a measure of {what}", key=name, code="wrong-series"))
    if problems:
        raise InputError(problems)
    keep = np.isfinite(time) & (np.isfinite(series) if np.ndim(series) == 1 else np.isfinite(series).all(axis=1))
    arguments = [series]
    if reference is not None and found.needs in ("pair", "either"):
        keep &= np.isfinite(reference)
        arguments.append(reference)
    if start is not None:
        keep &= time >= start
    if end is not None:
        keep &= time <= end
    if not keep.all():
        time, arguments = time[keep], [argument[keep] for argument in arguments]
    return found, time, arguments


def option_problems(found: Measure, options: dict[str, Any]) -> list[Problem]:
    """Problems with the options of a measure."""
    known = _options_of(found.function)
    choices = (*known, "start", "end")
    problems = [
        Problem(
            "is not an option of this measure", key=f"{found.name}.{name}", choices=choices, meant=name, code="unknown-option"
        )
        for name in options
        if name not in known
    ]
    problems += [
        Problem("must be given", key=f"{found.name}.{name}", code="missing-option")
        for name, default in known.items()
        if default is inspect.Parameter.empty and name not in options
    ]
    return problems


def trial_problems(
    name: str,
    options: Mapping[str, Any],
    kinds: Mapping[str, Kind[Any]] = MappingProxyType({}),
    *,
    poses: bool | None = None,
    compared: bool = False,
) -> list[Problem]:
    """Problems of a measure's options, found before the run: wrong names and kinds of value, and errors of the measure when it
    is applied to an artificial series.

    Args:
        name: Name of a measure in `MEASURES`.
        options: Options of the measure, `start` and `end` among them, and further options.
        kinds: Kinds of value of the further options.
        poses: Whether the series are the poses of a body; None: as the measure needs.
        compared: Whether a reference is given.
    """
    found, own = MEASURES.get(name), {key: value for key, value in options.items() if key not in kinds}
    start, end = own.pop("start", None), own.pop("end", None)
    problems = option_problems(found, own)
    parameters = inspect.signature(found.function).parameters
    numbers = {"start", "end", *(key for key in own if str(parameters.get(key, "")).startswith(f"{key}: 'float"))}
    expected = {**kinds, **{key: Number() for key in numbers if options.get(key) is not None}}
    reading = DocumentReading()
    for key, kind in expected.items():
        if key in options:
            attempt(kind, node_from_data(options[key]), ("options", key), reading)
    problems += reading.problems
    if not problems and start is not None and end is not None and not start < end:
        problems.append(Problem("must be before the end", key="options.start", value=start, code="bad-option"))
    return problems or _failure(found, own, poses=found.needs == "poses" if poses is None else poses, compared=compared)


def _failure(found: Measure, options: dict[str, Any], *, poses: bool, compared: bool) -> list[Problem]:
    """Problems of a measure that cannot be applied to an artificial series."""
    time = np.linspace(0.0, 1.0, 201)
    series = np.tile(time[:, None], 7) if poses else 1.0 - np.exp(-5.0 * time) * np.cos(30.0 * time)
    # Use a reference that moves, as in a run. For a constant reference, many measures divide by 0.
    reference = 1.0 - np.exp(-5.0 * time) if compared else None
    try:
        with np.errstate(all="ignore"):
            measure(found.name, time, series, reference, **options)
    except InputError as error:
        return list(error.problems)
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        fault = plugin_fault(error)
        if fault and not options:
            raise fault from error
        given = ", ".join(f"{key}: {value}" for key, value in options.items())
        how = f" with {given}" if given else ""
        return [Problem(f"cannot be measured{how}: {fault or error}", key="options", code="bad-option")]
    return []
