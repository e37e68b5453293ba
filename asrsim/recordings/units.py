"""Units of columns: symbols found in headers, their SI unit and factor. Nothing is converted without being said."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from asrsim.errors import RecordingError, did_you_mean
from asrsim.quantities import PRISMATIC_UNITS


@dataclass(frozen=True)
class Unit:
    """A unit as written, what it is in SI, and the factor to it."""

    symbol: str
    si: str
    factor: float


_DEGREE = math.pi / 180
_TABLE: tuple[tuple[str, float, tuple[str, ...]], ...] = (
    # SI unit, factor, spellings (compared without spaces; case matters only where two units differ by it)
    ("rad", 1.0, ("rad", "rads", "radian", "radians", "弧度", "라디안", "ラジアン")),
    ("rad", 1e-3, ("mrad", "millirad", "millirads", "milliradian", "milliradians")),
    ("rad", 1e-6, ("urad", "µrad", "μrad")),
    ("rad", _DEGREE, ("deg", "degs", "degree", "degrees", "°", "Grad", "grado", "gradi", "grados", "degré", "degrés",
        "graden", "graus", "stopni", "stupňů", "度", "도")),
    ("rad", _DEGREE * 1e-3, ("mdeg", "millideg", "millidegree", "millidegrees")),
    ("rad", _DEGREE / 60, ("arcmin",)),
    ("rad", _DEGREE / 3600, ("arcsec",)),
    ("rad", math.pi / 200, ("gon",)),
    ("rad", 2 * math.pi, ("rev", "revs", "revolutions", "turn", "turns")),
    ("rad/s", 1.0, ("rad/s", "rad_s", "rad/sec", "rad_per_s", "rad_per_sec", "rad_per_second",
        "radps", "弧度/秒", "rad/秒", "rads-1", "rad*s-1", "rad.s-1")),
    ("rad/s", 1e-3, ("mrad/s", "mrad_s")),
    ("rad/s", _DEGREE, ("deg/s", "deg_s", "deg/sec", "deg_per_s", "deg_per_sec", "deg_per_second",
        "degps", "dps", "°/s", "度/秒", "Grad/s", "gradi/s")),
    ("rad/s", 2 * math.pi / 60, ("rpm", "rev/min", "r/min", "1/min", "U/min")),
    ("rad/s", 2 * math.pi, ("rev/s", "rps", "turn/s", "turns/s")),
    ("rad/s^2", 1.0, ("rad/s^2", "rad/s2", "rad_s2", "rad/s/s")),
    ("rad/s^2", _DEGREE, ("deg/s^2", "deg/s2", "deg_s2")),
    ("N m", 1.0, ("Nm", "N*m", "N.m", "N·m", "N_m", "newtonmetre", "newtonmeter", "newtonmetres", "newtonmeters",
        "牛米", "牛·米")),
    ("N m", 1e-3, ("mNm", "mN*m", "mN.m", "mN_m", "Nmm", "N*mm")),
    ("N m", 1e-2, ("Ncm", "cNm", "N*cm")),
    ("N m", 1e3, ("kNm",)),
    ("N m", 1.3558179483, ("lbft", "lbfft", "ftlb", "ftlbs", "ftlbf")),
    ("N m", 0.1129848290, ("lbin", "lbfin", "inlb", "inlbs", "inlbf")),
    ("N m", 7.06155183e-3, ("ozin", "ozfin", "inoz")),
    ("N m", 9.80665e-2, ("kgcm", "kgfcm")),
    ("N m/rad", 1.0, ("Nm/rad", "N*m/rad", "N.m/rad", "Nm_rad", "Nm_per_rad")),
    ("N m/rad", 1e-3, ("mNm/rad",)),
    ("N m/rad", 1 / _DEGREE, ("Nm/deg", "Nm/°", "Nm_per_deg")),
    ("N/m", 1.0, ("N/m", "N_per_m")),
    ("N/m", 1e3, ("kN/m", "N/mm")),
    ("N", 1.0, ("N", "newton", "newtons")),
    ("N", 1e3, ("kN",)),
    ("N", 1e-3, ("mN",)),
    ("m", 1.0, ("m", "metre", "meter", "metres", "meters")),
    ("m", 1e-2, ("cm", "centimetre", "centimeter", "centimetres", "centimeters")),
    ("m", 1e-3, ("mm", "millimetre", "millimeter", "millimetres", "millimeters")),
    ("m", 1e-6, ("um", "µm", "μm")),
    ("m", 0.0254, ("inch", "inches")),
    ("m/s", 1.0, ("m/s", "m_s", "m_per_s")),
    ("m/s", 1e-2, ("cm/s", "cm_s")),
    ("m/s", 1e-3, ("mm/s", "mm_s")),
    ("m/s^2", 1.0, ("m/s^2", "m/s2", "m_s2")),
    ("s", 1.0, ("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden", "seconde", "secondes",
        "secondi", "segundos", "秒", "초")),
    ("s", 1e-3, ("ms", "msec", "millis", "millisecond", "milliseconds", "millisekunden", "毫秒", "ミリ秒")),
    ("s", 1e-2, ("cs", "csec", "centiseconds")),
    ("s", 1e-6, ("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds")),
    ("s", 1e-9, ("ns", "nsec", "nanos", "nanosecond", "nanoseconds")),
    ("s", 60.0, ("min", "minutes")),
    ("s", 3600.0, ("h", "hr", "hrs", "hour", "hours")),
    ("s", 86400.0, ("day", "days")),
    ("A", 1.0, ("A", "amp", "amps", "ampere")),
    ("A", 1e-3, ("mA", "milliamp", "milliamps", "milliampere", "milliamperes")),
    ("V", 1.0, ("V", "volt", "volts")),
    ("V", 1e-3, ("mV", "millivolt", "millivolts")),
    ("J", 1.0, ("J", "joule", "joules")),
    ("W", 1.0, ("W", "watt", "watts")),
    ("Hz", 1.0, ("Hz",)),
    ("Hz", 1e3, ("kHz",)),
    ("degC", 1.0, ("°C", "degC", "celsius")),
    ("1", 1.0, ("1", "-")),
    ("1", 1e-2, ("%", "percent")),
    # What a converter or a drive counts in: no unit of any quantity until somebody says what one of them is.
    ("counts", 1.0, ("counts", "count", "cnt", "cnts", "ticks", "tick", "pulses", "increments", "incr", "inc", "qc", "lsb",
                     "digits", "adc", "raw")),
)  # fmt: skip
UNITS: dict[str, Unit] = {spelling: Unit(spelling, si, factor) for si, factor, spellings in _TABLE for spelling in spellings}
"""Every spelling that is understood."""
_LOWER: dict[str, Unit] = {}
for _spelling, _unit in UNITS.items():
    if len(_spelling) > 2 or _spelling in ("ms", "us", "ns", "cm", "mm", "nm", "hz"):
        _LOWER.setdefault(_spelling.lower(), _unit)
_LOWER["nm"] = UNITS["Nm"]
_LOWER["hz"] = UNITS["Hz"]

_SIGNS = (
    ("Â", ""),  # what UTF-8 read as Latin-1 puts before a degree sign
    ("²", "^2"),
    ("⁻¹", "^-1"),
    ("\u2212", "-"),
    ("º", "°"),
    ("˚", "°"),
    ("⋅", "*"),
    ("∙", "*"),
    ("•", "*"),
    ("\u00d7", "*"),
    ("·", "*"),
)
_WORDS = {"degree": "deg", "radian": "rad", "meter": "m", "metre": "m"}
# Last tokens that look like a unit but are part of the name: theta_m is a motor's angle, q_s no second.
_SYMBOLS = {"theta", "tau", "q", "dq", "qd", "torque", "omega", "phi", "i", "u", "v", "w", "k", "x", "y", "z"}
_CLOCKS = {"t", "time", "timestamp", "elapsed", "zeit", "temps", "tempo", "tiempo", "tijd", "duration"}
"""Words behind which `min`, `h` and `cs` are units."""
_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(<{]\s*(?P<unit>[^\[\](){}<>]*?)\s*[\])>}]\s*$")
_BRACKETED = re.compile(r"[\[(<{]\s*(?P<unit>[^\[\](){}<>]*?)\s*[\])>}]")
_COLON = re.compile(r"(?<=[\w\])])\s*[:,]\s*")
_DASH = re.compile(r"(?<=[\w\])])[-.]")
"""`q1: deg`, `Position, deg` and `q1-deg`: what may stand between a name and its unit without brackets."""
_SLASH = re.compile(r"^.*?\S(?P<sign>\s+(?:/|in)\s+)(?=\S)")
_TIGHT = re.compile(r"^(?:[^/\[(<{]|[\[(<{]\w*[\])>}])*(?<!\s)/(?=[^/]+(?:/s)?$)")
_PLACE = re.compile(r"(?P<array>.*\S)(?P<place>[\[(]\d+[\])])")
_SIGN = re.compile(r"(?P<name>.*[\w\])])(?P<unit>[°º˚](?:/s(?:ec)?)?)")
"""`q1°`."""
_SINGLE = re.compile("[A-Za-z]")
_AMONG = re.compile(
    r"(?:(?<![A-Za-z])|(?<=[a-z])(?=[A-Z]))"
    r"(?P<unit>(?i:degree)s?|(?i:m?deg)s?|(?i:mrad|rpm|mm|cm|m?nm|ncm))"
    r"(?P<rate>(?i:[_ /]+(?:per[_ ]?)?|per[_ ]?)(?i:s(?:ec(?:onds?)?)?)|S)?(?![a-z]|(?<=[A-Z])[A-Z])"
)
"""Units among the words of a name: `q_deg_1`, `q1deg`, `shoulderDeg`, `velDegPerSec1`."""


def find_unit(text: str) -> Unit | None:
    """The unit of that spelling, or None."""
    plain = text.strip().strip("[](){}<>").replace(" ", "")
    for written in (plain, _ordinary(plain)):
        if (unit := UNITS.get(written) or _LOWER.get(written.lower())) is not None:
            return unit
    # lbf-ft, ozf.in, newton-metres: a force times a length, however it is joined.
    joined = _LOWER.get(re.sub(r"[-.*·⋅∙•\u00d7]", "", plain).lower())
    return joined if joined is not None and joined.si == "N m" else None


def _several(text: str) -> Unit | None:
    """A number of units: `250us`, `0.1 deg`, `1e-3 rad`, `1/100 s`."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?(?:e-?\d+)?)(?:/(\d+))?\s*([^\d\s/].*)", text)
    unit = find_unit(match[3]) if match else None
    if match is None or unit is None or (match[2] is not None and not int(match[2])):
        return None
    return Unit(text.strip(), unit.si, float(match[1]) / float(match[2] or 1) * unit.factor)


