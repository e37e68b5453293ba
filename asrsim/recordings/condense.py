"""Few notes instead of many: those of one kind in one, and those about what is not used in one of all."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

from asrsim.errors import Problem, listed

_ALIKE = 2
"""Notes of one kind up to which each stands alone."""
_NAMED = 4
"""Columns that a note of many names."""


def condense(findings: Iterable[Problem]) -> list[Problem]:
    """The notes with those of one kind joined where there are more than two: the first one's words, and the places of all."""
    kinds: dict[str, list[Problem]] = {}
    for one in findings:
        kinds.setdefault(one.code, []).append(one)
    result: list[Problem] = []
    for alike in kinds.values():
        if len(alike) <= _ALIKE:
            result += alike
            continue
        first = alike[0]
        places = _places(one.key for one in alike[1:] if one.key)
        result.append(
            replace(first, message=f"{first.message}; and {len(alike) - 1} more like it" + (f": {places}" if places else ""))
        )
    return result


def set_aside(findings: Sequence[Problem], used: Collection[str], unused: Collection[str]) -> list[Problem]:
    """The notes with those about columns that nobody uses in one; `used`, `unused`: the columns' names.

    A note is about a column whose name is its key, or begins with its key and a slash (a topic).
    """

    def of(key: str | None, names: Collection[str]) -> bool:
        return key is not None and any(name == key or name.startswith(f"{key}/") for name in names)

    aside = [one for one in findings if one.code in _OF_COLUMNS and of(one.key, unused) and not of(one.key, used)]
    aside += [one for one in findings if one.code == "unknown-message-type"]
    if len(aside) <= _ALIKE:
        return list(findings)
    topics = dict.fromkeys(one.key for one in aside if one.key)
    kinds: dict[str, int] = {}
    for one in aside:
        kinds[_OF_COLUMNS[one.code]] = kinds.get(_OF_COLUMNS[one.code], 0) + 1
    said = ", ".join(f"{name} ({count})" for name, count in kinds.items())
    note = Problem(
        f"{len(topics)} columns or topics that are not used here: {said}", file=aside[0].file, key=_places(topics),
        code="not-used",
    )  # fmt: skip
    kept = [one for one in findings if not any(one is other for other in aside)]
    return [*kept, note]


_OF_COLUMNS = {
    "jitter": "jitter", "dropped-samples": "lost samples", "duplicate-time": "repeated stamps",
    "backward-time": "backward stamps", "overtaken": "overtaken messages", "stray-time": "stray stamps",
    "bad-time": "bad stamps", "too-short": "one message", "two-time-bases": "other clocks", "broken-message": "broken messages",
    "time-unit-assumed": "times without unit", "missing-mark": "marked cells", "missing-cells": "empty cells",
    "not-a-number": "cells that are no numbers", "unknown-message-type": "not readable", "unread-topic": "not readable",
    "length": "another length",
}  # fmt: skip
"""Code of a note about a column -> what it tells, in a word or two."""


def _places(keys: Iterable[str]) -> str:
    return listed(dict.fromkeys(keys), _NAMED)
