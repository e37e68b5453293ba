"""What progress bars share: they stand on stderr, only where somebody watches, and only in what takes a while."""

from __future__ import annotations

import sys
import time as clock
from types import TracebackType
from typing import Any, Self

from asrsim.cli.console import is_terminal


class Bar:
    """A context that takes its bar away at its end. The bar goes to stderr, so that stdout stays clean."""

    def __init__(self, *, show: bool) -> None:
        self._show = show and is_terminal(sys.stderr)
        self._began = clock.perf_counter()
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
