"""Columns of joint names, as in JointState messages that were written as text. For example, `name0` contains the name of the
joint to which `position0` belongs.

Programs of ROS write such messages in three formats: a column for each entry (`rostopic echo -p`), a list in a cell (bagpy,
pandas), and a column for each entry but no header (`ros2 topic echo --csv`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from asrsim.errors import Problem, counted, listed, printable
from asrsim.recordings.data import RawColumn, RawTable, unique

MOST = 64
"""Largest number of entries of a list in a cell, and largest number of joints in the columns of names."""
_LIST = re.compile(r"array\(\s*(?:'[a-zA-Z]'\s*,\s*)?\[(?P<inner>.*)\]\s*\)|[\[(](?P<all>.*)[\])]", re.DOTALL)
"""Pattern of a list in a cell: `[1, 2]`, `(1.0, 2.0)`, `['a', 'b']`, `[1. 2.]`, `array('d', [1.0, 2.0])`."""
_ENTRY = re.compile(r"""b?'((?:[^'\\]|\\.)*)'|b?"((?:[^"\\]|\\.)*)"|([^\s,;]+)""")
_NAME = re.compile(r"(?P<head>(?:.*?[./_ ])?)(?:joint_?)?names?(?P<place>\d+|[\[(]\d+[\])])", re.IGNORECASE)
"""Pattern of the header of a column of names, such as `field.name0` or `name[0]`."""
_FIELDS = ("position", "velocity", "effort")
"""Arrays that follow the array of names in a message of type sensor_msgs/JointState."""


def entries(cell: str) -> list[str] | None:
    """Entries of a list in a cell, without quotes; None for a cell that is not a list."""
    if cell[:1] not in ("[", "(", "a") or (found := _LIST.fullmatch(cell)) is None:
        return None
    inner = found["all"] if found["inner"] is None else found["inner"]
    return [re.sub(r"\\(.)", r"\1", one or two) if one or two else plain for one, two, plain in _ENTRY.findall(inner)]


def list_widths(rows: Sequence[Sequence[str]]) -> dict[int, int]:
    """Number of list entries for each column whose cells are lists, by the column's index. rows: first rows of a table."""
    if not rows:
        return {}
    columns = Counter(map(len, rows)).most_common(1)[0][0]
    whole = [row for row in rows if len(row) == columns]
    found = {}
    for i in range(columns):
        sizes = [len(one) for row in whole if (one := entries(row[i])) is not None]
        if 2 * len(sizes) > len(whole) - 2 and sizes and 0 < max(sizes) <= MOST:
            found[i] = max(sizes)
    return found


def spread(cells: list[str], widths: Mapping[int, int]) -> list[str]:
    """Cells of a row, in which a separate cell for each entry replaces a list. A header `position` becomes `position[0]`,
    `position[1]`, ...
    """
    if not widths or len(cells) <= max(widths):
        return cells
    result: list[str] = []
    for i, cell in enumerate(cells):
        if (width := widths.get(i)) is None:
            result.append(cell)
        elif (found := entries(cell)) is not None:
            result += found + [""] * (width - len(found))
        else:
            result += [f"{cell}[{place}]" if cell else "" for place in range(width)]
    return result


def name_columns(header: Sequence[str]) -> dict[int, list[int]]:
    """Indices of the columns that each column of names describes, by the index of the column of names. The columns have the
    same prefix and the same number as the column of names.
    """
    found: dict[int, list[int]] = {}
    for i, name in enumerate(header):
        if (match := _NAME.fullmatch(name.strip())) is None:
            continue
        pattern = re.compile(rf"{re.escape(match['head'])}(?:.*[./_ ])?[a-z_]*[a-z]{re.escape(match['place'])}", re.IGNORECASE)
        described = (other.strip() for other in header)
        found[i] = [j for j, other in enumerate(described) if pattern.fullmatch(other) and not _NAME.fullmatch(other)]
    # If no column of names describes another column, as with a single column `name0`, the columns are ordinary text.
    return found if any(found.values()) else {}


