"""What a fit says on the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from asrsim.identification.judge import praise
from asrsim.identification.result import Result
from asrsim.identification.told import percent
from asrsim.identification.verdicts import HOPELESS, Estimate
from asrsim.robot.model import INERTIAS

CORRELATED = 0.95
"""From which on two estimates are named as correlated."""

NOTHING = 1e-6
"""Share of an interval's width, of which the table has five digits, below which a number is rounding."""


def columns(result: Result) -> Sequence[tuple[str, list[str], bool]]:
    """The table of parameters, as :func:`asrsim.cli.console.say_table` takes it."""
    rows = result.estimates
    return (
        ("parameter", [one.name for one in rows], False),
        ("unit", [one.unit for one in rows], False),
        ("start", [_digits(one, one.start, 5) for one in rows], True),
        ("estimate", [_value(one) for one in rows], True),
        ("95 % interval", [_interval(one) for one in rows], True),
        ("+-", [_margin(one) for one in rows], True),
        ("verdict", [one.verdict for one in rows], False),
    )


def errors(result: Result) -> Sequence[tuple[str, list[str], bool]]:
    """The table of channels: errors before and after, in what was fitted and in what was held out."""
    rows = result.channels
    several = len({one.recording for one in rows}) > 1
    names = [f"{one.key} ({one.recording})" if several else one.key for one in rows]
    numbers = (
        ("training\nbefore", "before"),
        ("\nafter", "after"),
        ("held out\nbefore", "held_before"),
        ("\nafter", "held_after"),
    )
    return (
        ("RMS error", names, False),
        ("unit", [one.unit for one in rows], False),
        *((head, [_number(getattr(one, name)) for one in rows], True) for head, name in numbers),
        ("noise", [_number(one.noise) for one in rows], True),
        ("lag-1\ncorrelation", [f"{one.correlation:.2f}" if math.isfinite(one.correlation) else "-" for one in rows], True),
    )


def remarks(result: Result) -> Iterator[tuple[str, str]]:
    """(text, style) of what else is to be said."""
    for one in result.estimates:
        if one.reason:
            yield f"{one.name}: {one.verdict}: {one.reason}", "yellow"
    for first, second, value in correlated(result):
        yield f"{first} and {second} are correlated ({value:.3f})", "dim"
    for text in result.remarks:
        yield text, "dim"


def judgement(result: Result) -> Iterator[tuple[str, str]]:
    """(text, style) of whether the model fits."""
    if result.status == "checked":
        return
    if result.status in ("interrupted", "unfinished"):
        yield f"{result.status}: the best so far; --resume goes on from it", "yellow"
        return
    if result.whole:
        yield "errors are those of a fit without the held-out part; estimates are from whole recordings", "dim"
    if result.fits:
        yield f"the model fits: {praise(result.channels)}", "green"
        return
    yield "model does not fit: intervals hold for this model only", "bold red"
    for text in (*result.misfit, *result.causes):
        yield f"  {text}", "red"
    known = [one for one in result.channels if math.isfinite(one.explained)]
    if known:
        worst = min(known, key=lambda one: one.explained)
        yield f"  it explains {100.0 * worst.explained:.4g} % of the variance of {worst.key}, and no less of the others", "red"
    if result.accepted:
        yield "  accepted: intervals are as wide as estimates from a tenth of the recording differ", "yellow"
    if not result.causes:
        yield "  what is missing does not show; look at the residuals in its picture", "red"


def advice(result: Result) -> Iterator[str]:
    """What to move more, for parameters that are not well known."""
    wanted: dict[str, list[str]] = {}
    for one in result.estimates:
        if one.verdict not in ("identified", "at bound"):
            wanted.setdefault(_movement(one.key), []).append(one.name)
    yield from (f"{', '.join(names)}: {text}" for text, names in wanted.items() if text)


def _movement(key: str) -> str:
    """That shows a parameter."""
    joint, _, name = key.rpartition(".")
    if "friction" in name:
        return "turn slowly, and reverse often: friction shows at low speed"
    if "damping" in name:
        return "move fast and let swing out: damping shows at high speed"
    if name.startswith("hysteresis"):
        return f"deflect {joint} to and fro, far and little, slowly: hysteresis shows where the motion turns"
    if name.startswith(("spring", "max_deflection", "lever", "pulley")):
        return f"deflect {joint} more, by loads or fast reversals, and at several presets"
    if "inertia" in name or name in ("mass", *INERTIAS):
        return "accelerate more: steps and chirps at higher frequencies"
    return ""


def correlated(result: Result) -> Iterator[tuple[str, str, float]]:
    """Pairs of estimates that go together."""
    names = [one.name for one in result.estimates]
    known = [not math.isnan(one.low) for one in result.estimates]
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            if abs(result.correlation[i, j]) > CORRELATED and known[i] and known[j]:
                yield names[i], names[j], float(result.correlation[i, j])


def _value(one: Estimate) -> str:
    return _digits(one, one.value, 6)


def _digits(one: Estimate, number: float, count: int) -> str:
    """As many digits as are told; what is nothing beside the interval is none."""
    width = 0.0 if math.isnan(one.low) else one.high - one.low
    return "0" if abs(number) < NOTHING * width else f"{number:.{count}g}"


def _interval(one: Estimate) -> str:
    return "-" if math.isnan(one.low) else f"{_digits(one, one.low, 5)} .. {_digits(one, one.high, 5)}"


def _margin(one: Estimate) -> str:
    if math.isnan(one.low):
        return "-"
    if one.is_place:
        return f"{0.5 * (one.high - one.low):.2g} {one.unit}".rstrip()
    return percent(one.margin) if one.margin < HOPELESS else "-"


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"
