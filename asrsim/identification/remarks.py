"""What a fit remarks on beside its tables: how recordings were taken, and what was estimated that nobody asked for."""

from __future__ import annotations

from asrsim.identification.fit import Best
from asrsim.identification.keys import JUMP
from asrsim.identification.layout import Layout
from asrsim.identification.setup import Setup


def remarks_of(setup: Setup, best: Best, layout: Layout, finer: str) -> list[str]:
    """What is said beside the tables; finer: of substeps."""
    remarks = [f"{one.name}: {text}" for one in (track.data for track in setup.tracks) for text in one.remarks]
    if count := best.substeps.get("substeps"):
        remarks.append(f"simulated with {count} substeps a step: with fewer, runs are off by more than this recording's noise")
    remarks += [finer] if finer else []
    asked = {parameter.key for parameter in setup.free}
    remarks += [
        f"{entry.name} is estimated, too: what was recorded asks for bristles of another stiffness than the law's own"
        for entry in layout.entries if entry.parameter.key.endswith("friction_stiffness") and entry.parameter.key not in asked
    ]  # fmt: skip
    if any(f".{JUMP}" in entry.parameter.key for entry in layout.entries):
        remarks.append("jumps of commands are estimated, too: they came between samples, so long before those that show them")
    if held := setup.fitted[0].held:
        remarks.append(
            f"{', '.join(sorted(held))}: played as stairs, each sample held until the next, as a digital controller does: what "
            "was recorded asks for it (`interpolation: hold` of the scenario's playback)"
        )
    remarks += [
        f"{track.data.name}: {key} is estimated, too: the recording begins elsewhere than the scenario, in motion, or "
        "where a sensor said"
        for track in setup.tracks for key in track.uncertain if any(key == one.parameter.key for one in layout.entries)
    ]  # fmt: skip
    return remarks
