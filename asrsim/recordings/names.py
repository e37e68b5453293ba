"""Derives joint and quantity from the name of a column. Each name is read independently of all other columns."""

from __future__ import annotations

import re
from collections.abc import Sequence

from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.data import RawColumn
from asrsim.recordings.units import Unit, fits, split_header

KNOWN = {name: one for name, one in (QUANTITIES | DERIVED).items() if not name.startswith("sent_")}
"""All quantities that a column may contain, by name. A recorded reference is a command as it was sent."""
ALIASES: dict[str, str] = {
    "position": "link_position", "velocity": "link_velocity", "effort": "link_torque", "torque": "link_torque",
    "reference": "reference_1", "stiffness_preset": "reference_2", "motor_position": "motor_1_position",
    "motor_velocity": "motor_1_velocity", "motor_torque": "motor_1_torque", "elastic_torque": "elastic_torque_1",
    "tau": "link_torque", "tau_ext": "external_torque", "preset": "reference_2", "motor_1": "motor_1_position",
    "motor_2": "motor_2_position",
}  # fmt: skip
"""Full name of a quantity for each short name; both names are valid in mappings and in columns called `joint.quantity`."""
_WORDS = {
    word: meant
    for meant, words in {
        "position": "q qpos pos positions angle angles", "velocity": "dq qdot qvel vel velocities speed",
        "torque": "tau torques effort efforts", "motor": "hub mot hubangle", "deflection": "defl", "external": "ext",
        "elastic": "el spring", "equilibrium": "eq",
        "reference": "references ref cmd command commanded des desired target setpoint qref qdes qcmd",
        "current": "currents cur curr amps", "voltage": "voltages volt volts",
        "": "joint joints axis link measured meas actual data value values angular state states",
        "?": "eff moment th qd phi rate rpm enc encoder rotation omega load trq",
    }.items()
    for word in words.split()
}  # fmt: skip
"""Word in `_QUANTITIES` for each spelling in a column's name; "" for words without effect on the meaning, as in `q1_meas`; "?"
for words that suggest a quantity of a joint, but may mean something else."""
_COMMANDS = {"position": "rad", "torque": "N m", "force": "N", "current": "A", "voltage": "V"}
"""Unit of a command by the word that states its kind."""
_QUANTITIES = {
    " ".join(sorted(words.split())): quantity
    for quantity, spellings in {
        "link_position": "position", "link_velocity": "velocity", "link_torque": "torque,force", "stiffness": "stiffness",
        "deflection": "deflection,tip deflection", "motor_1_position": "motor position", "motor_1_velocity": "motor velocity",
        "motor_1_torque": "motor torque", "elastic_torque_1": "elastic torque", "external_torque": "external torque",
        "position_error": "error position", "reference_2": "preset,stiffness preset",
        "equilibrium_position": "equilibrium,equilibrium position,equilibrium theta",
        "reference_1": ",".join(f"{whose} reference {kind}" for whose in ("", "motor") for kind in ("", *_COMMANDS)),
    }.items()
    for words in spellings.split(",")
}  # fmt: skip
"""Quantity for the sorted words of a column's name."""
_LETTERS = {"i", "id", "iq", "u", "v"}
"""Symbols that mean a current, a voltage, a velocity or any input in the name of a command."""
_DOUBTFUL = {"?", "theta", "position", "velocity", "torque", "force", "deflection", "stiffness"}
"""Words of an ambiguous name about which the user is asked."""


class DoubtError(Exception):
    """The meaning of a column is ambiguous, and the user is asked; the message is the reason."""


def tokens_of(name: str) -> list[str]:
    """Lower-case words and numbers of a name: `hub1_refPos` gives hub, 1, ref, pos."""
    text = re.sub(r"(?<![A-Za-z])dQ(?![a-z])", "dq", name)
    return [found.lower() for found in re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text))]


