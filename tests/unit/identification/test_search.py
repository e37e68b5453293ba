"""The levels of a search on a model in closed form, whose errors accumulate over the time of its predictions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.identification.search import Best, search, settle
from support.identify_files import Model, modelled

TIME = np.linspace(0.0, 1.0, 400)
SHOWN = np.sin(40.0 * TIME)
"""Effect of the parameter, whose true value is 0, on a free simulation."""
DRIFT = (1.0 + 0.3 * np.sin(7.0 * TIME)) * SHOWN
"""Error of the model in a free simulation: a parameter of -1 hides it, except for a part that differs between tenths."""


class Observed(Model):
    """An observer of bandwidth w, in units of the motion's, shortens predictions to the fraction 1 / (1 + w) of the time: the
    effect of the parameter falls by this fraction, and that of the model's error by its square.
    """

    def __init__(self, layout, noise, fastest, drift):
        super().__init__(None, layout, 10.0 * SHOWN, 0.0)
        self.channels = (replace(self.channels[0], noise=noise),)
        self.observes, self.motion = True, 1.0
        self.measured = SimpleNamespace(fastest=fastest, shows=lambda bandwidth: bandwidth <= fastest)
        robot = SimpleNamespace(actuators=(), joints=(), links=(), moving_joints=())
        self.door = SimpleNamespace(substeps_of=lambda numbers: (1, 1), robot=robot)
        self._drift, self._noise = drift, noise * np.random.default_rng(0).normal(size=len(TIME))

    def predictions(self, tables, playing, until):
        share = 1.0 / (1.0 + playing.bandwidth)
        for table in tables:
            left = table["a"] * share * SHOWN + share**2 * self._drift + self._noise
            yield [left + channel.values for channel in self.channels]


class Moved(Observed):
    """An observer of any bandwidth moves the estimate by -0.5. Estimates of tenths scatter equally at all bandwidths."""

    def predictions(self, tables, playing, until):
        share, moved = 1.0 / (1.0 + playing.bandwidth), 0.5 if playing.bandwidth else 0.0
        for table in tables:
            left = share * (self._drift + (table["a"] + moved) * SHOWN) + self._noise
            yield [left + channel.values for channel in self.channels]


def searched(noise, fastest, drift, model=Observed):
    """Fit after the search, and the bandwidths of its levels in their order."""
    problem, begun = modelled(None, 1, len(TIME), weight=noise), []
    best = Best(replace(problem, tracks=(model(problem.layout, noise, fastest, drift),)), np.zeros(1))
    search(best, begun.append)
    return best, [0.0 if name == "free simulation" else float(name.split()[2]) for name in begun]


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("fastest", [50.0, 1e5])
def test_the_bandwidth_rises_until_errors_of_the_model_are_as_small_as_noise(noise, fastest):
    """Estimates of tenths of 40 samples scatter by 0.2 / (1 + w) due to the model, and by (1 + w) sqrt(2 / 40) due to noise of
    deviation 1: both are equal at the best bandwidth.
    """
    best, levels = searched(noise, fastest, DRIFT)
    kept = best.problem.playing.bandwidth
    ideal = min((0.2 / (noise * np.sqrt(2.0 / 40.0))) ** 0.5 - 1.0, fastest)
    assert ideal / 2.0 <= kept <= 2.0 * ideal
    assert levels[:5] == [8.0, 2.0, 0.5, 0.1, 0.0]
    risen = levels[5:]
    assert risen == [8.0 * 2.0**k for k in range(1, 1 + len(risen))]
    # The search ends at the first bandwidth that is not kept, or beyond which the samples do not resolve the motion.
    assert max(levels) == (32.0 if fastest < kept * 2.0 else 2.0 * kept)
    share = 1.0 / (1.0 + kept)
    hidden = share * float(SHOWN @ DRIFT / (SHOWN @ SHOWN))
    assert best.problem.layout.values(best.x)[0] == pytest.approx(-hidden, abs=0.3 * noise / share)
    # Of the free simulation, the errors of the model are reported.
    assert [problem.playing.bandwidth for problem, _ in best.slow] == [0.0]


def test_a_model_without_errors_is_simulated_freely_after_the_first_level():
    best, levels = searched(1e-3, 1e5, 0.0 * DRIFT)
    assert (best.problem.playing.bandwidth, levels, best.slow) == (0.0, [8.0], ())
    assert best.problem.layout.values(best.x)[0] == pytest.approx(0.0, abs=3e-4)


def test_an_error_that_no_parameter_hides_does_not_need_an_observer():
    """The estimates of all levels agree."""
    best, levels = searched(1e-3, 1e5, np.cos(40.0 * TIME))
    assert best.problem.playing.bandwidth == 0.0
    assert levels == [8.0, 2.0, 0.5, 0.1, 0.0]


def test_of_levels_with_equal_scatter_the_one_is_kept_whose_free_simulation_errs_least():
    """The residuals of a fast observer are the smallest, but the free simulation with its estimates errs more."""
    best, _ = searched(1e-6, 50.0, 0.3 * np.sin(7.0 * TIME) * SHOWN, model=Moved)
    assert best.problem.playing.bandwidth == 0.0
    assert best.problem.layout.values(best.x)[0] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(("error", "substeps"), [(0.0, 1), (8.0, 8)])
def test_substeps_become_finer_while_the_time_step_error_matters(error, substeps):
    """error: time-step error with one substep, in units of the noise. It falls with the square of the number of substeps."""
    noise, time = np.random.default_rng(0).normal(size=2000), np.linspace(0.0, 1.0, 2000)
    problem = modelled(lambda x: noise + x[0] - 1.0, 1, 2000)
    (track,) = problem.tracks
    robot = SimpleNamespace(actuators=(), moving_joints=(), links=())
    track.door = SimpleNamespace(substeps_of=lambda numbers: (1, 1), robot=robot, exact_in_time=True)
    plain = track.predictions

    def predictions(tables, playing, until):
        late = error * np.sin(40.0 * time) / playing.substeps[0] ** 2
        return ([values + late for values in found] for found in plain(tables, playing, until))

    track.predictions = predictions
    best = Best(problem, np.zeros(1))
    settle(best)
    assert best.problem.playing.substeps == (substeps, 1)
