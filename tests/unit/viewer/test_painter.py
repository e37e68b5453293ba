"""Pictures of a page come at the page's rate, whatever makes the page late."""

import time
from threading import Lock

from asrsim.viewer.painter import Painter


def test_a_page_that_is_made_slowly_does_not_slow_its_pictures():
    lock, drawn = Lock(), []
    with lock:
        painter = Painter(lambda: drawn.append(time.perf_counter()), lock)
        painter.__enter__()
        # Meshes are read.
        time.sleep(0.4)
    ready = time.perf_counter()
    end = ready + 30.0
    while len(drawn) < 3 and time.perf_counter() < end:
        time.sleep(0.01)
    painter.__exit__()
    # Before, the next picture was as late as the page had been.
    assert drawn[2] - drawn[0] < 0.35


def test_a_picture_that_waits_for_a_core_does_not_slow_the_next_ones():
    drawn = []

    def draw():
        drawn.append(time.perf_counter())
        time.sleep(0.03)

    with Painter(draw, Lock()):
        time.sleep(1.0)
    # 33 ms a picture; half of them if the wait counted as work.
    assert len(drawn) > 20