def _words(tokens: Sequence[str]) -> list[str]:
    """Words of a name in the spelling of `_QUANTITIES`, without words that have no effect on the meaning."""
    return [word for token in tokens if (word := _WORDS.get(token, token))]


def stated_unit(name: str) -> Unit | None:
    """Unit in the name of a column. A velocity in deg is read in deg/s."""
    unit = split_header(name)[1]
    if unit is not None and unit.si in ("rad", "m") and "velocity" in _words(tokens_of(name)):
        return Unit(f"{unit.symbol}/s", f"{unit.si}/s", unit.factor)
    return unit


def meaning_of(name: str, unit: Unit | None, joints: Sequence[str] | None) -> tuple[str | None, str | None]:
    """Joint and quantity of a column, by its name and unit alone; no quantity if the name means none. Raises DoubtError.

    joints: joints of the simulation; None: the name states the joint.
    """
    plain = split_header(name)[0]
    head, dot, last = plain.strip("./ ").rpartition(".")
    if dot and ALIASES.get(last, last) in KNOWN and (last in KNOWN or not _commands(re.split(r"[./]", head))):
        return _joint_called(head, joints), _fitting(ALIASES.get(last, last), unit)
    joint, rest = find_joint(plain, joints or ())
    *above, tail = [part for part in re.split(r"[./]", rest) if {*tokens_of(part)} - {"data"}] or [""]
    array = re.search(r"[\[(](\d+)[\])]$", tail)
    tokens = tokens_of(tail[: array.start()] if array else tail)
    numbers = [int(word) for word in tokens if word.isdecimal()]
    words = [word for word in _words(tokens) if not word.isdecimal()]
    if words and "reference" not in words and _commands(above):
        words.append("reference")  # for example knee.command.effort, desired.positions
    named = words == ["motor"] or (not words and (joint or {"joint", "axis"} & {*tokens}))
    if named and unit is not None and unit.si == "rad":
        words.append("position")  # for example hub1_rad, Joint 1 [deg], elbow [deg]
    exact = "_".join(tokens)
    quantity = exact if exact in KNOWN else _QUANTITIES.get(" ".join(sorted(words)))
    # Other characters (q', q*, a dot above) are ambiguous.
    if quantity is None or re.search(r"[^\w\s./,:#()[\]-]", rest) or (words == ["force"] and (unit is None or unit.si != "N")):
        doubtful = named or _DOUBTFUL & {*_words(tokens_of(rest))} or (unit is not None and unit.si in ("rad", "rad/s", "N m"))
        if doubtful and "reference" not in words:
            raise DoubtError("its name may or may not be a quantity of a joint")
        if "reference" in words and {"?", "theta", *_LETTERS} & {*words}:
            raise DoubtError("its name means a command, but it may be a position, a torque, a velocity, a current or a voltage")
        return joint, None
    quantity = _fitting(quantity, unit)
    if quantity == "reference_1" and unit is not None:
        _require_kind(name, unit)
    owner = above[-1] if above else ""
    count = len(numbers) + (array is not None)
    unclear = bool(numbers) and exact in KNOWN
    if unclear and (joint or len(joints or ()) == 1):  # for example reference_1, motor_1_torque
        return joint or (joints or [""])[0], exact
    if count > (joint is None) or unclear or (count and re.search(r"\d|left|right|^field$", owner.lower())):
        raise DoubtError("the number in its name is ambiguous")
    if joint is None and not count and _words(tokens_of(owner)):
        return _joint_called(owner, joints), quantity  # for example elbow/position, /joint_states/elbow/position
    if joint is None:
        place = int(array[1]) if array else next(iter(numbers), None)
        joint = joint_of(place, joints, indexed=array is not None)
    return joint, quantity


def within_joint(name: str) -> str:
    """Name of a number that the file gives to a joint: its last part, after `desired` for a command's part.

    `field.desired.positions` is a command, as the part above its last one says.
    """
    *above, last = re.split(r"[./]", name)
    return f"desired {last}" if _commands(above) else name


