"""The mapping from columns to joint quantities, given on the command line or in a small YAML beside the file."""

from __future__ import annotations

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


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """What one column is."""

    column: str
    """Its header, or its number counted from 1."""
    role: str
    """`quantity`, `time` or `ignore`."""
    joint: str | None = None
    quantity: str | None = None
    unit: Unit | None = None
    """Replaces the unit in the header."""
    scale: float = 1.0
    """Factor on the numbers beside the unit, such as -1 for a reversed axis."""
    offset: float = 0.0
    """Added after scaling, in SI units."""
    origin: str = "command line"


def parse_mapping(text: str, *, origin: str = "command line") -> ColumnMap:
    """One item of `--map`: `COLUMN=JOINT.QUANTITY [unit]`, `COLUMN=time [ms]` or `COLUMN=ignore`; raises RecordingError.

    A minus before the joint turns the sign: `COLUMN=-JOINT.QUANTITY`.
    """
    column, equals, target = text.rpartition("=")
    if not equals or not column.strip() or not target.strip():
        raise _error(text, "is not COLUMN=JOINT.QUANTITY", hint="For example --map 'q1=joint_1.link_position [deg]'")
    return _target(column.strip(), target.strip(), origin=origin)


def load_mapping(path: Path) -> tuple[ColumnMap, ...]:
    """A mapping file: `columns:` (or the top level) from column to `JOINT.QUANTITY [unit]` or to a table with the keys
    joint, quantity, unit, scale, offset; `time:` a column's name. Raises RecordingError with all problems."""
    import yaml

    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RecordingError(Problem(message=f"cannot be read as YAML: {error}", file=path, code="map-file")) from None
    if not isinstance(data, Mapping):
        raise RecordingError(
            Problem(message="a mapping file is a table from column to JOINT.QUANTITY", file=path, code="map-file")
        )
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
    beside = find_mapping(path)
    maps = list(load_mapping(beside)) if beside is not None else []
    items = mapping.items() if isinstance(mapping, Mapping) else ()
    texts = [mapping] if isinstance(mapping, str) else ([] if mapping is None or items else list(mapping))
    problems: list[Problem] = []
    given: list[ColumnMap] = []
    for item in [*items, *texts]:
        try:
            given.append(parse_mapping(item) if isinstance(item, str) else _target(item[0], item[1], origin="command line"))
        except RecordingError as error:
            problems += error.problems
    if problems:
        raise RecordingError(problems)
    taken = {one.column for one in given}
    return (*given, *(one for one in maps if one.column not in taken))


def _from_table(data: Mapping[Any, Any], path: Path) -> tuple[ColumnMap, ...]:
    problems: list[Problem] = []
    maps: list[ColumnMap] = []
    columns = data.get("columns", {key: value for key, value in data.items() if key != "time"})
    if not isinstance(columns, Mapping):
        raise RecordingError(Problem(message="must be a table", file=path, key="columns", code="map-file"))
    entries = list(columns.items())
    time = data.get("time")
    if isinstance(time, Mapping):
        entries.append((time.get("column"), f"time [{time['unit']}]" if time.get("unit") else "time"))
    elif time is not None:
        entries.append((time, "time"))
    for column, target in entries:
        try:
            if isinstance(target, Mapping):
                maps.append(_from_entry(str(column), target))
            else:
                maps.append(_target(str(column), "ignore" if target is None else str(target), origin="map file"))
        except RecordingError as error:
            problems += [
                Problem(message=p.message, file=path, key=p.key, value=p.value, choices=p.choices, hint=p.hint, code=p.code)
                for p in error.problems
            ]
    if problems:
        raise RecordingError(problems)
    return tuple(maps)


def _from_entry(column: str, entry: Mapping[str, Any]) -> ColumnMap:
    known = ("joint", "quantity", "unit", "scale", "offset")
    for key in entry:
        if key not in known:
            raise _error(f"{column}.{key}", "is not a key of a column", choices=known, hint=did_you_mean(str(key), known))
    numbers = {}
    for key, default in (("scale", 1.0), ("offset", 0.0)):
        value = entry.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _error(f"{column}.{key}", f"must be a number, is {value!r}")
        numbers[key] = float(value)
    base = _target(column, f"{entry.get('joint')}.{entry.get('quantity')}", origin="map file")
    unit = parse_unit(str(entry["unit"])) if entry.get("unit") else None
    return ColumnMap(
        column=column, role=base.role, joint=base.joint, quantity=base.quantity, unit=unit, origin="map file",
        scale=numbers["scale"], offset=numbers["offset"],
    )  # fmt: skip


def _target(column: str, text: str, *, origin: str) -> ColumnMap:
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
    joint, dot, name = text.removeprefix("-").strip().rpartition(".")
    if not dot or not joint:
        hint = f"Did you mean {text}.link_position?" if find_unit(text) is None else None
        raise _error(column, f"'{text}' is not JOINT.QUANTITY", hint=hint)
    known = {**QUANTITIES, **DERIVED}
    quantity = ALIASES.get(name, name)
    if quantity not in known:
        choices = (*known, *ALIASES)
        raise _error(column, f"no quantity is called '{name}'", choices=choices, hint=did_you_mean(name, choices))
    return ColumnMap(column=column, role="quantity", joint=joint, quantity=quantity, unit=unit, scale=scale, origin=origin)


def _error(key: str, message: str, *, choices: tuple[str, ...] = (), hint: str | None = None) -> RecordingError:
    return RecordingError(Problem(message=message, key=key, choices=choices, hint=hint, code="bad-mapping"))
