"""Which numbers in columns' names count joints from 0: those of arrays mostly do, people's do not, and a file may have both."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from asrsim.recordings.names import VOCABULARY, Guess, find_joint, tokens_of

_SIDES = {"left", "right"}


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


def settled(meanings: Mapping[int, Guess], known: Sequence[str]) -> dict[int, Guess]:
    """Meanings of names with several numbers (`arm2_q1`) with their joint, where the simulation has one of these numbers, or
    with the last number, where the others are the same in all of the file and no quantity's own (`UR5_q1`).
    """
    several = {i: meaning for i, meaning in meanings.items() if meaning.quantity and meaning.numbers}
    before = {meaning.numbers[:-1] for meaning in several.values()}
    result = dict(meanings)
    for i, meaning in several.items():
        numbers = [str(number) for _, number in meaning.numbers]
        fitting = [joint for joint in known if [word for word in tokens_of(joint) if word.isdecimal()] == numbers]
        if len(fitting) == 1:
            result[i] = replace(meaning, joint=fitting[0], numbers=())
        elif len(before) == 1 and not any(word in VOCABULARY for word, _ in meaning.numbers[:-1]):
            result[i] = replace(meaning, number=meaning.numbers[-1][1], numbers=())
    return result


def unclear(meanings: Mapping[int, Guess], names: Sequence[str], joints: Sequence[str]) -> set[int]:
    """Columns of which it is not clear which joint their number means.

    Of names with several numbers; of `q0, q1, q2` for two joints, where the first or the last is of none; of `joint_0` beside
    joints that the simulation has by their names; of two sides (`left_q1`, `right_q1`) that no joint is called by.
    """
    found = {i for i, meaning in meanings.items() if meaning.quantity and meaning.numbers}
    alike: dict[str, dict[int, int]] = {}
    by_name: set[str] = set()
    for i, meaning in meanings.items():
        if meaning.quantity and meaning.number is not None:
            alike.setdefault(_family(names[i], meaning.number), {})[meaning.number] = i
        elif meaning.quantity and meaning.joint and (last := re.search(r"(\d+)$", meaning.joint)):
            by_name.add(_family(names[i], int(last[1])))
    for family, places in alike.items():
        if joints and set(places) == set(range(len(joints) + 1)):
            found |= set(places.values())
        if 0 in places and family in by_name:
            found.add(places[0])
    sides = {word for meaning in meanings.values() if meaning.quantity for word in meaning.words} & _SIDES
    called = {word for joint in joints for word in tokens_of(joint)}
    if sides == _SIDES and joints and not called & _SIDES:
        found |= {
            i for i, meaning in meanings.items() if meaning.quantity and sides & {*meaning.words} and meaning.joint is None
        }
    return found
