"""Playback of recordings: CSV, MCAP, ROS bags."""

import math

import numpy as np
import pytest
from scipy.io import savemat

from asrsim.errors import ScenarioError
from asrsim.signals import parse_signal
from asrsim.signals.curve import curve_through, is_jump
from support.bags import NUMBER, START, ramp_bag, write_bag

CSV = "# a comment\ntime,q1 [rad],q2 [deg]\n0,0,0\n0.5,1,90\n1.0,0,180\n"


def play(tmp_path, text, **keys):
    (tmp_path / "ref.csv").write_text(text)
    return parse_signal({"playback": {"file": "ref.csv", **keys}}, base=tmp_path)


def test_csv_is_interpolated_and_holds_its_ends(tmp_path):
    signal = play(tmp_path, CSV, column="q1")
    assert signal.values(np.array([-1, 0, 0.25, 0.5, 0.75, 1, 9])).tolist() == [0, 0, 0.5, 1, 0.5, 0, 0]
    assert signal.jumps(0.0, 2.0).size == 0


def test_a_topic_that_begins_late_is_played_late(tmp_path):
    """Times count from the first message of the bag."""
    late = {"/early": (NUMBER, lambda types, i, time: types[NUMBER](0.0))}
    late["/late"] = NUMBER, lambda types, i, time: types[NUMBER](0.1 * i) if i >= 4 else None
    write_bag(tmp_path / "run", "mcap", late, START + 10**8 * np.arange(11))
    signal = parse_signal({"playback": {"file": "run", "column": "/late"}}, base=tmp_path)
    assert signal.values(np.array([0.0, 0.4, 0.75, 2.0])) == pytest.approx([0.4, 0.4, 0.75, 1.0])


@pytest.mark.parametrize("begin", [62.0, 2e6])
@pytest.mark.parametrize(("keys", "shift"), [({"start": 0}, 0.0), ({"start": 1.5}, 1.5), ({}, None)])
def test_columns_with_separate_clocks_keep_the_time_between_them(tmp_path, begin, keys, shift):
    """The second table begins 0.25 s after the first. Without `start`, times above 1e6 s are those of a wall clock."""
    time = begin + np.array([0.0, 0.5, 1.0])
    savemat(tmp_path / "lab.mat", {"a": {"time": time, "q1": time}, "b": {"time": time + 0.25, "q2": time}})
    kept = begin if begin < 1e6 else 0.0
    for column, late in (("a.q1", 0.0), ("b.q2", 0.25)):
        signal = parse_signal({"playback": {"file": "lab.mat", "column": column, **keys}}, base=tmp_path)
        assert signal.earliest == (kept if shift is None else shift)
        assert signal.samples[0] == pytest.approx(signal.earliest + late + np.array([0.0, 0.5, 1.0]))


def test_unit_of_the_header_is_converted(tmp_path):
    assert play(tmp_path, CSV, column="q2 [deg]").values(np.array([1.0])) == pytest.approx([math.pi])
    scaled = play(tmp_path, CSV, column="q2", scale=-2, offset=1)
    assert scaled.values(np.array([1.0])) == pytest.approx([1 - 2 * math.pi])


def test_another_time_column_is_stated_in_the_document(tmp_path):
    (tmp_path / "ref.csv.yaml").write_text("time: stamp_ms [ms]\n")
    signal = play(tmp_path, "time;stamp_ms [ms];q\n0;1000;1\n9;2000;2\n", column="q", start=5)
    assert signal.values(np.array([5.0, 5.5, 6.0])).tolist() == [1, 1.5, 2]


def test_a_changed_file_is_read_again(tmp_path):
    import os

    assert play(tmp_path, "t,q\n0,1\n1,1\n", column="q").values(np.array([0.0]))[0] == 1
    (tmp_path / "ref.csv").write_text("t,q\n0,2\n1,2\n")
    os.utime(tmp_path / "ref.csv", (1, 1))
    assert parse_signal({"playback": {"file": str(tmp_path / "ref.csv"), "column": "q"}}).values(np.array([0.0]))[0] == 2


@pytest.mark.parametrize(
    ("text", "keys", "messages"),
    [
        (CSV, {"column": "q3"}, ["there is no numeric column 'q3'", "q1, q2", "ref.csv"]),
        (
            "time,q\n0,1\n1,\n2,x\n1.5,3\n",
            {"column": "q"},
            ["ref.csv:3: q: cells must contain numbers up to 1e+30", "lines 3, 4", "left out: line 5"],
        ),
        ("time,q\n0,1\n1\n2,3\n3,4\n4,5\n", {"column": "q"}, ["ref.csv:3", "row: expected 2 fields, found 1"]),
        ("time,q,note\n0,1,a\n1,2,b\n", {"column": "note"}, ["no numeric column 'note'"]),
        (CSV, {}, ["column"]),
    ],
)
def test_faults_of_a_csv_name_file_line_and_column(tmp_path, text, keys, messages):
    with pytest.raises(ScenarioError) as caught:
        play(tmp_path, text, **keys)
    for message in messages:
        assert message in str(caught.value)


def test_a_bag_is_played_by_topic_and_field(tmp_path):
    bag = ramp_bag(tmp_path / "run", "mcap")
    number = parse_signal({"playback": {"file": str(bag), "column": "/q"}})
    assert number.values(np.array([0.0, 0.25, 1.0, 5.0])) == pytest.approx([0.0, 0.25, 1.0, 1.0])
    by_name = parse_signal({"playback": {"file": str(bag), "column": "/states/position[b]"}})
    assert by_name.values(np.array([0.5])) == pytest.approx([-0.5])
    with pytest.raises(ScenarioError, match=r"no numeric column '/states/position\[c\]'.*/q, .*position\[a\], .*position\[b\]"):
        parse_signal({"playback": {"file": str(bag), "column": "/states/position[c]"}})
    (tmp_path / "run.yaml").write_text("time: header\n")
    by_header = parse_signal({"playback": {"file": str(bag), "column": "/states/position[a]", "start": 0}})
    assert by_header.values(np.array([0.25])) == pytest.approx([0.5])


