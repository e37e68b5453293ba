"""The controls of `asrsim view` stay where they are while the run goes on."""

import time

import pytest

import asrsim
from support.chromium import open_page
from support.paths import EXAMPLES


@pytest.mark.slow
def test_news_do_not_move_the_buttons(tmp_path):
    with (
        open_page() as browser,
        asrsim.view(EXAMPLES / "scenarios" / "step_2dof.yaml", variant="soft", out=tmp_path / "run") as view,
    ):
        page = browser(view.address)
        button = page.page.get_by_role("button", name="Pause", exact=True)
        button.wait_for()
        page.page.get_by_text("behind").first.wait_for()
        place = button.bounding_box()["y"]
        desk = view.show.session.operator
        for news in ("one line", "a text that takes a second line since it is long " * 4, ""):
            desk._news = news
            time.sleep(1.0)
            assert button.bounding_box()["y"] == place
