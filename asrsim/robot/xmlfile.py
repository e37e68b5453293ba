"""Reads hostile XML safely: no entities, no DTD, no network, limited size and depth."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.parsers import expat

from lxml import etree

from asrsim.document.file import lfs_pointer, mistaken
from asrsim.errors import Problem, RobotError, similar_file
from asrsim.robot.mending import mended

_SPACED_TAG = re.compile(r"</?(\w+(?: +\w+)+)\s*>")
"""Tag whose name has spaces, as figures print them: `<spring a1>`."""
MAX_BYTES = 64 * 1024 * 1024
"""Largest size of a robot file, bytes."""
BLANKS = " \t\r\n"
"""White space in XML; other blanks, such as non-breaking spaces, are ordinary characters."""


def read_bytes(path: Path) -> bytes:
    """Content of the file. Raises RobotError if the file is missing, no regular file, unreadable or too large."""
    try:
        if not path.exists():
            raise RobotError("no such file", file=path, hint=similar_file(path), code="missing-file")
        if not path.is_file():
            raise RobotError("is not a file", file=path, code="not-a-file")
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise RobotError(f"cannot be read: {error.strerror or error}", file=path, code="unreadable-file") from error
    if len(data) > MAX_BYTES:
        raise RobotError(f"is larger than {MAX_BYTES // 2**20} MB", file=path, code="file-too-large")
    return data


def parse_xml(data: bytes, path: Path, *, large: bool = False, notes: list[Problem] | None = None) -> Any:
    """Root element of the document (lxml), without a default name space. Raises RobotError with the line for malformed or
    hostile XML.

    Files that ROS and Gazebo read are mended where they are not well-formed. large: texts of more than 10 MB are valid, as in
    meshes. notes: list to which warnings about mended faults are added.
    """
    # Replace the XML version 0.0, which PyBullet's tools write although it does not exist.
    data = re.sub(rb"^(\s*<\?xml\s+version=[\"'])0\.0(?=[\"'])", rb"\g<1>1.0", data, count=1)
    found: list[Problem] = []
    try:
        root = _parsed(data, path, large=large)
    except RobotError as error:
        data, found = mended(data, path)
        if not found or error.problems[0].code != "malformed-xml":
            raise
        try:
            root = _parsed(data, path, large=large)
        except RobotError as second:
            raise error if second.problems[0].code == "malformed-xml" else second from None
    found += _without_default_space(root, path)
    if notes is not None:
        notes += found
    return root


def _parsed(data: bytes, path: Path, *, large: bool) -> Any:
    _refuse_declarations(data, path)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=large, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        reason = (error.msg or "not well-formed").split(", line ")[0]
        raise _malformed(path, data, reason, error.lineno or None) from error
    # Check again with lxml, since the check with expat (`_refuse_declarations`) may have missed declarations.
    declarations = root.getroottree().docinfo.internalDTD
    if declarations is not None and any(True for _ in declarations.iterentities()):
        raise _declares(path, None)
    return root


def _without_default_space(root: Any, path: Path) -> list[Problem]:
    """Remove the names of a robot's elements from the default name space. Returns a warning if the file has a default name
    space."""
    space = root.nsmap.get(None)
    if space is None or root.tag != f"{{{space}}}robot":
        return []
    for element in root.iter():
        if isinstance(element.tag, str) and element.tag.startswith(f"{{{space}}}"):
            element.tag = element.tag.rpartition("}")[2]
    etree.cleanup_namespaces(root, keep_ns_prefixes=[prefix for prefix in root.nsmap if prefix])
    message = "the default name space (xmlns) has no meaning in a URDF: it is ignored"
    return [Problem(message, file=path, line=root.sourceline, value=space, code="default-xmlns")]


def _declares(path: Path, line: int | None) -> RobotError:
    return RobotError(
        "XML declares entities or a document type; such files are refused",
        file=path,
        line=line,
        code="xml-declarations",
        hint="Remove the <!DOCTYPE ...>",
    )


class _RootReachedError(Exception):
    """Raised at the end of the prolog, to stop the parser."""


def _refuse_declarations(data: bytes, path: Path) -> None:
    """Raise RobotError for a document type with declarations (entities)."""
    parser = expat.ParserCreate()

    def document_type(_name: str, _system: str | None, _public: str | None, has_internal_subset: int) -> None:
        if has_internal_subset:
            raise _declares(path, parser.CurrentLineNumber)

    def root(_name: str, _attributes: dict[str, str]) -> None:
        raise _RootReachedError

    parser.StartDoctypeDeclHandler = document_type
    parser.StartElementHandler = root
    try:
        parser.Parse(data, True)
    except _RootReachedError:
        return
    except (LookupError, ValueError) as error:
        # Python supports encodings that its XML parser does not support, such as UTF-7 and multi-byte encodings. They raise
        # errors of different types.
        message = "the XML declaration names an encoding that cannot be read"
        hint = "Save the file as UTF-8"
        raise RobotError(message, file=path, line=1, value=str(error), hint=hint, code="encoding") from error
    except expat.ExpatError as error:
        raise _malformed(path, data, expat.ErrorString(error.code), error.lineno) from error


def _malformed(path: Path, data: bytes, reason: str, line: int | None) -> RobotError:
    other = mistaken(path, "robot")
    text = data.splitlines()[line - 1].decode(errors="replace") if line and line <= len(data.splitlines()) else ""
    spaced = _SPACED_TAG.search(text)
    hint = f"Names of tags have no spaces: write <{re.sub(' +', '_', spaced[1])}>" if spaced else None
    malformed = Problem(f"XML is not well-formed: {reason}", file=path, line=line, hint=hint, code="malformed-xml")
    pointer = lfs_pointer(data, "robot")
    problem = other or malformed if pointer is None else replace(pointer, file=path)
    return RobotError([problem])


def text_of(element: Any) -> str:
    """Text of the element without comments and surrounding blanks."""
    parts = [element.text or ""]
    parts.extend(child.tail or "" for child in element)
    return "".join(parts).strip(BLANKS)


def name_of(element: Any, key: str = "name") -> str:
    """Attribute that contains a name, without surrounding blanks; empty if it is absent."""
    text: str = (element.get(key) or "").strip(BLANKS)
    return text


def elements(parent: Any, tag: str | None = None) -> list[Any]:
    """Child elements without comments: all, or only the elements with a given tag."""
    return list(parent.iterchildren("*" if tag is None else tag))
