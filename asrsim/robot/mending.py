"""Mends the text of XML that is not well-formed but that ROS and Gazebo read, since their reader (TinyXML) is lenient."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from asrsim.errors import Problem

Mend = Callable[[bytes], tuple[bytes, str, int] | None]
"""Function that removes one kind of fault from a text. It returns the mended text, a phrase for the fault, and the fault's
line; None if the text lacks this fault.
"""

_BLANKS = b" \t\r\n"
_COMMENT = re.compile(rb"<!\[CDATA\[.*?\]\]>|<!--(.*?)-->", re.DOTALL)
_DECLARATION = re.compile(rb"<\?xml\s[^>]*?\?>")
_VERSION = re.compile(rb"""\bversion\s*=\s*(['"])(.*?)\1""")
_PREFIX = re.compile(rb"</?([A-Za-z_][\w.-]*):[A-Za-z_]|\s([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*\s*=")
_DECLARED = re.compile(rb"\bxmlns:([A-Za-z_][\w.-]*)\s*=")


def mended(data: bytes, path: Path) -> tuple[bytes, list[Problem]]:
    """Text without the faults that lenient readers accept, and a warning for each kind of fault. Lines stay where they are."""
    notes = []
    for mend in MENDS:
        found = mend(data)
        if found is not None:
            data, fault, line = found
            notes.append(
                Problem(f"{fault}; asrsim reads the file as ROS and Gazebo do", file=path, line=line, code="mended-xml")
            )
    return data, notes


def _late_declaration(data: bytes) -> tuple[bytes, str, int] | None:
    """Blanks and comments before `<?xml ...?>`: the declaration moves to the start."""
    start = 0
    while True:
        start += len(data[start:]) - len(data[start:].lstrip(_BLANKS))
        end = data.find(b"-->", start)
        if not data.startswith(b"<!--", start) or end < 0:
            break
        start = end + len(b"-->")
    declaration = _DECLARATION.match(data, start)
    if not start or declaration is None:
        return None
    text = declaration.group()
    moved = b" ".join(text.split()) + data[:start] + b"\n" * text.count(b"\n") + data[declaration.end() :]
    return moved, "blanks or comments stand before <?xml ...?>", 1 + data.count(b"\n", 0, start)


def _version(data: bytes) -> tuple[bytes, str, int] | None:
    """A declaration whose version is not an XML version, such as `<?xml version="1"?>`."""
    declaration = _DECLARATION.match(data)
    version = _VERSION.search(declaration.group()) if declaration else None
    if declaration is None or version is None or version[2] in (b"1.0", b"1.1"):
        return None
    stated = declaration.group()
    mended = stated[: version.start(2)] + b"1.0" + stated[version.end(2) :]
    return mended + data[declaration.end() :], f"the version in <?xml ...?> is '{version[2].decode()}', not '1.0'", 1


def _dashes(data: bytes) -> tuple[bytes, str, int] | None:
    """Two dashes within a comment, or a dash at its end."""
    first: list[int] = []

    def blanked(found: re.Match[bytes]) -> bytes:
        inner = found[1]
        if inner is None or (b"--" not in inner and not inner.endswith(b"-")):
            return found[0]
        first.append(found.start())
        return b"<!--" + inner.replace(b"-", b" ") + b"-->"

    text = _COMMENT.sub(blanked, data)
    return (text, "a comment contains --", 1 + data.count(b"\n", 0, first[0])) if first else None


def _undeclared(data: bytes) -> tuple[bytes, str, int] | None:
    """Prefixes of name spaces that the file does not declare, such as `drake:`."""
    plain = _without_comments(data)
    declared = {b"xml", b"xmlns", *_DECLARED.findall(plain)}
    used = {found[1] or found[2]: found.start() for found in reversed([*_PREFIX.finditer(plain)])}
    missing = [prefix for prefix in used if prefix not in declared]
    root = re.search(rb"<[A-Za-z_][\w.-]*", plain)
    if not missing or root is None:
        return None
    spaces = b"".join(b' xmlns:%s="%s"' % (prefix, prefix) for prefix in sorted(missing))
    names = ", ".join(f"'{prefix.decode()}:'" for prefix in sorted(missing))
    line = 1 + data.count(b"\n", 0, min(used[prefix] for prefix in missing))
    return data[: root.end()] + spaces + data[root.end() :], f"the name space of {names} is not declared", line


def _without_comments(data: bytes) -> bytes:
    """Text of the same length with blanks in the place of comments."""
    return _COMMENT.sub(lambda found: b" " * len(found[0]), data)


def _encoding(data: bytes) -> tuple[bytes, str, int] | None:
    """Bytes that are not UTF-8 in a file that states no other encoding."""
    declaration = _DECLARATION.match(data)
    if declaration is not None and b"encoding" in declaration.group() and b"utf-8" not in declaration.group().lower():
        return None
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = 1 + data.count(b"\n", 0, error.start)
        return data.decode("utf-8", errors="replace").encode(), "the file has bytes that are not UTF-8", line
    return None


def _tail(data: bytes) -> tuple[bytes, str, int] | None:
    """Text after the end of the root element."""
    end = _without_comments(data).find(b"</robot>") + len(b"</robot>")
    rest = _COMMENT.sub(b"", data[end:]).strip(_BLANKS) if end >= len(b"</robot>") else b""
    return (data[:end] + b"\n", "the file has text after </robot>", 1 + data.count(b"\n", 0, end)) if rest else None


MENDS: tuple[Mend, ...] = (_encoding, _late_declaration, _version, _dashes, _undeclared, _tail)
