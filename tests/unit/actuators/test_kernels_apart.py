"""Compiled functions whose code differs never share a file of the cache."""

from collections import OrderedDict

import pytest

from asrsim import compiling

pytest.importorskip("numba")


def test_functions_that_differ_in_a_constant_deep_inside_are_compiled_apart(monkeypatch, tmp_path):
    """Each is compiled as in a process of its own, with the files of the earlier ones."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def make(constant):
        def inner(x):
            return x * constant

        return inner

    def outer(x):
        return bound(x)  # type: ignore[name-defined]  # noqa: F821

    found = []
    for constant in (2.0, 3.0, 2.0):
        monkeypatch.setattr(compiling, "_loaded", OrderedDict())
        found.append(compiling.compile_function(outer, (1.0,), names={"bound": make(constant)})(1.0))
    assert found == [2.0, 3.0, 2.0]