def _ordinary(text: str) -> str:
    """Spellings that differ in their signs only: `N-m`, `N⋅m`, `rad s⁻¹`, `º/sec`, `deg.`, as `N*m`, `rad/s`, `°/s`, `deg`."""
    for old, new in _SIGNS:
        text = text.replace(old, new)
    text = re.sub(r"[*.]?(?:s\^?-1|(?<=/)sec(?:ond)?s?)(?![a-z])", lambda m: "s" if m[0].startswith("sec") else "/s", text)
    text = re.sub(r"[*.]?rad\^?-1", "/rad", text)
    text = re.sub(r"^([kmc]?)N[-*.]?([mc]?m)(?![a-z])", r"\1N\2", text)
    text = re.sub(r"(?<=[a-z])\.(?=/|$)", "", text)
    return text if text in UNITS else re.sub(r"^(degree|radian|meter|metre)s?(?=/)", lambda m: _WORDS[m[1]], text)


def parse_unit(text: str) -> Unit:
    """The unit of that spelling; raises RecordingError naming the known ones."""
    unit = find_unit(text)
    if unit is None:
        raise RecordingError(
            "is not a unit that is known here",
            value=text,
            hint=did_you_mean(text, tuple(UNITS)) or f"Known: {', '.join(UNITS)}",
            code="unknown-unit",
        )
    return unit


