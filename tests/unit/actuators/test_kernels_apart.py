"""Kernels in the cache: their names differ where their code does."""

from __future__ import annotations

from collections import OrderedDict

import pytest

from asrsim import compiling


def test_the_names_of_a_kernel_tell_what_it_does(monkeypatch, tmp_path):
    """Without compiling: the functions of two kernels that differ in one constant deep inside share no name."""
    numba = pytest.importorskip("numba")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    names: list[set[str]] = []

    class Dispatcher:
        signatures = ((),)

        def __init__(self, function):
            self.overloads = {(): self}
            self.entry_point = function

    def njit(*given, **options):
        def note(function):
            names[-1].add(str(function.__qualname__))  # type: ignore[attr-defined]
            return Dispatcher(function)

        if given and callable(given[0]) and not isinstance(given[0], tuple):
            names[-1].add(str(given[0].__qualname__))  # type: ignore[attr-defined]
            return given[0]
        return note

    monkeypatch.setattr(numba, "njit", njit)

    def make(constant):
        def inner(x):
            return x * constant

        return inner

    def outer(x):
        return bound(x)  # type: ignore[name-defined]  # noqa: F821

    for constant in (2.0, 3.0, 2.0):
        names.append(set())
        monkeypatch.setattr(compiling, "_loaded", OrderedDict())
        compiling.compile_function(outer, (1.0,), names={"bound": make(constant)})
    assert len(names[0]) == 2, "the function and what it calls"
    assert not names[0] & names[1]
    assert names[0] == names[2]
