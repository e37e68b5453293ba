"""Derives joint and quantity from the name of a column. Each name is interpreted independently of the other columns."""

from __future__ import annotations

import re
from collections.abc import Sequence

from asrsim.quantities import DERIVED, QUANTITIES, Quantity
from asrsim.recordings.commands import is_command, kind_of, unknown_words
from asrsim.recordings.data import RawColumn
from asrsim.recordings.owners import find_joint, joint_of
from asrsim.recordings.units import Unit, fits, split_header
from asrsim.recordings.words import BODIES, JOINTS, REFERENCE, CommandDoubtError, DoubtError, one_of, tokens_of, words_of

ALIASES: dict[str, str] = {
    "position": "link_position", "velocity": "link_velocity", "effort": "link_torque", "torque": "link_torque",
    "reference": "reference_1", "stiffness_preset": "reference_2", "motor_position": "motor_1_position",
    "motor_velocity": "motor_1_velocity", "motor_torque": "motor_1_torque", "elastic_torque": "elastic_torque_1",
    "tau": "link_torque", "tau_ext": "external_torque", "preset": "reference_2", "motor_1": "motor_1_position",
    "motor_2": "motor_2_position",
}  # fmt: skip
"""Full name of a quantity for each short name; both names are valid in mappings and in columns called `joint.quantity`."""
_QUANTITIES = {
    " ".join(sorted(words.split())): quantity
    for quantity, spellings in {
        "link_position": "position",
        "link_velocity": "velocity",
        "link_torque": "torque,force",
        "stiffness": "stiffness",
        "deflection": "deflection,tip deflection",
        "motor_1_position": "motor position",
        "motor_1_velocity": "motor velocity",
        "motor_1_torque": "motor torque",
        "elastic_torque_1": "elastic torque",
        "external_torque": "external torque",
        "position_error": "error position",
        "reference_2": "preset,stiffness preset",
        "equilibrium_position": "equilibrium,equilibrium position,equilibrium theta",
    }.items()
    for words in spellings.split(",")
}
"""Quantity for the sorted words of a column's name."""
_ERRORS = {"error", "errors", "err"}
_NOT_MEASURED = {
    word
    for words in (
        "covariance covariances variance std stddev deviation limit limits tolerance tolerances min max minimum maximum",
        "initial offset offsets bias previous prev last predicted prediction integral derivative delta difference residual",
        "residuals output outputs gain gains nominal points",
    )
    for word in words.split()
}
"""Words in a path before the quantity, such as `output` in `output.effort`, or the `points` of a trajectory. They mean that the
values were neither measured nor commanded at their times.
"""
_DOUBTFUL = {"?", "theta", "position", "velocity", "torque", "force", "deflection", "stiffness"}
"""The user is asked about an ambiguous name that contains one of these words."""


def column_quantities() -> dict[str, Quantity]:
    """All quantities that a column may contain, by name, including the quantities of all registered stages. Quantities
    `sent_...` are left out, since a recorded reference is a command as it was sent.
    """
    return {name: one for name, one in (QUANTITIES | DERIVED).items() if not name.startswith("sent_")}


def stated_unit(name: str) -> Unit | None:
    """Unit in the name of a column. In the name of a velocity, deg means deg/s."""
    unit = split_header(name)[1]
    if unit is not None and unit.si in ("rad", "m") and "velocity" in words_of(tokens_of(name)):
        return Unit(f"{unit.symbol}/s", f"{unit.si}/s", unit.factor)
    return unit


