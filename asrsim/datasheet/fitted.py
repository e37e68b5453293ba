"""Data sheets of identified actuators: the law with the estimated numbers, and the recorded torques beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from asrsim.datasheet.bench import MeasuredCurve, measured_curve
from asrsim.datasheet.data import Sheet
from asrsim.datasheet.sheet import make_sheet
from asrsim.datasheet.sources import Source, sources_in
from asrsim.errors import RecordingError
from asrsim.registry.engines import ENGINES
from asrsim.robot.vary import varied_robot

if TYPE_CHECKING:
    from asrsim.identification import FitResult


def fitted_sheets(result: FitResult) -> tuple[Sheet, ...]:
    """Sheets of the actuators whose torque over deflection was recorded, with all estimates of the fit.

    Raises RecordingError if no recording contains such a curve; the message states what the last recording lacks.
    """
    from asrsim.identification.parameters import numbers_of
    from asrsim.identification.write import chosen_values

    robot = varied_robot(result.robot, numbers_of(chosen_values(result, everything=True)))
    sheets, fault = [], None
    for source in sources_in(robot, plugins=tuple(result.task.plugins)):
        try:
            curves = _curves(result, source)
        except RecordingError as error:
            fault = error
            continue
        origin = f"{source.origin}, as identified from {len(curves)} recording{'s' * (len(curves) > 1)}"
        sheets.append(make_sheet(replace(source, origin=origin), measured=curves))
    if not sheets and fault is not None:
        raise fault
    return tuple(sheets)


def _curves(result: FitResult, source: Source) -> list[MeasuredCurve]:
    locked = ENGINES.get(result.scenario.engine).prescribed
    return [measured_curve(source, one.file, one.mapping, rate=one.rate, locked=locked) for one in result.task.experiments]
