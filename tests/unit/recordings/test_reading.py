"""The document beside a recording that says how it is read: what it states counts, and nothing else is taken from names."""

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from asrsim.recordings.propose import propose
from asrsim.scenario import load_scenario
from asrsim.signals import Playback

TIME = np.arange(60) * 0.01
ALPHA = 30 * np.sin(5 * TIME)
BETA = 20 * np.cos(5 * TIME)


def lab(folder, name="lab.csv"):
    """A file of which names say nothing: decimal commas, a remark above, names in another encoding."""
    rows = [f"{1000 * t:.0f};{a:.9f};{b:.9f}".replace(".", ",") for t, a, b in zip(TIME, ALPHA, BETA, strict=True)]
    path = folder / name
    path.write_bytes("\n".join(["run 7; of May", "\u6642\u9593;\u89d2\u5ea6;q1", *rows, ""]).encode("shift_jis"))
    return path


WHOLE = """\
time: {column: \u6642\u9593, unit: ms}
separator: ";"
decimal: ","
encoding: shift_jis
header: 2
map:
  \u89d2\u5ea6: elbow.link_position [deg]
"""


def test_a_document_states_layout_time_and_columns(tmp_path):
    path = lab(tmp_path)
    (tmp_path / "lab.csv.yaml").write_text(WHOLE, encoding="utf-8")
    recording = read_recording(path)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, np.radians(ALPHA), atol=1e-9)
    assert recording.column("elbow", "link_position").origin == "lab.csv.yaml"


def test_with_a_map_no_meaning_is_taken_from_a_name(tmp_path):
    path = lab(tmp_path)
    assert read_recording(path, mapping=["1=time [ms]"]).joints == ("joint_1",)
    (tmp_path / "lab.csv.yaml").write_text(WHOLE, encoding="utf-8")
    assert read_recording(path).joints == ("elbow",)
    assert "not listed in lab.csv.yaml" in read_recording(path).channels["q1"].origin


def test_the_command_line_overrules_the_document(tmp_path):
    path = lab(tmp_path)
    (tmp_path / "lab.csv.yaml").write_text(WHOLE, encoding="utf-8")
    over = read_recording(path, mapping=["q1=elbow.link_velocity [deg/s]", "\u89d2\u5ea6=-elbow.link_position [deg]"])
    np.testing.assert_allclose(over.column("elbow", "link_position").values, -np.radians(ALPHA), atol=1e-9)
    np.testing.assert_allclose(over.column("elbow", "link_velocity").values, np.radians(BETA), atol=1e-9)


def test_a_document_describes_its_file_and_similar_files(tmp_path):
    path = lab(tmp_path)
    (tmp_path / "arm.yaml").write_text("file: lab.csv\n" + WHOLE, encoding="utf-8")
    for found in (read_recording(path, mapping=tmp_path / "arm.yaml"), read_recording(tmp_path / "arm.yaml")):
        np.testing.assert_allclose(found.column("elbow", "link_position").values, np.radians(ALPHA), atol=1e-9)


def test_a_rate_and_a_window_are_stated(tmp_path):
    path = tmp_path / "lab.csv"
    np.savetxt(path, np.column_stack([ALPHA, BETA]), delimiter=",", header="alpha,beta", comments="")
    (tmp_path / "lab.csv.yaml").write_text(
        "time: {rate: 50}\nwindow: [0.1, 0.5]\nmap:\n  alpha: elbow.link_position [deg] - 0.1\n"
    )
    column = read_recording(path).column("elbow", "link_position")
    np.testing.assert_allclose(column.time, np.arange(5, 26) * 0.02)
    np.testing.assert_allclose(column.values, np.radians(ALPHA[5:26]) - 0.1, atol=1e-9)


