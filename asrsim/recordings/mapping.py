"""The mapping from columns to joint quantities, given on the command line or in a small YAML beside the file."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asrsim.errors import Problem, RecordingError, did_you_mean
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.units import Unit, find_unit, parse_unit

ALIASES: dict[str, str] = {
    "position": "link_position", "velocity": "link_velocity", "effort": "link_torque", "torque": "link_torque",
    "reference": "reference_1", "stiffness_preset": "reference_2", "motor_position": "motor_1_position",
    "motor_velocity": "motor_1_velocity", "motor_torque": "motor_1_torque", "elastic_torque": "elastic_torque_1",
    "tau": "link_torque", "tau_ext": "external_torque", "preset": "reference_2", "motor_1": "motor_1_position",
    "motor_2": "motor_2_position",
}  # fmt: skip
"""Short names that a mapping may use besides the quantities' own."""
IGNORE = ("ignore", "none", "-")
ZEROS = ("start", "mean")
"""What may be taken away from a column: its first number, or its mean."""
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SHIFT = re.compile(rf"\s+(?P<sign>[-+])\s*(?:(?P<number>{_NUMBER})|(?P<word>start|mean))$")
_FACTOR = re.compile(rf"(-?{_NUMBER})\s*\*\s*")


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """What one column is."""

    column: str
    """Its header, or its number counted from 1."""
    role: str
    """`quantity`, `time`, `ignore`, or `window`, which is about all columns."""
    joint: str | None = None
    quantity: str | None = None
    unit: Unit | None = None
    """Replaces the unit in the header."""
    scale: float = 1.0
    """Factor on the numbers beside the unit, such as -1 for a reversed axis."""
    offset: float = 0.0
    """Added after scaling, in SI units."""
    zero: str = ""
    """`start` or `mean`: what is taken away after scaling, of the column's own numbers."""
    unwrapped: bool = False
    """An angle goes on where it jumps by a whole turn."""
    window: tuple[float, float] = (-math.inf, math.inf)
    """s on the recording's clock: what is kept."""
    origin: str = "command line"

    @property
    def text(self) -> str:
        """The same as an item of `--map`."""
        if self.role == "window":
            return "window=" + "..".join("" if math.isinf(end) else f"{end:.12g}" for end in self.window)
        unit = f" [{self.unit.symbol}]" if self.unit is not None else ""
        if self.role != "quantity":
            return f"{self.column}={self.role}{unit}"
        unit += " unwrapped" if self.unwrapped else ""
        factor = "" if self.scale == 1.0 else "-" if self.scale == -1.0 else f"{self.scale:.12g}*"
        shift = (
            f" - {self.zero}"
            if self.zero
            else f" {'+' if self.offset > 0 else '-'} {abs(self.offset):.12g}"
            if self.offset
            else ""
        )
        return f"{self.column}={factor}{self.joint}.{self.quantity}{unit}{shift}"


def parse_mapping(text: str, *, origin: str = "command line") -> ColumnMap:
    """One item of `--map`: `COLUMN=JOINT.QUANTITY [unit]`, `COLUMN=time [ms]`, `COLUMN=ignore` or `window=2..12`.

    A minus before the joint turns the sign: `COLUMN=-JOINT.QUANTITY`; a factor stands there as well: `COLUMN=0.01*JOINT...`.
    An offset comes last, in SI: `... [deg] - 0.02`, or `- start`, `- mean` of the column's own numbers; before it `unwrapped`,
    for an angle that jumps by whole turns. Raises RecordingError.
    """
    column, equals, target = text.rpartition("=")
    if not equals or not column.strip() or not target.strip():
        raise _error(text, "is not COLUMN=JOINT.QUANTITY", hint="For example --map 'q1=joint_1.link_position [deg]'")
    if column.strip() == "window" and ".." in target:
        return _window(target.split(".."), origin=origin)
    return _target(column.strip(), target.strip(), origin=origin)


