"""What the name of a column says for certain. Each name is read by itself: no other column changes its meaning."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.data import RawColumn
from asrsim.recordings.units import Unit, find_unit, fits, split_header

KNOWN = {**QUANTITIES, **DERIVED}
"""Every quantity that a column may be of, by name."""
ALIASES: dict[str, str] = {
    "position": "link_position", "velocity": "link_velocity", "effort": "link_torque", "torque": "link_torque",
    "reference": "reference_1", "stiffness_preset": "reference_2", "motor_position": "motor_1_position",
    "motor_velocity": "motor_1_velocity", "motor_torque": "motor_1_torque", "elastic_torque": "elastic_torque_1",
    "tau": "link_torque", "tau_ext": "external_torque", "preset": "reference_2", "motor_1": "motor_1_position",
    "motor_2": "motor_2_position",
}  # fmt: skip
"""Short names that a mapping, or a column called `joint.quantity`, may use besides the quantities' own."""
_WORDS = {
    **dict.fromkeys(("q", "qpos", "pos", "positions", "angle", "angles"), "position"),
    **dict.fromkeys(("dq", "qdot", "qvel", "vel", "velocities", "speed"), "velocity"),
    **dict.fromkeys(("tau", "torques", "effort", "efforts"), "torque"),
    **dict.fromkeys(
        ("references", "ref", "cmd", "command", "commanded", "des", "desired", "target", "setpoint", "goal"), "reference"
    ),
    **dict.fromkeys(("mot", "hub"), "motor"),
    "defl": "deflection",
    "eq": "equilibrium",
    "ext": "external",
    "el": "elastic",
    "spring": "elastic",
}
"""Word -> the word of `_QUANTITIES` that it stands for."""
_QUANTITIES = {
    " ".join(sorted(words.split())): quantity
    for words, quantity in {
        **{word: f"link_{word}" for word in ("position", "velocity", "torque")},
        "force": "link_torque",
        **{f"motor {word}": f"motor_1_{word}" for word in ("position", "velocity", "torque")},
        "reference": "reference_1",
        "reference position": "reference_1",
        "reference torque": "reference_1",
        "motor reference": "reference_1",
        "motor reference position": "reference_1",
        "motor reference torque": "reference_1",
        "preset": "reference_2",
        "stiffness preset": "reference_2",
        "stiffness": "stiffness",
        "deflection": "deflection",
        "tip deflection": "deflection",
        "error position": "position_error",
        "equilibrium": "equilibrium_position",
        "equilibrium position": "equilibrium_position",
        "equilibrium theta": "equilibrium_position",
        "external torque": "external_torque",
        "elastic torque": "elastic_torque_1",
    }.items()
}
"""Words, in any order, that make a quantity together."""
_FILLING = {"joint", "joints", "jnt", "j", "axis", "link", "measured", "meas", "actual", "act", "data", "value", "values",
            "field", "angular", "in"}  # fmt: skip
"""Words that change nothing: `q1_meas`, `joint 1 position`, `field.position0`."""
_DOUBTFUL = {"eff", "moment", "theta", "th", "qd", "dqd", "phi", "rate", "state", "enc", "encoder", "rotation", "omega", "load",
             "trq", "position", "velocity", "torque", "force", "deflection", "stiffness"}  # fmt: skip
"""Words by which a name that is not understood may mean a quantity of a joint: it is asked about."""
_UNITS = {"rad": "position", "m": "position", "rad/s": "velocity", "m/s": "velocity", "N m": "torque", "N": "torque"}
_LETTERS = str.maketrans({"θ": "theta", "τ": "tau", "ω": "omega", "φ": "phi", "\u0307": "dot",
                          **{sign: str(number) for number, sign in enumerate("₀₁₂₃₄₅₆₇₈₉")}})  # fmt: skip
_GLUED = ("ref", "des", "desired", "cmd", "eq", "dot", "act", "meas", "ext", "target", "angle", "position", "pos", "velocity")
_STEMS = ("q", "pos", "position", "vel", "tau", "torque", "hub", "motor", "theta", "link", "joint")


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """What a name says; `quantity` None: it is not used."""

    joint: str | None = None
    quantity: str | None = None
    reason: str
    asked: bool = False
    """It may be a joint's quantity, and the user is asked."""


