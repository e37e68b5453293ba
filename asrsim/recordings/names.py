"""Guesses: which joint and quantity a column's name means. Cautious: what is unclear stays unmapped, and says so."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.abroad import in_english
from asrsim.recordings.units import Unit, find_unit, fits, split_header

_REFERENCE = {
    "ref", "refs", "reference", "cmd", "command", "commanded", "des", "desired", "target", "setpoint", "sp", "goal", "demand",
    "references", "cmds", "commands", "targets", "setpoints", "goals",
    "soll", "sollwert", "consigne", "riferimento", "referencia", "consigna",
}  # fmt: skip
_MEASURED = {"meas", "measured", "act", "actual", "ist", "istwert", "messwert", "mesure", "misurato", "medido",
    "value", "val", "values", "data", "signal"}  # fmt: skip
"""Words beside whose joint nothing else need be said: `actual_elbow`."""
_ACTUAL = _MEASURED - {"value", "val", "values", "data", "signal"}
"""Those of them that make an angle beside words that are unknown a joint's: `elbow Ist [°]`."""
_VELOCITY = {"velocity", "vel", "speed", "dq", "qdot", "qvel", "dtheta", "thetadot", "omega", "dot", "rate",
    "geschwindigkeit", "drehzahl", "vitesse", "velocità", "velocita", "velocidad",
}  # fmt: skip
_TORQUE = {"torque", "tau", "effort", "moment", "force", "trq", "eff", "drehmoment", "couple", "coppia",
    "kraft",
}  # fmt: skip
_POSITION = {"q", "qpos", "pos", "position", "positions", "angle", "ang", "theta", "th", "encoder", "enc", "winkel", "state",
    "link", "posizione", "posicion", "posición", "angolo", "angulo", "ángulo",
}  # fmt: skip
_THETA = {"theta", "th", "dtheta", "thetadot"}
_PLAIN = (_POSITION - _THETA - {"state"}) | _MEASURED | {"phi", "l", "hub"}
_AXIS = {"joint", "jnt", "j", "a", "axis", "gelenk", "achse", "giunto", "asse", "articulation", "articulacion", "axe", "eje"}
"""Words behind which a number counts joints."""
_CALM = {"filtered", "filt", "sensor", "abs", "absolute", "field"}
"""Words that say how a position was measured, or in what of a message it stands."""
_MOTOR = {"motor", "mot", "hub", "rotor"}
_FOREIGN = {
    "count", "counts", "ticks", "tick", "pulses", "increments", "adc", "raw", "current", "voltage", "volt", "pwm", "temp",
    "temperature", "status", "index", "acc", "acceleration",
    "ddq", "qdd", "qacc", "power", "energy", "duty", "x", "y", "z", "ee", "tcp", "tool", "imu", "battery", "filter", "variance",
    "std", "covariance", "id", "seq", "flag", "strain", "gauge", "ddtheta", "dd", "sin", "cos", "tan", "min", "max", "lim",
    "limit", "limits", "offset", "bias", "zero", "home", "init", "initial", "noise", "fft", "psd", "gain", "kp", "ki", "kd",
    "norm", "rms", "sum", "integral", "derivative", "counter", "valid", "ok", "code", "resolution", "damping", "friction",
    "prime", "fric", "gravity", "grav", "coriolis", "inertia",
}  # fmt: skip
"""Words beside which a position, velocity or torque is not the joint's: what it is measured in, bounds, parts, statistics."""
_TURNED = {"roll", "pitch", "yaw"}
"""Angles of a body: a link's are those of no joint."""
_ELECTRIC = {*(f"motor_{i}_{what}" for i in (1, 2) for what in ("voltage", "current")), "reference_1", "reference_2"}
"""What is in V or A only where a column is called so to the letter: drives record voltages and currents of many kinds."""
VOCABULARY = {
    *_REFERENCE, *_VELOCITY, *_TORQUE, *_POSITION, *_MOTOR, "deflection", "defl", "tip", "stiffness", "stiff", "sigma",
    "preset", "eq", "equilibrium", "error", "err", "el", "elastic", "spring", "ext", "external", "disturbance",
    "m", "l", "phi", *_MEASURED, *_AXIS, "field", "filtered", "filt", "sensor", "output", "set",
    "in", "of", "the", "gear", "side", "abs", "rel", "absolute", "relative",
}  # fmt: skip
_SUFFIXES = ("ref", "ext", "des", "desired", "cmd", "eq", "dot", "act", "meas", "measured", "target", "m", "l")
_STEMS = ("q", "theta", "pos", "position", "vel", "tau", "torque", "hub", "angle", "motor", "mot", "link", "joint")


