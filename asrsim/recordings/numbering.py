"""Which numbers in columns' names count joints from 0: those of arrays mostly do, people's do not, and a file may have both."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from asrsim.recordings.names import find_joint, tokens_of


def zero_based(counted: Mapping[int, tuple[str, int]], joints: int, *, zero: bool) -> set[int]:
    """Columns whose numbers count from 0: of names alike (`tau_1`, `tau_2`) one is a 0; or it may be so, and the file has a 0.

    counted: column -> its name and the number in it. joints: how many there are, 0 where it is not known. zero: a 0 was seen
    elsewhere in the file.
    """
    alike: dict[str, set[int]] = {}
    for name, number in counted.values():
        alike.setdefault(_family(name, number), set()).add(number)
    zeros = [numbers for numbers in alike.values() if 0 in numbers]
    joints = joints or max((max(numbers) + 1 for numbers in zeros), default=0)
    families = {
        key for key, numbers in alike.items() if 0 in numbers or ((zeros or zero) and (max(numbers) < joints or not joints))
    }
    return {column for column, (name, number) in counted.items() if _family(name, number) in families}


def _family(name: str, number: int) -> str:
    words = tokens_of(name)
    place = len(words) - 1 - words[::-1].index(str(number)) if str(number) in words else None
    return " ".join("#" if i == place else word for i, word in enumerate(words))


def one_behind(names: Sequence[str], joints: Sequence[str]) -> bool:
    """Whether a file's joint_0, joint_1 are the simulation's joint_1, joint_2: by their names they would be others."""
    if not joints or [re.sub(r".*?(\d*)$", r"\1", joint) for joint in joints] != [str(i + 1) for i in range(len(joints))]:
        return False
    stem = joints[0].removesuffix("1")
    named = {number for number in range(len(joints) + 1) for name in names if find_joint(name, [f"{stem}{number}"])[0]}
    return 0 in named and len(joints) not in named
