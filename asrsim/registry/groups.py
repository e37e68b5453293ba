"""Entry point groups by which installed packages add to asrsim, and faults of installed packages in these groups."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from asrsim.errors import Problem, did_you_mean
from asrsim.registry import Registry

GROUPS = {
    "asrsim.actuators": ("asrsim.actuators", "ACTUATORS"),
    "asrsim.stages": ("asrsim.actuators.stages", "STAGES"),
    "asrsim.signals": ("asrsim.signals", "SIGNALS"),
    "asrsim.recordings": ("asrsim.recordings", "READERS"),
    "asrsim.measures": ("asrsim.metrics", "MEASURES"),
    "asrsim.figures": ("asrsim.plots", "FIGURES"),
    "asrsim.samplers": ("asrsim.sweeps.samplers", "SAMPLERS"),
    "asrsim.causes": ("asrsim.identification", "CAUSES"),
    "asrsim.programs": ("asrsim.exports", "PROGRAMS"),
    "asrsim.engines": ("asrsim.engines", "ENGINES"),
    "asrsim.transports": ("asrsim.live", "TRANSPORTS"),
}
"""Module and name of the registry of each entry point group."""


def registry_of(group: str) -> Registry[Any]:
    """Registry of an entry point group; its module is imported only now."""
    module, name = GROUPS[group]
    found: Registry[Any] = getattr(import_module(module), name)
    return found


def faults_of_packages() -> Iterator[Problem]:
    """Problems of entry points of installed packages: entries that cannot be used, and groups that asrsim does not have."""
    from importlib.metadata import entry_points

    for group in sorted(one for one in entry_points().groups if one.startswith("asrsim.")):
        if group in GROUPS:
            yield from registry_of(group).broken()
            continue
        names = ", ".join(point.name for point in entry_points(group=group))
        yield Problem(
            f"asrsim has no entry point group '{group}': {names} of an installed package is not used",
            choices=tuple(GROUPS),
            hint=did_you_mean(group, tuple(GROUPS)),
            code="unknown-group",
        )
