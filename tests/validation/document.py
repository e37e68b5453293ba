"""Writer of docs/validation.md, which lists the figures of the checks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from validation.check import Check, Section, available, installed_engines, on

INTRODUCTION = """# Validation

`PYTHONPATH=tests python -m validation --out docs/validation.md` measured every number on this page. The tests
(`tests/physics/test_truth.py`) run the same functions with the same bounds. A row stands for all checks of one kind,
and shows the number that is nearest to its bound. Angles are in rad, and the step is 1 ms unless stated otherwise.
"""


Results = Mapping[str, Sequence[Check]]
"""Checks by engine; the key is "" for a section without engines."""


def measure(sections: Sequence[Section]) -> Iterator[tuple[Section, dict[str, list[Check]]]]:
    """Yield each section whose requirements are met, with its checks in every installed engine."""
    for section in sections:
        if not available(section):
            continue
        results: dict[str, list[Check]] = {}
        for name in installed_engines() if section.engines else ("",):
            with on(name or installed_engines()[0]):
                results[name] = [check for function in section.measures for check in function()]
        yield section, results


def document(results: Sequence[tuple[Section, Results]]) -> str:
    """Page as Markdown."""
    parts = [INTRODUCTION]
    for section, checks in results:
        heads = " | ".join(name or "figure" for name in checks)
        parts.append(f"\n## {section.title}\n\n{section.text}\n\n")
        parts.append(f"| check | number | {heads} | source |\n|{'---|' * (len(checks) + 3)}\n")
        for kind in dict.fromkeys(kind_of(check) for listed in checks.values() for check in listed):
            alike = [[check for check in listed if kind_of(check) == kind] for listed in checks.values()]
            source = next(check.source for listed in alike for check in listed)
            cells = " | ".join(cell(listed) for listed in alike)
            parts.append(f"| {kind} | {max(map(len, alike))} | {cells} | {source} |\n")
    return "".join(parts)


def kind_of(check: Check) -> str:
    """Name of the check without the part that describes the case."""
    return re.split("[,:]", check.name)[0]


def cell(checks: Sequence[Check]) -> str:
    """Figure that is nearest to its bound, with the bound; `-` without checks."""
    if not checks:
        return "-"
    check = max(checks, key=lambda check: check.bound / check.figure if check.at_least else check.figure / check.bound)
    unit = "" if check.unit == "1" else f" {check.unit}"
    missed = "" if check.passed else " **missed**"
    return f"{number(check.figure)}{unit}{missed} ({'≥' if check.at_least else '≤'} {number(check.bound)})"


def number(value: float) -> str:
    """Value with two or three significant digits."""
    if value == 0.0:
        return "0"
    return f"{value:.3g}" if 0.01 <= abs(value) < 1e4 else f"{value:.1e}"