def load_mapping(path: Path) -> tuple[ColumnMap, ...]:
    """A mapping file: `columns:` (or the top level) from column to `JOINT.QUANTITY [unit]` or to a table with the keys
    joint, quantity, unit, scale, offset, unwrapped; `time:` a column's name; `window: [start, end]`.

    Raises RecordingError with all problems.
    """
    import yaml

    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RecordingError(f"cannot be read as YAML: {error}", file=path, code="map-file") from None
    if not isinstance(data, Mapping):
        raise RecordingError("a mapping file is a table from column to JOINT.QUANTITY", file=path, code="map-file")
    return _from_table(data, path)


def find_mapping(path: Path) -> Path | None:
    """The mapping file beside a recording: `lab.csv.yaml`, `lab.map.yaml` (or .yml), or None."""
    for name in (f"{path.name}.yaml", f"{path.name}.yml", f"{path.stem}.map.yaml", f"{path.stem}.map.yml"):
        candidate = path.with_name(name)
        if candidate.is_file():
            return candidate
    return None


def resolve_mapping(mapping: Mapping[str, str] | Sequence[str] | Path | None, path: Path) -> tuple[ColumnMap, ...]:
    """All given maps; None looks for a file beside the recording. Command-line items add to that file and win over it."""
    if isinstance(mapping, Path):
        return load_mapping(mapping)
    if isinstance(mapping, str):
        mapping = [mapping]
    beside = find_mapping(path)
    maps = list(load_mapping(beside)) if beside is not None else []
    items = mapping.items() if isinstance(mapping, Mapping) else ()
    texts = [] if mapping is None or items else list(mapping)
    problems: list[Problem] = []
    given: list[ColumnMap] = []
    for item in [*items, *texts]:
        try:
            if isinstance(item, str) and is_file(item):
                given += load_mapping(Path(item))
            else:
                given.append(parse_mapping(item if isinstance(item, str) else "=".join(item)))
        except RecordingError as error:
            problems += error.problems
    if problems:
        raise RecordingError(problems)
    # One time only: the one that was said wins over the file's.
    taken = {one.column for one in given} | ({one.column for one in maps if one.role == "time"} if _times(given) else set())
    return (*given, *(one for one in maps if one.column not in taken))


def is_file(item: str) -> bool:
    """Whether an item of `--map` is the path of a mapping file."""
    return Path(item).suffix.lower() in (".yaml", ".yml") and Path(item).is_file()


def _times(maps: Sequence[ColumnMap]) -> bool:
    return any(one.role == "time" for one in maps)


def _window(ends: Sequence[Any], *, origin: str) -> ColumnMap:
    """The part of the recording that is kept; a blank end is the recording's own."""
    try:
        start, end = (float(text) if str(text).strip() else sign * math.inf for text, sign in zip(ends, (-1, 1), strict=True))
    except ValueError:
        start, end = math.nan, math.nan
    if not start < end:
        raise _error("window", f"must be START..END in s, is {'..'.join(str(text) for text in ends)}")
    return ColumnMap(column="window", role="window", window=(start, end), origin=origin)


def _from_table(data: Mapping[Any, Any], path: Path) -> tuple[ColumnMap, ...]:
    problems: list[Problem] = []
    maps: list[ColumnMap] = []
    columns = data.get("columns", {key: value for key, value in data.items() if key not in ("time", "window")})
    if not isinstance(columns, Mapping):
        raise RecordingError("must be a table", file=path, key="columns", code="map-file")
    entries = list(columns.items())
    time = data.get("time")
    if isinstance(time, Mapping):
        entries.append((time.get("column"), f"time [{time['unit']}]" if time.get("unit") else "time"))
    elif time is not None:
        entries.append((time, "time"))
    if isinstance(window := data.get("window"), list):
        entries.append(("window", window))
    for column, target in entries:
        try:
            if column == "window" and isinstance(target, list):
                maps.append(_window(["" if end is None else end for end in target], origin="map file"))
            elif isinstance(target, Mapping):
                maps.append(_from_entry(str(column), target))
            else:
                maps.append(_target(str(column), "ignore" if target is None else str(target), origin="map file"))
        except RecordingError as error:
            problems += [
                Problem(p.message, file=path, key=p.key, value=p.value, choices=p.choices, hint=p.hint, code=p.code)
                for p in error.problems
            ]
    if problems:
        raise RecordingError(problems)
    return tuple(maps)