@dataclass(frozen=True, kw_only=True)
class Guess:
    """What a name seems to mean; `quantity` None: nothing in the simulation, or unclear."""

    quantity: str | None
    number: int | None = None
    """Number in the name that counts joints."""
    numbers: tuple[tuple[str, int], ...] = ()
    """Where there are several, which of them does is not known: each behind the word before it."""
    joint: str | None = None
    """Joint whose name is in the column's name."""
    words: tuple[str, ...] = ()
    """Words of the name that say nothing of the quantity: perhaps a joint's name."""
    reason: str = ""


_LETTERS = str.maketrans({
    "θ": "theta", "ϑ": "theta", "τ": "tau", "ω": "omega", "φ": "phi", "ϕ": "phi", "\u0307": "dot", "\u0308": "ddot",
    **{sign: str(number) for number, sign in enumerate("₀₁₂₃₄₅₆₇₈₉")},
})  # fmt: skip
"""Letters of formulas as words: Greek ones, dots above, lowered numbers."""


def tokens_of(name: str) -> list[str]:
    """Lower-case words and numbers of a name: `hub1_refPos` gives hub, 1, ref, pos; `θ̇₁` thetadot, 1."""
    name = in_english(re.sub(r"(?<=\w)'(?!\w)", " prime", name.translate(_LETTERS)))
    text = re.sub(r"(?<![A-Za-z])dd?(?:Q|Theta)(?![a-z])", lambda match: match[0].lower(), name)  # dQ1 is a velocity
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    words: list[str] = []
    for word in re.findall(r"[^\W\d_]+|\d+", text):
        lower = word.lower()
        for prefix in ("soll", "ist"):  # German glues: Sollposition, Istwinkel
            if (rest := lower.removeprefix(prefix)) != lower and rest in _POSITION | _VELOCITY | _TORQUE:
                words.append(prefix)
                lower = rest
        for suffix in _SUFFIXES:
            stem = lower.removesuffix(suffix)
            if stem != lower and stem in _STEMS and lower not in _VELOCITY:
                words += [stem, suffix]
                break
        else:
            words.append(lower)
    return words


def stated_unit(name: str, beside: str = "") -> Unit | None:
    """The unit of a column, by what stands beside its name or in it. A velocity in deg is one in deg/s."""
    unit = find_unit(beside) or split_header(name)[1]
    if unit is not None and unit.si in ("rad", "m") and not _VELOCITY.isdisjoint(tokens_of(name)):
        return Unit(f"{unit.symbol}/s", f"{unit.si}/s", unit.factor)
    return unit


def joint_numbers(names: Iterable[str]) -> set[int]:
    """Numbers that count joints in a file: those of its plain positions (q1, q2, position_1, hub1), of arrays (q_ref[0]), and
    behind a word for joints (axis 1).

    Of angles called theta only where these are no motors.
    """
    names = list(names)
    # log.q1, log.q2: what holds all of them says nothing of any.
    holders = {name.partition(".")[0] for name in names}
    names = [name.partition(".")[2] or name for name in names] if len(holders) == 1 < len(names) else names
    listed = [tokens_of(name) for name in names]
    plain = _PLAIN if theta_is_motor(listed) else _PLAIN | {"theta", "th"}
    found = {int(match[1]) for name in names if (match := re.search(r"\[(\d+)\]$", name))}
    for words in listed:
        found |= {int(number) for word, number in pairwise(words) if word in _AXIS and number.isdecimal()}
        rest = [word for word in words if not word.isdecimal()]
        numbers = [int(word) for word in words if word.isdecimal()]
        if len(numbers) == 1 and rest and not set(rest) - plain - _AXIS - _CALM and not set(rest) <= _AXIS:
            found.add(numbers[0])
    return found


