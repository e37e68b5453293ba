"""Collects the errors and warnings of one file while its elements are read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Unpack

from asrsim.errors import Details, Place, Problem

Line = Callable[[Any], int | None]
"""An element's line in the user's file, None if unknown."""

EMPTY_LIMIT = "Exporters write 0 for what was left empty: give the joint's limits, or make it continuous, which needs none"
"""What to do about limits of 0."""


class Findings:
    """Errors and warnings of one file."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.errors: list[Problem] = []
        self.warnings: list[Problem] = []

    def error(self, message: str, *, code: str, **place: Unpack[Place]) -> None:
        """Add an error: the file cannot be simulated."""
        self.errors.append(Problem(message, code=code, file=self.file, **place))

    def warn(self, message: str, *, code: str, **place: Unpack[Place]) -> None:
        """Add a warning: something to know. Messages leave the name to `key`, so that equal ones can be shown as one."""
        self.warnings.append(Problem(message, code=code, file=self.file, **place))


class Reader:
    """Reads elements of a file; problems go to `findings`, each with its element's line."""

    def __init__(self, findings: Findings, line: Line) -> None:
        self.findings = findings
        self.line = line

    def error(self, message: str, element: Any, key: str, *, code: str, **details: Unpack[Details]) -> None:
        """Add an error of an element."""
        self.findings.error(message, code=code, line=self.line(element), key=key, **details)

    def warn(self, message: str, element: Any, key: str, *, code: str, **details: Unpack[Details]) -> None:
        """Add a warning of an element."""
        self.findings.warn(message, code=code, line=self.line(element), key=key, **details)
