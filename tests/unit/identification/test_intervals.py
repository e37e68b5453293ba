"""Intervals, derivatives and combinations of linear problems with known solutions; extensions of a model."""

import math
import re
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import stdtrit

from asrsim import identify
from asrsim.identification.causes import contradicted_ties
from asrsim.identification.combinations import combinations
from asrsim.identification.extensions import Extension, exchanged, extended, presliding, pruned
from asrsim.identification.noise import quantum_of
from asrsim.identification.parameters import FitParameter, make_layout
from asrsim.identification.problem import FitProblem, Meter, jacobian, posterior_draws, residuals, slopes_along, solve
from asrsim.identification.profiles import profiles
from asrsim.identification.result import estimates
from asrsim.identification.search import Best, settle
from asrsim.identification.task import Tie
from asrsim.identification.uncertainty import uncertainty, with_faint_directions
from asrsim.robot import load_robot, with_overrides
from support.event_driven import EventDriven, Mass
from support.identify_files import CHIRP, SEA, modelled, record, save, write
from support.paths import ROOT


def linear(slopes, left=0.0, corner=0.0):
    """Residuals A x + b + |C x|."""
    n = slopes.shape[1]
    bent = np.zeros(slopes.shape) + corner
    return modelled(lambda x: slopes @ x + left + np.abs(bent @ x), n, len(slopes))


def test_differences_are_never_taken_beyond_bounds():
    """The vector is at a bound, or nearer to a bound than a step."""
    step, tried = 1e-3, []
    slopes = np.random.default_rng(0).normal(size=(50, 5))
    low, high = np.array([0.0, -1.0, 0.0, -1.0, -1.0]), np.array([1.0, 0.0, 1.0, 0.0, 1.0])
    parameters = [
        FitParameter(key=key, unit="", start=1.0, low=1.0 + a, high=1.0 + b)
        for key, a, b in zip("abcde", low, high, strict=True)
    ]
    problem = modelled(lambda x: tried.append(x) or slopes @ x + 100.0 * x.sum() ** 2, parameters, 50)
    x = np.array([0.0, 0.0, 0.4 * step, -0.4 * step, 0.01])
    for found in (slopes_along(problem, x, range(5), step), with_faint_directions(problem, x, jacobian(problem, x))):
        assert np.all((np.array(tried) >= low - 1e-12) & (np.array(tried) <= high + 1e-12))
        np.testing.assert_allclose(found, slopes + 200.0 * x.sum(), atol=101.0 * step)
    # Away from bounds the step is 1e-6.
    np.testing.assert_allclose(found[:, 4], slopes[:, 4] + 200.0 * x.sum(), atol=2e-4)


@pytest.mark.parametrize("way", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (0, 1, -1), (0, 0, 0)])
def test_a_profile_shows_how_residuals_bend(way):
    """Residuals 1000 x, and 250000 (a x)^2 for a direction a: w standard deviations of x_i add w^2 + (a_i w)^4 / 16."""
    noise, ways = np.random.default_rng(4).normal(size=200), np.array(way, dtype=float)
    problem = modelled(lambda x: np.array([*1e3 * x, 2.5e5 * (ways @ x) ** 2, *noise]), 3, 204)
    x, widths = np.zeros(3), np.arange(-3.0, 4.0)
    found = profiles(problem, x, uncertainty(problem, x), ("a", "b", "c"))
    for one, a in zip(found, ways, strict=True):
        np.testing.assert_allclose(one.rise, widths**2 + (a * widths) ** 4 / 16.0, rtol=2e-3)


def test_white_noise_gives_the_deviation_of_least_squares():
    """Deviation sqrt(r'r / (m - n) diag(A'A)^-1); the half width is 1.96 times this if blocks do not differ."""
    generator = np.random.default_rng(2)
    slopes = generator.normal(size=(60, 4))
    noise = generator.normal(size=60)
    left = 0.3 * (noise - slopes @ np.linalg.lstsq(slopes, noise, rcond=None)[0])
    inverse = np.linalg.inv(slopes.T @ slopes)
    found = uncertainty(linear(slopes, left), np.zeros(4))
    variance = float(left @ left) / (60 - 4)
    assert found.deviation == pytest.approx(np.sqrt(variance * np.diag(inverse)), rel=1e-3)
    assert found.quantile == pytest.approx(np.full(4, stdtrit(60 - 4, 0.975)))
    assert found.covariance == pytest.approx(variance * inverse, rel=2e-3)


