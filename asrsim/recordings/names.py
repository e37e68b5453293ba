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
_KINDS = {
    **dict.fromkeys(("q", "qpos", "pos", "position", "positions", "angle", "angles"), "position"),
    **dict.fromkeys(("dq", "qdot", "qvel", "vel", "velocity", "velocities", "speed"), "velocity"),
    **dict.fromkeys(("tau", "torque", "torques", "effort", "efforts", "force"), "torque"),
}
"""Word -> what is measured."""
_REFERENCE = {"ref", "reference", "references", "cmd", "command", "commanded", "des", "desired", "target", "setpoint", "goal"}
_MOTOR = {"motor", "mot", "hub"}
_FILLING = {"joint", "joints", "jnt", "j", "axis", "link", "measured", "meas", "actual", "act", "data", "value", "values",
            "field", "angular", "in"}  # fmt: skip
"""Words that change nothing: `q1_meas`, `joint 1 position`, `field.position0`."""
_WHOLE = {" ".join(sorted(words.split())): quantity for words, quantity in {
    "deflection": "deflection", "defl": "deflection", "tip deflection": "deflection", "stiffness": "stiffness",
    "preset": "reference_2", "stiffness preset": "reference_2", "error position": "position_error",
    "eq position": "equilibrium_position", "equilibrium position": "equilibrium_position", "eq theta": "equilibrium_position",
    "equilibrium": "equilibrium_position", "ext torque": "external_torque", "external torque": "external_torque",
    "el torque": "elastic_torque_1", "elastic torque": "elastic_torque_1", "spring torque": "elastic_torque_1",
}.items()}  # fmt: skip
"""Words that make a quantity together, in any order; each of `_KINDS` by what it measures."""
_DOUBTFUL = {"eff", "moment", "theta", "th", "qd", "dqd", "phi", "rate", "state", "enc", "encoder", "rotation", "omega", "load",
             "trq"}  # fmt: skip
"""Words that often mean a quantity of a joint, and as often something else: asked about."""
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
        end = next((end for end in _GLUED if word.endswith(end) and word[: -len(end)] in _STEMS and word not in _KINDS), None)
        words += [word] if end is None else [word[: -len(end)], end]
    return words


def stated_unit(name: str, beside: str = "") -> Unit | None:
    """The unit of a column, by what stands beside its name or in it. A velocity in deg is one in deg/s."""
    unit = find_unit(beside) or split_header(name)[1]
    if unit is not None and unit.si in ("rad", "m") and any(_KINDS.get(word) == "velocity" for word in tokens_of(name)):
        return Unit(f"{unit.symbol}/s", f"{unit.si}/s", unit.factor)
    return unit


def meaning_of(name: str, unit: Unit | None, joints: Sequence[str] | None) -> Meaning:
    """What a column is, by its name and unit alone. joints: of the simulation; None: not known, and taken from the name."""
    plain = re.sub(r"#\d+$", "", split_header(name)[0])
    head, dot, last = plain.strip("./ ").rpartition(".")
    if dot and (exact := ALIASES.get(last, last)) in KNOWN:
        called: str | None = find_joint(head, joints or ())[0] or _called(re.split("[./]", head)[-1])
        place = re.fullmatch(r"(?:joint|axis|j)[_ ]?(\d+)", called or "")
        if place and joints and called not in joints:  # another robot's file
            called, doubt = joint_of(int(place[1]), joints, indexed=False)
            if called is None:
                return Meaning(reason=doubt, asked=True)
        return _fitting(called, exact, unit, f"'{last}' of '{head}'")
    joint, rest = find_joint(plain, joints or ())
    found = _parsed(rest, unit, named=joint is not None)
    path = re.fullmatch(
        r".*?([^./\s]+)[./]([^./]+)", re.sub(r"[./](?:values?|data)$|[./]\s+(?=[./])", "", plain if joint is None else rest)
    )
    if found.quantity is None and path is not None:
        # elbow/position, /joint_states/elbow/position: what stands before the quantity is the joint's name
        inner, counted = _parsed(path[2], unit, named=True), _parsed(path[2], unit, named=False)
        owner = joint or (_called(path[1]) if joints is None else find_joint(path[1], joints)[0])
        several = re.search(r"\d|left|right", path[1].lower()) is not None
        if joint is None and counted.quantity and counted.number is not None and not several:
            found = counted  # run.q1, /state/q[0]: what holds all joints' series is not one of them
        elif inner.quantity and owner and not {*tokens_of(owner)} <= {*_FILLING, *_MOTOR, "state", "states"}:
            joint, found = owner, inner
    if found.quantity is None:
        spare = set(found.words)
        owners = [one for one in joints or () if spare and spare <= {*tokens_of(one)}]
        if joint is None and len(owners) == 1:  # hip_pos of left_hip_joint
            joint, found = owners[0], _parsed(" ".join(word for word in tokens_of(rest) if word not in spare), unit, named=True)
    if found.quantity is None:
        return Meaning(joint=joint, reason=found.reason, asked=found.asked)
    if joint is None:
        joint, doubt = joint_of(found.number, joints, indexed=found.indexed)
        if doubt:
            return Meaning(reason=doubt, asked=True)
    elif found.number is not None:
        return Meaning(reason=f"which joint its number {found.number} counts is unclear", asked=True)
    return _fitting(joint, found.quantity, unit, f"'{plain}'")


