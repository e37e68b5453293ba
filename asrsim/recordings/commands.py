"""Physical kind of a recorded command, by its name and unit. If the kind of a command is unclear, the user is asked; no command
is left out silently.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from asrsim.recordings.owners import find_joint
from asrsim.recordings.units import Unit, split_header
from asrsim.recordings.words import (
    KIND_UNITS,
    LETTERS,
    REFERENCE,
    TAKEN,
    UNIT_KINDS,
    CommandDoubtError,
    kind_of_word,
    one_of,
    spellings_of,
    tokens_of,
    words_of,
)


def is_command(parts: Sequence[str]) -> bool:
    """Whether a part of a name or of a path means that a quantity is a command."""
    return any(REFERENCE in words_of(tokens_of(part)) for part in parts)


def kind_of(parts: Sequence[str], unit: Unit | None) -> str:
    """Kind of a command, such as `torque`; "" if neither name nor unit states it.

    The last part of a path has precedence: `/effort_controller/joint_commands/position` is a position.

    Args:
        parts: Parts of the command's name, without the joint.
        unit: Unit that the file states.

    Raises CommandDoubtError if the kind is ambiguous or contradicts the unit, or if no operation mode accepts it.
    """
    measured = "" if unit is None else UNIT_KINDS.get(unit.si, unit.si)
    target = f"reference_1 [{unit.symbol if unit else 'unit'}]"
    for part in reversed(parts):
        words, stated = spellings_of(tokens_of(part)), _stated(part)
        if "current" in words and {"state", "states"} & {*words}:
            raise CommandDoubtError("its name means a command, but 'current' may be a current or the present state", target)
        if len(stated) > 1:
            raise CommandDoubtError(f"its name may mean a command of {one_of(stated)}", target)
        if stated:
            # In `q1_ref [N m]`, the q belongs to the joint's name. The unit shows that the command is a torque.
            named = measured and "q" in words and stated == ["position"]
            return _taken(measured if named else stated[0], unit, measured)
        if hint := next((word for word in words if word in LETTERS), ""):
            if measured in LETTERS[hint]:
                return _taken(measured, unit, measured)
            message = f"its name means a command, but '{hint}' may mean {one_of(LETTERS[hint])}"
            raise CommandDoubtError(message, target)
    return _taken(measured, unit, measured) if measured else ""


def _stated(part: str) -> list[str]:
    """Kinds that the words of a part of a name state unambiguously. Each kind is listed once."""
    return [*dict.fromkeys(kind for word in spellings_of(tokens_of(part)) if (kind := kind_of_word(word)))]


def _taken(kind: str, unit: Unit | None, measured: str) -> str:
    """Kind, after checking that it agrees with the unit and that an operation mode accepts it. Raises CommandDoubtError."""
    if unit is not None and kind != measured and {kind, measured} != {"torque", "force"}:
        raise CommandDoubtError(f"its name means a command of {one_of([kind])}, but its unit is {unit.symbol}")
    if kind == "stiffness":
        raise CommandDoubtError("it commands a stiffness; mode 6 takes a preset, in rad", "reference_2 [rad]")
    if kind not in TAKEN:
        what = f"of {one_of([kind])}" if unit is None or unit.si in UNIT_KINDS else f"in {unit.symbol}"
        raise CommandDoubtError(f"it is a command {what}, which no operation mode accepts")
    return measured or kind


def unknown_words(words: Sequence[str]) -> list[str]:
    """Words of a command's name whose meaning is unknown. words: as returned by `words_of`."""
    return [one for one in words if not (one in (REFERENCE, "motor", "?") or one in LETTERS or kind_of_word(one))]


def command_unit(name: str, joint: str | None) -> str:
    """SI unit of the kind that the name of a command states, such as "N m" for `knee_tau_des`; "" if the name states no kind.

    joint: joint whose name may be part of the column's name.
    """
    rest = find_joint(split_header(name)[0], [joint] if joint else [])[1]
    for part in reversed(re.split(r"[./]", rest)):
        if stated := _stated(part):
            return KIND_UNITS.get(stated[0], "") if len(stated) == 1 else ""
    return ""
