"""Words in the names of columns: their spellings, and the physical kinds that they state."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache


def _table(rows: Mapping[str, str]) -> dict[str, str]:
    """Meaning of each spelling, from spellings by meaning."""
    return {spelling: meaning for meaning, spellings in rows.items() for spelling in spellings.split()}


class DoubtError(Exception):
    """Raised if the meaning of a column is ambiguous, so that the user is asked. The message is the reason."""

    target = "QUANTITY [unit]"
    """Meaning that a mapping may give to the column."""


class CommandDoubtError(DoubtError):
    """Raised if the kind of a command is ambiguous, or if no operation mode accepts it."""

    def __init__(self, message: str, target: str = "reference_1 [unit]") -> None:
        super().__init__(message)
        self.target = target


REFERENCE = "reference"
"""Standard word for all spellings that mean a command."""
WORDS = _table(
    {
        "position": "q qpos pos positions angle angles",
        "velocity": "dq qdot qvel vel velocities speed",
        "torque": "tau torques effort efforts",
        "motor": "hub mot hubangle",
        "deflection": "defl",
        "external": "ext",
        "elastic": "el spring",
        "equilibrium": "eq",
        REFERENCE: "references ref refs cmd cmds command commands commanded des desired target targets setpoint setpoints goal "
        "demand demanded",
        "current": "currents cur curr amps",
        "voltage": "voltages volt volts",
        "": "joint joints axis link measured meas actual data value values val angular state states controller controllers "
        "interface topic",
        "?": "eff moment th qd phi rate rpm enc encoder rotation omega load trq",
    }
)
"""Standard word for each spelling in a column's name. It is "" for words without effect on the meaning, such as `meas` in
`q1_meas`. It is "?" for words that suggest a quantity of a joint, but may mean something else.
"""
KINDS = _table(
    {
        "position": "position equilibrium",
        "velocity": "velocity velo omega rpm rps",
        "torque": "torque moment moments trq",
        "force": "force forces",
        "current": "current i iq amp ampere amperes",
        "voltage": "voltage",
        "PWM duty": "pwm pwms duty dutycycle",
        "acceleration": "acceleration accelerations acc accel ddq qddot",
        "power": "power",
        "stiffness": "stiffness stiff",
    }
)
"""Physical kind of a command, by each word that states a kind. The words `i` and `iq` mean currents only together with a word
for a command.
"""
LETTERS = {
    "u": ("voltage", "torque", "current", "force", "PWM duty"), "v": ("voltage", "velocity"), "w": ("velocity", "power"),
    "id": ("current",), "theta": ("position",), "th": ("position",), "phi": ("position",), "eff": ("torque",),
    "load": ("torque", "force"), "qd": ("position", "velocity"), "rate": ("velocity",), "rotation": ("position",),
    "enc": ("position",), "encoder": ("position",), "x": ("position",), "p": ("position", "power"), "f": ("force",),
    "t": ("torque",), "m": ("torque",), "a": ("acceleration", "current"),
}  # fmt: skip
"""Kinds that an ambiguous letter or word in the name of a command may mean. If the unit of the command fits one of the kinds,
the command has this kind.
"""
UNIT_KINDS = {
    "rad": "position", "m": "position", "N m": "torque", "N": "force", "A": "current", "V": "voltage", "rad/s": "velocity",
    "m/s": "velocity", "rad/s^2": "acceleration", "m/s^2": "acceleration", "W": "power", "1": "PWM duty",
    "N m/rad": "stiffness", "N/m": "stiffness",
}  # fmt: skip
"""Kind of a command, by its SI unit. A number without a unit, such as a percentage, is a PWM duty cycle."""
KIND_UNITS = {
    "position": "rad",
    "torque": "N m",
    "force": "N",
    "current": "A",
    "voltage": "V",
    "velocity": "rad/s",
    "PWM duty": "1",
}
"""SI unit of a command, by its kind, for kinds that a column's name may state."""
BODIES = {
    "tool", "tcp", "ee", "eef", "effector", "endeffector", "base", "body", "trunk", "torso", "pelvis", "com", "imu", "gyro",
    "pose", "poses", "twist", "odom", "odometry", "camera", "marker", "world", "cartesian", "wrench",
}  # fmt: skip
"""Words for bodies in space and for their sensors. In names with these words, a number means a direction, not a joint."""
JOINTS = {"joint", "joints", "motor", "motors"}
"""In a name with one of these words, a number means a joint even if a body is also named, as in
`cartesian_controller.joint_position[1]`.
"""
TAKEN = ("position", "torque", "force", "current", "voltage")
"""Kinds of commands that at least one operation mode accepts. A force is accepted only for a prismatic joint."""


def one_of(kinds: Sequence[str]) -> str:
    """Kinds as text, such as `a torque or an acceleration`."""
    return " or ".join(f"a{'n' if kind[:1] in 'aeiou' else ''} {kind}" for kind in kinds)


def spaced(name: str) -> str:
    """Name with blanks between words that begin with upper case: `kneeTauDes` gives `knee Tau Des`."""
    text = re.sub(r"(?<![A-Za-z])dQ(?![a-z])", "dq", name)
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", text)


def tokens_of(name: str) -> list[str]:
    """Words in lower case, and numbers, of a name: `hub1_refPos` gives hub, 1, ref, pos."""
    return [found.lower() for found in re.findall(r"[^\W\d_]+|\d+", spaced(name))]


def spellings_of(tokens: Sequence[str]) -> list[str]:
    """Words of a name in their original spelling. Joined words, as in `tauref`, are separated."""
    return [part for token in tokens for part in _parts(token)]


def words_of(tokens: Sequence[str]) -> list[str]:
    """Words of a name in standard spelling, without words that have no effect on the meaning."""
    return [word for part in spellings_of(tokens) if (word := WORDS.get(part, part))]


def kind_of_word(spelling: str) -> str:
    """Kind that a word in the name of a command states; "" if the word does not state a kind unambiguously."""
    return KINDS.get(spelling) or KINDS.get(WORDS.get(spelling, ""), "")


def is_known(spelling: str) -> bool:
    """Whether a spelling is a word, or joined words, with a known meaning in the name of a column."""
    return any(part in WORDS or part in KINDS or part in LETTERS for part in _parts(spelling))


@lru_cache(maxsize=8192)
def _parts(token: str) -> tuple[str, ...]:
    """Words in one token. In a token such as `tauref` or `cmdpos`, a word for a command and a word for a kind are joined."""
    if token in WORDS:
        return (token,)
    for word in (spelling for spelling, meant in WORDS.items() if meant == REFERENCE):
        for other in (token.removeprefix(word), token.removesuffix(word)):
            if other != token and (kind_of_word(other) or other in LETTERS):
                return (other, word)
    return (token,)
