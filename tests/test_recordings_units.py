"""Units: every factor worked out anew from its definition, and the spellings that are only nearly alike."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import pytest

from asrsim.recordings.cells import stamp_ns
from asrsim.recordings.columns import _joint
from asrsim.recordings.units import UNITS, find_unit, split_header

pytestmark = pytest.mark.once

TURN, POUND, OUNCE, FOOT, WEIGHT = math.tau, 4.4482216152605, 4.4482216152605 / 16, 0.3048, 9.80665
"""rad; N; N; m; N of a kilogram."""
FACTORS = {
    "rad": {"rad": 1, "mrad": 1e-3, "urad": 1e-6, "deg": TURN / 360, "°": TURN / 360, "Grad": TURN / 360, "mdeg": TURN / 360e3,
            "arcmin": TURN / 21600, "arcsec": TURN / 1296e3, "gon": TURN / 400, "rev": TURN, "turns": TURN},
    "rad/s": {"rad/s": 1, "rad_per_sec": 1, "mrad/s": 1e-3, "deg/s": TURN / 360, "dps": TURN / 360, "rpm": TURN / 60,
              "1/min": TURN / 60, "rps": TURN, "rev/s": TURN},
    "rad/s^2": {"rad/s^2": 1, "deg/s2": TURN / 360},
    "N m": {"Nm": 1, "N*m": 1, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "cNm": 1e-2, "kNm": 1e3, "lbft": POUND * FOOT,
            "in-lb": POUND * FOOT / 12, "oz-in": OUNCE * FOOT / 12, "kgcm": WEIGHT / 100},
    "N m/rad": {"Nm/rad": 1, "mNm/rad": 1e-3, "Nm/deg": 360 / TURN, "Nm/°": 360 / TURN},
    "N": {"N": 1, "kN": 1e3, "mN": 1e-3},
    "m": {"m": 1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": FOOT / 12},
    "m/s": {"m/s": 1, "cm/s": 1e-2, "mm/s": 1e-3},
    "N/m": {"N/m": 1, "kN/m": 1e3, "N/mm": 1e3},
    "m/s^2": {"m/s2": 1},
    "s": {"s": 1, "cs": 1e-2, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60, "h": 3600, "days": 86400},
    "A": {"A": 1, "mA": 1e-3},
    "V": {"V": 1, "mV": 1e-3},
    "J": {"J": 1}, "W": {"W": 1}, "Hz": {"Hz": 1, "kHz": 1e3}, "degC": {"°C": 1},
    "1": {"1": 1, "-": 1, "%": 1e-2, "percent": 1e-2},
    "counts": {"counts": 1, "ticks": 1, "raw": 1},
}  # fmt: skip
ALIKE = {
    "NM": "Nm", "nm": "Nm", "HZ": "Hz", "hz": "Hz", "RAD": "rad", "Deg": "deg", "[deg]": "deg", "( N m )": "Nm", "{ms}": "ms",
    "MS": "ms", "Rad/S": "rad/s", "N·m": "Nm", "N\u22c5m": "N*m", "rad s\u207b\u00b9": "rad/s", "\u00ba/sec": "°/s",
    "deg/s\u00b2": "deg/s^2", "Degrees": "deg", "SECONDS": "s",
}  # fmt: skip


def test_every_factor_is_that_of_the_definition() -> None:
    wanted = {spelling: (si, factor) for si, spellings in FACTORS.items() for spelling, factor in spellings.items()}
    for spelling, (si, factor) in wanted.items():
        found = find_unit(spelling)
        assert found is not None
        assert found.si == si
        assert found.factor == pytest.approx(factor, rel=1e-8)
    # Whatever else is understood is another spelling of one of these.
    known = {(si, f"{factor:.6g}") for si, factor in wanted.values()}
    assert {(unit.si, f"{unit.factor:.6g}") for unit in UNITS.values()} <= known


@pytest.mark.parametrize("text", ALIKE)
def test_spellings_that_differ_in_case_and_signs(text: str) -> None:
    found, other = find_unit(text), UNITS[ALIKE[text]]
    assert found is not None
    assert (found.si, found.factor) == (other.si, other.factor)


@pytest.mark.parametrize("text", ["", "x", "a", "M", "S", "k", "joint", "v", "n", "radiant"])
def test_what_is_no_unit_or_another_one_is_not_taken_for_one(text: str) -> None:
    found = find_unit(text)
    assert found is None or text == found.symbol


@pytest.mark.parametrize("form", ["{d}.{m}.{y:02d} 10:11:12", "{d:02d}.{m:02d}.{y:02d} 10:11:12"])
def test_years_of_two_digits_are_of_this_century(form):
    """Every one of them, the day first, beside days that are as large or larger."""
    for year in range(100):
        for day, month in ((1, 2), (12, 11), (31, 12)):
            text = form.format(d=day, m=month, y=year)
            assert stamp_ns(text) == int(datetime(2000 + year, month, day, 10, 11, 12, tzinfo=UTC).timestamp()) * 10**9, text


@pytest.mark.parametrize(
    ("known", "number", "zero", "joint"),
    [
        (["left_arm_2", "left_arm_1", "left_wrist_7"], 7, False, "left_wrist_7"),
        (["left_arm_2", "left_arm_1", "left_wrist_7"], 1, False, "left_arm_1"),
        (["left_arm_2", "left_arm_1", "left_wrist_7"], 3, False, "left_wrist_7"),
        (["left_arm_2", "left_arm_1", "left_wrist_7"], 4, False, None),
        (["the_arm_joint_1", "the_arm_joint_2"], 1, True, "the_arm_joint_2"),
        (["the_arm_joint_0", "the_arm_joint_1"], 1, True, "the_arm_joint_1"),
        (["shoulder", "elbow"], 1, True, "elbow"),
        (["shoulder", "elbow"], 1, False, "shoulder"),
        (["shoulder", "elbow"], 0, False, None),
        (["shoulder", "elbow"], None, False, None),
        (["shoulder"], None, False, "shoulder"),
        ([], 3, False, "joint_3"),
        ([], None, False, "joint_1"),
    ],
)
def test_a_number_is_of_the_joint_that_ends_with_it_else_of_the_place(known, number, zero, joint):
    assert _joint(number, known, [], zero=zero) == joint


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("q_deg_1", "q 1", "deg"), ("shoulderDeg", "shoulder", "deg"), ("velDegPerSec1", "vel 1", "deg/s"),
        ("dq_deg_per_sec_1", "dq 1", "deg/s"), ("speedDegS1", "speed 1", "deg/s"), ("vel_mrad_s_2", "vel 2", "mrad/s"),
    ],
)  # fmt: skip
def test_a_unit_among_words_has_its_rate(header: str, name: str, unit: str) -> None:
    rest, found = split_header(header)
    assert found is not None
    words = " ".join(rest.replace("_", " ").split())
    assert (words, found.si, found.factor) == (name, UNITS[unit].si, UNITS[unit].factor)
