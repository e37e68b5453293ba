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