def _commands(parts: Sequence[str]) -> bool:
    """Whether parts of a path above a quantity say that the quantity is a command."""
    return any("reference" in _words(tokens_of(part)) for part in parts)


def command_unit(name: str) -> str:
    """SI unit of a command whose name states another kind than a position, such as "N m" for `knee_tau_des`; "" otherwise.

    The last part of a path counts first: `/effort_controller/joint_commands/position` is a position.
    """
    for part in reversed(re.split(r"[./]", split_header(name)[0])):
        words = {*_words(tokens_of(part))}
        for kind, unit in _COMMANDS.items():
            if kind in words:
                return "" if unit == "rad" else unit
    return ""


KINDS = {
    "rad": "position", "m": "position", "N m": "torque", "N": "torque", "A": "current", "V": "voltage", "rad/s": "velocity",
    "m/s": "velocity",
}  # fmt: skip
"""Kind of a command by its SI unit."""


def _require_kind(name: str, unit: Unit) -> None:
    """Raise DoubtError if the unit of a command is that of a velocity, or does not fit the kind that its name states."""
    kind, stated = KINDS.get(unit.si, ""), KINDS.get(command_unit(name), "")
    if kind == "velocity":
        raise DoubtError("it is a command of a velocity, which no operation mode takes")
    if kind and stated and kind != stated:
        raise DoubtError(f"its name means a command of a {stated}, but its unit is {unit.symbol}")


def _joint_called(name: str, joints: Sequence[str] | None) -> str:
    """Joint whose name precedes the quantity in a column's name."""
    return find_joint(name, joints or ())[0] or re.split("[./]", name)[-1]


def _fitting(quantity: str, unit: Unit | None) -> str:
    """Quantity, after checking that the unit fits the quantity. Raises DoubtError."""
    if unit is not None and not fits(unit.si, KNOWN[quantity].unit):
        raise DoubtError(f"its name means {quantity}, but its unit is {unit.symbol}")
    return quantity


def find_joint(name: str, joints: Sequence[str]) -> tuple[str | None, str]:
    """Joint whose name is part of the column's name, and the rest of the column's name."""
    for joint in sorted(joints, key=len, reverse=True):
        for spelling in (joint.lower(), joint.lower().replace("_", "")):
            match = re.search(rf"(?<![a-z0-9]){re.escape(spelling)}(?![0-9])", name.lower())
            if match and len(spelling) > 1:
                return joint, name[: match.start()] + " " + name[match.end() :]
    return None, name


def joint_of(number: int | None, joints: Sequence[str] | None, *, indexed: bool) -> str:
    """Joint with this number. indexed: joints are counted from 0, as in an array. Raises DoubtError if it is ambiguous."""
    if number is None:
        if joints is None or len(joints) == 1:
            return (joints or ["joint_1"])[0]
        raise DoubtError(f"its name does not state the joint: {', '.join(joints[:8])}")
    if joints is None:
        return f"joint_{number}"
    ends = [re.sub(r".*?(\d*)$", r"\1", joint) for joint in joints]
    counted = [str(i + 1) for i in range(len(joints))]
    if not indexed and ends.count(str(number)) == 1 and (sorted(ends) == counted or number == 0):
        return joints[ends.index(str(number))]
    place = number if indexed else number - 1
    if 0 <= place < len(joints) and (not any(ends) or indexed or ends == counted):
        return joints[place]
    raise DoubtError(f"the number {number} fits none of {', '.join(joints[:8])} for certain")


def find_raw(wanted: str, columns: Sequence[RawColumn]) -> int | None:
    """Index of a column by its header, with or without unit, or by its number in the file."""
    headers = [column.name for column in columns]
    numbers = [str(column.place or i) for i, column in enumerate(columns, start=1)]
    for names in (headers, [split_header(header)[0] for header in headers], numbers):
        if wanted in names:
            return names.index(wanted)
    return None
