"""Reads the signals of a scenario. Each is a number, or a mapping whose only key is the kind of the signal."""

from __future__ import annotations

from pathlib import Path

from asrsim.document.block import Block, declared_keys
from asrsim.document.kinds import Key, Kind, Schema, attempt, unit_hint
from asrsim.document.node import Node, node_from_data
from asrsim.document.reading import DocumentReading, KeyPath
from asrsim.errors import ScenarioError
from asrsim.signals.base import SIGNALS, Signal
from asrsim.signals.pieces import Constant

FORM = "a number, or a mapping with one key, the kind of signal"


class SignalKind(Kind[Signal]):
    """Kind of value of a document: a signal."""

    text = "signal"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Signal:
        value = node.value
        if isinstance(value, int | float) and not isinstance(value, bool):
            return Constant(value=block_of(Constant).keys[0].kind.read(node, path, reading))
        if not isinstance(value, dict):
            moved = path[-1:] == ("inverse_dynamics",)
            hint = "State it as a key of the scenario: `inverse_dynamics: {JOINT: true}`" if moved else unit_hint(value)
            choices = () if hint else SIGNALS.names()
            raise reading.fault(node, path, f"must be a signal: {FORM}", choices=choices, hint=hint, code="signal")
        if len(value) != 1:
            raise reading.fault(
                node,
                path,
                f"must have one key, the kind of signal, not {len(value)}",
                choices=SIGNALS.names(),
                code="signal",
            )
        kind, body = next(iter(value.items()))
        if kind not in SIGNALS:
            found = SIGNALS.unknown(kind)
            raise reading.fault(
                node,
                (*path, kind),
                found.message,
                line=node.key_line(kind),
                choices=found.choices,
                hint=found.hint,
                code=found.code,
                show=False,
            )
        cls = SIGNALS.get(kind)
        return block_of(cls).read(body, (*path, kind), reading)

    def schema(self) -> Schema:
        return {"$ref": "#/$defs/signal"}

    def merge(self, base: Node, over: Node) -> Node:
        """The signal `base` with the keys of `over` set, if both are signals of the same kind; otherwise `over`."""
        kinds = [name for name, _ in base.items()]
        return super().merge(base, over) if len(kinds) == 1 and kinds == [name for name, _ in over.items()] else over

    def fits(self, node: Node) -> bool:
        return not isinstance(node.value, list)

    def part(self, name: str) -> Key | None:
        return Key(name="", kind=block_of(SIGNALS.get(name))) if name in SIGNALS else None


SIGNAL = SignalKind()


def block_of(cls: type[Signal]) -> Block[Signal]:
    """Block with the declared keys of a kind of signal."""
    doc = (cls.__doc__ or "").strip().splitlines()
    main = getattr(cls, "main_field", "")
    return Block(keys=declared_keys(cls), build=cls, noun=f"mapping of {cls.kind}", doc=doc[0] if doc else "", main=main)


def signal_schema() -> Schema:
    """JSON Schema of a signal, for `#/$defs/signal`."""
    shapes: list[Schema] = [{"type": "number", "description": "a constant"}]
    for name in SIGNALS:
        body = block_of(SIGNALS.get(name)).schema()
        shapes.append({"type": "object", "properties": {name: body}, "required": [name], "additionalProperties": False})
    return {"anyOf": shapes}


def parse_signal(data: object, *, base: Path | None = None) -> Signal:
    """Signal described by plain data: a number, or a mapping whose only key is the kind of the signal.

    base: folder to which the paths of played recordings are relative; None: the working folder. Raises ScenarioError with every
    problem.
    """
    reading = DocumentReading(base=base or Path())
    found = attempt(SIGNAL, node_from_data(data), (), reading)
    if found is None or reading.problems:
        raise ScenarioError(reading.problems)
    return found[0]