@pytest.mark.parametrize(("memory", "quantum"), [(0.0, 0.0), (0.9, 0.0), (0.97, 0.0), (0.0, 4.0)])
def test_intervals_of_a_linear_model_hold_under_coloured_noise(memory, quantum):
    """Noise of an autoregression, or quantisation of a slow motion; 90 to 98 % of 400 intervals contain the truth."""
    generator, time, hits = np.random.default_rng(7), np.linspace(0.0, 1.0, 1500), []
    slopes = np.stack([np.sin(9.0 * time), np.cos(23.0 * time), time, np.sign(np.sin(14.0 * time))], axis=1)
    truth = 30.0 * np.sin(5.0 * time)
    for _ in range(100):
        noise = lfilter([1.0], [1.0, -memory], generator.normal(size=2000))[500:]
        shown = truth + (noise if not quantum else 0.2 * noise)
        if quantum:
            shown = quantum * np.round((shown + quantum * generator.uniform(-0.5, 0.5)) / quantum)
        size = quantum / math.sqrt(12.0) if quantum else math.sqrt(1.0 / (1.0 - memory**2))
        left = partial(lambda x, shown: truth + slopes @ x - shown, shown=shown)
        problem = modelled(left, 4, 1500, recorded=shown, quantum=quantum, weight=size)
        x = -np.linalg.lstsq(jacobian(problem, np.zeros(4)), residuals(problem, np.zeros(4)), rcond=None)[0]
        found = uncertainty(problem, x)
        hits.append(np.abs(x) <= found.deviation * found.quantile)
    assert 0.90 <= np.mean(hits) <= 0.98


def test_priors_count_as_residuals():
    """The second parameter has no effect. Solution and covariance of linear least squares with normal priors about 0."""
    generator = np.random.default_rng(4)
    slopes, left = generator.normal(size=(60, 3)) * (1.0, 0.0, 1.0), generator.normal(size=60)
    problem = linear(slopes, left)
    spreads = np.array([0.1, 0.5, np.inf])
    entries = tuple(replace(one, spread=own) for one, own in zip(problem.layout.entries, spreads.tolist(), strict=True))
    known = replace(problem, layout=replace(problem.layout, entries=entries))
    covariance = np.linalg.inv(slopes.T @ slopes + np.diag(spreads**-2.0) + 1e-12 * np.eye(3))
    x = solve(known, np.full(3, 0.3))
    np.testing.assert_allclose(x, -covariance @ slopes.T @ left, atol=1e-5)
    draws = posterior_draws(known, x, 4000)
    np.testing.assert_allclose(np.cov(draws.T), covariance, atol=0.05 * np.sqrt(np.outer(*[np.diag(covariance)] * 2)).max())
    np.testing.assert_allclose(draws.mean(axis=0), x, atol=0.05 * spreads[1])
    # Draws stay within the bounds.
    bounded = replace(known, layout=replace(known.layout, entries=(replace(entries[0], low=1.0), *entries[1:])))
    assert posterior_draws(bounded, np.zeros(3), 100)[:, 0].min() == 0.0


