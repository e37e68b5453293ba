"""Values that no user means: refused at the boundary with a message, or taken as they are; never an internal error."""

from __future__ import annotations

from pathlib import Path

import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.recordings import read_recording
from asrsim.sweeps.fitted import joint_of
from support.paths import ROOT

SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


def test_more_draws_than_a_study_may_have_are_refused() -> None:
    with pytest.raises(InputError, match="must be 1 to"):
        asrsim.sweep(SCENARIO, {"link_1.mass": "uniform(0.3, 0.5)"}, variants=["soft"], samples=10**23)


@pytest.mark.parametrize(
    ("fit", "message"),
    [
        ({"keys": 5, "mean": [1.0], "covariance": [[1.0]]}, "keys is not a list"),
        ({"keys": [], "mean": [], "covariance": []}, "0 keys need"),
    ],
)
def test_a_fit_names_its_keys_in_a_list(fit: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        joint_of(fit)


@pytest.mark.parametrize("side", ["commands", "sensors"])
def test_rates_of_commands_and_sensors_have_an_upper_bound(side: str) -> None:
    with pytest.raises(InputError, match=r"rate.*1e\+06"):
        asrsim.load_scenario(SCENARIO, variant="soft", overrides={"effects": {side: {"joint_1": {"rate": 2.5e11}}}})


def test_digits_that_are_no_decimal_numbers_are_letters_of_a_name(tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    path.write_text("time,q1,a_³,q²,theta³\n" + "".join(f"{0.1 * i},{i},{i},{i},{i}\n" for i in range(9)), encoding="utf-8")
    assert read_recording(path).column("joint_1", "link_position").values[-1] == 8.0


def test_names_of_users_are_no_formulas_in_pictures_of_fits_and_studies(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from asrsim.plots.output import save_figure, styled

    with styled(mathematics=False):
        figure = Figure()
        figure.subplots().set(xlabel=r"$\frac{x$", title="$^$")
        assert save_figure(figure, tmp_path, "names", ("png",))
