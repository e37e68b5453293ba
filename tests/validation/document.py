"""docs/validation.md from the checks' own numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from validation.check import Check, Section, available, installed_engines, on

INTRODUCTION = """# Validation

Every figure of this page was measured when it was written, by
`PYTHONPATH=tests python -m validation --out docs/validation.md`; the same functions, with the same bounds, are the project's
tests (`tests/physics/test_truth.py`). A figure is what came out, a bound is what it must stay below (orders of
convergence: reach).
Angles are in rad, steps 1 ms unless said. What depends on the engine was measured in each, with a column of its own; a dash
stands where a check is another engine's.
"""


Results = Mapping[str, Sequence[Check]]
"""Engine -> checks; "" for a section that no engine has a part in."""


def measure(sections: Sequence[Section]) -> Iterator[tuple[Section, dict[str, list[Check]]]]:
    """Sections that can be run here, each with its checks in every installed engine."""
    for section in sections:
        if not available(section):
            continue
        results: dict[str, list[Check]] = {}
        for name in installed_engines() if section.engines else ("",):
            with on(name or installed_engines()[0]):
                results[name] = [check for function in section.measures for check in function()]
        yield section, results


def document(results: Sequence[tuple[Section, Results]]) -> str:
    """The page as Markdown."""
    parts = [INTRODUCTION]
    for section, checks in results:
        heads = " | ".join(f"{name}, bound" if name else "figure | bound" for name in checks)
        lines = "---|" * (3 + ("" in checks) + len(checks) - 1)
        parts.append(f"\n## {section.title}\n\n{section.text}\n\n| check | {heads} | source |\n|{lines}\n")
        names = dict.fromkeys(check.name for listed in checks.values() for check in listed)
        tables = {engine: {check.name: check for check in listed} for engine, listed in checks.items()}
        parts.extend(row(name, {engine: table.get(name) for engine, table in tables.items()}) for name in names)
    return "".join(parts)


def row(name: str, checks: Mapping[str, Check | None]) -> str:
    """A line of a table."""
    source = next(check.source for check in checks.values() if check is not None)
    cells = " | ".join(_cell(check, " " if engine else " | ") for engine, check in checks.items())
    return f"| {name} | {cells} | {source} |\n"


def _cell(check: Check | None, between: str) -> str:
    if check is None:
        return "-"
    sign = "≥" if check.at_least else "≤"
    unit = "" if check.unit == "1" else f" {check.unit}"
    mark = "" if check.passed else " **missed**"
    bound = f"{sign} {number(check.bound)}"
    return f"{number(check.figure)}{unit}{mark}{between}{bound if between.strip() else f'({bound})'}"


def number(value: float) -> str:
    """Short: two or three figures."""
    if value == 0.0:
        return "0"
    return f"{value:.3g}" if 0.01 <= abs(value) < 1e4 else f"{value:.1e}"
