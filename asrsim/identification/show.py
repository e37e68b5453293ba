"""Result of a fit as text: tables of parameters and of errors, remarks and judgement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from asrsim.identification.combinations import percent
from asrsim.identification.judge import praise
from asrsim.identification.result import HOPELESS, Estimate, FitResult
from asrsim.identification.resume import Resumed
from asrsim.quantities import prefixed
from asrsim.tables import TableColumn

NOTHING = 1e-6
"""A number is shown as 0 if it is below this fraction of its interval's width."""


def estimate_columns(result: FitResult | Resumed) -> Sequence[TableColumn]:
    """Table of parameters."""
    rows = result.estimates
    return (
        TableColumn("parameter", [one.name for one in rows]),
        TableColumn("unit", [one.unit for one in rows]),
        TableColumn("start", [_digits(one, one.start, 5) for one in rows], right=True),
        TableColumn("estimate", [_digits(one, one.value, 6) for one in rows], right=True),
        TableColumn("95 % interval", [_interval(one) for one in rows], right=True),
        TableColumn("+-", [_margin(one) for one in rows], right=True),
        TableColumn("verdict", [one.verdict for one in rows]),
    )


ERRORS = ("before", "after", "held_before", "held_after", "noise")
"""Fields of `ChannelFit` with values in the unit of the channel."""


def errors(result: FitResult) -> Sequence[TableColumn]:
    """Table of channels, with the errors of the training part and of the held-out part before and after the fit."""
    rows = result.channels
    several = len({one.recording for one in rows}) > 1
    names = [f"{one.key} ({one.recording})" if several else one.key for one in rows]
    numbers = {
        "training\nbefore": "before", "training\nafter": "after", "held out\nbefore": "held_before",
        "held out\nafter": "held_after", "noise": "noise", "lag-1\ncorrelation": "correlation",
    }  # fmt: skip
    scales = [prefixed([getattr(one, name) for name in ERRORS], one.unit) for one in rows]
    columns = {
        head: [
            _number(getattr(one, name) * (scale if name in ERRORS else 1.0))
            for one, (scale, _) in zip(rows, scales, strict=True)
        ]
        for head, name in numbers.items()
    }
    return (
        TableColumn("RMS error", names),
        TableColumn("unit", [unit for _, unit in scales]),
        *(TableColumn(head, cells, right=True) for head, cells in columns.items()),
    )


def judgement(result: FitResult) -> Iterator[tuple[str, str]]:
    """Reasons of the verdicts, remarks, and the statement whether the model fits, each as a pair (text, style)."""
    for one in result.estimates:
        if one.reason:
            yield f"{one.name}: {one.verdict}: {one.reason}", "yellow"
    for text in result.remarks:
        yield text, "dim"
    if result.status == "checked":
        condition = "if the start values are close to the true values"
        yield f"check only, nothing was fitted: a fit of these recordings would give about these intervals {condition}", "bold"
        return
    if result.status != "complete":
        yield f"{result.status}: these are the numbers of the best fit so far", "yellow"
        return
    if result.whole:
        yield "errors are from a fit without the held-out parts; estimates are from a fit of the whole recordings", "dim"
    yield from ((one.text, "green" if one.succeeds else "red") for one in result.transfers)
    if result.fits:
        yield from ((text, "green") for text in praise(result.channels))
        return
    yield "model does not fit: the intervals show the spread of estimates from tenths of the recording", "bold red"
    for text in (*result.misfit, *result.causes):
        yield f"  {text}", "red"
    share = min(100.0 * result.explained, 99.99)
    yield f"  it explains at least {share:.4g} % of the variance of each channel", "red"
    if result.accepted:
        yield "  accepted: the robot is written with all estimates, since only together they explain the recording", "yellow"
    if not result.causes:
        yield "  no missing effect was found among those that were tried; look at the residuals in the picture", "red"


def _digits(one: Estimate, number: float, count: int) -> str:
    """Number as text; 0 if the number is negligible relative to the width of its interval."""
    return "0" if one.has_interval and abs(number) < NOTHING * (one.high - one.low) else f"{number:.{count}g}"


def _interval(one: Estimate) -> str:
    return f"{_digits(one, one.low, 5)} .. {_digits(one, one.high, 5)}" if one.has_interval else "-"


def _margin(one: Estimate) -> str:
    if one.is_place and one.has_interval:
        return f"{0.5 * (one.high - one.low):.2g} {one.unit}".rstrip()
    return percent(one.margin) if one.has_interval and one.margin < HOPELESS else "-"


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"
