"""Compiled functions whose code differs never share a file of the cache."""

from collections import OrderedDict

import numpy as np
import pytest

from asrsim.compiled import compiling

pytest.importorskip("numba")


@pytest.fixture
def compiled(monkeypatch, tmp_path):
    """Function that compiles as in a process of its own, with the files of earlier calls."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def fresh(*given, **names):
        monkeypatch.setattr(compiling, "_loaded", OrderedDict())
        return compiling.compile_function(*given, names=names)

    return fresh


def test_functions_that_differ_in_a_constant_deep_inside_are_compiled_apart(compiled):
    def make(constant):
        def inner(x):
            return x * constant

        return inner

    def outer(x):
        return bound(x)  # type: ignore[name-defined]  # noqa: F821

    assert [compiled(outer, (1.0,), bound=make(constant))(1.0) for constant in (2.0, 3.0, 2.0)] == [2.0, 3.0, 2.0]


def test_readers_of_integers_and_of_floats_are_compiled_apart(compiled):
    def first(address):
        return bound(address)[0]  # type: ignore[name-defined]  # noqa: F821

    number = np.array([1.0])
    floats, integers = (
        compiled(first, (number.ctypes.data,), bound=compiling.row_at(kind))(number.ctypes.data) for kind in (False, True)
    )
    assert (floats, integers) == (1.0, number.view(np.int64)[0])


def test_intrinsics_that_differ_only_in_their_code_are_compiled_apart(compiled):
    from numba.extending import intrinsic

    def make(more):
        def add(typing, value):
            def generate(context, builder, signature, arguments):
                return builder.fadd(arguments[0], arguments[0].type(more))

            return value(value), generate

        return intrinsic(add)

    def outer(x):
        return bound(x)  # type: ignore[name-defined]  # noqa: F821

    assert [compiled(outer, (1.0,), bound=make(more))(1.0) for more in (2.0, 3.0, 2.0)] == [3.0, 4.0, 3.0]