def test_parts_of_a_time_have_units_in_their_names(tmp_path):
    path = tmp_path / "lab.csv"
    path.write_text("".join(f"{i // 50},{(i % 50) * 20_000_000},{a}\n" for i, a in enumerate(ALPHA)))
    (tmp_path / "lab.csv.yaml").write_text("header: 0\ntime: {column: [1, 2]}\nmap:\n  3: elbow.link_position [deg]\n")
    with pytest.raises(RecordingError, match="nanosec"):
        read_recording(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mapp: {q1: a.link_position}", "Did you mean 'map'"),
        ("map: {q1: a.link_positon}", "q1: no quantity is called 'link_positon'"),
        ("map: {q1: time}", "state its column under `time`"),
        ("separator: ':'", "not one of the choices"),
        ("encoding: hex", "not a known encoding"),
        ("encoding: utf-16", "UTF-16 stream does not start with BOM"),
        ("window: [3, 1]", "must be a start and a later end"),
    ],
)
def test_a_fault_of_a_document_is_told_with_its_place(tmp_path, text, words):
    path = tmp_path / "lab.csv"
    np.savetxt(path, np.column_stack([TIME, ALPHA]), delimiter=",", header="time,q1", comments="")
    (tmp_path / "lab.csv.yaml").write_text(text + "\n")
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert "lab.csv" in str(caught.value.problems[0].file)


def test_what_is_proposed_reads_the_same_numbers(tmp_path, asrsim_command):
    rows = [f"{1000 * t:.0f}\t{a:.9f}\t{b:.9f}\t0.5" for t, a, b in zip(TIME, ALPHA, BETA, strict=True)]
    path = tmp_path / "lab.txt"
    path.write_text("\n".join(["%Time (ms)\tHubangle (deg)\tq1 [deg]\teff", *rows]) + "\n")
    plain = read_recording(path)
    assert asrsim_command("init", "--experiment", "lab.txt").code == 0
    text = (tmp_path / "lab.txt.yaml").read_text()
    assert "# eff: JOINT.QUANTITY [unit]" in text
    assert "time: {column: Time (ms), unit: ms}" in text
    stated = read_recording(path)
    np.testing.assert_array_equal(stated.channels["q1 [deg]"].values, plain.channels["q1 [deg]"].values)
    assert stated.channels["eff"].quantity is None
    # What is confirmed by hand is not written over.
    assert asrsim_command("init", "--experiment", "lab.txt").code == 1


def test_a_question_is_answered_in_its_line(tmp_path):
    path = tmp_path / "lab.csv"
    np.savetxt(path, np.column_stack([TIME, ALPHA]), delimiter=",", header="time,theta", comments="")
    document = tmp_path / "lab.csv.yaml"
    document.write_text(propose(path)[0].replace("# theta: JOINT.QUANTITY [unit]", "theta: elbow.link_position [deg]"))
    np.testing.assert_allclose(read_recording(path).column("elbow", "link_position").values, np.radians(ALPHA))


@pytest.mark.parametrize("heading", ["knee_pos_deg", "knee position (degrees)", "theta [deg]"])
def test_a_question_proposes_the_unit_of_the_heading(tmp_path, heading):
    """Not the SI unit: the numbers in the file are degrees."""
    path, document = tmp_path / "lab.csv", tmp_path / "lab.csv.yaml"
    np.savetxt(path, np.column_stack([TIME, ALPHA]), delimiter=",", header=f"time,{heading}", comments="")
    text = propose(path)[0]
    assert f"# {heading}: JOINT.QUANTITY [deg" in text
    document.write_text(text.replace(f"# {heading}: JOINT.QUANTITY", f"{heading}: elbow.link_position"))
    np.testing.assert_allclose(read_recording(path).column("elbow", "link_position").values, np.radians(ALPHA))