@pytest.mark.parametrize("met", [True, False])
def test_blocks_that_disagree_widen_the_intervals(met):
    """Tenths of the recording give different values of the first number. For the second number all give the same larger value,
    which a bound forbids."""
    slopes, signs = np.zeros((400, 2)), np.random.default_rng(0).choice([-1.0, 1.0], 400)
    slopes[::2, 0], slopes[1::2, 1] = signs[::2], signs[1::2]
    apart = np.repeat(np.tile([1.0, -1.0], 5), 40)
    left = signs * np.where(np.arange(400) % 2 == 0, 0.4 * apart, 0.3)
    problem = linear(slopes, left)
    a, b = problem.layout.entries
    bounded = replace(problem.layout, entries=(a, replace(b, low=b.start))) if met else problem.layout
    found = uncertainty(replace(problem, layout=bounded), np.zeros(2))
    of_blocks = 20 * 0.4 / 200 * math.sqrt(10 * 10 / 9)
    assert found.deviation[0] == pytest.approx(of_blocks, rel=1e-5)
    assert found.quantile[0] == pytest.approx(2.262157, rel=1e-5)
    ordinary = math.sqrt(float(left @ left) / (400 - 2) / 200)
    assert found.deviation[1] == pytest.approx(ordinary if met else 20 * 0.3 / 200 * math.sqrt(10 * 10 / 9), rel=1e-5)
    # Each tenth alone moves the first number by 0.4, which is the deviation for an accepted model.
    assert found.of_a_block.deviation[0] == pytest.approx(0.4, rel=1e-5)


def test_a_parameter_on_which_tenths_disagree_has_this_reason():
    """Estimates of the tenths are -1 and 3 in turn, so the half width is 2.26 * 2 / 3."""
    problem = linear(np.ones((400, 1)), np.repeat(np.tile([2.0, -2.0], 5), 40))
    ((one,), _) = estimates(problem, np.zeros(1), uncertainty(problem, np.zeros(1)))
    assert "parts of the recordings disagree" in one.reason


def test_a_contradicted_tie_may_have_the_value_0():
    slopes = np.random.default_rng(0).normal(size=(40, 2))
    a, b = (FitParameter(key=key, unit="", start=0.0) for key in "ab")
    problem = modelled(lambda x: slopes @ (x - [0.0, 1.0]), [a, b], 40)
    tied = replace(problem, layout=make_layout([a], [Tie(key="b", to="a")], ["a"], [{}], [{}]))
    assert list(contradicted_ties(tied, np.zeros(1))) == ["b is tied to a, but they differ by 100 %"]


@pytest.mark.parametrize("apart", [0.0, 1.0])
def test_a_tie_is_contradicted_only_if_the_fit_is_better_without_it(apart):
    """The effect of a difference is linear up to 0.1 and vanishes beyond, as that of friction that keeps a joint at rest."""
    generator = np.random.default_rng(0)
    slopes, effect = generator.normal(size=(400, 1)), generator.normal(size=400)
    noise = generator.normal(size=400) - 0.3 * effect

    def left(x):
        free, other = x
        vanishing = effect * np.clip(other - free, -0.1, 0.1) * (abs(other - free) < 0.2)
        return slopes[:, 0] * free + (1.0 - apart) * vanishing + apart * effect * (other - free) + noise

    a, b = (FitParameter(key=key, unit="", start=1.0) for key in "ab")
    tied = replace(modelled(left, [a, b], 400), layout=make_layout([a], [Tie(key="b", to="a")], ["a"], [{}], [{}]))
    assert bool(list(contradicted_ties(tied, np.zeros(1)))) == bool(apart)


def test_a_tenth_does_not_identify_what_nothing_distinguishes():
    slopes = np.tile(np.random.default_rng(0).normal(size=(400, 1)), 2)
    assert np.isnan(uncertainty(linear(slopes, slopes[::-1, 0]), np.zeros(2)).of_a_block.deviation).all()


@pytest.mark.parametrize(("bend", "simulations"), [(0.0, 1), (0.01, 1), (10.0, 4)])
def test_derivatives_are_used_again_where_they_predict_the_residuals(bend, simulations):
    tried, slopes = [], np.random.default_rng(0).normal(size=(50, 3))
    problem = modelled(lambda x: tried.append(x) or slopes @ x + bend * (x @ x), 3, 50)
    jacobian(problem, np.zeros(3))
    tried.clear()
    there = np.array([1.0, 0.0, 0.0])
    # The update makes the derivatives along the move those of its chord.
    along = jacobian(problem, there) @ there
    assert len(tried) == simulations
    np.testing.assert_allclose(along, slopes[:, 0] + (bend if simulations == 1 else 2.0 * bend), atol=1e-4)