def split_header(header: str) -> tuple[str, Unit | None]:
    """Name and unit of a header such as `q1 [deg]`, `pos (rad)`, `q1_deg`, `t / ms`; None where it states no unit."""
    text = header.strip().strip("\"'").strip()
    for inner in reversed([*_BRACKETED.finditer(text)]):
        last = inner.end() == len(text)
        name = " ".join(filter(None, (text[: inner.start()].strip(), text[inner.end() :].strip()))).rstrip("_")
        if inner["unit"].isdecimal() and not (last and text[inner.start() - 1].isspace()):
            continue  # q[1] is the second of an array, q [1] without dimension
        unit = find_unit(inner["unit"]) or _several(inner["unit"])
        if name and unit is not None and (last or not _SINGLE.fullmatch(unit.symbol)):
            return name, unit
    if (array := _PLACE.fullmatch(text)) is not None:
        name, unit = split_header(array["array"])  # q_deg[0]
        return (name + array["place"], unit) if unit is not None else (text, None)
    if (match := _SLASH.match(text)) and (unit := find_unit(text[match.end() :])) is not None:
        return text[: match.start("sign")], unit
    if (behind := _behind(text, _COLON)) is not None:
        return behind
    tokens = re.split(r"[_\s]+", text)
    for count in (3, 2, 1):
        if len(tokens) <= count:
            continue
        name, tail = "_".join(tokens[:-count]), "_".join(tokens[-count:])
        found = find_unit(tail)
        if found is None or found.si == "counts" or tail in ("1", "-") or tail[-1] in "])}>":
            continue
        if tail in ("min", "h", "cs") and re.split("[./]", tokens[-count - 1].lower())[-1] not in _CLOCKS:
            continue  # q_min is the least q, t_min a time in minutes
        if len(tail) == 1 and tail != "V" and re.sub(r"\d+$", "", tokens[-count - 1].lower()) in _SYMBOLS:
            continue
        return re.sub(r"(?<=.)[_\s]in$", "", name), found  # q_1_in_deg
    if (behind := _behind(text, _DASH)) is not None:
        return behind
    if (match := _TIGHT.match(text)) and (unit := find_unit(text[match.end() :])) is not None:
        return text[: match.end() - 1], unit
    if (match := _SIGN.fullmatch(text)) and (unit := find_unit(match["unit"])) is not None:
        return match["name"], unit
    if (among := _outside(text)) and (found := find_unit(among["unit"] + ("/s" if among["rate"] else ""))) is not None:
        rest = (text[: among.start()] + " " + text[among.end() :]).strip(" _-.")
        return (rest, found) if rest else (text, None)
    return text, None