@pytest.mark.parametrize("name", ["quanser_2dsfl_lqr_10deg.csv", "hebi_sine_1hz.csv", "emps_estimation.csv"])
def test_proposals_for_real_files_do_not_change_the_reading(tmp_path, shared, name):
    path = tmp_path / name
    path.write_bytes((shared / "recordings" / name).read_bytes())
    plain = read_recording(path)
    (tmp_path / f"{name}.yaml").write_text(propose(path)[0])
    stated = read_recording(path)
    for column in plain.channels.values():
        other = stated.channels[column.source]
        assert (other.joint, other.quantity, other.unit) == (column.joint, column.quantity, column.unit) or not column.quantity
        np.testing.assert_array_equal(other.values, column.values)


def test_a_signal_is_played_as_the_document_says(tmp_path):
    (tmp_path / "lab.csv.yaml").write_text(WHOLE + "window: [0.1, 0.4]\n", encoding="utf-8")
    times, values = Playback(file=lab(tmp_path), column="\u89d2\u5ea6").samples
    np.testing.assert_allclose(times, TIME[10:41], atol=1e-12)
    np.testing.assert_allclose(values, np.radians(ALPHA[10:41]), atol=1e-9)


def test_a_scenario_keeps_the_document_of_what_it_plays(tiny):
    lab(tiny.folder)
    (tiny.folder / "lab.csv.yaml").write_text(WHOLE, encoding="utf-8")
    text = tiny.scenario.read_text()
    played = "{playback: {file: lab.csv, column: \u89d2\u5ea6}}"
    tiny.scenario.write_text(
        text.replace("references:", f"external_torques: {{joint_1: {played}}}\nreferences:", 1), encoding="utf-8"
    )
    (scenario,) = load_scenario(tiny.scenario)
    assert {"lab.csv", "lab.csv.yaml"} <= set(scenario.attachments)


def test_a_late_column_is_read_at_earlier_times_and_played_there(tmp_path):
    """Other columns keep their times; an offset needs no unit; a correction of a meaning is read back from its text."""
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([TIME, ALPHA, BETA]), delimiter=",", header="time,a,b", comments="", fmt="%.12g"
    )
    (tmp_path / "a.csv.yaml").write_text("map: {a: 2*elbow.link_position - 0.5 late 0.004, b: elbow.reference_1 late -0.002}\n")
    recording = read_recording(tmp_path / "a.csv")
    late, early = recording.column("elbow", "link_position"), recording.column("elbow", "reference_1")
    np.testing.assert_allclose(late.time, TIME - 0.004, atol=1e-12)
    np.testing.assert_allclose(late.values, 2.0 * ALPHA - 0.5, atol=1e-9)
    np.testing.assert_allclose(early.time, TIME + 0.002, atol=1e-12)
    assert late.conversion.endswith("-0.5; -0.004 s")
    np.testing.assert_allclose(Playback(file=tmp_path / "a.csv", column="b").samples[0], TIME + 0.002, atol=1e-12)
    text = late.read_as.corrected(gain=-1.5, offset=0.25, late=0.001).text
    assert text == "-3*elbow.link_position + 1.125 late 0.005"
    again = read_recording(tmp_path / "a.csv", mapping=[f"a={text}"]).column("elbow", "link_position")
    np.testing.assert_allclose(again.values, -1.5 * (late.values - 0.25), atol=1e-9)
    np.testing.assert_allclose(again.time, TIME - 0.005, atol=1e-12)


@pytest.mark.parametrize("called", ["alpha", "alpha [deg]", "2"])
def test_an_item_counts_more_than_the_document_however_it_names_the_column(tmp_path, called):
    path = tmp_path / "lab.csv"
    path.write_text("t [s],alpha [deg]\n" + "".join(f"{i / 100},{i}\n" for i in range(20)))
    (tmp_path / "lab.csv.yaml").write_text("map: {'alpha [deg]': elbow.deflection}\n")
    read = read_recording(path, mapping=[f"{called}=-elbow.deflection"]).column("elbow", "deflection")
    assert read.values[10] == pytest.approx(-np.radians(10.0))
