"""Real time of `asrsim view`: lateness, CPU time and pictures of a live run, and what part of it the browser has.

    python benchmarks/view.py examples/scenarios/step_2dof.yaml --variant soft --seconds 10
    python benchmarks/view.py examples/scenarios/step_2dof.yaml --variant soft --client none reader still drawn

The clients, in turns: none; a reader of all messages in this process; Chromium with the page open, which draws nothing
(`still`) or draws all (`drawn`, by the processor where there is no graphics card). Chromium needs Playwright. The lateness
means something on a quiet machine only.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import asrsim

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

CLIENTS = ("none", "reader", "still", "drawn")
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
STILL = "window.requestAnimationFrame = () => 0"


def main() -> None:
    """Print the numbers of one run for each client."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--variant")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--client", nargs="+", choices=CLIENTS, default=["reader"])
    given = parser.parse_args()
    with TemporaryDirectory() as out, asrsim.view(given.scenario, variant=given.variant, out=out) as view:
        while view.show.session is None or view.show.session.time < 1.0:
            if view.error is not None:
                raise view.error
            time.sleep(0.1)
        for client in given.client:
            sizes: list[int] = []
            with opened(view.address, client, sizes):
                measure(view, client, sizes, given.seconds)


def measure(view: Any, client: str, sizes: list[int], seconds: float) -> None:
    """Print the numbers of some seconds."""
    session, page = view.show.session, view.show.session.operator._page
    draws: list[float] = []
    page.draw = lambda *drawn, **options: (draws.append(time.perf_counter()), type(page).draw(page, *drawn, **options))
    late, before, wall, cpu = [], session.time, time.perf_counter(), time.process_time()
    while time.perf_counter() - wall < seconds:
        late.append(session.pace.late)
        time.sleep(0.005)
    simulated, wall, cpu = session.time - before, time.perf_counter() - wall, time.process_time() - cpu
    del page.draw
    late.sort()
    print(f"client                      {client}")
    print(f"load of the machine         {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"simulated per wall-clock    {simulated / wall:.3f}")
    print(f"CPU per simulated second    {cpu / simulated:.3f} s")
    print(f"behind: median, 99 %        {1e3 * late[len(late) // 2]:.1f} ms, {1e3 * late[int(0.99 * len(late))]:.1f} ms")
    print(f"pictures a second           {len(draws) / wall:.1f}")
    if sizes:
        print(f"sent to the client          {sum(sizes) / wall / 1e6:.2f} MB/s")


@contextmanager
def opened(address: str, client: str, sizes: list[int]) -> Iterator[None]:
    """Have the page open in a client."""
    if client in ("none", "reader"):
        if client == "reader":
            threading.Thread(target=read, args=(address, sizes), daemon=True).start()
        yield
        return
    from playwright.sync_api import sync_playwright

    from support.browser import CHROMIUM

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(200_000)
        page.goto(address)
        page.get_by_text("behind").first.wait_for(state="attached")
        if client == "still":
            page.evaluate(STILL)
        yield
        browser.close()


def read(address: str, sizes: list[int]) -> None:
    """Read all that the page sends."""
    with (
        suppress(ConnectionClosed),
        connect(address.replace("http", "ws"), origin=address, subprotocols=["viser-v1.1.1"], max_size=None) as client,
    ):
        sizes.extend(map(len, client))


if __name__ == "__main__":
    main()