def _from_entry(column: str, entry: Mapping[str, Any]) -> ColumnMap:
    known = ("joint", "quantity", "unit", "scale", "offset", "unwrapped")
    for key in entry:
        if key not in known:
            raise _error(f"{column}.{key}", "is not a key of a column", choices=known, hint=did_you_mean(str(key), known))
    numbers = {}
    for key, default in (("scale", 1.0), ("offset", 0.0)):
        value = entry.get(key, default)
        if key == "offset" and value in ZEROS:
            value = 0.0
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _error(f"{column}.{key}", f"must be a number, is {value!r}")
        numbers[key] = float(value)
    base = _target(column, f"{entry.get('joint')}.{entry.get('quantity')}", origin="map file")
    unit = parse_unit(str(entry["unit"])) if entry.get("unit") else None
    return ColumnMap(
        column=column, role=base.role, joint=base.joint, quantity=base.quantity, unit=unit, origin="map file",
        scale=numbers["scale"], offset=numbers["offset"], zero=str(entry["offset"]) if entry.get("offset") in ZEROS else "",
        unwrapped=entry.get("unwrapped") is True,
    )  # fmt: skip


def _target(column: str, text: str, *, origin: str) -> ColumnMap:
    offset, zero = 0.0, ""
    if (match := _SHIFT.search(text)) is not None:
        text = text[: match.start()]
        zero = match["word"] or ""
        offset = float(f"{match['sign']}{match['number']}") if match["number"] else 0.0
        if zero and match["sign"] == "+":
            raise _error(column, f"'+ {zero}' is no offset", hint=f"A column's own {zero} is taken away: - {zero}")
    unwrapped = text.endswith(" unwrapped")
    text = text.removesuffix(" unwrapped").rstrip()
    unit = None
    if text.endswith("]") and "[" in text:
        text, _, symbol = text[:-1].rpartition("[")
        text = text.strip()
        unit = parse_unit(symbol)
    if text.lower() in IGNORE:
        return ColumnMap(column=column, role="ignore", origin=origin)
    if text.lower() == "time":
        if unit is not None and unit.si != "s":
            raise _error(column, f"time cannot be in {unit.symbol}", choices=("s", "ms", "us", "ns"))
        return ColumnMap(column=column, role="time", unit=unit, origin=origin)
    # A minus turns the axis: of a deflection counted the other way, or of a motor that is mounted the other way round.
    scale = -1.0 if text.startswith("-") else 1.0
    if (factor := _FACTOR.match(text)) is not None:
        scale, text = float(factor[1]), text[factor.end() :]
    joint, dot, name = text.removeprefix("-").strip().rpartition(".")
    if not dot or not joint:
        hint = f"Did you mean {text}.link_position?" if find_unit(text) is None else None
        raise _error(column, f"'{text}' is not JOINT.QUANTITY", hint=hint)
    known = {**QUANTITIES, **DERIVED}
    quantity = ALIASES.get(name, name)
    if quantity not in known:
        choices = (*known, *ALIASES)
        raise _error(column, f"no quantity is called '{name}'", choices=choices, hint=did_you_mean(name, choices))
    return ColumnMap(column=column, role="quantity", joint=joint, quantity=quantity, unit=unit, scale=scale, offset=offset,
                     zero=zero, unwrapped=unwrapped, origin=origin)  # fmt: skip


def _error(key: str, message: str, *, choices: tuple[str, ...] = (), hint: str | None = None) -> RecordingError:
    return RecordingError(message, key=key, choices=choices, hint=hint, code="bad-mapping")
