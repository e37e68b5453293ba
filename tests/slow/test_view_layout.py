"""The controls of `asrsim view` stay where they are while the run goes on, and its plots show the time that they have."""

import time

import pytest

import asrsim
from support.chromium import open_page, until
from support.paths import EXAMPLES

SPANS = """Object.values(window.__viserTestpoints.uplots).map(({ chart: { scales: { x }, data: [time] } }) =>
  [x.min, x.max, time[0], time[time.length - 1]])"""
"""Shown and known interval of time of each plot."""


@pytest.mark.slow
def test_plots_show_all_of_the_time_after_a_reset(tmp_path):
    """The previous run joins the curves."""
    with (
        open_page() as browser,
        asrsim.view(EXAMPLES / "scenarios" / "step_2dof.yaml", variant="soft", out=tmp_path / "run") as view,
    ):
        page = browser(view)
        until(lambda: page.count(".uplot canvas") == 2)
        first = view.show.session
        page.click("Reset")
        until(lambda: view.show.session is not first and view.show.session.time > 2.0)
        page.click("Pause")
        time.sleep(1.0)
        for low, high, start, end in page.page.evaluate(SPANS):
            assert (low, high) == (start, end)


@pytest.mark.slow
def test_news_do_not_move_the_buttons(tmp_path):
    with (
        open_page() as browser,
        asrsim.view(EXAMPLES / "scenarios" / "step_2dof.yaml", variant="soft", out=tmp_path / "run") as view,
    ):
        page = browser(view)
        button = page.page.get_by_role("button", name="Pause", exact=True)
        button.wait_for()
        page.page.get_by_text("behind").first.wait_for()
        place = button.bounding_box()["y"]
        desk = view.show.session.operator
        for news in ("one line", "a text that takes a second line since it is long " * 4, ""):
            desk._news = news
            time.sleep(1.0)
            assert button.bounding_box()["y"] == place
