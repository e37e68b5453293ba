"""Debian's Chromium, driven by Playwright, and what tests do with a page of `asrsim view`."""

from __future__ import annotations

import time
from contextlib import contextmanager

import numpy as np
import pytest

from support.browser import CHROMIUM

FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-vsync",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-lcd-text",
)
"""Flags for machines without a graphics card and for users without a sandbox."""
SLOWLY = """{
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => setTimeout(() => next(draw), 150);
}"""
"""Without a graphics card, each picture takes the time of a core: the page draws a few in a second."""
UNCOVERED = """control => {
  control.scrollIntoView({ block: "nearest" });
  const box = control.getBoundingClientRect();
  return control.contains(document.elementFromPoint(box.x + 0.5 * box.width, box.y + 0.5 * box.height));
}"""
"""Whether a press on the middle of a control reaches it."""
KNOWN = ("Unable to preventDefault inside passive event listener",)
"""Messages of viser's own client while a user drags."""
PATIENCE = 300.0
"""Longest time for which a fact is awaited, s. On a busy machine without a graphics card, a picture may take a second, and the
first ones half a minute."""
SHORTLY = 10.0
"""Time after which an action that had no effect yet is repeated, s."""


@contextmanager
def open_page():
    """Function (view, width, height) that opens a page; skips the test where Chromium or Playwright is missing."""
    library = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    if CHROMIUM is None:
        pytest.skip("needs Chromium (apt-get install chromium), or ASRSIM_CHROMIUM=PATH")
    with library.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)

        # Few pixels and one page: without a graphics card each of them takes time.
        page = PageOfView(browser.new_page(device_scale_factor=0.2))

        def make(view, *, width=1000, height=450, lit=False):
            return page.opened(view, width, height, lit)

        yield make
        browser.close()


def until(fact, patience=PATIENCE):
    """Wait until a fact holds, and return it."""
    end = time.monotonic() + patience
    while not (found := fact()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)
    return found


class PageOfView:
    """A page of `asrsim view` in the browser.

    No action waits for animation frames, as Playwright does by itself until a control "is stable": where other processes take
    the machine's cores, frames fail to come for a minute, and a click would fail that a person can make.
    """

    def __init__(self, page):
        self.page, self.errors, self._size = page, [], None
        page.set_default_timeout(1e3 * PATIENCE)
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.add_init_script(SLOWLY)

    def opened(self, view, width, height, lit):
        """This page, at the address of a view in a window of a size in pixels. lit: with the light of viser's environment,
        whose preparation takes ten seconds of a core without a graphics card."""
        size = {"width": width, "height": height}
        if self.page.url.rstrip("/") != view.address or self._size != size or lit:
            if not lit:
                view.server.viser.scene.configure_environment_map(None)
            self._size = size
            self.page.set_viewport_size(size)
            self.errors.clear()
            self.page.goto(view.address)
            # viser notes that WebGL runs in software, above the controls of a small window.
            self.page.add_style_tag(content=".mantine-Notifications-root { display: none }")
            self._settle()
        return self

    def _settle(self):
        """Wait until the page has its controls: while they come, a press may be lost."""
        before = None
        while (now := self.count("button, input, canvas")) == 0 or now != before:
            before = now
            time.sleep(1.0)

    def _hear(self, message):
        if message.type == "error" and not message.text.startswith(KNOWN):
            self.errors.append(message.text)

    def has(self, text):
        return self.page.get_by_text(text).count() > 0

    def count(self, selector):
        return self.page.locator(selector).count()

    def tab(self, name):
        """Open a tab; a press before the page listens is repeated."""
        tab = self.page.get_by_role("tab", name=name, exact=True)
        end = time.monotonic() + PATIENCE
        self._press(tab)
        while tab.get_attribute("aria-selected") != "true":
            assert time.monotonic() < end, f"the tab {name} does not open"
            time.sleep(0.5)
            self._press(tab)

    def click(self, name):
        self._press(self.page.get_by_role("button", name=name, exact=True))

    def check(self, label):
        self._press(self._row(label).locator("input").first)

    def _press(self, control):
        """Press the mouse on a control that is seen and that nothing covers."""
        control.wait_for()
        until(lambda: control.evaluate(UNCOVERED))
        control.click(force=True)

    def _row(self, label):
        return self.page.get_by_text(label, exact=True).first.locator("xpath=ancestor::div[2]")

    def number(self, label, value):
        field = self._row(label).locator("input[type=text], input[inputmode]").first

        def typed():
            # Key by key, as a person types.
            field.press("Control+a")
            field.press_sequentially(str(value), delay=30)
            return field.input_value() == str(value)

        until(typed)
        field.press("Enter")

    def place(self, view, point):
        """Place in the browser's window of a point (3,) in the world, m."""
        (client,) = view.server.viser.get_clients().values()
        forward = client.camera.look_at - client.camera.position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, client.camera.up_direction)
        right /= np.linalg.norm(right)
        x, y, depth = np.array([right, np.cross(right, forward), forward]) @ (np.asarray(point) - client.camera.position)
        boxes = [box for canvas in self.page.locator("canvas").all() if (box := canvas.bounding_box()) is not None]
        box = max(boxes, key=lambda one: one["width"] * one["height"])
        scale = 0.5 * box["height"] / np.tan(0.5 * client.camera.fov) / depth
        return box["x"] + 0.5 * box["width"] + scale * x, box["y"] + 0.5 * box["height"] - scale * y

    @contextmanager
    def dragging(self, view, point, way, held):
        """Hold the mouse after a drag from a point (3,) in the world, m, by a way (2,), pixels. held: function that says
        whether the drag has an effect. A page that shows an earlier picture has the body elsewhere: the drag is repeated."""
        mouse = self.page.mouse
        end = time.monotonic() + PATIENCE
        while True:
            start = self.place(view, point)
            mouse.move(*start)
            mouse.down()
            for share in np.linspace(0.1, 1.0, 10):
                mouse.move(start[0] + share * way[0], start[1] + share * way[1])
            shortly = time.monotonic() + SHORTLY
            while not held() and time.monotonic() < shortly:
                time.sleep(0.05)
            if held():
                break
            mouse.up()
            assert time.monotonic() < end, "the drag has no effect"
        yield
        mouse.up()
