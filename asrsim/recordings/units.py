"""Units of columns. Finds unit symbols in headers, with their SI units and conversion factors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from asrsim.errors import RecordingError, did_you_mean
from asrsim.quantities import PRISMATIC_UNITS


@dataclass(frozen=True)
class Unit:
    """Symbol of a unit, its SI unit, and the factor from this unit to the SI unit."""

    symbol: str
    si: str
    factor: float


_TABLE = """
rad        1.0                   rad rads radian radians
rad        0.001                 mrad
rad        0.017453292519943295  deg degs degree degrees ° Grad
rad        0.015707963267948967  gon gons gradian gradians
rad        1.7453292519943296e-05  mdeg
rad        6.283185307179586     rev revs turn turns
rad/s      1.0                   rad/s
rad/s      0.001                 mrad/s
rad/s      0.017453292519943295  deg/s dps °/s Grad/s
rad/s      0.015707963267948967  gon/s
rad/s      0.10471975511965977   rpm rev/min 1/min
rad/s      6.283185307179586     rev/s rps turns/s
rad/s^2    1.0                   rad/s^2 rad/s2
N m        1.0                   Nm
N m        0.001                 mNm Nmm
N m        0.01                  Ncm
N m        1.3558179483          lbft lbfft ftlb ftlbf
N m        0.112984829           lbin lbfin inlb inlbf
N m        0.00706155183         ozin ozfin
N m        0.0980665             kgcm kgfcm
N m/rad    1.0                   Nm/rad
N m/rad    57.29577951308232     Nm/deg Nm/°
N/m        1.0                   N/m
N/m        1000.0                kN/m N/mm
N          1.0                   N newton
N          1000.0                kN
m          1.0                   m metre meter metres meters
m          0.01                  cm
m          0.001                 mm
m          1e-06                 um µm
m/s        1.0                   m/s
m/s        0.001                 mm/s
m/s^2      1.0                   m/s^2 m/s2
s          1.0                   s sec secs second seconds
s          0.001                 ms msec msecs millis millisecond milliseconds
s          1e-06                 us µs usec usecs micros microsecond microseconds
s          1e-09                 ns nsec nsecs nanos nanosec nanosecond nanoseconds
s          60.0                  min minutes
s          3600.0                h hours
s          86400.0               days
A          1.0                   A amp
A          0.001                 mA
V          1.0                   V volt volts
V          0.001                 mV
W          1.0                   W
Hz         1.0                   Hz 1/s s^-1
Hz         1000.0                kHz
°C         1.0                   °C degC
1          1.0                   1 -
1          0.01                  % percent
counts     1.0                   counts count ticks pulses increments inc lsb adc raw
"""
"""Each row contains an SI unit, the factor to this unit, and spellings; two blanks or more separate them. Spellings are
compared without blanks. Upper and lower case are distinguished only if two units differ by case. Counts of a converter have no
SI unit until the user states the size of a count.
"""
UNITS = {
    spelling: Unit(spelling, si, float(factor))
    for si, factor, spellings in (re.split("  +", row) for row in _TABLE.strip().splitlines())
    for spelling in spellings.split()
}
"""Units, by each known spelling."""
_LOWER = {spelling.lower(): unit for spelling, unit in reversed(UNITS.items()) if len(spelling) > 2 or spelling[:1].islower()}
_LOWER |= {"nm": UNITS["Nm"], "hz": UNITS["Hz"]}
_UNSURE = {"grad": ("deg", "gon"), "grads": ("deg", "gon"), "grad/s": ("deg/s", "gon/s")}
"""Units that an ambiguous spelling may mean. In German, Grad means degrees; in other languages, grad is 1/400 of a turn."""
_LETTERS = {letter.lower() for letter in UNITS if len(letter) == 1 and letter.isalpha()}
_GAP, _WORD = r"(?:[_\s]in)?[_\s]+", r"[^_\s]+"
_BRACKETS = re.compile(r".*[^\s_\[\](){}<>][_\s]*[\[(<{](?P<unit>[^\[\](){}<>]*[^\W\d_][^\[\](){}<>]*)[\])>}]\s*")
"""Pattern of a header that ends with a text in brackets."""
_NAME, _ANOTHER = rf"(?P<name>.*?[^_\s]){_GAP}", rf"[_\s]+{_WORD}"
"""_NAME: pattern of a name, with the gap before its unit.
_ANOTHER: pattern of a further word of the unit.
"""
_HEADERS = tuple(
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        # q1 [deg], but not q[1]
        r"(?P<name>.*[^_\s])[_\s]*[\[(<{](?P<unit>(?!\s*\d+\s*[\])>}])[^\[\](){}<>]+)[\])>}](?P<rest>.*)",
        r"[\[(<{](?P<unit>[^\[\](){}<>]+)[\])>}]\s*(?P<name>\S.*)",  # [deg] q1
        r"(?P<name>[^/]*[^\s/])[\s/]+(?P<unit>[^\s/]+/[^\s/]+)",  # dq rad/s
        rf"{_NAME}(?P<unit>[^\W\d_][^_\s/]*/[^_\s/]+)",  # dq_rad/s
        r"(?P<name>[^/]*[^\s/])\s*/\s*(?P<unit>[^\s/]+)",  # t / ms
        rf"{_NAME}(?P<unit>{_WORD}{_ANOTHER}{_ANOTHER})",  # dq_deg_per_s
        rf"{_NAME}(?P<unit>{_WORD}{_ANOTHER})",  # dq_rad_s
        rf"{_NAME}(?P<unit>(?!min$)[^_\s()\[\]]{{2,}}|[°º])",  # q1_deg, but not q_min or q [1]
        # The m of position_m is a unit. The m of pos_m or theta_m may mean motor.
        rf"(?P<name>(?:.*[_\s./])?(?:position|angle|velocity|reference|deflection|force|torque|voltage|current)\d*){_GAP}(?P<unit>[mNAV])",
        # cmd_A and tau_des_N, but not cmd_m, whose m may mean motor
        rf"(?P<name>(?:.*[_\s./])?(?:ref|cmd|command|des|desired|target|setpoint|goal)\d*){_GAP}(?P<unit>[NAV])",
        rf"(?P<name>(?:.*[_\s./])?(?:t|time)\d*){_GAP}(?P<unit>s|h|min)",  # time_s, t in min
        r"(?P<name>.+)_(?P<unit>m?deg|mrad|rad|rpm)(?P<rest>_?\d+|\[\d+\])",  # q_deg_1, q_deg[0]
    )
)
"""Patterns of headers with a name, a unit, and sometimes the rest of the name. The first pattern that gives a known unit is
used.
"""
_RATE = re.compile(r".*[_\s](?!(?:t|time|timestamp|stamp|clock|elapsed|delay)\d*$)[^\W\d_]+", re.IGNORECASE)
"""Pattern of several words, of which the last word is no word for a time."""


def find_unit(text: str) -> Unit | None:
    """Unit with this spelling; None if it is unknown."""
    plain = text.strip().strip("[](){}<>").replace(" ", "")
    for sign, usual in (("º", "°"), ("μ", "µ"), ("²", "^2")):
        plain = plain.replace(sign, usual)
    plain = re.sub(r"(?:_|/)?per(?!cent)_?|_(?=s(?:ec)?$)|_(?=rad$)", "/", plain)  # rad_s, rad_per_s
    plain = re.sub(r"(?<=/)sec(?:ond)?s?$", "s", plain)
    # Torques are written with any sign between force and length: newton-metre, N·m, lbf-ft. The m of tau_m_Nm means motor.
    joined = re.sub("(?<=[A-Za-z])(?<!^m)[-.*·⋅_](?=[A-Za-z])", "", plain)
    for written in (plain, joined):
        unit = UNITS.get(written) or (None if written.lower() in _LETTERS else _in_lower_case(written))
        if unit is not None and (written == plain or unit.si.startswith("N m")):
            return unit
    return None


def _in_lower_case(text: str) -> Unit | None:
    """Unit with this spelling in lower case. None if the spelling begins with M (mega) but only the unit with m (milli) is
    known, or if the spelling may mean two units.
    """
    unit = _LOWER.get(text.lower())
    mega = unit is not None and text[0] == "M" and unit.symbol[0] == "m" and unit.symbol[1:] in UNITS and unit.si != "s"
    return None if mega or text.lower() in _UNSURE else unit


def unsure_units(text: str) -> tuple[str, ...]:
    """Units that an ambiguous text, such as `grad`, may mean. text: a unit, or a header with a unit. Empty if the unit is
    unambiguous.
    """
    known = find_unit(text) is not None or split_header(text)[1] is not None
    words = () if known else re.findall(r"[^\W\d_]+(?:/s)?", text.lower())
    return next((_UNSURE[word] for word in words if word in _UNSURE), ())


def parse_unit(text: str) -> Unit:
    """Unit with this spelling. If it is unknown, raises RecordingError with a list of the known units."""
    unit = find_unit(text)
    if unit is None:
        if choices := unsure_units(text):
            raise RecordingError("may mean several units", value=text, choices=choices, code="unknown-unit")
        hint = did_you_mean(text, tuple(UNITS)) or f"Known: {', '.join(UNITS)}"
        raise RecordingError("is not a known unit", value=text, hint=hint, code="unknown-unit")
    return unit


@lru_cache(maxsize=8192)
def split_header(header: str) -> tuple[str, Unit | None]:
    """Name and unit in a header such as `q1 [deg]`, `pos (rad)`, `q1_deg` or `t / ms`. The unit is None if the header states no
    unit.
    """
    text = header.strip(' "')
    for pattern in _HEADERS:
        found = pattern.fullmatch(text)
        # Words with a blank between them are separate symbols, so the unit of `theta m deg` is not mdeg.
        unit = find_unit(re.sub(r"(?<=\w)\s+(?=\w)", "_", found["unit"])) if found else None
        # Both parts of `v [km/h]` have half of a bracket: the h is not its unit.
        if found and unit is not None and _closed(found["name"]) and not _is_rate(text, found["name"], unit):
            return found["name"] + (found.groupdict().get("rest") or ""), unit
    return text, None


def _closed(name: str) -> bool:
    """Whether a name has as many opening as closing brackets."""
    return all(name.count(opening) == name.count(closing) for opening, closing in ("[]", "()", "{}"))


def _is_rate(header: str, name: str, unit: Unit) -> bool:
    """Whether a unit of time behind a slash is the lower part of an unknown unit: `v_km/h` is not v_km in hours."""
    return unit.si == "s" and re.match(r"\s*/", header[len(name) :]) is not None and _RATE.fullmatch(name) is not None


def unread_unit(header: str) -> str:
    """Text in brackets at the end of a header that is probably an unknown unit, such as `cNm`; "" otherwise."""
    found = _BRACKETS.fullmatch(header.strip(' "'))
    return found["unit"].strip() if found is not None and split_header(header)[1] is None else ""


def fits(unit: str, quantity_unit: str) -> bool:
    """Whether a column's SI unit fits a quantity. It fits if it is the quantity's unit for a revolute or a prismatic joint, or
    if the column has no unit.
    """
    if quantity_unit == "":
        return unit in ("", "1", "V", "A", *PRISMATIC_UNITS, *PRISMATIC_UNITS.values())
    return unit in ("", quantity_unit) or PRISMATIC_UNITS.get(quantity_unit) == unit
