"""Figures by name, and a figure of a user's own: the recipe of the documentation."""

import numpy as np
import pytest

from asrsim.errors import InputError
from asrsim.plots import FIGURES, FigurePage, RunFigure
from asrsim.plots.figures import new_figure
from asrsim.plots.job import PlotJob, plot
from support.paths import ROOT
from support.plot_example import made_up_log


def test_the_figure_of_the_page_is_drawn(tiny, asrsim_command):
    page = (ROOT / "docs" / "plots.md").read_text(encoding="utf-8")
    code = page.partition("### A figure of your own")[2].partition("```python\n")[2].partition("```")[0]
    (tiny.folder / "my_figure.py").write_text(code)
    assert asrsim_command("run", tiny.scenario, "--set", "duration=0.2", "--out", "soft", "--no-plot", "-q").code == 0
    done = asrsim_command("plot", "soft", "--plugin", "my_figure.py", "--figure", "loops", "--out", "pictures")
    assert done.code == 0, done.err
    assert [path.name for path in (tiny.folder / "pictures").iterdir()] == ["loops.png"]


def test_a_figure_gets_the_curves_of_the_runs(tmp_path):
    seen = []

    def pages(runs):
        seen.extend(run.get("joint_1", "link_torque").values.max() for run in runs)
        yield FigurePage(name="mine", figure=new_figure(2.0, 2.0))

    FIGURES.add("mine", RunFigure(title="mine", pages=pages))
    logs = [made_up_log(tmp_path / f"{n}.mcap", values={"link_torque": np.full(1001, n)}) for n in (1.0, 3.0)]
    result = plot(PlotJob(logs=tuple(logs), folder=tmp_path / "drawn", figures=("mine", "joints")))
    assert seen == [1.0, 3.0]
    assert [path.name for path in result.files] == ["mine.png", "joints.png"]


@pytest.mark.parametrize(
    ("more", "said"),
    [({"figures": ("joint",)}, "no figure is called 'joint'"), ({"figures": ("joints",), "bode": True}, "show runs only")],
)
def test_an_unknown_figure_and_figures_of_comparisons_are_refused_before_anything_is_written(tmp_path, more, said):
    log = made_up_log(tmp_path / "log.mcap")
    with pytest.raises(InputError, match=said):
        plot(PlotJob(logs=(log,), folder=tmp_path / "drawn", **more))
    assert not (tmp_path / "drawn").exists()
