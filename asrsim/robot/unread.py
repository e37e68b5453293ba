"""Warns about the words (elements and attributes) of a robot file that asrsim does not read. There is one warning for each word
and file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from asrsim.errors import counted, nearest
from asrsim.robot.blocks import is_block
from asrsim.robot.findings import Findings
from asrsim.robot.vocabulary import PLUGINS, SILENT_PLUGINS, UNKNOWN_PLUGIN, WORDS, Effect, Word
from asrsim.robot.xmlfile import elements, name_of, text_of

SEVERAL = {
    "link", "joint", "material", "visual", "collision", "inertial", "gazebo", "transmission", "sensor", "ros2_control",
    "actuator", "plugin", "loop_joint", "param", "command_interface", "state_interface",
}  # fmt: skip
"""Elements that may be repeated, or whose repetition is reported elsewhere."""
OPEN = ("ros2_control joint", "command_interface", "gazebo", "transmission", "actuator", "ros2_control", "mujoco", "compiler")
"""Elements that contain words of other programs. In these elements, words may be repeated."""


@dataclass(frozen=True, kw_only=True)
class _Use:
    """Use of a word in a file."""

    effect: Effect
    element: Any
    place: str
    """Dotted path in messages."""
    hint: str | None


def check_words(findings: Findings, root: Any) -> tuple[str, ...]:
    """Warn about words that are unknown, repeated, or left out although they would change the motion.

    Returns the words that act only in contacts, and therefore have no effect in asrsim.
    """
    uses: dict[tuple[str, str], list[_Use]] = {}
    contact: dict[str, None] = {}
    for parent, name, word, element, place in _walk(findings, root):
        effect = word.effect(element, value_of(element, name)) if word.effect else None
        if effect is not None:
            use = _Use(effect=effect, element=element, place=place, hint=word.hint)
            uses.setdefault((parent, name), []).append(use)
        if word.use == "contacts":
            contact[name.removeprefix("@")] = None
    for found in uses.values():
        worst = max(found, key=lambda use: use.effect.size)
        more = f" (and at {counted(len(found) - 1, 'other place')})" if len(found) > 1 else ""
        findings.warn(worst.effect.text + more, worst.element, worst.place, code="left-out", hint=worst.hint)
    return tuple(contact)


def value_of(element: Any, name: str) -> str:
    """Value of a word as text: the value of an attribute (`@name`), or the `value` or text of an element."""
    text: str = element.get(name[1:], "") if name.startswith("@") else element.get("value") or text_of(element)
    return text.strip()


_Known = tuple[str, str, Word, Any, str]
"""A known word: parent, name, word, element, place."""


def _walk(findings: Findings, root: Any) -> list[_Known]:
    """Known words of a robot. Unknown and repeated words get warnings."""
    found: list[_Known] = []
    _add_words(found, findings, root, "robot", "")
    return found


def _add_words(found: list[_Known], findings: Findings, element: Any, kind: str, place: str) -> None:
    for attribute in element.attrib:
        name = f"@{_local(element, str(attribute))}"
        word = _word(kind, name)
        if word is not None:
            found.append((kind, name, word, element, place))
        else:
            shown = name.removeprefix("@")
            _unknown(findings, element, "attribute", shown, kind, f"{place}.{shown}" if place else shown)
    seen = set()
    for child in elements(element):
        name = _local(element, child.tag)
        inner = _place(child, name, kind, place)
        if name in seen:
            message = f"a second <{name}> of one <{kind}>; only the first has an effect"
            findings.warn(message, child, place, code="repeated-element")
        word = _word(kind, name)
        if word is None:
            if kind != "geometry":
                _unknown(findings, child, "element", name, kind, f"{place}.{name}" if place else name)
            continue
        seen |= set() if kind in OPEN else {name} - SEVERAL
        if word.inside == "plugin":
            plugin = _plugin(child)
            if plugin is not None:
                shared = "plugin" if plugin is UNKNOWN_PLUGIN else name_of(child, "filename")
                found.append((kind, shared, plugin, child, name_of(child) or "plugin"))
        else:
            found.append((kind, name, word, child, inner))
            if word.inside is not None:
                _add_words(found, findings, child, word.inside, inner)


def _word(kind: str, name: str) -> Word | None:
    """Word with this name below its parent, or the word for all names with its prefix; None if there is none."""
    return WORDS[kind].get(name) or WORDS[kind].get(f"{name.partition(':')[0]}:*")


def _place(element: Any, name: str, kind: str, place: str) -> str:
    if kind == "robot":
        return name_of(element) or name_of(element, "reference") or name
    return f"{place}.{name}"


def _plugin(element: Any) -> Word | None:
    """Word of a plugin that moves or couples bodies in Gazebo, or that is unknown; None for plugins without physics, and for
    blocks of actuators.
    """
    filename = name_of(element, "filename").lower().replace("-", "_")
    acts = next((word for parts, word in PLUGINS if any(part in filename for part in parts)), None)
    silent = acts or SILENT_PLUGINS.search(filename) or is_block(element)
    return acts if silent else UNKNOWN_PLUGIN


def _unknown(findings: Findings, element: Any, what: str, name: str, kind: str, place: str) -> None:
    attribute = what == "attribute"
    known = tuple(
        word.removeprefix("@")
        for word, entry in WORDS[kind].items()
        if entry.use == "read" and word.startswith("@") == attribute
    )
    present = set(element.attrib) if attribute else {child.tag for child in elements(element.getparent())} - SEVERAL
    close = nearest(name.lower(), [word for word in known if word not in present])
    shown, meant = (f"'{name}'", f"'{close}'") if attribute else (f"<{name}>", f"<{close}>")
    findings.warn(
        f"unknown {what} {shown}; it has no effect",
        element,
        place,
        code=f"unknown-{what}",
        hint=f"Did you mean {meant}?" if close else None,
        choices=() if close or kind in OPEN else known,
    )


def _local(element: Any, name: str) -> str:
    """Name as in the file, with the prefix of its name space."""
    if not name.startswith("{"):
        return name
    space, _, local = name[1:].partition("}")
    prefix = next((prefix for prefix, uri in element.nsmap.items() if uri == space and prefix), None)
    return f"{prefix}:{local}" if prefix else local