def tokens_of(name: str) -> list[str]:
    """Lower-case words and numbers of a name: `hub1_refPos` gives hub, 1, ref, pos."""
    text = re.sub(r"(?<![A-Za-z])dQ(?![a-z])", "dq", name.translate(_LETTERS))
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    words: list[str] = []
    for word in (found.lower() for found in re.findall(r"[^\W\d_]+|\d+", text)):
        known = word in _WORDS or word in _QUANTITIES
        end = next((end for end in _GLUED if not known and word.endswith(end) and word[: -len(end)] in _STEMS), None)
        words += [word] if end is None else [word[: -len(end)], end]
    return words


def stated_unit(name: str, beside: str = "") -> Unit | None:
    """The unit of a column, by what stands beside its name or in it. A velocity in deg is one in deg/s."""
    unit = find_unit(beside) or split_header(name)[1]
    if unit is not None and unit.si in ("rad", "m") and any(_WORDS.get(word, word) == "velocity" for word in tokens_of(name)):
        return Unit(f"{unit.symbol}/s", f"{unit.si}/s", unit.factor)
    return unit


def meaning_of(name: str, unit: Unit | None, joints: Sequence[str] | None) -> Meaning:
    """What a column is, by its name and unit alone. joints: of the simulation; None: not known, and taken from the name."""
    plain = re.sub(r"#\d+$", "", split_header(name)[0])
    head, dot, last = plain.strip("./ ").rpartition(".")
    if dot and ALIASES.get(last, last) in KNOWN:
        return _of_joint(head, ALIASES.get(last, last), unit, joints)
    joint, rest = find_joint(plain, joints or ())
    parts = [part for part in re.split(r"[./]", rest) if part.strip(" _[]")]
    parts = parts[:-1] if len(parts) > 1 and parts[-1] in ("data", "value", "values") else parts
    *above, tail = parts or [""]
    while above and {_WORDS.get(word, word) for word in tokens_of(above[-1])} <= {*_FILLING, "reference", "motor"}:
        tail = f"{above.pop()} {tail}"  # command/q1
    array = re.search(r"[\[(](\d+)[\])]$", tail) or (re.search(r"(\d+)$", tail) if tail.startswith("field ") else None)
    tokens = tokens_of(tail[: array.start()] if array else tail)
    numbers = [int(word) for word in tokens if word.isdecimal()]
    exact = "_".join(tokens)
    if numbers and ALIASES.get(exact, exact) in KNOWN and (joint or (joints is not None and len(joints) == 1)):
        return _fitting(joint or str((joints or [""])[0]), ALIASES.get(exact, exact), unit)
    words = [_WORDS.get(word, word) for word in tokens if not word.isdecimal() and word not in _FILLING]
    if "torque" in words:  # of a position m may be metres, of a torque it is the motor
        words = ["motor" if word == "m" else word for word in words]
    si = "" if unit is None else unit.si
    asked = bool(_DOUBTFUL & {_WORDS.get(word, word) for word in tokens_of(rest)}) or si in ("rad", "rad/s", "N m")
    owners = [one for one in joints or () if joint is None and (own := {*words} & {*tokens_of(one)}) and own - _DOUBTFUL]
    if len(owners) == 1:  # hip_pos of left_hip_joint
        joint, words = owners[0], [word for word in words if word not in tokens_of(owners[0])]
    if si in _UNITS and (words == ["motor"] or (not words and (joint or (numbers and re.search("(?i)joint|axis", rest))))):
        words.append(_UNITS[si])  # hub [rad], elbow [deg], Joint 1 [deg]
    quantity = _QUANTITIES.get(" ".join(sorted(words)))
    if numbers and ALIASES.get(exact, exact) in KNOWN:
        return Meaning(reason=f"{numbers[0]} in its name may count joints", asked=True)
    strange = next((word for word in words if word not in " ".join(_QUANTITIES).split()), None)
    if "reference" in words and not strange and (quantity is None or ("torque" in words and not si)):
        return Meaning(joint=joint, reason="the simulation has no such reference")
    if quantity is None or (words == ["force"] and si != "N"):
        why = "its name has no quantity of a joint"
        if asked:
            why = f"it is unclear what '{strange}' in its name says" if strange else "its name says two things"
        return Meaning(joint=joint, reason=why, asked=asked)
    if joint is not None and numbers and re.search(r"_\d", quantity):  # elbow_motor_2_position
        quantity, numbers = re.sub(r"\d", str(numbers[0]), quantity, count=1), numbers[1:]
    owner = _called(above[-1]) if above else ""
    if numbers and (joint or len(numbers) > 1 or re.search(r"\d|left|right", owner.lower())):
        return Meaning(reason=f"which joint the number {numbers[-1]} in its name counts is unclear", asked=True)
    if not (joint or numbers or array) and owner and not {*tokens_of(owner)} <= {*_FILLING, "state", "states"}:
        # elbow/position, /joint_states/elbow/position: what stands before the quantity is the joint's name
        return _of_joint(owner, quantity, unit, joints)
    doubt = ""
    if joint is None:
        joint, doubt = joint_of(int(array[1]) if array else numbers[0] if numbers else None, joints, indexed=array is not None)
    return Meaning(reason=doubt, asked=True) if doubt or quantity not in KNOWN else _fitting(joint, quantity, unit)