def test_directions_of_a_smooth_model_are_looked_at_together():
    """A simulation at the estimate, and one on each side of it."""
    tried, slopes = [], np.random.default_rng(0).normal(size=(50, 3))
    with_faint_directions(modelled(lambda x: tried.append(x) or slopes @ x, 3, 50), np.zeros(3), slopes)
    assert len(tried) == 3


def test_a_diverged_simulation_gives_no_derivative():
    slopes = np.random.default_rng(0).normal(size=(50, 3))
    problem = modelled(lambda x: None if x[1] > 0.0 else slopes @ x, 3, 50)
    found = slopes_along(problem, np.zeros(3), range(3), 1e-3)
    np.testing.assert_allclose(found, slopes * [1.0, 0.0, 1.0], atol=1e-9)


def test_a_diverged_simulation_of_two_channels_keeps_its_weights():
    diverging = modelled(lambda x: None, 1, 50)
    (track,) = diverging.tracks
    track.channels *= 2
    robot = SimpleNamespace(actuators=(), moving_joints=(), links=())
    track.door = SimpleNamespace(substeps_of=lambda numbers: (1, 1), robot=robot, exact_in_time=False)
    best = Best(replace(diverging, weights=((2.0, 3.0),)), np.zeros(1))
    settle(best)
    assert best.problem.weights == ((2.0, 3.0),)


def known(parameters, slopes, x=None):
    """Combinations that are identified by a noisy recording of one linear combination of the vector x."""
    x = np.zeros(len(parameters)) if x is None else x
    shape = 1e3 * np.outer(np.sin(np.linspace(0.0, 9.0, 200)), slopes)
    problem = modelled(lambda there: shape @ (there - x), parameters, 200)
    found = uncertainty(problem, x, foreseen=True)
    return combinations(problem, x, found, range(len(x)))


def positive(key, start, unit=""):
    return FitParameter(key=key, unit=unit, start=start, low=1e-9 * start, high=1e9 * start, logarithmic=True)


