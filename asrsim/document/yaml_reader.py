"""Reads YAML 1.2 into nodes with lines. Rejects duplicate keys, and documents that are too large or too deep."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from asrsim.document.node import Node
from asrsim.errors import InputError, Problem, similar_file

MAX_BYTES = 2_000_000
"""Largest size of a document, bytes; a usual scenario has some thousand bytes."""
MAX_DEPTH = 40
"""Largest number of lists and mappings that are nested in each other."""
MAX_NODES = 200_000
"""Largest number of values after the expansion of aliases."""

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_HALF = re.compile("[\ud800-\udfff]")
_WORDS = {
    "": None,
    "~": None,
    "null": None,
    "true": True,
    "false": False,
    ".inf": math.inf,
    "+.inf": math.inf,
    "-.inf": -math.inf,
    ".nan": math.nan,
}
"""Values of unquoted words by the core schema of YAML 1.2; the words are in lower case."""

_PLAIN = "plain"
"""Tag of scalars that have neither quotes nor a tag: only these may be numbers, booleans or null."""


def plain_scalar(text: str) -> bool | int | float | str | None:
    """Value of an unquoted scalar by the core schema of YAML 1.2: `1e-3` is a number, `on` and `yes` are text."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) < 400 else float(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def read_yaml(path: Path, *, error: type[InputError] = InputError, faults: list[Problem] | None = None) -> tuple[Node, str]:
    """Root node and text of a YAML file. Raises `error` if the file is unreadable or invalid. faults: as in `parse_yaml`."""
    try:
        # Pipes and devices have no known size, so limit the number of bytes that are read.
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise error(f"is larger than the limit of {MAX_BYTES} bytes", file=path, code="too-large")
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise error(f"is not UTF-8 text ({fault.reason})", file=path, code="encoding") from None
    except OSError as fault:
        raise error(f"cannot be read: {fault.strerror}", file=path, hint=similar_file(path), code="no-file") from None
    return parse_yaml(text, file=path, error=error, faults=faults), text


def parse_yaml(
    text: str, *, file: Path | None = None, error: type[InputError] = InputError, faults: list[Problem] | None = None
) -> Node:
    """Root node of a YAML text. Raises `error` with the first syntax error, or with every duplicate key.

    faults: list that receives duplicate keys and similar problems. They then raise no error, and the caller can report all
    problems together.
    """
    import yaml

    converter = _Converter(file)
    try:
        root = _composed(text)
        node = Node(None, 1) if root is None else converter.convert(root, 0)
    except (yaml.YAMLError, RecursionError, _Refused) as fault:
        mark = getattr(fault, "problem_mark", None) or getattr(fault, "context_mark", None)
        said = getattr(fault, "problem", None) or getattr(fault, "context", None) or " ".join(str(fault).split())
        if isinstance(fault, RecursionError):
            said = "it is nested too deeply"
        tabs = " (indent with blanks, not tabs)" if "tab" in said or "'\\t'" in said else ""
        raise error(f"is not valid YAML: {said}{tabs}", file=file, line=mark.line + 1 if mark else None, code="yaml") from None
    if faults is not None:
        faults += converter.problems
    elif converter.problems:
        raise error(converter.problems)
    return node


class _Refused(Exception):  # noqa: N818 - internal signal, not an error of the tree
    """Raised for a document that exceeds a limit of size, depth or number of values."""


class _Converter:
    """Converts PyYAML's nodes to `Node`. Aliases may share a node of PyYAML."""

    def __init__(self, file: Path | None) -> None:
        self.file = file
        self.problems: list[Problem] = []
        self.count = 0

    def convert(self, node: Any, depth: int) -> Node:
        self.count += 1
        if self.count > MAX_NODES:
            raise _Refused(f"it has more than {MAX_NODES} values after expanding its aliases")
        if depth > MAX_DEPTH:
            raise _Refused(f"it is nested more than {MAX_DEPTH} levels deep")
        line = node.start_mark.line + 1
        if node.tag not in ("", _PLAIN):
            self._complain(f"YAML tag {node.tag} is not supported", line)
        if node.id == "scalar":
            self._whole(node.value, line)
            return Node(plain_scalar(node.value) if node.tag == _PLAIN else str(node.value), line, file=self.file)
        if node.id == "sequence":
            return Node([self.convert(item, depth + 1) for item in node.value], line, file=self.file)
        return self._mapping(node, line, depth)

    def _mapping(self, node: Any, line: int, depth: int) -> Node:
        items: dict[str, Node] = {}
        lines: dict[str, int | None] = {}
        for key_node, value_node in node.value:
            key_line = key_node.start_mark.line + 1
            if key_node.id != "scalar":
                self._complain("a key must be plain text", key_line)
                continue
            key = str(key_node.value)
            if key == "<<" and key_node.tag == _PLAIN:
                self._complain("merge keys (<<) are not read: repeat the keys, or use an alias for the whole value", key_line)
                continue
            self._whole(key, key_line)
            value = self.convert(value_node, depth + 1)
            if key in items:
                self._complain(
                    f"the key is a duplicate of the key in line {lines[key]}", key_line, key=key, code="duplicate-key"
                )
            else:
                items[key], lines[key] = value, key_line
        return Node(items, line, lines, self.file)

    def _whole(self, text: str, line: int) -> None:
        """Reject surrogates (halves of characters, from JSON escapes), which no file name, log or terminal can contain."""
        if half := _HALF.search(text):
            raise _Refused(f"\\u{ord(half[0]):04x} in line {line} is half a character (a surrogate), which is not allowed")

    def _complain(self, message: str, line: int, *, key: str | None = None, code: str = "yaml") -> None:
        self.problems.append(Problem(message, file=self.file, line=line, key=key, code=code))


def _composed(text: str) -> Any:
    """PyYAML's root node of the text; None if the text is empty.

    libyaml is four times as fast as PyYAML's own parser. A text that libyaml rejects is parsed again by PyYAML, so that error
    messages do not depend on libyaml.
    """
    import yaml

    if yaml.__with_libyaml__:
        with suppress(yaml.YAMLError, UnicodeEncodeError):
            return _loader(yaml.CSafeLoader)(text).get_single_node()
    return _loader(yaml.SafeLoader)(text).get_single_node()


def _loader(base: Any) -> Any:
    """Parser class with a limit on the nesting depth, and without the implicit types of YAML 1.1, such as `on` for true."""
    import yaml

    class Loader(base):  # type: ignore[misc]
        depth = 0

        def descend_resolver(self, parent: Any, index: Any) -> None:
            self.depth += 1
            if self.depth > MAX_DEPTH:
                raise _Refused(f"it is nested more than {MAX_DEPTH} levels deep")

        def ascend_resolver(self) -> None:
            self.depth -= 1

        def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
            return _PLAIN if kind is yaml.ScalarNode and implicit[0] else ""

    return Loader
