"""Tables of the documentation, from the declarations of keys, signals and measures."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import asrsim
from asrsim.actuators import MODES
from asrsim.document.block import Block
from asrsim.document.kinds import Either, Key, Kind, ListOf, MapOf
from asrsim.identification import CAUSES
from asrsim.metrics.measures import MEASURES
from asrsim.plots import FIGURES
from asrsim.recordings.reading import READING, TIME
from asrsim.robot.vocabulary import PLUGINS, SILENT_PLUGINS, UNKNOWN_PLUGIN, WORDS
from asrsim.scenario.data import KEYS, VARIANTS
from asrsim.signals import SIGNALS
from asrsim.signals.parse import block_of
from asrsim.sweeps.samplers import SAMPLERS


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; pipes in cells are escaped."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def key_table(keys: Iterable[Key]) -> str:
    """Key, value, unit, default and meaning, a row a key."""
    rows = [(f"`{key.name}`", key.kind.text, key.unit, default_text(key).strip(), key.doc) for key in keys]
    return markdown_table(("key", "value", "unit", "default", "meaning"), rows)


def default_text(key: Key) -> str:
    """Text of a key's default."""
    if key.required:
        return "required"
    if key.shown:
        return key.shown
    value = key.default
    if value is None or value in ({}, ()):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"[{', '.join(f'{item:g}' for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _blocks() -> dict[str, Block[Any]]:
    """Every block within the scenario's keys, by the places where it may stand."""
    places: dict[int, tuple[list[str], Block[Any]]] = {}

    def walk(kind: Kind[Any], place: str) -> None:
        if isinstance(kind, Block):
            places.setdefault(id(kind), ([], kind))[0].append(place)
            for key in kind.keys:
                walk(key.kind, f"{place}.{key.name}")
        for inner in kind.options if isinstance(kind, Either) else ():
            walk(inner, place)
        if isinstance(kind, ListOf | MapOf):
            walk(kind.of, place + ("[]" if isinstance(kind, ListOf) else f".<{kind.noun}>"))

    for key in KEYS:
        walk(key.kind, key.name)
    return {", ".join(names): block for names, block in places.values()}


def scenario_tables() -> dict[str, str]:
    """Name of a generated part -> its Markdown."""
    return {
        "scenario-keys": key_table((*KEYS, VARIANTS)),
        "reading-keys": key_table(READING.keys),
        "reading-time": key_table(TIME.keys),
        "scenario-blocks": "\n\n".join(f"### `{name}`\n\n{key_table(block.keys)}" for name, block in _blocks().items()),
        "references": _reference_table(),
        "signals": _signal_list(),
        "signal-keys": "\n\n".join(_signal_section(name) for name in SIGNALS),
    }


def _reference_table() -> str:
    rows = [
        (str(mode.number), mode.name, *(f"`{name}` ({unit})" for name, unit in zip(mode.references, mode.units, strict=True)))
        for mode in MODES.values()
    ]
    return markdown_table(("mode", "name", "first reference", "second reference"), [(*row, "")[:4] for row in rows])


def _signal_list() -> str:
    rows = [(f"[`{name}`](#{name})", block_of(SIGNALS.get(name)).doc) for name in SIGNALS]
    return markdown_table(("signal", "what"), rows)


def _signal_section(name: str) -> str:
    cls = SIGNALS.get(name)
    block = block_of(cls)
    short = f"\n\n`{name}: ...` without keys means `{block.main}`." if block.main else ""
    return f"### {name}\n\n{block.doc}{short}\n\n{key_table(block.keys)}"


NEEDS = {"series": "one series", "pair": "two series", "either": "two series, or a target", "poses": "a body's poses"}


def measure_table() -> str:
    """Every measure with what it is taken of, its unit, definition and options."""
    rows = []
    for name in MEASURES:
        found = MEASURES.get(name)
        options = (
            f"`{key}`" + ("" if default in (None, inspect.Parameter.empty) else f" = {default}")
            for key, default in found.options.items()
        )
        unit = {"series": "of the series", "1": "-"}.get(found.unit, found.unit)
        rows.append((f"`{name}`", NEEDS[found.needs], unit, found.doc, ", ".join(options)))
    return markdown_table(("measure", "of", "unit", "definition", "options"), rows)


def sampler_table() -> str:
    """Every sampler of a study with what it is."""
    return markdown_table(("sampler", "draws"), [(f"`{name}`", SAMPLERS.get(name).title) for name in SAMPLERS])


