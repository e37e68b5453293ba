"""docs/validation.md from the checks' own numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from validation.check import Check, Section, available

INTRODUCTION = """# Validation

Every figure of this page was measured when it was written, by
`PYTHONPATH=tests python -m validation --out docs/validation.md`; the same functions, with the same bounds, are the project's
tests (`tests/test_truth.py`). A figure is what came out, a bound is what it must stay below (orders of convergence: reach).
Angles are in rad, steps 1 ms unless said.

![Error against cost](images/work_precision.png)

The picture (`--figures`) has the largest error of the joint positions over the time that one simulated second takes, for
each stepping and for steps from 4 ms to 1/16 ms, without substeps.
"""


def measure(sections: Sequence[Section]) -> Iterator[tuple[Section, list[Check]]]:
    """Sections that can be run here, each with its checks."""
    for section in sections:
        if available(section):
            yield section, [check for function in section.measures for check in function()]


def document(results: Sequence[tuple[Section, list[Check]]]) -> str:
    """The page as Markdown."""
    parts = [INTRODUCTION]
    for section, checks in results:
        parts.append(f"\n## {section.title}\n\n{section.text}\n\n| check | figure | bound | source |\n|---|---|---|---|\n")
        parts.extend(row(check) for check in checks)
    return "".join(parts)


def row(check: Check) -> str:
    """A line of a table."""
    sign = "≥" if check.at_least else "≤"
    unit = "" if check.unit == "1" else f" {check.unit}"
    mark = "" if check.passed else " **missed**"
    return f"| {check.name} | {number(check.figure)}{unit}{mark} | {sign} {number(check.bound)} | {check.source} |\n"


def number(value: float) -> str:
    """Short: two or three figures."""
    if value == 0.0:
        return "0"
    return f"{value:.3g}" if 0.01 <= abs(value) < 1e4 else f"{value:.1e}"
