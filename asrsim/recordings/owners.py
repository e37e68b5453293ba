"""Joint to which a column belongs, by the name of a joint or a number in the column's name."""

from __future__ import annotations

import re
from collections.abc import Sequence

from asrsim.recordings.words import LETTERS, WORDS, DoubtError, is_known, spaced, tokens_of


def find_joint(name: str, joints: Sequence[str]) -> tuple[str | None, str]:
    """Joint whose name is part of the column's name, and the rest of the column's name. The joint is None if there is no such
    joint.

    A known word may follow the joint's name without a gap, as in `kneepos`. A joint's name of one letter must be a separate
    word. If the letter also has another meaning, as in `q_des`, it must be the first word, and a known word must follow.
    """
    text = spaced(name)
    for joint in sorted(joints, key=len, reverse=True):
        pattern = r"[\W_]*".join(map(re.escape, tokens_of(joint))) or re.escape(joint)
        match = re.search(rf"(?<![^\W_]){pattern}(?![0-9])(?P<next>[^\W\d_]*)", text, re.IGNORECASE)
        if match is None:
            continue
        following, rest = match["next"].lower(), text[match.end() :]
        letter = len(joint) == 1 and (joint.lower() in LETTERS or joint.lower() in WORDS)
        if (following and (len(joint) == 1 or not is_known(following))) or (
            letter and (match.start() or not any(map(is_known, tokens_of(rest))))
        ):
            continue
        return joint, f"{text[: match.start()]} {match['next']}{rest}"
    return None, name


def joint_of(number: int | None, joints: Sequence[str] | None, *, indexed: bool) -> str:
    """Joint with this number. indexed: whether joints are counted from 0, as in an array. Raises DoubtError if the number is
    ambiguous.
    """
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
    raise DoubtError(f"the number {number} in its name does not clearly mean one of {', '.join(joints[:8])}")