def theta_is_motor(listed: Iterable[Sequence[str]]) -> bool:
    """Whether theta means motors in a file with these names (as tokens): beside a q, its velocity beside another one, or beside
    a deflection, which is measured from the motor on.
    """
    listed = list(listed)
    if any({"deflection", "defl"} & set(words) for words in listed):
        return True
    found: set[tuple[bool, bool]] = set()
    for words in map(set, listed):
        velocity, theta = bool(words & _VELOCITY), bool(words & _THETA)
        if not words & (_REFERENCE | _MOTOR | {"d", "set"}) and (
            velocity or theta or words & {"q", "qpos", "link", "pos", "position"}
        ):
            found.add((velocity, theta))
    return any({(velocity, True), (velocity, False)} <= found for velocity in (True, False))


def guess(name: str, unit: Unit | None, *, joints: Sequence[str], counted: set[int], theta_is_motor: bool) -> Guess:
    """Meaning of one name.

    `joints`: names to look for; `counted`: numbers that count joints in this file (:func:`joint_numbers`);
    `theta_is_motor`: see :func:`theta_is_motor`.
    """
    joint, rest = find_joint(name, joints)
    exact = rest.strip(" .:/_").lower()
    if joint is not None and unit is not None and unit.si in ("V", "A") and exact in _ELECTRIC:
        return Guess(quantity=exact, joint=joint, reason=f"'{name}' is {exact}")
    words = tokens_of(rest)
    numbers = [int(word) for word in words if word.isdecimal()]
    head, _, last = rest.rpartition(".")
    if len(numbers) > 1 and sum(word.isdecimal() for word in tokens_of(last)) == 1 and not last.endswith("]"):
        # trial_2.q1: the numbers before the last dot count something else.
        words = tokens_of(last)
        numbers = [int(word) for word in words if word.isdecimal()]
        # joint_2.reference_1: unless they count joints, and the last one is the quantity's own.
        holders = [int(number) for word, number in pairwise(tokens_of(head)) if word in _AXIS and number.isdecimal()]
    else:
        holders = []
    plain = [word for word in words if not word.isdecimal()]
    if joint is not None and re.search(rf"(^|\.){re.escape(joint)}(\.data|\.values?)?$", name, re.IGNORECASE):
        # trial.elbow, elbow.Data: what holds the joint's series may be called anything, but is no other quantity.
        plain = [word for word in plain if word in VOCABULARY | _FOREIGN]
    quantity, own_number = _quantity(plain, words, unit, theta_is_motor=theta_is_motor, named=joint is not None)
    if quantity is None:
        return Guess(quantity=None, joint=joint, reason="no quantity of the simulation in its name")
    if unit is not None and (unit.si in ("V", "A") or not fits(unit.si, (QUANTITIES | DERIVED)[quantity].unit)):
        return Guess(quantity=None, joint=joint, reason=f"looks like {quantity}, but its unit is {unit.symbol}")
    if own_number is not None:
        numbers = [*holders, *numbers]
    # reference_1, motor_2, theta_1: the number is the quantity's own unless numbers count joints in this file.
    if own_number is not None and (len(numbers) > 1 or joint is not None or not counted):
        numbers.remove(own_number)
    else:
        quantity = re.sub(r"_2(?=_|$)", "_1", quantity) if own_number is not None else quantity
    number = numbers[0] if len(numbers) == 1 and joint is None else None
    pairs = tuple((word, int(two)) for word, two in pairwise(["", *words]) if two.isdecimal()) if len(numbers) > 1 else ()
    spare = tuple(word for word in plain if word not in VOCABULARY)
    return Guess(
        quantity=quantity, number=number, numbers=pairs, joint=joint, words=spare, reason=f"'{name}' reads as {quantity}"
    )


def find_joint(name: str, joints: Sequence[str]) -> tuple[str | None, str]:
    """The joint whose name is part of the column's name, and the rest of the name."""
    lower = name.lower()
    for joint in sorted(joints, key=len, reverse=True):
        for spelling in (joint.lower(), joint.lower().replace("_", "")):
            match = re.search(rf"(?<![a-z0-9]){re.escape(spelling)}(?![0-9])", lower)
            if match and len(spelling) > 1:
                return joint, name[: match.start()] + " " + name[match.end() :]
    return None, name


