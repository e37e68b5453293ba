"""Collects the errors and warnings of one file while it is read."""

from __future__ import annotations

from pathlib import Path

from asrsim.errors import Problem, RobotError


class Findings:
    """Errors and warnings of one file; `raise_errors` ends the reading if there is any error."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.errors: list[Problem] = []
        self.warnings: list[Problem] = []

    def error(
        self,
        message: str,
        *,
        code: str,
        line: int | None = None,
        key: str | None = None,
        value: object | None = None,
        choices: tuple[str, ...] = (),
        hint: str | None = None,
    ) -> None:
        """Add an error: the file cannot be simulated."""
        self.errors.append(self._problem(message, code, line, key, value, choices, hint))

    def warn(
        self,
        message: str,
        *,
        code: str,
        line: int | None = None,
        key: str | None = None,
        value: object | None = None,
        choices: tuple[str, ...] = (),
        hint: str | None = None,
    ) -> None:
        """Add a warning: something to know. Messages leave the name to `key`, so that equal ones can be shown as one."""
        self.warnings.append(self._problem(message, code, line, key, value, choices, hint))

    def raise_errors(self) -> None:
        """Raise RobotError with all errors, if there are any."""
        if self.errors:
            raise RobotError(sorted(self.errors, key=lambda problem: problem.line or 0), warnings=self.warnings)

    def _problem(
        self,
        message: str,
        code: str,
        line: int | None,
        key: str | None,
        value: object | None,
        choices: tuple[str, ...],
        hint: str | None,
    ) -> Problem:
        return Problem(message=message, file=self.file, line=line, key=key, value=value, choices=choices, hint=hint, code=code)
