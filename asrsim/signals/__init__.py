"""Signals: scalar functions of time, one file a kind; `SIGNALS` is the registry that users extend."""

from __future__ import annotations

from asrsim.registry import Registry
from asrsim.signals.base import Signal
from asrsim.signals.chirp import Chirp
from asrsim.signals.combine import Delay, Scale, Sum
from asrsim.signals.constant import Constant
from asrsim.signals.multisine import Multisine
from asrsim.signals.parse import parse_signal
from asrsim.signals.playback import Playback
from asrsim.signals.pulse_train import PulseTrain
from asrsim.signals.ramp import MinimumJerk, Ramp
from asrsim.signals.sinusoid import Sinusoid
from asrsim.signals.step import Step
from asrsim.signals.waypoints import Waypoints

SIGNALS: Registry[type[Signal]] = Registry("signal", entry_point_group="asrsim.signals")
for _signal in (
    Constant,
    Step,
    Ramp,
    Sinusoid,
    Chirp,
    Multisine,
    MinimumJerk,
    Waypoints,
    PulseTrain,
    Playback,
    Sum,
    Delay,
    Scale,
):
    SIGNALS.add(_signal.kind, _signal)

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