def meaning_of(name: str, unit: Unit | None, joints: Sequence[str] | None, file: str = "") -> tuple[str | None, str | None]:
    """Joint and quantity of a column, only by its name and unit. The quantity is None if the name states no quantity. Raises
    DoubtError.

    joints: joints of the simulation; None: the name states the joint. file: name of the column's file, if several files form
    the recording; its words complete the name of the column.
    """
    known, plain = column_quantities(), split_header(name)[0]
    head, dot, last = plain.strip("./ ").rpartition(".")
    joint, rest = find_joint(plain, joints or ())
    about = _words_above(rest)
    stated = dot and ALIASES.get(last, last) in known and not about & _ERRORS
    if stated and (last in known or not is_command([*re.split(r"[./]", head), file])):
        return _joint_called(head, joints), _fitting(ALIASES.get(last, last), unit)
    elsewhere, file = find_joint(file, joints or ()) if file else (None, "")
    joint = joint or elsewhere
    parts = [part for part in re.split(r"[./]", rest) if tokens_of(part)]
    *above, tail = [part for part in parts if words_of(tokens_of(part))] or parts or [""]
    array = re.search(r"[\[(](\d+)[\])]$", tail)
    tokens = tokens_of(tail[: array.start()] if array else tail)
    numbers = [int(word) for word in tokens if word.isdecimal()]
    words = [word for word in words_of(tokens) if not word.isdecimal()]
    said = [word for word in words_of(tokens_of(file)) if not word.isdecimal()]
    if unsure := unknown_words(said):  # the meaning of a word is unknown, such as `run` in `run_position`
        said = said if REFERENCE in said and not {*words} - {"field"} else [word for word in said if word not in unsure]
    if not {*words} - {REFERENCE, "field"}:
        words = [word for word in (*words, *said) if word != "field"]
    if words and REFERENCE not in words and (is_command(above) or (REFERENCE in said and not unsure)):
        words.append(REFERENCE)  # for example knee.command.effort and desired.positions, which are references
    if about & _ERRORS:
        words.append("error")  # for example error.positions, the error of a controller
    named = words == ["motor"] or (not words and (joint or {"joint", "axis"} & {*tokens}))
    if named and unit is not None and unit.si == "rad":
        words.append("position")  # for example hub1_rad, Joint 1 [deg] and elbow [deg]: the unit shows a position
    exact = "_".join(tokens)
    if exact in known:
        quantity: str | None = exact
    elif REFERENCE in words:
        quantity = _commanded([" ".join(said), *above, tail], words, unit, owned=joint is not None)
    else:
        quantity = _QUANTITIES.get(" ".join(sorted(words)))
    # Names with other characters (q', q*, a dot above) are ambiguous.
    if quantity is None or re.search(r"[^\w\s./,:#()[\]-]", rest) or (words == ["force"] and (unit is None or unit.si != "N")):
        stated = unit is not None and unit.si in ("rad", "rad/s", "N m")
        if named or stated or _DOUBTFUL & {*words_of(tokens_of(rest))}:
            desired = " (d for desired: a command?)" if "d" in words else ""
            raise DoubtError(f"its name does not clearly state a quantity of a joint{desired}")
        return joint, None
    quantity = _fitting(quantity, unit)
    owner = above[-1] if above else ""
    count = len(numbers) + (array is not None)
    unclear = bool(numbers) and exact in known
    if unclear and (joint or len(joints or ()) == 1):  # for example reference_1, motor_1_torque
        return joint or (joints or [""])[0], exact
    if owner == "field" and array is None and numbers == [0] and joints is not None and len(joints) == 1:
        return joints[0], quantity  # field.position0: `rostopic echo -p` of a message with one joint
    if count > (joint is None) or unclear or (count and re.search(r"\d|left|right|^field$", owner.lower())):
        raise DoubtError("the number in its name is ambiguous")
    if joint is None and not count and words_of(tokens_of(owner)):
        return _joint_called(owner, joints), quantity  # for example elbow/position, /joint_states/elbow/position
    spoken, of_file = {*tokens_of(rest)}, {*tokens_of(file)}
    if joint is None and count and not (spoken | of_file) & JOINTS:
        if spoken & BODIES:
            return None, None  # for example tool.position[1], imu.angular_velocity[0]
        if of_file & BODIES:
            raise DoubtError("its file is named after a body, so its number may be an axis of the body, not a joint")
    if joint is None:
        place = int(array[1]) if array else next(iter(numbers), None)
        joint = joint_of(place, joints, indexed=array is not None)
    return joint, quantity


def _commanded(parts: Sequence[str], words: Sequence[str], unit: Unit | None, *, owned: bool) -> str | None:
    """Reference that the column of a command contains; None if it is not a command for a joint. Raises CommandDoubtError.

    Args:
        parts: Parts of the column's path, without the joint.
        words: Words of the last part.
        unit: Unit that the file states.
        owned: Whether the column's name contains the name of a joint.
    """
    others = sorted({*words} - {REFERENCE})
    if others in (["preset"], ["preset", "stiffness"]):
        return "reference_2"
    kind = kind_of(parts, unit)
    if unknown := unknown_words(words):
        if kind or owned:
            what = f"a command of {one_of([kind])}" if kind else "a command"
            raise CommandDoubtError(f"its name means {what}, but '{unknown[0]}' is not a known word")
        return None
    return "reference_1"


def check_path(name: str, joint: str | None, joints: Sequence[str] | None) -> None:
    """Raise DoubtError for a column whose path suggests that its values were neither measured nor commanded at their times.

    joint: joint that the file states for the column.
    """
    rest = find_joint(split_header(name)[0], joints or ([joint] if joint else ()))[1]
    if unsure := _words_above(rest) & _NOT_MEASURED:
        raise DoubtError(f"'{min(unsure)}' in its name suggests that its values were neither measured nor commanded")


def _words_above(path: str) -> set[str]:
    """Words in all parts of a path but the last."""
    return {word for part in re.split(r"[./]", path)[:-1] for word in tokens_of(part)}


def within_joint(name: str) -> str:
    """Name of a column whose joint the file states. If earlier parts of its path mean a command, as in
    `field.desired.positions`, the name is `desired` and the last part.
    """
    *above, last = re.split(r"[./]", name)
    return f"desired {last}" if is_command(above) else name


def _joint_called(name: str, joints: Sequence[str] | None) -> str:
    """Joint whose name precedes the quantity in a column's name."""
    return find_joint(name, joints or ())[0] or re.split("[./]", name)[-1]


def _fitting(quantity: str, unit: Unit | None) -> str:
    """The quantity, after a check that the unit fits it. Raises DoubtError."""
    if unit is not None and not fits(unit.si, column_quantities()[quantity].unit):
        raise DoubtError(f"its name means {quantity}, but its unit is {unit.symbol}")
    return quantity


def find_raw(wanted: str, columns: Sequence[RawColumn]) -> int | None:
    """Index of a column, by its header with or without the unit, or by its number in the file; None if there is no such
    column.
    """
    headers = [column.name for column in columns]
    numbers = [str(column.place or i) for i, column in enumerate(columns, start=1)]
    for names in (headers, [split_header(header)[0] for header in headers], numbers):
        if wanted in names:
            return names.index(wanted)
    return None
