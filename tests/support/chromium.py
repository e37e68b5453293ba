"""Debian's Chromium, driven by Playwright, and what tests do with a page of `asrsim view`."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from support.browser import CHROMIUM

FLAGS = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-vsync",
    "--disable-extensions", "--disable-background-networking", "--disable-lcd-text",
)  # fmt: skip
"""Flags for machines without a graphics card and for users without a sandbox."""
SLOWLY = """{
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => setTimeout(() => next(draw), 150);
}"""
"""Without a graphics card, each picture takes the time of a core: the page draws a few in a second."""
KNOWN = ("Unable to preventDefault inside passive event listener",)
"""Messages of viser's own client while a user drags."""


@contextmanager
def open_page():
    """Function (address, width) that opens a page; skips the test where Chromium or Playwright is missing."""
    library = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    if CHROMIUM is None:
        pytest.skip("needs Chromium (apt-get install chromium), or ASRSIM_CHROMIUM=PATH")
    with library.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)

        # Few pixels and one page: without a graphics card each of them takes time.
        page = PageOfView(browser.new_page(device_scale_factor=0.2))

        def make(address, *, width=1000, height=450):
            return page.opened(address, width, height)

        yield make
        browser.close()


class PageOfView:
    """A page of `asrsim view` in the browser."""

    def __init__(self, page):
        self.page, self.errors = page, []
        page.set_default_timeout(120_000)
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.add_init_script(SLOWLY)

    def opened(self, address, width, height):
        """This page, at an address in a window of a size in pixels."""
        size = {"width": width, "height": height}
        if self.page.viewport_size != size:
            self.page.set_viewport_size(size)
        if self.page.url.rstrip("/") != address:
            self.errors.clear()
            self.page.goto(address)
            # viser notes that WebGL runs in software, above the controls of a small window.
            self.page.add_style_tag(content=".mantine-Notifications-root { display: none }")
        return self

    def _hear(self, message):
        if message.type == "error" and not message.text.startswith(KNOWN):
            self.errors.append(message.text)

    def has(self, text):
        return self.page.get_by_text(text).count() > 0

    def count(self, selector):
        return self.page.locator(selector).count()

    def tab(self, name):
        self.page.get_by_role("tab", name=name, exact=True).click()

    def click(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()

    def _row(self, label):
        return self.page.get_by_text(label, exact=True).first.locator("xpath=ancestor::div[2]")

    def number(self, label, value):
        field = self._row(label).locator("input[type=text], input[inputmode]").first
        # Key by key, as a person types.
        field.press("Control+a")
        field.press_sequentially(str(value), delay=30)
        field.press("Enter")

    def check(self, label):
        self._row(label).locator("input").first.click()

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
    def dragging(self, start, way):
        """Hold the mouse after a drag from a place in the window by a way, pixels."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for share in np.linspace(0.1, 1.0, 10):
            mouse.move(start[0] + share * way[0], start[1] + share * way[1])
        yield
        mouse.up()