@pytest.mark.parametrize("values", [(0.02, 0.5, 0.3), (2.0, 30.0, 5.0)])
@pytest.mark.parametrize("powers", [(1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (2.0, 1.0, 1.0), (-1.0, 2.0, 1.0), (4.0, 1.0, 1.0)])
def test_an_identifiable_product_of_three_parameters_is_found(values, powers):
    (one,) = known([positive(key, value) for key, value in zip("abc", values, strict=True)], powers)
    assert sorted(one.keys) == [0, 1, 2]
    factors = re.findall(r"(^| \* | / )([abc])(?:\^([\d.]+))?", one.text)
    shown = {name: (-1.0 if sign == " / " else 1.0) * float(power or 1.0) for sign, name, power in factors}
    found = np.array([shown[name] for name in "abc"])
    assert np.cross(found, powers) == pytest.approx(0.0, abs=0.01)
    assert np.prod(np.array(values) ** found) == pytest.approx(one.value)


def test_the_combination_with_the_narrowest_interval_is_told_although_a_simpler_one_is_also_known():
    """a^2 b^3 is known within a few thousandths, and a b only within some tenths, since each parameter is hardly known."""
    parameters = [positive("a", 2.0, "kg"), positive("b", 3.0, "m")]
    wave = np.linspace(0.0, 9.0, 200)
    shape = 1e3 * np.outer(np.sin(wave), (2.0, 3.0)) + 0.1 * np.outer(np.cos(wave), (3.0, -2.0))
    problem = modelled(lambda there: shape @ there, parameters, 200)
    x = np.zeros(2)
    (one,) = combinations(problem, x, uncertainty(problem, x, foreseen=True), range(2))
    assert sorted(one.text.split(" * ")) == ["a^2", "b^3"]
    assert one.margin / one.size < 0.01


@pytest.mark.parametrize("angle", [0.0, 0.2])
def test_a_parameter_that_another_imitates_is_not_without_effect(angle):
    """Unit noise and columns of norm 3 at an angle: the half width is 1.96 / (3 sin(angle)) > 1 if both are free, and 1.96 / 3
    if one is free. A column of norm 1 counts as no effect.
    """
    columns = np.zeros((100, 3))
    columns[0] = 3.0, 3.0 * math.cos(angle), 0.0
    columns[1, 1], columns[2, 2] = 3.0 * math.sin(angle), 1.0

    def verdicts(slopes):
        n, problem = slopes.shape[1], linear(slopes)
        known, _ = estimates(problem, np.zeros(n), uncertainty(problem, np.zeros(n), foreseen=True))
        assert all(math.isnan(one.low) for one in known if one.verdict != "weak")
        return [one.verdict for one in known]

    assert verdicts(columns) == ["only as ratio", "only as ratio", "no effect"]
    assert verdicts(columns[:, :1]) == verdicts(columns[:, 1:2]) == ["weak"]


@pytest.mark.parametrize(("unit", "text", "value"), [("kg", "a + b", 3.0), ("1", "a * b", 2.25), ("m", "a * b", 2.25)])
def test_equal_changes_give_sums_of_masses_and_products_of_gains(unit, text, value):
    (one,) = known([positive(key, 1.5, unit) for key in "ab"], (1.0, 1.0))
    assert (sorted(one.text.split()), one.value) == (sorted(text.split()), pytest.approx(value))


def of_two(values, slopes, start=None):
    """Combinations of two angles a and b, of which a recording shows slopes[0] a + slopes[1] b."""
    starts = values if start is None else (start, start)
    parameters = [
        FitParameter(key=key, unit="rad", start=one, low=-5.0, high=5.0) for key, one in zip("ab", starts, strict=True)
    ]
    sizes = np.array([one.size for one in parameters])
    return known(parameters, slopes * sizes, (np.array(values) - starts) / sizes)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("values", [(1.0, -2.0), (-1.0, -2.0), (1.5, -0.5), (-1.5, 0.001)])
def test_a_known_sum_has_its_sign_whatever_its_terms(values, sign):
    (one,) = of_two(values, (1.0, sign))
    assert one.text in (f"a {'+' if sign > 0.0 else '-'} b", f"b {'+' if sign > 0.0 else '-'} a")
    assert one.value == pytest.approx((values[0] + sign * values[1]) * (1.0 if one.text[0] == "a" else sign))


def test_a_combination_without_a_relative_interval_is_left_out():
    """A sum that is 0, and powers of a value that is a hundredth of its typical size."""
    assert of_two((1.0, -1.0), (1.0, 1.0)) == []
    assert all("^" not in one.text for one in of_two((0.01, 1.0), (1.0, 0.01), start=1.0))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("a", "power"), [(1e80, 4.0), (2.0, 6.5)])
def test_a_combination_that_overflows_or_has_high_powers_is_left_out(a, power):
    """Only a^4 b is known, and a is 1e80; or only a^13 b^2 is known."""
    assert known([positive("a", a), positive("b", 2.0)], (power, 1.0)) == []


def test_a_sticking_joint_gives_no_false_information():
    """The residuals depend only on the difference of two entries, and have a corner at this difference."""
    time = np.linspace(0.0, 1.0, 200)
    shown = 1e3 * np.outer(np.sin(7.0 * time), [1.0, -1.0])
    problem = linear(shown, corner=30.0 * np.outer(time, [1.0, -1.0]))
    found = uncertainty(problem, np.zeros(2), foreseen=True)
    assert np.all(np.isnan(found.deviation) | (found.deviation > 1e3))


def lacking_one(problem):
    """Problem without its last parameter, and functions that propose to free it."""
    *others, last = problem.layout.entries
    extension = Extension(parameters=(last,), share=1.0)
    return replace(problem, layout=replace(problem.layout, entries=tuple(others))), [lambda *_: [extension]]


@pytest.mark.parametrize("seed", range(3))
def test_an_extension_promises_what_it_would_explain(seed):
    """Linear residuals: the start is the new number in the least-squares solution; the fraction is the explained error."""
    generator = np.random.default_rng(seed)
    matrix, x = generator.normal(size=(40, 4)), generator.normal(size=3)
    begin = 9.0 * matrix[:, 3] + 0.1 * generator.normal(size=40)
    problem, propose = lacking_one(modelled(lambda x: matrix @ x + begin, 4, 40))
    found = extended(problem, x, propose, most=1, enough=lambda *_: False)
    np.testing.assert_allclose(found.x, np.linalg.lstsq(matrix, -begin, rcond=None)[0], atol=1e-4)
    # An extension that explains nothing is not adopted.
    problem, propose = lacking_one(modelled(lambda x: matrix[:, :3] @ x[:3] + begin, 4, 40))
    assert extended(problem, x, propose, most=1, enough=lambda *_: False).chosen == ()


