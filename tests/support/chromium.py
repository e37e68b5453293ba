"""Debian's Chromium, driven by Playwright, and what tests do with a page of `asrsim view`."""

from __future__ import annotations

import os
from contextlib import contextmanager

import numpy as np
import pytest

from support.browser import CHROMIUM

FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Flags for machines without a graphics card and for users without a sandbox."""
KNOWN = ("Unable to preventDefault inside passive event listener",)
"""Messages of viser's own client while a user drags."""


@contextmanager
def open_page():
    """Function (address, width) that opens a page; skips the test where Chromium or Playwright is missing."""
    library = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    path = os.environ.get("ASRSIM_CHROMIUM") or CHROMIUM
    if path is None:
        pytest.skip("needs Chromium (apt-get install chromium), or ASRSIM_CHROMIUM=PATH")
    with library.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        pages = []

        def make(address, *, width=1000, height=450):
            for old in pages:
                old.close()
            # Few pixels: without a graphics card each of them takes time.
            pages[:] = [browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=0.2)]
            return PageOfView(pages[0], address)

        yield make
        browser.close()


class PageOfView:
    """A page of `asrsim view` in the browser."""

    def __init__(self, page, address):
        self.page, self.errors = page, []
        page.set_default_timeout(120_000)
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(address)
        # viser notes that WebGL runs in software, above the controls of a small window.
        page.add_style_tag(content=".mantine-Notifications-root { display: none }")

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
        field.press_sequentially(str(value), delay=100)
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
        boxes = [canvas.bounding_box() for canvas in self.page.locator("canvas").all()]
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
