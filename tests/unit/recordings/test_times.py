"""Times of recordings."""

import numpy as np
import pytest

from asrsim.recordings import read_recording

TICKS = 1250 * np.arange(60)
"""Times in microseconds."""


@pytest.mark.parametrize(("unit", "digits"), [("s", 6), ("ms", 3), ("us", 0), ("min", None)])
@pytest.mark.parametrize("zero", [0, 1_700_000_000_123_457])
def test_a_time_keeps_its_microseconds_in_every_unit(tmp_path, unit, digits, zero):
    if digits is None:
        times = [f"{(zero + tick) / 60e6:.17g}" for tick in TICKS]
    else:
        times = ["{}.{:0{}d}".format(*divmod(zero + tick, 10**digits), digits) for tick in TICKS]
    rows = [f"{time},{k % 7}" for k, time in enumerate(times)]
    (tmp_path / "lab.csv").write_text("\n".join([f"time [{unit}],q1", *rows]) + "\n")
    recording = read_recording(tmp_path / "lab.csv")
    np.testing.assert_allclose(recording.time, 1e-6 * TICKS, atol=1e-9 if digits is not None or not zero else 4e-6)


@pytest.mark.parametrize(("unit", "factor", "full"), [("s", 1.0, 86400.0), ("ms", 1e-3, 2.0**16), ("us", 1e-6, 2.0**32)])
def test_a_clock_that_restarts_goes_on(tmp_path, unit, factor, full):
    """A clock that passes midnight, and counters of 16 and 32 bits."""
    step = 0.01 / factor
    ticks = full - 10.5 * step + step * np.arange(60)
    rows = [f"{tick % full:.6f},{0.01 * k:.2f}" for k, tick in enumerate(ticks)]
    (tmp_path / "lab.csv").write_text("\n".join([f"time [{unit}],q1", *rows]) + "\n")
    recording = read_recording(tmp_path / "lab.csv")
    np.testing.assert_allclose(np.diff(recording.time), 0.01, atol=1e-6)
    (said,) = (one for one in recording.findings if one.code == "restarted-clock")
    assert f"restarts 1 time after {full:g} {unit}," in said.message
    assert recording.doubts == (), "nothing is lost, so verdicts do not repeat the note"


@pytest.mark.parametrize("unit", ["s", "ms", "us"])
def test_a_clock_that_counts_from_the_start_of_a_computer_keeps_its_zero(tmp_path, unit):
    """Only dates, seconds since 1970, are counted from the first sample."""
    scale = {"s": 1.0, "ms": 1e3, "us": 1e6}[unit]
    rows = [
        f"{scale * (5000.0 + 0.01 * k):.0f},{k % 7}" if unit != "s" else f"{5000.0 + 0.01 * k:.2f},{k % 7}" for k in range(60)
    ]
    (tmp_path / "lab.csv").write_text("\n".join([f"time [{unit}],q1", *rows]) + "\n")
    np.testing.assert_allclose(
        read_recording(tmp_path / "lab.csv").channels["q1"].time, 5000.0 + 0.01 * np.arange(60), atol=1e-9
    )