def cause_table() -> str:
    """Every cause of a misfit that a fit tries."""
    return markdown_table(("causes", "what"), [(f"`{name}`", CAUSES.get(name).title) for name in CAUSES])


def figure_table() -> str:
    """Every figure of runs with what it shows."""
    return markdown_table(("figure", "what it shows"), [(f"`{name}`", FIGURES.get(name).title) for name in FIGURES])


def word_tables() -> dict[str, str]:
    """What asrsim does with each word of a robot file, by parent: words with equal meaning share a row."""
    rows = []
    for parent, words in WORDS.items():
        groups: dict[tuple[str, str], list[str]] = {}
        for name, word in words.items():
            groups.setdefault((word.use, word.doc if word.use == "left out" else ""), []).append(f"`{name}`")
        rows += [(f"`{parent}`", ", ".join(names), use, doc) for (use, doc), names in groups.items()]
    plugins = [(", ".join(f"`{part}`" for part in parts), word.use, word.doc) for parts, word in PLUGINS]
    silent = ", ".join(f"`{part}`" for part in SILENT_PLUGINS.pattern.split("|"))
    plugins += [(silent, "no physics", ""), ("any other", UNKNOWN_PLUGIN.use, UNKNOWN_PLUGIN.doc)]
    return {
        "words": markdown_table(("in", "words", "use", "warning"), rows),
        "word-plugins": markdown_table(("file name contains", "use", "warning"), plugins),
    }


def problem_tables() -> dict[str, str]:
    """What is said under every code, and the cure, from the places in the code that say it; a table for each package."""
    found: dict[str, set[tuple[str, str, str]]] = {}
    root = Path(asrsim.__file__).parent
    for path in root.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        room = path.relative_to(root).parts[0].removesuffix(".py")
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.Module)):
            found.setdefault(room, set()).update((f"`{code}`", said, cure) for code, said, cure in _said(function))
    return {
        "problems": "\n\n".join(
            f"### {room}\n\n" + markdown_table(("code", "what is said", "what to do"), sorted(rows))
            for room, rows in sorted(found.items())
            if rows
        )
    }


def _said(function: ast.FunctionDef | ast.Module) -> Iterator[tuple[str, str, str]]:
    """Code, message and hint of the calls in a function that have a code, with `...` for what differs from case to case."""
    known: dict[str, ast.expr] = {}
    nodes = [node for node in ast.walk(function) if isinstance(node, ast.Assign | ast.Call)]
    for node in sorted(nodes, key=lambda node: (node.lineno, node.col_offset)):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    pairs = [*zip(target.elts, node.value.elts, strict=True)]
                known |= {name.id: value for name, value in pairs if isinstance(name, ast.Name)}
            continue
        words = {keyword.arg: keyword.value for keyword in node.keywords}
        if not isinstance(code := words.get("code"), ast.Constant) or not code.value or isinstance(function, ast.Module):
            continue
        message = words.get("message", node.args[0] if node.args else None)
        cure = _template(words.get("hint"), known) or ("Choose one that the message lists" if "choices" in words else "")
        # A message that the code composes elsewhere has no words here.
        if re.search("[A-Za-z]", said := _template(message, known).strip()):
            yield str(code.value), said, cure.strip()


def _part(part: ast.expr) -> str:
    """Part of an f-string as in the code, with `...` for a value; of `counted(number, noun)`, the noun in the plural."""
    match part:
        case ast.Constant(value=text):
            return str(text)
        case ast.FormattedValue(value=ast.Call(func=ast.Name(id="counted"), args=[_, ast.Constant(value=noun)])):
            return f"... {noun}s"
    return "..."


def _template(value: ast.expr | None, known: dict[str, ast.expr]) -> str:
    """A text as it stands in the code; "" for none."""
    if isinstance(value, ast.Name) and isinstance(known.get(value.id), ast.JoinedStr | ast.Constant | ast.BinOp):
        value = known[value.id]
    if isinstance(value, ast.Constant):
        return re.sub(r"\s+", " ", str(value.value)) if value.value is not None else ""
    if isinstance(value, ast.JoinedStr):
        return "".join(map(_part, value.values))
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.Add):
        return _template(value.left, known) + _template(value.right, known)
    if isinstance(value, ast.IfExp):
        return " / ".join(filter(None, (_template(value.body, known), _template(value.orelse, known))))
    return "" if value is None else "..."
