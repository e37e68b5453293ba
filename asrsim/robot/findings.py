"""Collects the errors and warnings of one file while it is read."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from asrsim.errors import Place, Problem, RobotError


class Findings:
    """Errors and warnings of one file; `raise_errors` ends the reading if there is any error."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.errors: list[Problem] = []
        self.warnings: list[Problem] = []

    def error(self, message: str, *, code: str, **place: Unpack[Place]) -> None:
        """Add an error: the file cannot be simulated."""
        self.errors.append(Problem(message=message, code=code, file=self.file, **place))

    def warn(self, message: str, *, code: str, **place: Unpack[Place]) -> None:
        """Add a warning: something to know. Messages leave the name to `key`, so that equal ones can be shown as one."""
        self.warnings.append(Problem(message=message, code=code, file=self.file, **place))

    def raise_errors(self) -> None:
        """Raise RobotError with all errors, if there are any."""
        if self.errors:
            raise RobotError(sorted(self.errors, key=lambda problem: problem.line or 0), warnings=self.warnings)
