"""Measures with options as one text, NAME or NAME:OPTION=VALUE,... This form is used on the command line and in verdicts."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from asrsim.document.yaml_reader import parse_yaml
from asrsim.errors import InputError, Problem
from asrsim.metrics.measures import MEASURES, Measure, measure, trial_problems
from asrsim.samples import Array

_BETWEEN = re.compile(r",(?![^\[]*\])")
"""Comma that separates two options; a comma inside a list does not separate options."""


@dataclass(frozen=True, kw_only=True)
class AskedMeasure:
    """Measure with options."""

    measure: Measure
    options: Mapping[str, Any]

    @property
    def text(self) -> str:
        """Name and options of the measure."""
        return measure_text(self.measure.name, self.options)

    def of(self, time: Array, series: Array, reference: Array | None) -> float:
        """Value of the measure for a series (n,) and the reference (n,) of this series; NaN if the value is undefined, or if
        the measure needs a reference and none is given.
        """
        if reference is None and self.measure.needs == "pair":
            return math.nan
        return measure(self.measure.name, time, series, reference, **self.options)


def measure_text(name: str, options: Mapping[str, Any]) -> str:
    """Name and options as one text, such as `at:when=2`."""
    written = (f"{key}={value:g}" if isinstance(value, float) else f"{key}={value}" for key, value in options.items())
    return f"{name}:{','.join(written)}" if options else name


def asked_measures(texts: Sequence[str]) -> list[AskedMeasure]:
    """Measures of series, from texts. Raises InputError with the problems of all texts."""
    found: list[AskedMeasure] = []
    problems: list[Problem] = []
    for text in dict.fromkeys(texts):
        try:
            found.append(_asked(text))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return found


def _asked(text: str) -> AskedMeasure:
    name, _, rest = text.partition(":")
    known = MEASURES.get(name)
    if known.needs == "poses":
        raise InputError("measures the poses of a body, not a series of numbers", key=name, code="wrong-series")
    pairs = [one.partition("=") for one in _BETWEEN.split(rest) if one]
    if wrong := [key for key, equals, _ in pairs if not equals or not key.strip()]:
        raise InputError("is not OPTION=VALUE", key=name, value=wrong[0], hint=f"Write {name}:OPTION=VALUE", code="bad-option")
    options = {key.strip(): parse_yaml(value).plain() for key, _, value in pairs}
    if problems := trial_problems(name, options, compared=True):
        hint = f"Write {name}:{{}}=VALUE"
        raise InputError(
            replace(one, hint=hint.format((one.key or "").rpartition(".")[2])) if one.code == "missing-option" else one
            for one in problems
        )
    return AskedMeasure(measure=known, options=options)
