"""Simulator against external facts: every check of docs/validation.md with its bound."""

import pytest

from validation.check import available, installed_engines, on
from validation.sections import SECTIONS


def _measures(recorded):
    for section in SECTIONS:
        if (section.needs == "data") != recorded:
            continue
        for measure in section.measures:
            for engine in installed_engines() if section.engines else installed_engines()[:1]:
                # Where the engines solve the same equations, `test_two_engines.py` compares them with each other.
                again = engine != installed_engines()[0] and not section.solvers
                marks = [pytest.mark.slow] if again or measure.__name__ in section.slow else []
                yield pytest.param(section, measure, engine, id=f"{measure.__name__}-{engine}", marks=marks)


@pytest.mark.parametrize(("section", "measure", "engine"), list(_measures(recorded=False)))
def test_every_check_is_within_its_bound(section, measure, engine):
    if not available(section):
        pytest.skip(f"needs {section.needs}")
    keeps_its_bounds(measure, engine)


@pytest.mark.parametrize(("section", "measure", "engine"), list(_measures(recorded=True)))
def test_every_check_against_recordings_is_within_its_bound(section, measure, engine, shared):
    keeps_its_bounds(measure, engine)


def keeps_its_bounds(measure, engine):
    """Assert that each check of `measure` passes in the engine."""
    with on(engine):
        checks = list(measure())
    assert checks
    assert not [str(check) for check in checks if not check.passed]