def _quantity(
    plain: list[str], words: list[str], unit: Unit | None, *, theta_is_motor: bool, named: bool
) -> tuple[str | None, int | None]:
    """Quantity of the words, and the number that belongs to it (motor_2, reference_1, el1)."""
    found = set(plain)
    if found & _FOREIGN or (found & _TURNED and found & _POSITION == {"link"}):
        return None, None
    velocity, torque, reference = bool(found & _VELOCITY), bool(found & _TORQUE), bool(found & _REFERENCE)
    reference = reference or ("set" in found and bool(found & _POSITION)) or ("joint", "trajectory") in pairwise(words)
    si = unit.si if unit is not None else ""
    velocity = velocity or si in ("rad/s", "m/s")
    torque = torque or si in ("N m", "N")
    if "qd" in found and found & _MEASURED and not si:
        velocity = True  # what was measured is not what was desired
    if "qd" in found and not velocity:
        if si not in ("rad", "m"):  # a velocity to some, desired to others
            return None, None
        reference = True
    if found & _POSITION and not reference:
        # A reference, or the right one; d_q is a velocity to some, desired to others.
        if "r" in found or any(one == "d" and other in _POSITION for one, other in pairwise(words)):
            return None, None
        reference = "d" in found
    if found & {"deflection", "defl"}:
        return (None if velocity or torque or reference else "deflection"), None
    if "preset" in found:
        return "reference_2", None
    if found & {"stiffness", "stiff", "sigma"}:
        return (None if reference else "stiffness"), None
    if reference:
        # The command of a torque is a reference where its unit says that it is one; its name alone may mean a limit or a sum.
        if velocity or (torque and si not in ("N m", "N")):
            return None, None
        own = _after(words, _REFERENCE)
        return ("reference_2" if own == 2 else "reference_1"), own
    if found & {"eq", "equilibrium"}:
        return "equilibrium_position", None
    if found & {"error", "err"}:
        return (None if velocity or torque else "position_error"), None
    if torque and found & {"el", "elastic", "spring"}:
        own = _after(words, {"el", "elastic", "spring", "torque"})
        return f"elastic_torque_{own if own in (1, 2) else 1}", own
    if torque and found & {"ext", "external", "disturbance"}:
        return "external_torque", None
    kind = "velocity" if velocity else "torque" if torque else "position"
    theta = theta_is_motor and bool(found & _THETA)
    if (found & _MOTOR and "link" not in found) or theta or (len(plain) > 1 and "m" in found):
        own = None if "hub" in found else _after(words, {"motor", "mot", "rotor", "theta", "m"})
        return f"motor_{own if own in (1, 2) else 1}_{kind}", own
    # An angle of which nothing else is said but whose it is: "Axis 1 [deg]", "Istwert Achse 1 [Grad]".
    only = bool(plain) and found <= VOCABULARY and si in ("rad", "m")
    only = only or (bool(found & _ACTUAL) and si in ("rad", "m"))
    only = only or (named and (found <= _MEASURED or "phi" in found or si in ("rad", "m")))
    if velocity or torque or found & _POSITION or only:
        return f"link_{kind}", None
    return None, None


def _after(words: list[str], keys: set[str]) -> int | None:
    """1 or 2 where it follows one of the words."""
    for word, following in pairwise(words):
        if word in keys and following in ("1", "2"):
            return int(following)
    return None


def find_column(wanted: str, labels: Sequence[str]) -> int | None:
    """Index of a column by its header, with or without unit, by case-blind name, or by its number from 1."""
    plain = [split_header(label)[0] for label in labels]
    for candidates in (labels, plain, [label.lower() for label in labels], [label.lower() for label in plain]):
        for spelling in (wanted, wanted.lower()):
            if spelling in candidates:
                return list(candidates).index(spelling)
    if wanted.lstrip("#").isdecimal() and 1 <= int(wanted.lstrip("#")) <= len(labels):
        return int(wanted.lstrip("#")) - 1
    return None
