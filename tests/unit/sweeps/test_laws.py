"""Laws of a varied key as users write them."""

import numpy as np
import pytest
from scipy import stats

from asrsim.errors import InputError
from asrsim.sweeps.laws import Distribution, Values, law_of

SHARES = np.linspace(0.01, 0.99, 9)


@pytest.mark.parametrize(
    ("law", "same"),
    [
        ("uniform(-1, 3)", stats.uniform(-1.0, 4.0)),
        ("loguniform(0.1, 10)", stats.loguniform(0.1, 10.0)),
        (" normal( 2 , 0.5 ) ", stats.norm(2.0, 0.5)),
        ("lognormal(2, 0.3)", stats.lognorm(0.3, scale=2.0)),
    ],
)
def test_a_distribution_is_that_of_its_name(law, same):
    found = law_of(law, "key")
    assert isinstance(found, Distribution)
    np.testing.assert_allclose(found.quantile(SHARES), same.ppf(SHARES), rtol=1e-12, atol=1e-12)
    assert law_of(found, "key") is found


@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("1:2:3", (1.0, 1.5, 2.0)),
        ("2:1:2", (2.0, 1.0)),
        ("log:1:100:3", (1.0, 10.0, 100.0)),
        ("5:9:1", (5.0,)),
        ("[1, two, true]", (1, "two", True)),
        ([0.1, 0.2], (0.1, 0.2)),
        (0.3, (0.3,)),
    ],
)
def test_a_list_or_a_range_has_its_values(law, values):
    found = law_of(law, "key")
    assert isinstance(found, Values)
    assert found.values == pytest.approx(values)
    assert len(found) == len(values)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ([], "the list is empty"),
        ("[]", "the list is empty"),
        ({"a": 1}, "a single mapping must be an element of a list"),
        ("{a: 1}", "a single mapping must be an element of a list"),
        ("[1, 2", "cannot be read"),
        ("much", "is neither a list of values nor a distribution"),
        ("gauss(1, 2)", "there is no distribution 'gauss'"),
        ("normal(1)", r"normal has the arguments \(mean, deviation\)"),
        ("normal(1, 2, 3)", r"normal has the arguments \(mean, deviation\)"),
        ("uniform(2, 2)", "the high end of a uniform distribution must be above the low end"),
        ("loguniform(3, 1)", "the high end of a loguniform distribution must be above the low end"),
        ("loguniform(0, 1)", "the low end of a loguniform distribution must be above 0"),
        ("normal(1, 0)", "deviation must be above 0"),
        ("lognormal(1, -1)", "sigma must be above 0"),
        ("lognormal(0, 1)", "median must be above 0"),
        ("uniform(a, 1)", "must be a finite number"),
        ("uniform(0, inf)", "must be a finite number"),
        ("1:2:0", "the count of a range must be a whole number of at least 1"),
        ("1:2:1.5", "the count of a range must be a whole number of at least 1"),
        ("1:2:100000000", "the count of a range must be a whole number of at least 1"),
        ("log:0:2:3", "both ends of a logarithmic range must be above 0"),
        ("log:1:-2:3", "both ends of a logarithmic range must be above 0"),
    ],
)
def test_a_law_that_is_none_is_refused_by_its_key_with_the_valid_forms(law, said):
    with pytest.raises(InputError, match=said) as caught:
        law_of(law, "arm.mass")
    (problem,) = caught.value.problems
    assert (problem.key, problem.code) == ("arm.mass", "sweep-values")
    assert "loguniform" in str(problem)