def _outside(text: str) -> re.Match[str] | None:
    """A unit among the words of a name, outside of brackets: what is in them is a unit as a whole, or none."""
    return next((one for one in _AMONG.finditer(text) if not re.search(r"[\[(<{][^\])>}]*$", text[: one.start()])), None)


def _behind(text: str, sign: re.Pattern[str]) -> tuple[str, Unit] | None:
    """Name and unit without brackets behind one of these signs: not of `x.m`, `stamp.sec` or `q-1`."""
    foreign = ("counts", "1", "s") if sign is _DASH else ("counts", "1")
    for match in sign.finditer(text):
        unit = find_unit(text[match.end() :])
        if unit is not None and unit.si not in foreign and not _SINGLE.fullmatch(unit.symbol):
            return text[: match.start()], unit
    return None


def unknown_unit(header: str) -> str | None:
    """What a header states in brackets behind a name, if it looks like a unit and none of that spelling is known.

    In round brackets it may be a remark, `q1 (left)`: only what is short or has a slash is taken for a unit there.
    """
    text = header.strip().strip("\"'").strip()
    match = _BRACKETS.match(text)
    if match is None or not match["name"] or not match["unit"].strip() or find_unit(match["unit"]) is not None:
        return None
    if text.endswith(")") and len(match["unit"]) > 3 and "/" not in match["unit"]:
        return None
    return match["unit"] if re.fullmatch(r"[^\d\s]{1,8}([/ *][^\d\s]{1,4}(\^?-?\d)?)?", match["unit"].strip()) else None


def fits(unit: str, quantity_unit: str) -> bool:
    """Whether a column's SI unit can be a quantity's: equal, or its counterpart of a prismatic joint."""
    if quantity_unit == "":
        return unit in ("", "1", "V", "A", *PRISMATIC_UNITS, *PRISMATIC_UNITS.values())
    return unit in ("", quantity_unit) or PRISMATIC_UNITS.get(quantity_unit) == unit
