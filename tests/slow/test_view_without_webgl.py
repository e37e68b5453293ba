"""`asrsim view` in a browser that cannot draw three dimensions."""

import pytest

import asrsim
from support.browser import CHROMIUM
from support.paths import EXAMPLES


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("flag", ["--disable-3d-apis", "--disable-software-rasterizer"])
def test_the_page_says_in_words_that_webgl_is_missing(tmp_path, flag):
    library = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    scenario = EXAMPLES / "scenarios" / "step_2dof.yaml"
    with asrsim.view(scenario, variant="soft", out=tmp_path / "run") as view, library.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", flag])
        page = browser.new_page()
        # Without pictures the page is never done with loading.
        page.goto(view.address, wait_until="commit")
        page.get_by_text("WebGL is unavailable").wait_for(timeout=120_000)
        browser.close()
        # The run goes on.
        assert view.error is None
