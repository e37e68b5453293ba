"""Signals: scalar functions of time. Users add kinds of signals of their own to the registry `SIGNALS`."""

from __future__ import annotations

from asrsim.signals.base import SIGNALS, Signal
from asrsim.signals.combine import Delay, Scale, Sum
from asrsim.signals.parse import parse_signal
from asrsim.signals.pieces import Constant, MinimumJerk, PulseTrain, Ramp, Step, Waypoints
from asrsim.signals.playback import Playback
from asrsim.signals.sines import Chirp, Multisine, Sinusoid

for _signal in (
    Constant, Step, Ramp, Sinusoid, Chirp, Multisine, MinimumJerk, Waypoints, PulseTrain, Playback, Sum, Delay, Scale
):  # fmt: skip
    SIGNALS.own(_signal.kind, _signal)

__all__ = [
    "SIGNALS",
    "Chirp",
    "Constant",
    "Delay",
    "MinimumJerk",
    "Multisine",
    "Playback",
    "PulseTrain",
    "Ramp",
    "Scale",
    "Signal",
    "Sinusoid",
    "Step",
    "Sum",
    "Waypoints",
    "parse_signal",
]
