"""Plugin files that the log of a run contains, and the advice to name them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import PurePath, PurePosixPath

from asrsim.actuators import ACTUATORS
from asrsim.errors import InputError, Problem, folded
from asrsim.quantities import QUANTITIES
from asrsim.registry import Registry
from asrsim.samples import JointInfo
from asrsim.scenario.load import PLUGINS


def missing_plugins(attachments: Iterable[str]) -> tuple[str, ...]:
    """Names of the plugin files among the attachments of a log that this process has not run."""
    here = {PurePath(file).name for file in Registry.plugin_files()}
    carried = (PurePosixPath(name).name for name in attachments if name.startswith(PLUGINS))
    return tuple(name for name in carried if name not in here)


def advice(missing: Sequence[str]) -> str:
    """Advice to name plugin files; empty without such files."""
    return f"The run used {', '.join(missing)}: name your copy with --plugin" if missing else ""


@contextmanager
def advising(attachments: Iterable[str]) -> Iterator[None]:
    """Context in which InputErrors advise to name the plugin files that the attachments contain and that this process has not
    run."""
    try:
        yield
    except InputError as error:
        if missing := missing_plugins(attachments):
            error.add_note(advice(missing))
        raise


def unknown_quantities(
    joints: Iterable[JointInfo], attachments: Iterable[str], wanted: Sequence[str] | None = None
) -> list[Problem]:
    """A note on the quantities of a run that are not registered in this process, so that their units are unknown. wanted: names
    of the only quantities to consider; None: all."""
    unknown = (name for joint in joints for name in joint.quantities if name not in QUANTITIES)
    names = dict.fromkeys(name for name in unknown if wanted is None or name in wanted)
    if not names:
        return []
    message = f"the units of quantities are not known here: {', '.join(folded(tuple(names)))}"
    return [Problem(message, hint=advice(missing_plugins(attachments)) or None, code="quantity-not-here")]


def unknown_actuators(joints: Iterable[JointInfo], attachments: Iterable[str]) -> list[Problem]:
    """A note for each actuator of a run that is not registered in this process, so that quantities that are derived from its
    laws are missing."""
    own: dict[str, list[str]] = {}
    for joint in joints:
        if joint.actuator != "rigid" and joint.actuator not in ACTUATORS:
            own.setdefault(joint.actuator, []).append(joint.name)
    hint = advice(missing_plugins(attachments))
    return [
        Problem(
            f"the actuator '{name}' of {', '.join(names)} is not known here: deflection and equilibrium position are missing",
            hint=hint,
            code="actuator-not-here",
        )
        for name, names in own.items()
    ]