def message_names(cells: Sequence[str], kinds: Sequence[str]) -> list[str]:
    """Column names for a row of a JointState message that `ros2 topic echo --csv` prints without a header; an empty list for
    other rows.

    kinds: kind of each cell, as `asrsim.recordings.text.parse` returns it.
    """
    if len(cells) < 5 or not (cells[0].isdecimal() and cells[1].isdecimal() and int(cells[1][:12]) < 10**9):
        return []
    if cells[2] and kinds[2] != "text":
        return []
    joints = next((i for i, kind in enumerate(kinds[3:]) if kind != "text"), 0)
    arrays, rest = divmod(len(cells) - 3 - joints, joints or 1)
    if not joints or rest or not 1 <= arrays <= len(_FIELDS) or "text" in kinds[3 + joints :]:
        return []
    head = ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id"]
    return head + [f"{field}[{i}]" for field in ("name", *_FIELDS[:arrays]) for i in range(joints)]


def with_joints(table: RawTable, findings: list[Problem]) -> RawTable:
    """Table without columns of names. Its other columns state the joint that the names give.

    If the order of the names changes between rows, the values are sorted by the names. The table then has a column for each
    joint, such as `position[elbow]`. Values without a name become NaN.
    """
    columns = table.columns
    groups = {
        i: others for i, others in name_columns([one.name for one in columns]).items() if columns[i].values.dtype.kind == "U"
    }
    if not groups:
        return table
    cells = {i: columns[i].values.tolist() for i in groups}
    plain = {text: _plain(text) for rows in cells.values() for text in {*rows}}
    texts = {i: np.array([plain[text] for text in rows]) for i, rows in cells.items()}
    joints = [*dict.fromkeys(name for text in texts.values() for name in dict.fromkeys(text.tolist()) if name)]
    kept = [(i, one) for i, one in enumerate(columns) if i not in groups]
    if len(joints) > MOST:
        message = f"name {len(joints)} joints; expected up to {MOST}, so the names are not read"
        findings.append(Problem(message, key=listed([columns[i].name for i in groups], 6), code="text-column"))
        return replace(table, columns=tuple(one for _, one in kept))
    fixed = all(len({*text.tolist()} - {""}) <= 1 for text in texts.values())
    owner = {j: i for i, others in groups.items() for j in others}
    seen: Counter[str] = Counter()
    result: list[RawColumn] = []
    done: set[str] = set()
    repeated = np.zeros(len(columns[0].values), dtype=bool)  # rows in which a joint is named several times
    for j, column in kept:
        if j not in owner:
            result.append(replace(column, name=unique(column.name, seen)))
        elif fixed:
            text = texts[owner[j]]
            joint = next((name for name in text.tolist() if name), None)
            values = np.where(text == "", np.nan, column.values) if joint else column.values
            result.append(replace(column, name=unique(column.name, seen), values=values, joint=joint))
        elif (stem := _stem(column.name)) not in done:
            done.add(stem)
            parts = [(texts[owner[k]], other) for k, other in kept if k in owner and _stem(other.name) == stem]
            for joint in joints:
                values = np.full(len(column.values), np.nan)
                repeated |= np.sum([text == joint for text, _ in parts], axis=0) > 1
                for text, other in parts:
                    values = np.where(text == joint, other.values, values)
                if np.isfinite(values).any():
                    name = unique(f"{stem}[{joint}]", seen)
                    result.append(replace(column, name=name, values=values, joint=joint))
    if repeated.any():
        message = f"a joint is named several times in {counted(int(repeated.sum()), 'row')}; only the last value is kept"
        hint = "Record each joint once: asrsim cannot know which of its values is right"
        key = listed([columns[i].name for i in groups], 6)
        findings.append(Problem(message, key=key, hint=hint, code="repeated-name"))
    if not fixed:
        message = "the names of joints change between rows; each value counts for the joint that its row names"
        findings.append(Problem(message, key=listed([columns[i].name for i in groups], 6), code="names-change"))
    return replace(table, columns=tuple(result))


def _plain(text: str) -> str:
    """Name of a joint, without surrounding quotes and blanks."""
    found = _ENTRY.fullmatch(text.strip())
    return printable(((found[1] or found[2] or found[3]) if found else text.strip()) or "")


def _stem(name: str) -> str:
    return re.sub(r"(?:\d+|[\[(]\d+[\])])$", "", name)
