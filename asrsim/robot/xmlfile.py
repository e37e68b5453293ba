"""Reads a stranger's XML without letting it do anything: no entities, no DTD, no network, bounded size and depth."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.parsers import expat

from lxml import etree

from asrsim.document.mistaken import mistaken
from asrsim.errors import Problem, RobotError, similar_file

MAX_BYTES = 64 * 1024 * 1024
"""Of a robot's file."""
BLANKS = " \t\r\n"
"""What XML calls white space; any other blank (a non-breaking space) is a character like every other."""


def read_bytes(path: Path) -> bytes:
    """The file's content; raises RobotError if it is missing, no plain file, unreadable or too large."""
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


def parse_xml(data: bytes, path: Path, *, large: bool = False) -> Any:
    """Root element of the document (lxml); raises RobotError with the line for malformed or hostile XML.

    large: texts of more than 10 MB are allowed, as meshes have them; the size of the file bounds them.
    """
    # PyBullet's own tools write a version that XML does not have.
    data = re.sub(rb"^(\s*<\?xml\s+version=[\"'])0\.0(?=[\"'])", rb"\g<1>1.0", data, count=1)
    _refuse_declarations(data, path)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=large, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        reason = (error.msg or "not well-formed").split(", line ")[0]
        raise _malformed(path, reason, error.lineno or None) from error
    # expat looked above; lxml may see declarations that expat did not.
    declarations = root.getroottree().docinfo.internalDTD
    if declarations is not None and any(True for _ in declarations.iterentities()):
        raise _declares(path, None)
    return root


def _declares(path: Path, line: int | None) -> RobotError:
    return RobotError(
        "XML declares entities or a document type; such files are refused",
        file=path,
        line=line,
        code="xml-declarations",
        hint="Take the <!DOCTYPE ...> out",
    )


class _RootReachedError(Exception):
    """Ends the look at the prolog."""


def _refuse_declarations(data: bytes, path: Path) -> None:
    """Raise RobotError for a document type with declarations (entities): they are only allowed before the root."""
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
        # Python knows encodings (UTF-7, multi-byte ones) that its parser cannot use, and fails on each in a way of its own.
        message = "the XML declaration names an encoding that cannot be read"
        hint = "Save the file as UTF-8"
        raise RobotError(message, file=path, line=1, value=str(error), hint=hint, code="encoding") from error
    except expat.ExpatError as error:
        raise _malformed(path, expat.ErrorString(error.code), error.lineno) from error


def _malformed(path: Path, reason: str, line: int | None) -> RobotError:
    other = mistaken(path, "robot")
    problem = other or Problem(f"XML is not well-formed: {reason}", file=path, line=line, code="malformed-xml")
    return RobotError([problem])


def text_of(element: Any) -> str:
    """The element's own text without comments, stripped."""
    parts = [element.text or ""]
    parts.extend(child.tail or "" for child in element)
    return "".join(parts).strip(BLANKS)


def name_of(element: Any, key: str = "name") -> str:
    """An attribute that names something, without the blanks around it; empty if it is absent."""
    text: str = (element.get(key) or "").strip(BLANKS)
    return text


def elements(parent: Any, tag: str | None = None) -> list[Any]:
    """Child elements (no comments), all or those of one tag."""
    return [child for child in parent if isinstance(child.tag, str) and (tag is None or child.tag == tag)]
