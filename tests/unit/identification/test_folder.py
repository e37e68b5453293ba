"""The folder of a fit, read back; profiles and spectra."""

import json

import numpy as np
import pytest

from asrsim.errors import InputError
from asrsim.identification import identify, read_fit
from asrsim.identification.curves import CURVES, channel_charts, channel_curves, curves_of, write_curves
from asrsim.identification.folder import FIT
from asrsim.identification.write import fit_data, write_curves_of
from asrsim.outfile import write_json
from support.identify_files import CHIRP, SEA, record, write


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    true = write(folder / "true", "lab", SEA, references=f"{{equilibrium_position: {CHIRP}}}")
    recording = record(true, folder / "a.csv")
    guess = write(folder / "guess", "lab", {**SEA, "damping": 0.03}, references=f"{{equilibrium_position: {CHIRP}}}")
    result = identify(guess, [recording], free=["joint_1.damping", "joint_1.spring_stiffness"])
    place = folder / "result"
    place.mkdir()
    write_json(place / FIT, fit_data(result))
    write_curves_of(result, place)
    return result, place


def test_a_fit_is_read_back_as_it_was(fitted):
    result, place = fitted
    found = read_fit(place)
    assert (found.fits, found.status) == (result.fits, result.status) == (True, "complete")
    assert found.estimates == result.estimates
    (channel,) = found.curves
    assert channel.residuals == pytest.approx(
        result.channels[0].lines["after"] - result.channels[0].lines["recorded"], abs=1e-6
    )
    assert np.diag(found.correlations) == pytest.approx([1.0, 1.0])
    assert abs(found.correlations[0, 1]) < 1.0


def test_profiles_of_a_smooth_model_are_parabolas(fitted):
    for profile in read_fit(fitted[1]).profiles:
        assert profile.rise == pytest.approx([9.0, 4.0, 1.0, 0.0, 1.0, 4.0, 9.0], abs=0.15)
        assert (np.diff(profile.values) > 0.0).all()


def test_the_spectrum_of_white_noise_has_its_variance(fitted):
    """Parseval: the integral of the power spectral density is the mean square; the recording's noise is 1 mrad."""
    (channel,) = read_fit(fitted[1]).curves
    power = np.sum(channel.density**2) * (channel.frequency[1] - channel.frequency[0])
    assert power == pytest.approx(1e-6, rel=0.25)


def test_a_long_channel_is_thinned_without_losing_its_extremes(fitted):
    one = fitted[0].channels[0]
    time = np.arange(60_000) * 1e-3
    values = np.sin(time)
    values[31_234] = 5.0
    long = type(one)(**{**vars(one), "lines": {"time": time, "recorded": values, "after": np.zeros(60_000)}})
    path = fitted[1] / "long.json"
    write_curves(path, [channel_curves(long, 60.0)])
    (found,) = curves_of(json.loads(path.read_text()))
    assert len(found.time) <= 2000
    assert found.lines["recorded"].max() == 5.0
    assert found.time[np.argmax(found.lines["recorded"])] == pytest.approx(31.234, abs=0.06)
    assert len(channel_charts(found)) == 2
    diverged = type(one)(**{**vars(one), "lines": {"time": time, "recorded": values}})
    write_curves(path, [channel_curves(diverged, 60.0)])
    assert len(curves_of(json.loads(path.read_text()))[0].frequency) == 0


@pytest.mark.parametrize("damage", ['{"status": 3}', "[]", "{", '{"keys": []}'])
def test_a_damaged_fit_is_refused_by_name(fitted, tmp_path, damage):
    (tmp_path / FIT).write_text(damage)
    with pytest.raises(InputError, match=r"fit\.json"):
        read_fit(tmp_path)
    with pytest.raises(InputError, match=r"fit\.json"):
        read_fit(tmp_path / "nowhere")
    (tmp_path / FIT).write_text((fitted[1] / FIT).read_text())
    (tmp_path / CURVES).write_text(damage)
    with pytest.raises(InputError, match=CURVES):
        read_fit(tmp_path)
