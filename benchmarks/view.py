"""Real time of `asrsim view`: lateness, CPU time and pictures of a live run with a client that reads all.

    python benchmarks/view.py examples/scenarios/step_2dof.yaml --variant soft --seconds 10

CPU time includes that of the client. The lateness means something on a quiet machine only.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from contextlib import suppress
from tempfile import TemporaryDirectory

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import asrsim


def main() -> None:
    """Print the numbers of one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--variant")
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    with TemporaryDirectory() as out, asrsim.view(given.scenario, variant=given.variant, out=out) as view:
        while view.show.session is None or view.show.session.time < 1.0:
            if view.error is not None:
                raise view.error
            time.sleep(0.1)
        sizes: list[int] = []
        threading.Thread(target=read, args=(view.address, sizes), daemon=True).start()
        session, page = view.show.session, view.show.session.operator._page
        draws: list[float] = []
        draw = page.draw
        page.draw = lambda *drawn, **options: (draws.append(time.perf_counter()), draw(*drawn, **options))
        late, before, wall, cpu = [], session.time, time.perf_counter(), time.process_time()
        while time.perf_counter() - wall < given.seconds:
            late.append(session.pace.late)
            time.sleep(0.005)
        simulated, wall, cpu = session.time - before, time.perf_counter() - wall, time.process_time() - cpu
    late.sort()
    print(f"load of the machine         {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"simulated per wall-clock    {simulated / wall:.3f}")
    print(f"CPU per simulated second    {cpu / simulated:.3f} s")
    print(f"behind: median, 99 %        {1e3 * late[len(late) // 2]:.1f} ms, {1e3 * late[int(0.99 * len(late))]:.1f} ms")
    print(f"pictures a second           {len(draws) / wall:.1f}")
    print(f"sent to the client          {sum(sizes) / wall / 1e6:.2f} MB/s")


def read(address: str, sizes: list[int]) -> None:
    """Read all that the page sends."""
    with (
        suppress(ConnectionClosed),
        connect(address.replace("http", "ws"), origin=address, subprotocols=["viser-v1.1.1"], max_size=None) as client,
    ):
        sizes.extend(map(len, client))


if __name__ == "__main__":
    main()
