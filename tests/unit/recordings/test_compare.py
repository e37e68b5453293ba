"""Lag, resampling and comparison of a simulation with a recording whose differences are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

from asrsim.errors import RecordingError, ScenarioError
from asrsim.recordings import band, compare, read_recording, resample
from asrsim.recordings.align import align
from asrsim.samples import JointInfo, Samples
from asrsim.scenario.data import Expectation
from asrsim.summary.claims import claim_results
from support.examined import check_claims

TIME = 0.001 * np.arange(5001)


def motion(time):
    """A step at 1 s that rings, and a slow return."""
    s = np.maximum(time - 1.0, 0.0)
    return np.where(s > 0, 0.8 * (1 - np.exp(-3 * s) * np.cos(15 * s)), 0.0)


def reference(time):
    return np.where(time >= 1.0, 0.8, 0.0)


def simulation(joint="elbow", scale=1.0):
    values = {"link_position": scale * motion(TIME)[:, None], "reference_1": scale * reference(TIME)[:, None]}
    return Samples(time=TIME, joints=(joint,), values=values)


def write(folder, header, *columns, name="lab.csv"):
    np.savetxt(folder / name, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.12g")
    return folder / name


def laboratory(
    folder, *, late = 0.0, rate = 200.0, scale = 1.0, header = "time,elbow_pos,elbow_cmd",
    seconds = 5.0, offset = 0.0, name = "lab.csv",
):  # fmt: skip
    t = np.arange(0, seconds, 1 / rate)
    return write(folder, header, t, scale * motion(t - late) + offset, scale * reference(t - late), name=name)


def read(path, **options):
    return read_recording(path, joints=("elbow",), **options)


@pytest.mark.parametrize(("late", "gap"), [(0.0, 0), (0.1234, 0), (-0.25, 0), (0.5, 0), (0.1234, 60)])
def test_the_lag_is_found_within_a_fraction_of_a_sample(tmp_path, late, gap):
    """The gap hides 0.3 s of the ringing. A correlation of the line across it is 80 ms off."""
    lines = laboratory(tmp_path, late=late, header="time,elbow_pos,other").read_text().splitlines(keepends=True)
    (tmp_path / "lab.csv").write_text("".join(lines[:231] + lines[231 + gap :]))
    result = compare(simulation(), read(tmp_path / "lab.csv"))
    assert result.alignment.lag == pytest.approx(late, abs=3e-4)
    assert result.alignment.findings == ()
    metrics = result.find("elbow", "link_position").metrics
    assert metrics["rmse"] < 2e-3
    assert metrics["r2"] > 0.9999
    assert abs(metrics["delay"]) < 5e-4


def test_alignment_by_references_keeps_the_delay_of_the_response(tmp_path):
    t = np.arange(0, 5, 0.005)
    result = compare(simulation(), read(write(tmp_path, "time,elbow_pos,elbow_cmd", t, motion(t - 0.05), reference(t))))
    assert result.alignment.how == "cross-correlation of elbow.reference_1"
    assert result.alignment.lag == pytest.approx(0.0, abs=2e-3)
    # The simulation comes earlier.
    assert result.find("elbow", "link_position").metrics["delay"] == pytest.approx(-0.05, abs=2e-3)


@pytest.mark.parametrize(("correlation", "believed"), [(0.53, False), (0.67, True)])
def test_a_lag_of_little_correlation_is_not_believed(correlation, believed):
    clean = motion(TIME)
    noise = np.std(clean) * np.sqrt(1.0 / correlation**2 - 1.0) * np.random.default_rng(2).standard_normal(len(TIME))
    found = align(TIME, clean, TIME, motion(TIME - 0.1) + noise)
    assert found.found.correlation == pytest.approx(correlation, abs=0.04)
    assert found.how.startswith("cross-correlation") == believed
    assert found.lag == pytest.approx(0.1 if believed else 0.0, abs=0.02)


def test_lag_can_be_set_or_switched_off(tmp_path):
    recording = read(laboratory(tmp_path, late=0.3))
    assert compare(simulation(), recording, lag="off").alignment.lag == 0.0
    assert compare(simulation(), recording, lag=0.3).find("elbow", "link_position").metrics["rmse"] < 2e-3
    with pytest.raises(RecordingError, match="number of seconds"):
        compare(simulation(), recording, lag="maybe")


def test_a_recording_starts_with_its_earliest_column(tmp_path):
    """As for `start` of a playback: the columns have separate clocks, and the position begins 0.2 s after the command."""
    late = TIME[200:]
    tables = {"a": {"time": TIME + 7.0, "elbow_cmd": reference(TIME)}, "b": {"time": late + 7.0, "elbow_pos": motion(late)}}
    savemat(tmp_path / "lab.mat", tables)
    for joints in ({}, {"mapping": ["a.elbow_cmd=ignore"]}):
        result = compare(simulation(), read(tmp_path / "lab.mat", **joints), lag="start")
        assert result.alignment.lag == pytest.approx(7.0)


def test_a_lag_at_the_limit_of_the_search_is_not_believed(tmp_path):
    """The search covers a quarter of the shorter record: 0.5 s of 2 s."""
    t = np.arange(0.0, 2.0, 0.005)
    result = compare(simulation(), read(write(tmp_path, "time,elbow_pos", t, motion(t - 0.55))))
    assert result.alignment.lag == 0.0
    assert "limit" in result.alignment.how
    assert any(one.code == "lag" for one in result.findings)


def test_a_lag_beyond_the_search_is_found_if_both_begin_together(tmp_path):
    t = np.arange(0.0, 2.0, 0.005)
    result = compare(simulation(), read(write(tmp_path, "time,elbow_pos", t + 1.5, motion(t - 0.02))))
    assert result.alignment.lag == pytest.approx(1.52, abs=1e-3)


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_a_later_recording_on_the_same_clock_is_aligned(tmp_path, late):
    """Where both begin says nothing, as long as they overlap."""
    t = np.arange(0.8, 5, 0.01)
    found = compare(simulation(), read(write(tmp_path, "time,elbow_pos", t, motion(t - late)))).alignment
    assert found.lag == pytest.approx(late, abs=3e-3)
    assert found.how.startswith("cross-correlation")


def test_a_lag_beyond_the_search_is_found_although_a_wrong_lag_correlates():
    """Without a command, a swing also fits its later part: here with a correlation of 0.76 at 1.4 s."""
    ours, late = 0.001 * np.arange(8001), 1.7
    since = np.maximum(ours - 0.1, 0.0)
    swing = 0.8 * (1.0 - np.exp(-3.0 * since) * np.cos(12.8 * since)) + 0.05 * np.sin(3.1 * since)
    theirs = slice(13, 6301)
    assert align(ours, swing, ours[theirs] + late, swing[theirs]).lag == pytest.approx(late, abs=1e-5)


@pytest.mark.parametrize(("rate", "told"), [(37.0, True), (500.0, False)])
def test_a_step_between_two_samples_leaves_a_range_of_lags_which_is_told(rate, told):
    theirs, late = np.arange(0.013, 5.0, 1.0 / rate), 0.1234
    found = align(TIME, reference(TIME), theirs, reference(theirs - late), name="elbow.reference_1", command=True)
    assert found.lag == pytest.approx(late, abs=1.0 / rate)
    notes = [str(one) for one in found.findings]
    assert ("all lags from" in " ".join(notes)) == told


def test_a_periodic_signal_gets_its_smallest_lag_and_a_note(tmp_path):
    t = np.arange(0, 5, 0.01)
    path = write(tmp_path, "time,elbow_pos", t, np.sin(2 * np.pi * 2 * (t - 0.04)))
    samples = Samples(time=TIME, joints=("elbow",), values={"link_position": np.sin(2 * np.pi * 2 * TIME)[:, None]})
    result = compare(samples, read(path))
    assert result.alignment.lag == pytest.approx(0.04, abs=1e-3)
    assert any("periodic" in f.message for f in result.findings)


def test_the_coarser_one_keeps_its_samples(tmp_path):
    fine, coarse = (
        compare(simulation(), read(laboratory(tmp_path, rate=rate)), lag="off").find("elbow", "link_position")
        for rate in (4000.0, 50.0)
    )
    np.testing.assert_array_equal(fine.simulation, motion(fine.time))
    np.testing.assert_allclose(coarse.time, np.arange(0, 5, 0.02), atol=1e-9)
    np.testing.assert_allclose(coarse.simulation, motion(coarse.time), atol=1e-9)


def test_gaps_are_not_bridged():
    time = np.concatenate([np.arange(0, 1, 0.01), np.arange(1.5, 2.5, 0.01)])
    values = np.where((time > 0.195) & (time < 0.395), np.nan, np.sin(time))
    grid = np.array([0.1, 0.189, 0.192, 0.3, 0.398, 0.401, 0.98, 0.992, 1.4, 1.499, 1.501, 2.48, 2.6])
    hidden = np.isin(grid, [0.192, 0.3, 0.398, 0.992, 1.4, 1.499, 2.6])
    result = resample(time, values, grid)
    assert np.isnan(result[hidden]).all()
    np.testing.assert_allclose(result[~hidden], np.sin(grid[~hidden]), atol=2e-5)


def test_resampling_makes_no_overshoot_at_a_step():
    time = np.arange(0, 2, 0.01)
    result = resample(time, np.where(time >= 1, 1.0, 0.0), np.arange(0, 1.99, 0.0095))
    assert np.nanmin(result) >= 0.0
    assert np.nanmax(result) <= 1.0


def test_clocks_without_overlap_are_aligned_by_motion_or_refused(tmp_path):
    t = 100 + np.arange(0, 5, 0.01)
    found = compare(simulation(), read(write(tmp_path, "time,elbow_pos", t, motion(t - 100.3)))).alignment
    assert found.lag == pytest.approx(100.3, abs=3e-3)
    recording = read(write(tmp_path, "time,elbow_pos", t, np.random.default_rng(1).normal(size=len(t))))
    for lag in ("auto", "off"):
        with pytest.raises(RecordingError, match=r"no overlap.*from 0 to 5 s.*from 100 to 104.*--align start") as caught:
            compare(simulation(), recording, lag=lag)
        assert caught.value.problems[0].file == recording.path
    assert compare(simulation(), recording, lag="start").alignment.lag == 100.0


@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_reversed_axis_is_not_aligned_by_half_a_period(tmp_path, late):
    recording = read(laboratory(tmp_path, late=late, scale=-1.0, header="time,elbow_pos,other"))
    result = compare(simulation(), recording)
    assert result.alignment.lag == pytest.approx(late, abs=3e-3)
    assert "the opposite sign" in result.alignment.how
    (hint,) = (one.hint for one in result.findings if one.code == "suspected-sign")
    assert "elbow_pos=-elbow.link_position" in str(hint)


def test_columns_of_another_kind_of_joint_do_not_align_clocks(tmp_path):
    """A reference in m, of a revolute joint, is compared with nothing, and so no lag is taken from it."""
    t = np.arange(0, 5, 0.01)
    recording = read(write(tmp_path, "time,elbow_ref [m],elbow_pos [rad]", t, motion(t - 0.4), motion(t - 0.1)))
    infos = (JointInfo(name="elbow", actuator="sea", mode=1, prismatic=False, quantities=("reference_1", "link_position")),)
    result = compare(simulation(), recording, infos=infos)
    assert result.alignment.how.endswith("elbow.link_position")
    assert result.alignment.lag == pytest.approx(0.1, abs=0.01)
    assert any(one.code == "wrong-unit" for one in result.findings)


def test_no_common_quantity_names_both(tmp_path):
    recording = read(laboratory(tmp_path), mapping=["elbow_pos=elbow.stiffness", "elbow_cmd=ignore"])
    with pytest.raises(RecordingError, match=r"elbow\.stiffness.*link_position"):
        compare(simulation(), recording)


def test_joints_are_paired_by_name(tmp_path):
    recording = read_recording(laboratory(tmp_path, header="time,q1,q1_ref"))
    assert compare(simulation("Joint-1"), recording).find("Joint-1", "link_position")
    with pytest.raises(RecordingError, match="no common joint"):
        compare(simulation("forearm"), recording)


def test_a_column_of_a_joint_that_the_simulation_lacks_is_named(tmp_path):
    mapping = ["q1=elbow.link_position", "q1_ref=wrist.link_position"]
    recording = read_recording(laboratory(tmp_path, header="time,q1,q1_ref"), mapping=mapping)
    (note,) = [one for one in compare(simulation("elbow"), recording).findings if one.code == "no-such-joint"]
    assert (note.key, note.message) == ("q1_ref", "is not compared: the simulation has no joint wrist")


def test_a_recording_with_an_unknown_ending_may_need_a_reader_of_the_user(tmp_path):
    """Without the reader, it is read as text, so its faults are those of the text."""
    hint, known, unknown = (
        "A reader of your own needs --plugin FILE",
        laboratory(tmp_path),
        laboratory(tmp_path, name="lab.own"),
    )
    for path, expected in ((known, False), (unknown, True)):
        with pytest.raises(RecordingError, match="no common joint") as mismatch:
            compare(simulation("forearm"), read(path))
        with pytest.raises(RecordingError, match="no such time column") as timeless:
            read_recording(path, mapping=["absent=time"])
        assert [hint in str(one.value) for one in (mismatch, timeless)] == [expected, expected]


def test_derived_quantities_are_compared(tmp_path):
    t = np.arange(0, 5, 0.005)
    path = write(tmp_path, "time,elbow_position_error", t, reference(t) - motion(t))
    info = JointInfo(name="elbow", actuator="rigid", mode=1, motors=0)
    series = compare(simulation(), read(path), infos=(info,), lag="off").find("elbow", "position_error")
    assert series.metrics["rmse"] < 1e-9


def test_a_band_spans_the_gaps_of_a_run_only(tmp_path):
    runs = [
        compare(simulation(), read(laboratory(tmp_path, offset=offset, name=f"run{i}.csv")), lag="off")
        for i, offset in enumerate((-0.01, 0.0, 0.04))
    ]
    whole = band(runs, "elbow", "link_position")
    assert whole.count == 3
    np.testing.assert_allclose(whole.high - whole.low, 0.05, atol=1e-9)
    np.testing.assert_allclose(whole.mean - motion(whole.time), 0.01, atol=1e-9)
    assert band(runs, "elbow", "stiffness") is None
    last = runs[2].find("elbow", "link_position")
    inside, after = (last.time > 2) & (last.time < 3), last.time > 4
    values = np.where(inside | after, np.nan, last.recording)
    runs[2] = replace(runs[2], series=(replace(last, recording=values),))
    found = band(runs, "elbow", "link_position")
    np.testing.assert_allclose((found.high - found.low)[inside], 0.01, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(found.mean), after)


ELBOW = JointInfo(name="elbow", actuator="sea", mode=3, motors=1, quantities=("link_position", "reference_1"))


def claim(path, limit=0.03, **options):
    return Expectation(quantity="link_position", measure="rmse", comparison="<", value=limit, joint="elbow",
                       against=path, options=options, line=4)  # fmt: skip


def test_claims_against_a_recording_align_it_as_a_comparison_does(tmp_path):
    path = laboratory(tmp_path, offset=0.02, late=0.37)
    claims = [claim(path), claim(path, 0.01), claim(path, lag="off"), claim(path, lag=0.37)]
    check_claims(claims, (ELBOW,), file=None)
    results = claim_results(claims, (ELBOW,), lambda *_: simulation())
    assert [result.holds for result in results] == [True, False, False, True]
    compared = compare(simulation(), read(path)).find("elbow", "link_position")
    assert results[0].measured == compared.metrics["rmse"] == pytest.approx(0.02, rel=0.02)
    assert "lab.csv" in results[0].text


def test_claims_say_what_is_doubtful_in_their_recording(tmp_path):
    path = laboratory(tmp_path)
    head, *rows = path.read_text().splitlines()
    rows[300] = ",".join("-9999" if i == 1 else cell for i, cell in enumerate(rows[300].split(",")))
    path.write_text("\n".join([head, *rows]) + "\n")
    (result,) = claim_results([claim(path)], (ELBOW,), lambda *_: simulation())
    assert "is -9999 in 1 sample" in result.text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"map": ["pos=elbow.stiffness"]}, "no such column"),
        ({"map": ["elbow_pos=ignore"]}, "no column for elbow.link_position"),
    ],
)
def test_claims_whose_recording_cannot_serve_are_errors_before_the_run(tmp_path, options, words):
    with pytest.raises(ScenarioError, match=words) as error:
        check_claims([claim(laboratory(tmp_path), **options)], (ELBOW,), file=None)
    assert error.value.problems[0].line == 4


def test_a_damaged_recording_of_a_claim_is_stated_at_the_line_of_the_claim(tmp_path):
    path = tmp_path / "lab.json"
    path.write_text("7")
    with pytest.raises(ScenarioError) as error:
        check_claims([claim(path)], (ELBOW,), file=tmp_path / "lab.yaml")
    (problem,) = error.value.problems
    assert (problem.file, problem.line) == (tmp_path / "lab.yaml", 4)
    assert problem.message.startswith("lab.json: ")


@pytest.mark.parametrize(
    ("unit", "prismatic", "wrong"), [("m", False, True), ("rad", True, True), ("m", True, False), ("rad", False, False)]
)
def test_a_unit_of_another_kind_of_joint_is_refused(tmp_path, unit, prismatic, wrong):
    recording = read(laboratory(tmp_path, header=f"time,elbow_pos [{unit}],other"))
    infos = (replace(ELBOW, prismatic=prismatic),)
    if wrong:
        with pytest.raises(RecordingError, match=rf"is in {unit}, but elbow is"):
            compare(simulation(), recording, infos=infos)
    else:
        assert compare(simulation(), recording, infos=infos).find("elbow", "link_position").unit == unit


@pytest.mark.parametrize("late", [0.0, 0.0203, 120.5])
@pytest.mark.parametrize("hold", [True, False])
def test_a_run_that_plays_a_recorded_command_is_aligned_to_its_clock_exactly(tmp_path, late, hold):
    """The command has 250 values a second, which the run plays as a staircase, or between straight lines."""
    recorded = np.arange(0.0, 4.0, 0.004)
    command = 0.3 * np.sin(4.4 * recorded) + 0.2 * (recorded > 1.0) - 0.3 * (recorded > 2.3)
    place = np.searchsorted(recorded, TIME + 1e-9, side="right") - 1
    played = command[place] if hold else np.interp(TIME, recorded, command)
    own = Samples(time=TIME[TIME < 4.0], joints=("elbow",), values={"reference_1": played[TIME < 4.0, None]})
    result = compare(own, read(write(tmp_path, "time,elbow_cmd", recorded + late, command)))
    assert result.alignment.lag == pytest.approx(late, abs=1e-5)
    assert result.find("elbow", "reference_1").metrics["rmse"] < 1e-4


def stairs(time):
    """Three steps, at samples of records of 20, 50, 100 and 250 samples a second."""
    return np.select([time >= 2.3 - 1e-9, time >= 1.0 - 1e-9], [-0.1, 0.8], 0.0) + 0.3 * (time >= 3.1 - 1e-9)


@pytest.mark.parametrize("gain", [1.0, 1.02])
@pytest.mark.parametrize("late", [0.0, 0.0603, -0.0507])
@pytest.mark.parametrize("rates", [(1000, 20), (1000, 50), (1000, 100), (1000, 250), (100, 1000), (20, 1000), (100, 100)])
def test_each_value_of_a_staircase_holds_until_the_next_sample(rates, late, gain):
    """Rates of the simulation and of the recording. With a gain, the values of both records differ. The lags are longer than
    every sampling interval: a shorter lag would fit as well as none.
    """
    ours, theirs = (np.arange(0.0, 5.0, 1.0 / rate) for rate in rates)
    found = align(ours, stairs(ours), theirs + late, gain * stairs(theirs) + gain - 1.0, name="elbow.reference_1", command=True)
    assert found.lag == pytest.approx(late, abs=1e-5 if gain == 1.0 else 0.5 / max(rates))


def test_a_step_between_two_samples_does_not_move_a_clock(tmp_path):
    """The run steps 4 ms before the sample that shows the step: lags from -6 to 4 ms fit equally well."""
    time = np.arange(0.0, 5.0, 0.01)
    own = Samples(time=TIME, joints=("elbow",), values={"reference_1": reference(TIME + 0.004)[:, None]})
    result = compare(own, read(write(tmp_path, "time,elbow_cmd", time, reference(time + 0.004))))
    assert result.alignment.lag == 0.0


@pytest.mark.parametrize("rate", [50, 100, 250])
def test_smooth_commands_are_not_held(rate):
    ours, theirs = 0.001 * np.arange(5000), np.arange(0.0, 5.0, 1.0 / rate)
    smooth = [np.sin(2.0 * time) + 0.3 * np.sin(7.1 * time) for time in (ours, theirs)]
    for command in (True, False):
        found = align(ours, smooth[0], theirs + 0.0203, smooth[1], name="elbow.reference_1", command=command)
        assert found.lag == pytest.approx(0.0203, abs=3e-5)


@pytest.mark.parametrize("swapped", [False, True])
def test_columns_of_two_joints_that_are_interchanged_are_told(tmp_path, swapped):
    t, values = TIME[::5], np.column_stack([motion(TIME), 0.4 * reference(TIME)])
    both = values[::5, ::-1] if swapped else values[::5]
    path = write(tmp_path, "time,hip_pos,elbow_pos", t, *(both + 0.01).T)
    samples = Samples(time=TIME, joints=("hip", "elbow"), values={"link_position": values})
    found = compare(samples, read_recording(path, joints=("hip", "elbow")), lag="off").findings
    assert [one.key for one in found if one.code == "suspected-joint"] == ["hip_pos"] * swapped


@pytest.mark.filterwarnings("error")
def test_a_joint_without_numbers_is_no_interchanged_one(tmp_path):
    values = np.column_stack([motion(TIME), 0.4 * reference(TIME)])
    path = write(tmp_path, "time,hip_pos,elbow_pos", TIME[::5], values[::5, 0], np.full(1001, np.nan))
    samples = Samples(time=TIME, joints=("hip", "elbow"), values={"link_position": values})
    found = compare(samples, read_recording(path, joints=("hip", "elbow")), lag="off").findings
    assert "suspected-joint" not in [one.code for one in found]