def test_of_two_extensions_that_explain_everything_the_simpler_is_adopted():
    noise, one, two, other = np.random.default_rng(0).normal(size=(4, 500))
    problem = modelled(lambda x: np.stack([other, one, two], axis=1) @ x + 3.0 * one + noise, 3, 500)
    first, *both = problem.layout.entries
    alone = replace(problem, layout=replace(problem.layout, entries=(first,)))
    kinds = [lambda *_: [Extension(text=str(count), parameters=tuple(both[:count])) for count in (2, 1)]]
    assert extended(alone, np.zeros(1), kinds, most=1, enough=lambda *_: False).chosen[0].text == "1"


def test_an_extension_that_later_ones_replace_is_removed():
    """Residuals are the sum of two shapes. A third shape resembles the sum, so it is adopted first, and is then useless."""
    one, two, three, other = np.random.default_rng(0).normal(size=(4, 500))
    matrix = np.stack([three, one, two, one + two + other], axis=1)
    problem = modelled(lambda x: matrix @ x + 3.0 * (one + two), 4, 500)
    first, *parameters = problem.layout.entries
    alone = replace(problem, layout=replace(problem.layout, entries=(first,)))
    kinds = [lambda *_: [Extension(text=parameter.key, parameters=(parameter,)) for parameter in parameters]]
    found = extended(alone, np.zeros(1), kinds, enough=lambda *_: False)
    assert found.chosen[0].text == "d"
    assert {extension.text for extension in pruned(alone, found, rounds=15).chosen} == {"b", "c"}


def test_extensions_that_imitate_each_other_are_told_together():
    """With the free parameter, the third shape has the same effect as the second one; the fourth shape has another one."""
    noise, one, two, other = np.random.default_rng(0).normal(size=(4, 500))
    matrix = np.stack([other, one, 2.0 * one + other, two], axis=1)
    problem = modelled(lambda x: matrix @ x + 3.0 * one + noise, 4, 500)
    first, *parameters = problem.layout.entries
    alone = replace(problem, layout=replace(problem.layout, entries=(first,)))
    kinds = [lambda *_: [Extension(text=parameter.key, parameters=(parameter,)) for parameter in parameters]]
    own = Extension(text="b", parameters=parameters[:1])
    start = extended(alone, np.zeros(1), [lambda *_: [own]], most=1, enough=lambda *_: False)
    found = exchanged(alone, start, kinds, rounds=15)
    assert {one.chosen[-1].text for one in (found, *found.rivals)} == {"b", "c"}
    # An extension without much effect is replaced by one that explains more.
    start = extended(alone, np.zeros(1), kinds[:0], most=1, enough=lambda *_: True)
    wrong = Extension(text="d", parameters=parameters[2:])
    start = replace(start, chosen=(wrong,), problem=wrong.added_to(alone), x=np.zeros(2))
    assert exchanged(alone, start, kinds, rounds=15).chosen[-1].text in {"b", "c"}


@pytest.mark.parametrize("memory", [0.0, 0.98])
def test_noise_however_coloured_asks_for_no_extension(memory):
    generator, time = np.random.default_rng(3), np.linspace(0.0, 1.0, 2000)
    slopes = np.stack([np.sin(9.0 * time), time, np.cos(40.0 * time), np.sin(25.0 * time)], axis=1)
    for _ in range(40):
        left = lfilter([1.0], [1.0, -memory], generator.normal(size=2500))[500:]
        problem, propose = lacking_one(linear(slopes, left))
        assert extended(problem, np.zeros(3), propose, most=1, enough=lambda *_: False).chosen == ()


