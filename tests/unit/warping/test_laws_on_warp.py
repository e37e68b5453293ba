"""Laws translated to Warp give the numbers of their source; code without a translation is refused by file and line."""

import math
import types

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.actuators.motor import velocity_bounds
from asrsim.actuators.vectorised import energy_law
from asrsim.plugins import load_plugin_file
from asrsim.warping import FLOAT, TranslationError, WarpProgram
from asrsim.warping.values import Row, constant
from support.paths import EXAMPLES

SHIPPED = ("sea", "qbmove", "bavs", "awas_ii")


def on_warp(law, positions, parameters, results):
    wp = pytest.importorskip("warp", reason='needs the extra "warp"')
    from asrsim.warping.program import law_kernel, module_of

    code = module_of(law_kernel(law, positions.shape[1], len(parameters), results))
    found = wp.zeros((len(positions), results), dtype=float, device="cpu")
    given = [
        wp.array(np.float32(values), dtype=float, device="cpu") for values in (positions, np.tile(parameters, len(positions)))
    ]
    wp.launch(code.evaluate, dim=len(positions), inputs=[*given, found], device="cpu")
    return found.numpy()


@pytest.mark.parametrize("name", [*SHIPPED, "my_vsa"])
@pytest.mark.parametrize(("law", "results"), [("elastic_torques", 2), ("stiffness", 1), ("elastic_energy", 1)])
def test_every_law_is_that_of_its_source(name, law, results):
    if name == "my_vsa":
        load_plugin_file(EXAMPLES / "plugins" / "my_vsa.py")
    actuator = ACTUATORS.get(name)
    own = energy_law(actuator) if law == "elastic_energy" else getattr(actuator, law)
    parameters = tuple(parameter.default for parameter in actuator.parameters)
    positions = np.float32(np.random.default_rng(1).uniform(-0.4, 0.4, (200, 1 + actuator.positions())))
    if actuator.adjuster:
        positions[:, 2] = np.abs(positions[:, 2]) * 0.05
    wanted = np.array([np.atleast_1d(own(*map(float, row), parameters)) for row in positions])
    np.testing.assert_allclose(on_warp(own, positions, parameters, results), wanted, atol=1e-6 * np.abs(wanted).max())


def branching(x, y):
    total = count = 0
    for i in range(5):
        if i % 2 == 0 and x > 0.1 * i:
            total += i * x
        elif y < 0:
            total -= y / 2
        else:
            count += 1
    pair = (math.hypot(x, y), count)
    return total + pair[0] ** 2 + pair[1], max(x, y, 0)


def test_numbers_change_their_kind_as_in_python():
    program = WarpProgram()
    name, kind = program.function(branching, [FLOAT, FLOAT])
    assert kind.kinds == (FLOAT, FLOAT)
    assert f"def {name}(x: float, y: float)" in program.text

    def law(x, y, parameters):
        return branching(x, y)

    points = np.float32(np.random.default_rng(2).uniform(-1.0, 1.0, (100, 2)))
    np.testing.assert_allclose(on_warp(law, points, (0.0,), 2), [branching(*map(float, row)) for row in points], atol=1e-6)


def pull(x):
    return 2.0 * x


def _pull(x):
    return pull(x) + 1.0


def bracketed(x, y):
    inside = (x > 0.0 or y > 0.0) and not (y > 0.5 or x < y - 1.0)
    outside = x < 0.0 or (y < 0.0 and x < 1.0)
    a = -(x**2) if inside else (-x) ** 2
    b = x - (y - (x - 1.0))
    c = x / (y * 2.0 + 3.0) / (1.0 + x * x)
    d = (x + y) * (x - y) if outside and not inside else 1.0 if x > y else 2.0
    e = min(max(x, -0.5), 0.5) if -0.7 < x <= 0.7 else abs(y)
    return a + b, c - d, _pull(e) - pull(x)


def in_python(text):
    """Functions of a translated program, run by Python: its text is Python that calls functions of Warp."""
    warp = types.SimpleNamespace(func=lambda made: made, where=lambda said, one, other: one if said else other)
    warp.min, warp.max, warp.abs = min, max, abs
    warp.__dict__.update({name: made for name, made in vars(math).items() if not name.startswith("_")})
    names = {"wp": warp}
    exec(text.replace("import warp as wp", ""), names)
    return names


def test_operators_bind_as_in_python_and_functions_of_one_name_stay_apart():
    program = WarpProgram()
    name, _ = program.function(bracketed, [FLOAT, FLOAT])
    translated = in_python(program.text)[name]
    for x, y in np.random.default_rng(3).uniform(-1.5, 1.5, (300, 2)).tolist():
        assert translated(x, y) == pytest.approx(bracketed(x, y), abs=1e-12)


def circles(x):
    return (
        math.sin(x),
        math.cos(x),
        math.tan(x),
        math.asin(x),
        math.acos(x),
        math.atan(x),
        math.atan2(x, 0.3),
        math.hypot(x, 2.0),
    )


def curves(x):
    return math.sinh(x), math.cosh(x), math.tanh(x), math.exp(x), math.expm1(x), math.log1p(x), math.pow(2.0, x), math.cbrt(x)


def logarithms(x):
    y = x * x + 0.1
    return math.log(y), math.log2(y), math.log10(y), math.sqrt(y), math.fabs(x), math.copysign(2.0, x), math.hypot(x, 2.0)


def parts(x):
    y = 3.0 * x
    return math.floor(y), math.ceil(y), int(y), float(math.isfinite(x)), float(math.isnan(x))


@pytest.mark.parametrize("function", [circles, curves, logarithms, parts])
def test_functions_of_math_are_those_of_warp(function):
    program = WarpProgram()
    name, _ = program.function(function, [FLOAT])
    translated = in_python(program.text)[name]
    for x in (-0.9, -0.2, 0.4, 0.8):
        assert translated(x) == pytest.approx(function(x), abs=1e-12)


def test_functions_with_several_results_are_translated_with_their_callees():
    program = WarpProgram()
    _, kind = program.function(velocity_bounds, [FLOAT] * 5)
    assert kind.kinds == (FLOAT, FLOAT)


def reading(x):
    with open("law.txt") as file:  # noqa: PTH123 - what a law must not do
        return x + len(file.read())


def test_code_without_translation_is_refused_with_its_line():
    with pytest.raises(TranslationError, match=r"test_laws_on_warp\.py, line \d+: `with open"):
        WarpProgram().function(reading, [FLOAT])


def named(x, parameters):
    return x * parameters.spring_stiffness


def test_a_name_of_a_row_without_names_is_refused_with_its_line():
    with pytest.raises(TranslationError, match=r"test_laws_on_warp\.py, line \d+: .*: '\.spring_stiffness' has no"):
        WarpProgram().function(named, [FLOAT, Row(FLOAT, 3)])


@pytest.mark.parametrize(
    ("value", "text"),
    [(3.4e38, "3.4e+38"), (3.5e38, "wp.inf"), (-3.5e38, "(-wp.inf)"), (-math.inf, "(-wp.inf)"), (math.nan, "wp.nan"),
     (-2.5, "(-2.5)"), (-3, "(-3)"), (True, "True")],
)  # fmt: skip
def test_a_constant_beyond_single_precision_is_infinite(value, text):
    """A C++ compiler refuses a literal that its type does not hold."""
    assert constant(value).text == text