def _of_joint(name: str, quantity: str, unit: Unit | None, joints: Sequence[str] | None) -> Meaning:
    """The meaning where a name of a joint stands before the quantity."""
    called = find_joint(name, joints or ())[0] or _called(re.split("[./]", name)[-1])
    within = [joint for joint in joints or () if {*tokens_of(called)} <= {*tokens_of(joint)}]
    called = within[0] if len(within) == 1 else called  # elbow of elbow_joint
    place = re.fullmatch(r"(?:joint|axis|j)[_ ]?(\d+)", called)
    if place is None or not joints or called in joints:
        return _fitting(called, quantity, unit)
    joint, doubt = joint_of(int(place[1]), joints, indexed=False)  # another robot's file
    return Meaning(reason=doubt, asked=True) if doubt else _fitting(joint, quantity, unit)


def _fitting(joint: str | None, quantity: str, unit: Unit | None) -> Meaning:
    """The meaning, where the unit can be the quantity's."""
    if unit is not None and not fits(unit.si, KNOWN[quantity].unit):
        return Meaning(reason=f"its name says {quantity}, but its unit is {unit.symbol}", asked=True)
    return Meaning(joint=joint, quantity=quantity, reason="")


def find_joint(name: str, joints: Sequence[str]) -> tuple[str | None, str]:
    """The joint whose name is part of the column's name, and the rest of the name."""
    for joint in sorted(joints, key=len, reverse=True):
        for spelling in (joint.lower(), joint.lower().replace("_", "")):
            match = re.search(rf"(?<![a-z0-9]){re.escape(spelling)}(?![0-9])", name.lower())
            if match and len(spelling) > 1:
                return joint, name[: match.start()] + " " + name[match.end() :]
    return None, name


def _called(name: str) -> str:
    """The name in `joints[elbow]`, else the name itself."""
    return re.sub(r"^[^\[]*\[(\D[^\]]*)\]$", r"\1", name)


def joint_of(number: int | None, joints: Sequence[str] | None, *, indexed: bool) -> tuple[str | None, str]:
    """The joint that a number counts, and why it is unclear. indexed: counted from 0, as in an array."""
    if number is None:
        if joints is None or len(joints) == 1:
            return (joints or ["joint_1"])[0], ""
        return None, f"it does not say which of {', '.join(joints[:8])} it is of"
    if joints is None:
        return f"joint_{number}", ""
    ends = [re.sub(r".*?(\d*)$", r"\1", joint) for joint in joints]
    counted = [str(i + 1) for i in range(len(joints))]
    if not indexed and ends.count(str(number)) == 1 and (sorted(ends) == counted or number == 0):
        return joints[ends.index(str(number))], ""
    place = number if indexed else number - 1
    if 0 <= place < len(joints) and (not any(ends) or indexed or ends == counted):
        return joints[place], ""
    return None, f"which of {', '.join(joints[:8])} the number {number} counts is unclear"


def find_raw(wanted: str, columns: Sequence[RawColumn]) -> int | None:
    """Index of a raw column by its name or its number among all columns of the file."""
    numbers = [column.place or i for i, column in enumerate(columns, start=1)]
    if wanted.lstrip("#").isdecimal() and wanted not in [column.name for column in columns]:
        return numbers.index(int(wanted.lstrip("#"))) if int(wanted.lstrip("#")) in numbers else None
    return find_column(wanted, [column.name for column in columns])


def find_column(wanted: str, labels: Sequence[str]) -> int | None:
    """Index of a column by its header, with or without unit, or by case-blind name."""
    plain = [split_header(label)[0] for label in labels]
    for candidates in (labels, plain, [label.lower() for label in labels], [label.lower() for label in plain]):
        for spelling in (wanted, wanted.lower()):
            if spelling in candidates:
                return list(candidates).index(spelling)
    return None
