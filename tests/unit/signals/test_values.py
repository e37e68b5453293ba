"""Signals at known times, and their jumps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asrsim.document.block import declare
from asrsim.document.kinds import Number
from asrsim.errors import InputError, ScenarioError
from asrsim.samples import grid
from asrsim.signals import SIGNALS, Chirp, Constant, Delay, Multisine, Signal, Sinusoid, Step, parse_signal
from asrsim.signals.common import interpolate


def at(data, *times):
    return parse_signal(data).values(np.array(times, dtype=float)).tolist()


def test_number_is_a_constant_without_jumps():
    signal = parse_signal(0.3)
    assert signal == Constant(value=0.3)
    assert signal.values(np.array([-1.0, 0.0, 5.0])).tolist() == [0.3] * 3
    assert signal.jumps(0.0, 10.0).size == 0


def test_step_has_its_new_value_at_its_time():
    step = {"step": {"at": 0.1, "from": 0.2, "to": 0.8}}
    assert at(step, 0.0, np.nextafter(0.1, 0.0), 0.1, 1.0) == [0.2, 0.2, 0.8, 0.8]
    assert parse_signal(step).jumps(0.0, 1.0).tolist() == [0.1]
    assert parse_signal(step).jumps(0.1, 0.1).tolist() == [0.1]
    assert parse_signal(step).jumps(0.2, 1.0).size == 0


def test_only_steps_that_change_the_value_are_jumps():
    assert parse_signal({"step": {"to": 1}}).jumps(0.0, 1.0).tolist() == [0.0]
    assert parse_signal({"step": {"from": 1, "to": 1}}).jumps(0.0, 1.0).size == 0


def test_ramp_is_a_line_between_two_rests():
    assert at({"ramp": {"start": 1, "duration": 2, "from": -1, "to": 3}}, 0, 1, 2, 3, 9) == [-1, -1, 1, 3, 3]


def test_minimum_jerk_halfway_and_at_rest_at_both_ends():
    signal = parse_signal({"minimum_jerk": {"from": 0, "to": 0.8, "duration": 20}})
    assert signal.values(np.array([0.0, 10.0, 20.0, 30.0])) == pytest.approx([0.0, 0.4, 0.8, 0.8])
    peak = (signal.values(np.array([10.001])) - signal.values(np.array([9.999]))) / 0.002
    assert peak[0] == pytest.approx(1.875 * 0.8 / 20, rel=1e-5)  # Flash and Hogan: 15/8 of the mean speed
    assert signal.values(np.array([0.01]))[0] < 1e-8


def test_a_sinusoid_rests_at_its_phase_before_the_start():
    a = parse_signal({"sinusoid": {"amplitude": 0.8, "angular_frequency": 0.8, "offset": 1}})
    b = parse_signal({"sinusoid": {"amplitude": 0.8, "frequency": 0.8 / (2 * math.pi), "offset": 1}})
    time = np.linspace(0, 10, 101)
    assert a.values(time) == pytest.approx(1 + 0.8 * np.sin(0.8 * time))
    assert b.values(time) == pytest.approx(a.values(time))
    late = Sinusoid(amplitude=2.0, frequency=1.0, phase=math.pi / 2, start=3.0)
    assert late.values(np.array([0.0, 3.0, 3.5])) == pytest.approx([2.0, 2.0, -2.0])


@pytest.mark.parametrize("law", ["linear", "logarithmic"])
def test_chirp_sweeps_its_instantaneous_frequency(law):
    sine = Chirp(amplitude=1.0, start_frequency=0.5, end_frequency=6.0, duration=20.0, law=law)
    cosine = Chirp(amplitude=1.0, start_frequency=0.5, end_frequency=6.0, duration=20.0, law=law, phase=math.pi / 2)
    time = np.linspace(0.0, 20.0, 40_001)
    phase = np.unwrap(np.arctan2(sine.values(time), cosine.values(time)))
    frequency = np.gradient(phase, time) / (2 * math.pi)
    middle = {"linear": 3.25, "logarithmic": math.sqrt(0.5 * 6.0)}[law]
    assert frequency[[0, 20_000, -1]] == pytest.approx([0.5, middle, 6.0], rel=1e-3)
    assert sine.values(np.array([25.0])) == sine.values(np.array([20.0]))
    for chirp, first in ((sine, 0.0), (cosine, 1.0)):
        assert chirp.values(np.array([-1.0, 0.0])) == pytest.approx([first, first], abs=1e-12)


def test_multisine_has_its_lines_and_low_peaks_with_schroeder_phases():
    frequencies = tuple(float(k) for k in range(1, 21))
    low = Multisine(frequencies=frequencies, amplitudes=1.0)
    high = Multisine(frequencies=frequencies, amplitudes=1.0, phases="zero")
    time = np.arange(1000) / 1000.0
    spectrum = np.abs(np.fft.rfft(low.values(time))) / 500.0
    assert spectrum[1:21] == pytest.approx(np.ones(20))
    assert np.delete(spectrum, range(1, 21)) == pytest.approx(0.0, abs=1e-9)
    assert np.abs(low.values(time)).max() < 0.6 * np.abs(high.values(time)).max()
    a, b = (
        parse_signal({"multisine": {"frequencies": [1, 2], "amplitude": [1, 2], "phase": "random", "seed": s}}) for s in (1, 1)
    )
    assert a.values(time).tolist() == b.values(time).tolist()


def test_waypoints_linear_hold_and_cubic():
    points = [[0, 0], [1, 2], [3, 0]]
    assert at({"waypoints": points}, -1, 0.5, 2, 9) == [0, 1, 1, 0]
    held = {"waypoints": {"points": points, "interpolation": "hold"}}
    assert at(held, -1, 0.5, 1, 2.9, 3) == [0, 0, 2, 2, 0]
    assert parse_signal(held).jumps(0.0, 5.0).tolist() == [1.0, 3.0]
    for interpolation in ("linear", "hold", "cubic"):
        assert at({"waypoints": {"points": [[1, 7]], "interpolation": interpolation}}, 0, 1, 2) == [7, 7, 7]
    smooth = parse_signal({"waypoints": {"points": points, "interpolation": "cubic"}})
    assert smooth.values(np.array([-1.0, 0.0, 1.0, 3.0, 9.0])) == pytest.approx([0, 0, 2, 0, 0])
    assert abs(smooth.values(np.array([1e-4]))[0]) < 1e-6  # rests at the ends


def test_pulse_train_counts_its_pulses():
    data = {"pulse_train": {"low": -1, "high": 1, "period": 0.5, "width": 0.1, "start": 0.2, "count": 2}}
    assert at(data, 0, 0.2, 0.29, 0.31, 0.7, 0.85, 1.2) == [-1, 1, 1, -1, 1, -1, -1]
    assert parse_signal(data).jumps(0, 5) == pytest.approx([0.2, 0.3, 0.7, 0.8])


@pytest.mark.parametrize("by", [0.0, 0.05, 0.3])
def test_a_delayed_jump_at_the_edge_is_in_the_window(by):
    late = Delay(by=by, of=Step(at=1.0, after=0.5))
    (place,) = late.jumps(0.0, 9.0).tolist()
    assert place == pytest.approx(1.0 + by)
    for window in ((place, 2.0), (0.5, place), (place, place)):
        assert late.jumps(*window).tolist() == [place]


@pytest.mark.parametrize(
    "data",
    [
        {"pulse_train": {"high": 1, "period": 0.05, "width": 0.02, "start": 0.1}},
        {"delay": {"by": 0.005, "of": {"waypoints": {"points": [[0, 0], [0.1, 1], [0.2, 0]], "interpolation": "hold"}}}},
    ],
)
def test_edges_at_the_time_of_a_step_belong_to_it(data):
    """0.1 + 0.02 is larger than 0.12 in floating point."""
    signal, time = parse_signal(data), grid(0, 1000, 1e-3)
    edges = np.flatnonzero(np.diff(signal.values(time))) + 1
    assert time[edges].tolist() == signal.jumps(1e-9, 0.999).tolist()


def test_sum_unites_jumps_and_delay_and_scale_carry_them():
    data = {
        "sum": [
            {"step": {"at": 0.1, "to": 1}},
            {"delay": {"by": 0.3, "of": {"scale": {"by": 2, "of": {"step": {"to": 1}}}}}},
            5,
        ]
    }
    assert at(data, 0, 0.1, 0.3) == [5, 6, 8]
    assert not len(parse_signal({"scale": {"by": 0, "of": {"step": {"to": 1}}}}).jumps(0, 1))
    assert parse_signal(data).jumps(0, 1) == pytest.approx([0.1, 0.3])


@given(
    st.floats(0.001, 3.0),
    st.floats(0.0, 2.0),
    st.floats(0.01, 0.99),
    st.floats(0.0, 1.0),
)
def test_values_change_exactly_at_the_jumps(period, delay, share, start):
    """Right-continuous to the last bit, through a delay too: the simulation splits its step at `jumps`."""
    signal = Delay(by=delay, of=SIGNALS.get("pulse_train")(high=1.0, period=period, width=share * period, start=start))
    jumps = signal.jumps(0.0, delay + start + 3.0 * period)
    assert jumps.size >= 3
    assert np.all(np.diff(jumps) > 0.0)
    before, after = signal.values(np.nextafter(jumps, -np.inf)), signal.values(jumps)
    assert np.all(before != after)


@given(st.lists(st.floats(-1.0, 4.0), min_size=1, max_size=20))
def test_values_do_not_depend_on_what_else_is_asked(times):
    signals = [
        parse_signal({"pulse_train": {"high": 1, "period": 0.3, "width": 0.1}}),
        parse_signal({"delay": {"by": 0.1, "of": {"step": {"at": 0.7, "to": 2}}}}),
        parse_signal({"waypoints": [[0, 1], [1, 2]]}),
        parse_signal({"chirp": {"amplitude": 1, "from": 1, "to": 2, "duration": 3}}),
    ]
    for signal in signals:
        together = signal.values(np.array(times))
        assert together.shape == (len(times),)
        assert together.tolist() == [signal.values(np.array([time]))[0] for time in times]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("up", "must be a signal"),
        ({"step": {"to": 1}, "ramp": {}}, "one key"),
        ({"stp": {"to": 1}}, "Did you mean 'step'?"),
        ({"step": {"too": 1}}, "Did you mean 'to'?"),
        ({"step": {"to": math.nan}}, "finite"),
        ({"ramp": {"to": 1, "duration": 0}}, "ramp.duration: must be a number > 0"),
        ({"sinusoid": {"amplitude": 1}}, "frequency (Hz) or angular_frequency (rad/s)"),
        ({"sinusoid": {"amplitude": 1, "frequency": 1, "angular_frequency": 1}}, "give one"),
        ({"chirp": {"amplitude": 1, "from": 1, "to": 6, "duration": 1, "law": "log"}}, "linear, logarithmic"),
        ({"pulse_train": {"high": 1, "period": 1, "width": 2}}, "pulse_train.width: must lie between 0 and the period"),
        ({"waypoints": [[0, 1], [0, 2]]}, "times must ascend, but 0 follows 0"),
        ({"waypoints": [[0, 1, 2]]}, "waypoints.points.0: must be a list [time, value], but has 3 entries"),
        ({"multisine": {"frequencies": [1, 2], "amplitude": [1]}}, "1 entries for 2 frequencies"),
        ({"sum": [{"stp": 1}]}, "sum.terms.0.stp"),
    ],
)
def test_faults_name_the_key_and_what_is_right(data, message):
    with pytest.raises(ScenarioError) as caught:
        parse_signal(data)
    assert message in str(caught.value)


def test_constructors_check_relations_too():
    with pytest.raises(InputError, match="frequency"):
        Sinusoid(amplitude=1.0)


def test_users_add_their_own_kind():
    @dataclass(frozen=True, kw_only=True)
    class Triangle(Signal):
        """A triangle wave."""

        kind: ClassVar[str] = "test_triangle"
        period: float = declare(Number(above=0.0), doc="length", unit="s", default=1.0)

        def values(self, time):
            phase = np.asarray(time) / self.period
            return 4.0 * np.abs(phase - np.floor(phase + 0.5)) - 1.0

    SIGNALS.add(Triangle.kind, Triangle, replace=True)
    try:
        assert at({"test_triangle": {"period": 2}}, 0, 1, 2) == [-1, 1, -1]
        with pytest.raises(ScenarioError, match="period"):
            parse_signal({"test_triangle": {"period": 0}})
    finally:
        SIGNALS._entries.pop(Triangle.kind)


def test_rounding_of_a_clock_does_not_delay_held_samples():
    times = np.array([0.0, 100.2 - 100.0, 0.4])
    assert times[1] > 0.2
    assert interpolate(np.array([0.2, 0.1999]), times, np.array([1.0, 2.0, 3.0]), "hold").tolist() == [2.0, 1.0]


KINDS = {
    "constant": 0.3,
    "step": {"step": {"at": 0.7, "to": 1}},
    "ramp": {"ramp": {"start": 0.2, "duration": 1, "to": 2}},
    "sinusoid": {"sinusoid": {"amplitude": 1, "frequency": 2, "phase": 0.4, "start": 0.3}},
    "chirp": {"chirp": {"amplitude": 1, "from": 1, "to": 4, "duration": 1.5, "start": 0.1}},
    "minimum_jerk": {"minimum_jerk": {"start": 0.4, "duration": 1, "to": 1}},
    "pulse_train": {"pulse_train": {"high": 1, "low": -1, "width": 0.13, "period": 0.41, "start": 0.2}},
    "waypoints": {"waypoints": {"points": [[0.2, 0], [0.9, 1], [1.4, 0.5]]}},
    "held waypoints": {"waypoints": {"points": [[0.2, 0], [0.9, 1], [1.4, 0.5]], "interpolation": "hold"}},
    "playback": {"playback": {"file": "a.csv", "column": "q"}},
    "held playback": {"playback": {"file": "a.csv", "column": "q", "interpolation": "hold"}},
    "sum": {"sum": [{"step": {"at": 0.5, "to": 1}}, {"pulse_train": {"high": 1, "width": 0.1, "period": 0.3}}]},
    "delay": {"delay": {"by": 0.123, "of": {"step": {"at": 0.5, "to": 1}}}},
    "scale": {"scale": {"by": -3, "of": {"step": {"at": 0.5, "to": 1}}}},
}


@pytest.mark.parametrize("kind", KINDS)
def test_jumps_are_told_of_where_values_jump_and_nowhere_else(kind, tmp_path):
    (tmp_path / "a.csv").write_text("time,q\n" + "".join(f"{t},{q}\n" for t, q in [(0.1, 0), (0.6, 1), (0.9, 0.2), (1.3, 2)]))
    signal = parse_signal(KINDS[kind], base=tmp_path)
    times = np.linspace(0.0, 2.0, 20001)
    jumps = signal.jumps(0.0, 2.0)
    assert np.all((jumps >= 0.0) & (jumps <= 2.0) & (np.diff(jumps, prepend=-1.0) > 0.0))
    heights = np.abs(signal.values(jumps + 1e-5) - signal.values(jumps - 1e-5))
    assert np.all(heights > 0.05)
    # A run requests the jumps of each block. No jump is lost between two blocks, and none lies outside.
    for count in (3, 101):
        edges = np.linspace(0.0, 2.0, count + 1)
        parts = [signal.jumps(float(a), float(b)) for a, b in pairwise(edges)]
        assert all(np.all((a <= part) & (part <= b)) for part, (a, b) in zip(parts, pairwise(edges), strict=True))
        np.testing.assert_allclose(np.unique(np.concatenate(parts).round(9)), jumps.round(9))
    told = np.searchsorted(jumps, times[1:], side="right") > np.searchsorted(jumps, times[:-1], side="right")
    moved = np.abs(np.diff(signal.values(times)))
    assert np.all(moved[~told] < 0.01)