@pytest.mark.parametrize("rate", [50, 1000])
@pytest.mark.parametrize("at", [0.2, 3.0])
def test_smooth_playback_follows_a_coarse_recording_and_its_jump(tmp_path, rate, at):
    """A chirp to 6 Hz with a step in it: splines are off by 5/384 of the fourth derivative, lines by .05 rad at 50 Hz."""

    def motion(time):
        return 0.3 * np.sin(np.pi * (time + 1.375 / 0.9 / 2 * time**2)) + 0.4 * (time >= at - 1e-9)

    known, asked = np.arange(0.0, 3.8, 1.0 / rate), np.arange(0.1, 3.6, 1e-3)
    text = "time,q\n" + "".join(f"{t:.12g},{q:.12g}\n" for t, q in zip(known, motion(known), strict=True))
    played = play(tmp_path, text, column="q", interpolation="smooth")
    assert played.jumps(0.0, 4.0) == pytest.approx([at])
    error, turn = np.abs(played.values(asked) - motion(asked)), 2.0 * np.pi * 6.3 / rate
    # Beside the jump each side ends, and goes on as it was.
    beside = np.abs(asked - at) < 4.0 / rate
    assert error[~beside].max() < 0.3 * 5.0 / 384.0 * turn**4 + 1e-9
    assert error[beside].max() < 0.3 * turn**3


@pytest.mark.parametrize("alone", [2, 3])
def test_smooth_playback_passes_every_sample_and_holds_short_pieces(alone):
    """Pieces of any length between jumps, after a motion that has slope and curvature where it ends; steps are uneven."""
    count, step = 40, 0.02
    time = step * np.arange(2 * count + alone)
    time[count - 2] -= 0.3 * step
    before = np.polynomial.Polynomial([0.0, 4.0, 3.0, -2.0])
    values = np.where(np.arange(len(time)) < count, before(time), 9.0 + 2.0 * time)
    values[count : count + alone] = -5.0
    curve = curve_through(time, values)
    np.testing.assert_allclose(curve.values(time), values, atol=1e-12)
    np.testing.assert_allclose(curve.jumps, time[[count, count + alone]])
    held = np.linspace(time[count], time[count + alone], 50, endpoint=False)
    np.testing.assert_allclose(curve.values(held), -5.0, atol=1e-9)
    # Both motions go on as they were.
    inside = np.array([0.3, 1.0 + 0.5 * step, time[-1] - 0.5 * step])
    np.testing.assert_allclose(curve.values(inside), [before(0.3), 9.0 + 2.0 * inside[1], 9.0 + 2.0 * inside[2]], atol=1e-6)
    last, ahead = time[count - 1], np.linspace(0.0, 0.99 * step, 9)
    parabola = before(last) + before.deriv()(last) * ahead + 0.5 * before.deriv(2)(last) * ahead**2
    np.testing.assert_allclose(curve.values(last + ahead), parabola, atol=2e-6)


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("values", [[0.4], [0.0, 1.0], [0.0, 1.0, 0.5], [0.0, 0.0, 3.0], [2.0, 2.0, 2.0, 2.0]])
def test_a_curve_of_few_samples_goes_through_them(values, hold):
    time = 0.1 * np.arange(len(values))
    curve = curve_through(time, np.array(values), hold=hold)
    np.testing.assert_allclose(curve.values(time), values, atol=1e-12)
    inside = curve.values(np.linspace(0.0, time[-1] + 1.0, 57))
    assert inside[-1] == values[-1]
    assert np.all(np.isfinite(inside))


@pytest.mark.parametrize("at", [1.5, 2.0, 47.5])
def test_a_summit_beside_an_end_is_no_jump(at):
    """Of two samples as high as each other the step between is 0, and those beside are infinitely larger."""
    time = np.arange(50.0)
    motion = np.cos(0.05 * (time - at))
    assert not is_jump(time, motion).any()
    assert is_jump(time, np.where(time < 25, motion, motion + 0.5)).nonzero()[0].tolist() == [24]


@pytest.mark.parametrize("lost", [1, 2, 3, 60])
def test_a_gap_is_bridged_and_no_jump(lost):
    """Noise of an encoder on a sine of 1 Hz at 500 Hz: a polynomial that continues one side would leave the gap by 1 rad."""
    whole = 0.002 * np.arange(1000)
    time = np.delete(whole, slice(400, 400 + lost))
    values = 0.5 * np.sin(2.0 * np.pi * time) + np.random.default_rng(1).normal(0.0, 2e-4, len(time))
    curve = curve_through(time, values)
    assert len(curve.jumps) == 0
    np.testing.assert_allclose(curve.values(whole), 0.5 * np.sin(2.0 * np.pi * whole), atol=0.01)


@pytest.mark.parametrize("stairs", [20, 60])
def test_many_jumps_are_stairs(stairs):
    time = 0.1 * np.arange(2 * stairs + 2)
    curve = curve_through(time, (np.arange(len(time)) // 2 % 2).astype(float), hold=True)
    assert len(curve.jumps) == (stairs if stairs < 40 else 0)
    np.testing.assert_array_equal(curve.values(time + 0.05), curve.values(time))
