"""Maps the joints of a recording to the joints of the simulation by their names, and checks the units of columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from asrsim.actuators import MODES
from asrsim.errors import Problem, RecordingError
from asrsim.quantities import PRISMATIC_UNITS
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.formats import with_reader_hint
from asrsim.recordings.words import TAKEN, UNIT_KINDS, one_of


def match_joints(names: Sequence[str], recording: Recording) -> Mapping[str, str]:
    """Joint of the simulation for each joint of the recording. Raises RecordingError if they have no common joint."""
    recorded = recording.joints
    pairing = {joint: name for joint in recorded if (name := matching_name(joint, names)) is not None}
    if pairing:
        return pairing
    column, joint = next(iter(recording.channels.values())), names[0] if names else "JOINT"
    doubt = next((f"; {one.source}: {one.question}" for one in recording.asked), "")
    problem = Problem(
        f"no common joint: the simulation has {', '.join(names) or 'none'}, the recording has "
        f"{', '.join(recorded) or 'no column that is mapped to a joint'}{doubt}",
        file=recording.path,
        code="no-common-joint",
        hint=f"Columns: {', '.join(list(recording.channels)[:30])}. Map them, in the document beside the file or with "
        f"--map '{column.source}={joint}.{column.quantity or 'link_position'} [{column.unit or 'unit'}]'",
    )
    raise RecordingError([with_reader_hint(problem, recording.path)])


def wrong_unit(column: Column, joint: str, *, prismatic: bool, mode: int | None = None) -> Problem | None:
    """Problem of a column whose stated unit does not fit the joint, such as m for a revolute joint; None if the unit fits.

    mode: operation mode of the joint in the run, which determines whether the reference is a position or a torque; None: the
    reference is not checked.
    """
    quantity = str(column.quantity)
    if quantity == "reference_1" and column.unit:
        kind = UNIT_KINDS.get(column.unit, column.unit)
        kind = "torque" if prismatic and kind == "force" else kind  # torque modes accept a force on a prismatic joint
        wanted = UNIT_KINDS[MODES[mode].units[0]] if mode in MODES else ""
        how = "is" if column.stated else "is, by its name,"
        if kind == "force" or kind not in TAKEN:
            why = f"{joint} is revolute and takes a torque" if kind == "force" else "no operation mode accepts it"
            hint = f"State the quantity in this column: --map '{column.source}={joint}.reference_1 [unit]', or =ignore"
            return Problem(f"{how} a command of {one_of([kind])}, but {why}", key=column.source, hint=hint, code="wrong-unit")
        if wanted and kind != wanted:
            message = f"{how} in {column.unit}, but the reference of {joint} is a {wanted} in mode {mode}"
            return Problem(message, key=column.source, code="wrong-unit")
    # Accept any unit for the second and later references and motors, since they may belong to an adjuster. In AwAS-II, the
    # position of the adjuster is in m.
    if not column.stated or re.match(r"(reference|motor)_[2-9]", quantity):
        return None
    kind, right, others = ("prismatic", "m", PRISMATIC_UNITS) if prismatic else ("revolute", "rad", PRISMATIC_UNITS.values())
    if column.unit not in others:
        return None
    hint = f"Give the unit of its numbers: --map '{column.source}={joint}.{quantity} [unit]', or =ignore"
    message = f"is in {column.unit}, but {joint} is {kind}, whose positions are in {right}"
    return Problem(message, key=column.source, hint=hint, code="wrong-unit")


def matching_name(name: str, names: Sequence[str]) -> str | None:
    """Name in `names` that is equal to `name` except for case and separators; None if there is no such name."""

    def plain(text: str) -> str:
        return text.lower().translate({ord(sign): None for sign in "_- "})

    return next((other for other in names if plain(other) == plain(name)), None)