@pytest.mark.parametrize(("noise", "adopted"), [(1.0, True), (3.0, False)])
def test_a_badly_fitting_model_adopts_only_what_explains_much(noise, adopted):
    """A fifth of the squared residuals is explained, at the level of the noise or at nine times its variance."""
    slopes = np.random.default_rng(5).normal(size=(2000, 2))
    problem, (propose,) = lacking_one(linear(slopes, noise * (slopes[:, 1] / 2.0 + np.random.default_rng(6).normal(size=2000))))
    kinds = [lambda *_: [replace(one, excess=0.5) for one in propose()]]
    assert bool(extended(problem, np.zeros(1), kinds, most=1, enough=lambda *_: False).chosen) == adopted


@pytest.mark.parametrize(("other", "suspected"), [(1.0, True), (4.0, False)])
def test_a_cause_is_suspected_beside_a_smaller_unknown_cause(other, suspected):
    """A sine of amplitude 3 can be explained; a sine of another frequency remains, and its samples are not independent."""
    time = np.linspace(0.0, 2.0 * math.pi, 2000)
    slopes = np.stack([np.cos(40.0 * time), np.sin(3.0 * time)], axis=1)
    problem, (propose,) = lacking_one(linear(slopes, 3.0 * slopes[:, 1] + other * np.sin(5.0 * time)))
    for text, expected in (("a cause", suspected), ("", False)):
        kinds = [lambda *_, text=text: [replace(one, text=text) for one in propose()]]
        assert bool(extended(problem, np.zeros(1), kinds, most=1, enough=lambda *_: False).chosen) == expected


@pytest.mark.parametrize(("noise", "told"), [(0.0, True), (0.2, True), (3.0, False)])
def test_fast_motions_show_no_plateaus_of_the_encoder(noise, told):
    time, quantum = np.arange(0.0, 6.0, 0.002), 2.0 * np.pi / 4096
    values = 0.8 * np.sin(6.0 * time) + noise * quantum * np.random.default_rng(0).normal(size=len(time))
    found = quantum_of(quantum * np.round(values / quantum))
    assert found == (pytest.approx(quantum) if told else 0.0)


AXIS = """<robot name="axis"><link name="world"/>
  <joint name="motor" type="prismatic"><parent link="world"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit effort="1e5" velocity="100" lower="-1" upper="1"/><dynamics damping="1000" friction="10"/></joint>
  <link name="carriage"><inertial><mass value="200"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
</robot>
"""


@pytest.mark.slow
def test_a_locked_joint_needs_its_spring_for_the_published_values(tmp_path):
    """A mass of 360 kg on a spring, moved by a chirp of force; the integration is independent of asrsim."""
    generator, time, rate = np.random.default_rng(1), np.arange(0.0, 20.001, 2e-3), math.log(12.0 / 0.1) / 20.0

    def force(at):
        return 500.0 * np.sin(2.0 * math.pi * 0.1 * np.expm1(rate * at) / rate)

    joint = EventDriven(Mass(360.0, 2200.0), lambda v: 30.0 + 0.0 * v)
    place = joint.move(np.zeros(1), np.zeros(1), lambda at, x: force(at) - 3.5e5 * x, time)[0][:, 0]
    shown = 2e-6 * np.round((place + 1e-6 * generator.normal(size=len(time))) / 2e-6)
    header = "t [s],motor.reference_1 [N],motor.link_position [m]"
    recording = save(tmp_path / "a.csv", header, time, force(time) + generator.normal(size=len(time)), shown)
    (tmp_path / "axis.urdf").write_text(AXIS)
    scenario, free = tmp_path / "lab.yaml", ["motor.damping", "motor.friction", "carriage.mass"]
    scenario.write_text("robot: axis.urdf\nduration: 20\nactuators: {motor: {type: sea, mode: 0}}\n")
    without = identify(scenario, [recording], free=free)
    (suspected,) = re.findall(r"a passive spring of motor \((.*) N/m\) is suspected", "\n".join(without.causes))
    assert float(suspected) == pytest.approx(3.5e5, rel=0.02)
    found = identify(scenario, [recording], free=[*free, "motor.passive_stiffness=1e5"])
    assert (without.fits, found.fits) == (False, True)
    assert {one.verdict for one in found.estimates} == {"identified"}
    # The time-step error at 1 ms would be larger than the error of the sensor.
    for key, true in (("carriage.mass", 360.0), ("motor.damping", 2200.0), ("motor.passive_stiffness", 3.5e5)):
        assert found.find(key).value == pytest.approx(true, rel=2e-3)


