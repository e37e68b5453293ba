"""Measures of runs without a recording (`asrsim plot LOG --measure NAME`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from asrsim.joint_units import unit_at
from asrsim.log import open_log
from asrsim.log.derived import own_reference
from asrsim.metrics import MetricRow
from asrsim.metrics.asked import asked_measures
from asrsim.recordings.align import simulated, simulated_sources

MEASURED = ("link_position",)
"""Quantities that are measured unless other quantities are named."""


def measured_rows(
    path: Path,
    label: str,
    measures: Sequence[str],
    *,
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
) -> Iterator[MetricRow]:
    """Measures of the joints of a log. A link position is compared with the joint's reference; other quantities have no
    reference.

    Args:
        path: File of the log.
        label: Label of the log, which the rows name as their source.
        measures: Measures, NAME or NAME:OPTION=VALUE,...
        joints: Names of joints; None: all.
        quantities: Names of quantities; None: `MEASURED`.

    Raises InputError for unknown measures, and LogError.
    """
    asked, reader = asked_measures(measures), open_log(path)
    infos = [one for one in reader.info.joints if joints is None or one.name in joints]
    wanted = quantities or MEASURED
    samples = reader.read(
        quantities=simulated_sources([*wanted, "position_error"], infos), joints=[one.name for one in infos]
    ).samples
    for info in infos:
        for quantity in wanted:
            values = simulated(samples, info.name, quantity, infos)
            if values is None:
                continue
            reference = own_reference(samples, info) if quantity == "link_position" else None
            unit = unit_at(quantity, info)
            for one in asked:
                value = one.of(samples.time, values, reference)
                yield MetricRow(
                    source=label,
                    joint=info.name,
                    quantity=quantity,
                    measure=one.text,
                    value=value,
                    unit=one.measure.unit_of(unit),
                )