def _fitting(joint: str | None, quantity: str, unit: Unit | None, said: str) -> Meaning:
    """The meaning, where the unit can be the quantity's."""
    if unit is not None and not fits(unit.si, KNOWN[quantity].unit):
        return Meaning(reason=f"its name says {quantity}, but its unit is {unit.symbol}", asked=True)
    return Meaning(joint=joint, quantity=quantity, reason=f"{said} names {quantity}")


@dataclass(frozen=True, kw_only=True)
class _Parsed:
    quantity: str | None = None
    number: int | None = None
    """Number that counts joints."""
    indexed: bool = False
    """It is the place in an array, from 0."""
    words: tuple[str, ...] = ()
    """Words that are not known."""
    reason: str = "its name has no quantity of a joint"
    asked: bool = False


def _parsed(text: str, unit: Unit | None, *, named: bool) -> _Parsed:
    """The quantity of a name without its unit and joint; each of its words must be known. named: its joint is known."""
    array = re.search(r"[\[(](\d+)[\])]$", text) or re.search(r"(?:^|/|\s)field\..*?(\d+)$", text)
    tokens = tokens_of(text[: array.start(1)] if array else text)
    numbers = [int(word) for word in tokens if word.isdecimal()]
    words = [word for word in tokens if not word.isdecimal() and word not in _FILLING]
    if any(_KINDS.get(word) == "torque" for word in words):  # of a torque m is the motor, of a position it may be metres
        words = ["motor" if word == "m" else word for word in words]
    strange = tuple(word for word in words if word not in {*_KINDS, *_REFERENCE, *_MOTOR, *" ".join(_WHOLE).split()})
    kinds = [_KINDS[word] for word in words if word in _KINDS]
    si = "" if unit is None else unit.si
    asked = bool(kinds or {*_DOUBTFUL, "deflection", "stiffness"} & {*words} or si in ("rad", "rad/s", "N m"))
    if strange:
        said = f"it is unclear what '{strange[0]}' in its name says" if asked else "its name has no quantity of a joint"
        return _Parsed(words=strange, reason=said, asked=asked)
    whole = " ".join(sorted(_KINDS.get(word, word) for word in words))
    doubled = any(len({*part}) < len(part) for part in (kinds, words)) or len({*kinds}) > 1
    kind = kinds[0] if kinds else _UNITS.get(si, "")
    exact = "_".join(tokens)
    if array is None and numbers and (ALIASES.get(exact) or exact) in KNOWN and len(numbers) == 1:
        quantity, numbers = ALIASES.get(exact, exact), [] if named else [-numbers[0]]
    elif whole in _WHOLE:
        quantity = _WHOLE[whole]
        if quantity == "elastic_torque_1" and numbers and (named or len(numbers) == 2):
            quantity, numbers = f"elastic_torque_{numbers[0]}", numbers[1:]
    elif doubled or ("force" in words and si != "N"):
        return _Parsed(reason="its name says two things, or a force that may be a sensor's", asked=True)
    elif _REFERENCE & {*words}:
        if kind == "velocity" or (kind == "torque" and not si) or {*words} - _REFERENCE - _MOTOR - {*_KINDS}:
            return _Parsed(reason="the simulation has no such reference")
        quantity = "reference_1"
    elif _MOTOR & {*words} and not {*words} - _MOTOR - {*_KINDS}:
        if not kind:
            return _Parsed(reason="what of the motor it is, is not said", asked=True)
        own = numbers[0] if named and numbers else 1
        numbers = [] if named else numbers
        quantity = f"motor_{own}_{kind}"
    elif kinds and not {*words} - {*_KINDS}:
        quantity = f"link_{kind}"
    elif not words and si in _UNITS and (named or ((numbers or array) and re.search("joint|axis", text, re.I))):
        quantity = f"link_{kind}"  # elbow [deg], Joint 1 [deg]
    else:
        return _Parsed(reason="its name has no quantity of a joint", asked=asked)
    if quantity not in KNOWN or len(numbers) > 1:
        return _Parsed(reason="which of the numbers in its name counts joints is unclear", asked=True)
    number = int(array[1]) if array else numbers[0] if numbers else None
    return _Parsed(quantity=quantity, number=number, indexed=array is not None)


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
    """The joint of a number, and why it is unclear. Behind a quantity's own number, which is negative here, there is none."""
    if number is None or number < 0:
        if joints is None:
            return ("joint_1", "") if number is None else (None, f"{-number} in its name may count joints")
        only = len(joints) == 1
        return (joints[0], "") if only else (None, f"it does not say which of {', '.join(joints[:8])} it is of")
    if joints is None:
        return f"joint_{number}", ""
    ends = [re.sub(r".*?(\d*)$", r"\1", joint) for joint in joints]
    counted = [str(i + 1) for i in range(len(joints))]
    if not indexed and ends.count(str(number)) == 1 and (sorted(ends) == sorted(counted) or number == 0):
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