@pytest.mark.parametrize("tied", range(4))
def test_motors_with_tied_friction_have_tied_bristle_stiffness(tied):
    """A stiffness that is free or given is not changed."""
    robot = load_robot(ROOT / "examples/urdf/dof2_horizontal.urdf")
    motors = [f"joint_{j}.motor_{i}" for j in (1, 2) for i in (1, 2)]
    ties = [Tie(key=f"{motors[n + 1]}_friction_torque", to=f"{motors[0]}_friction_torque") for n in range(tied)]
    found = _freed(robot, ties=ties)
    assert list(found) == [f"{motors[n]}_friction_stiffness" for n in (0, *range(tied + 1, 4))]
    tied_to, *others = found.values()
    assert tied_to == [f"{motors[n + 1]}_friction_stiffness" for n in range(tied)]
    assert not any(others)
    given = with_overrides(robot, parameters={"joint_1": {"motor_1_friction_stiffness": 800.0}})
    free = FitParameter(key="joint_2.motor_2_friction_stiffness", unit="N m/rad", start=900.0, logarithmic=True)
    assert list(_freed(given, free=[free])) == [f"{motor}_friction_stiffness" for motor in motors[1:3]]


def _freed(robot, free=(), ties=()):
    """Keys of stiffnesses that would be tied, by the key of the stiffness that would be free."""
    track = SimpleNamespace(door=SimpleNamespace(robot=robot))
    problem = FitProblem((track,), make_layout(free, ties, ["lab"], [{}], [{}]), (), (), (), Meter())
    return {one.parameters[0].key: [tie.key for tie in one.ties] for one in presliding(problem, np.zeros(0))}


def test_steps_that_the_toolbox_prescribes_are_no_error_of_the_time_step(tmp_path):
    """The released code's steps belong to its model: intervals are those of the noise."""
    references = f"{{equilibrium_position: {CHIRP}}}"
    true, lab = (
        write(tmp_path, name, {**SEA, "damping": damping}, references) for name, damping in (("true", 0.02), ("lab", 0.03))
    )
    for path in (true, lab):
        path.write_text(f"{path.read_text()}stepping: toolbox\n")
    recording = record(true, tmp_path / "a.csv", noise=1e-4)
    found = identify(lab, [recording], free=["joint_1.spring_stiffness", "joint_1.damping"]).find("joint_1.spring_stiffness")
    assert found.value == pytest.approx(4.0, abs=1e-4)
    assert 0.0 < found.high - found.low < 2e-4


@pytest.mark.parametrize(
    ("name", "tag", "limit", "reference"),
    [
        ("max_torque", "mot_tauMax", 1.0, CHIRP),
        # Many pairs of causes are tried before it is found.
        pytest.param("max_torque", "mot_tauMax", 1.0, "{step: {at: 0.1, to: 0.4}}", marks=pytest.mark.slow),
        ("max_velocity", "mot_maxVel", 1.5, CHIRP),
    ],
)
def test_a_limit_that_the_recording_runs_into_is_suspected(tmp_path, name, tag, limit, reference):
    free = {**SEA, "mode": 6, "tags": f"{SEA['tags']}<mot_tauMax>100</mot_tauMax><mot_maxVel>100</mot_maxVel>"}
    tight = {**SEA, "mode": 6, "tags": free["tags"].replace(f"<{tag}>100", f"<{tag}>{limit}")}
    true = write(tmp_path, "true", tight, f"{{equilibrium_position: {reference}}}")
    record(true, tmp_path / "a.csv", ("link_position", "motor_1_position"))
    lab = write(tmp_path, "lab", {**free, "damping": 0.025})
    result = identify(lab, [tmp_path / "a.csv"], free=["joint_1.spring_stiffness", "joint_1.damping"])
    assert not result.fits
    assert any(f"motor_1_{name}" in text for text in result.causes), (result.misfit, result.causes)
