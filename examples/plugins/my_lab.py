"""A plugin that adds a signal, a measure, a recording format and a sampler.

asrsim run lab.yaml --plugin examples/plugins/my_lab.py
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import Number
from asrsim.errors import RecordingError
from asrsim.metrics import MEASURES, Measure
from asrsim.recordings import READERS, Reader
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.signals import SIGNALS, Signal
from asrsim.sweeps.samplers import SAMPLERS, Sampler


@dataclass(frozen=True, kw_only=True)
class Triangle(Signal):
    """A triangle wave. In a scenario: `{triangle: {amplitude: 0.5, period: 2}}`."""

    kind: ClassVar[str] = "triangle"

    amplitude: float = declare(Number(), doc="largest value", unit="value")
    period: float = declare(Number(above=0.0), doc="length of a period", unit="s", default=1.0)

    def values(self, time):
        phase = np.asarray(time) / self.period
        return self.amplitude * (4.0 * np.abs(phase - np.floor(phase + 0.5)) - 1.0)


def crest_factor(time, values):
    """Ratio of the largest magnitude and the root mean square. In `expect:`: `measure: crest_factor`."""
    return float(np.max(np.abs(values)) / np.sqrt(np.mean(values**2)))


RECORD = np.dtype([("time", "<f8"), ("elbow.link_position", "<f4"), ("elbow.link_velocity", "<f4")])


def read_mylog(path, reading):
    """Read a logger's binary file. Each record: time in s, position in rad, velocity in rad/s."""
    data = path.read_bytes()
    if len(data) % RECORD.itemsize:
        raise RecordingError(f"ends within a record of {RECORD.itemsize} bytes")
    table = np.frombuffer(data, RECORD)
    columns = tuple(RawColumn(name=name, values=table[name].astype(float)) for name in RECORD.names)
    return Content(format="mylog", tables=(RawTable(columns=columns),))


class Halton(Sampler):
    """A Halton sequence. In a study: `asrsim sweep ... --sampler halton`."""

    title = "Halton sequence"

    def points(self, samples, dimensions, seed):
        from scipy.stats import qmc

        return qmc.Halton(dimensions, rng=seed).random(samples)


SIGNALS.add(Triangle.kind, Triangle)
READERS.add("mylog", Reader(suffixes=(".mylog",), read=read_mylog))
MEASURES.add("crest_factor", Measure(name="crest_factor", function=crest_factor, unit="1", needs="series"))
SAMPLERS.add("halton", Halton())
