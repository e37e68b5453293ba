"""Units of columns: each spelling against the definition of its unit."""

from math import pi

import pytest

from asrsim.recordings.units import UNITS, find_unit

INCH, POUND, KILOPOND = 0.0254, 0.45359237 * 9.80665, 9.80665
"""Inch in m; weight of a pound and of a kilogram in N: international yard and pound, standard gravity."""
DEFINED = {
    "rad": {"rad rads radian radians": 1, "mrad": 1e-3, "deg degs degree degrees ° Grad": pi / 180, "mdeg": pi / 180e3,
            "gon gons gradian gradians": pi / 200, "rev revs turn turns": 2 * pi},
    "rad/s": {"rad/s": 1, "mrad/s": 1e-3, "deg/s dps °/s Grad/s": pi / 180, "gon/s": pi / 200, "rpm rev/min 1/min": 2 * pi / 60,
              "rev/s rps turns/s": 2 * pi},
    "rad/s^2": {"rad/s^2 rad/s2": 1},
    "N m": {"Nm": 1, "mNm Nmm": 1e-3, "Ncm": 1e-2, "lbft lbfft ftlb ftlbf": 12 * INCH * POUND,
            "lbin lbfin inlb inlbf": INCH * POUND, "ozin ozfin": INCH * POUND / 16, "kgcm kgfcm": 0.01 * KILOPOND},
    "N m/rad": {"Nm/rad": 1, "Nm/deg Nm/°": 180 / pi},
    "N/m": {"N/m": 1, "kN/m N/mm": 1e3},
    "N": {"N newton": 1, "kN": 1e3},
    "m": {"m metre meter metres meters": 1, "cm": 1e-2, "mm": 1e-3, "um µm": 1e-6},
    "m/s": {"m/s": 1, "mm/s": 1e-3},
    "m/s^2": {"m/s^2 m/s2": 1},
    "s": {"s sec secs second seconds": 1, "ms msec msecs millis millisecond milliseconds": 1e-3,
          "us µs usec usecs micros microsecond microseconds": 1e-6, "ns nsec nsecs nanos nanosec nanosecond nanoseconds": 1e-9,
          "min minutes": 60, "h hours": 3600, "days": 86400},
    "A": {"A amp": 1, "mA": 1e-3},
    "V": {"V volt volts": 1, "mV": 1e-3},
    "W": {"W": 1},
    "Hz": {"Hz 1/s s^-1": 1, "kHz": 1e3},
    "°C": {"°C degC": 1},
    "1": {"1 -": 1, "% percent": 0.01},
    "counts": {"counts count ticks pulses increments inc lsb adc raw": 1},
}  # fmt: skip


def test_every_spelling_has_the_factor_of_its_definition():
    defined = {
        spelling: (si, pytest.approx(factor, rel=1e-8))
        for si, units in DEFINED.items()
        for spellings, factor in units.items()
        for spelling in spellings.split()
    }
    assert {spelling: (unit.si, unit.factor) for spelling, unit in UNITS.items()} == defined
    assert {spelling: find_unit(spelling) for spelling in UNITS} == UNITS
    assert find_unit("Percent") == UNITS["percent"]
