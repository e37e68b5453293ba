"""Files as laboratories write them, laid over a simulation with nothing said about them: right, or refused in clear words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from lab_files import ABQ, MATLAB, READ, REFUSED, TIME, A, B, command, elbow, shoulder, table, write_bag
from typer.testing import CliRunner

from asrsim.cli.app import app
from asrsim.errors import RecordingError
from asrsim.log import LogWriter
from asrsim.recordings import Comparison, Recording, compare, read_recording
from asrsim.recordings.unstated import beyond_stops
from asrsim.samples import JointInfo, RunInfo, Samples

pytestmark = pytest.mark.once

JOINTS = ("shoulder", "elbow")
FINE = np.arange(3001) * 0.001
SIMULATION = Samples(
    time=FINE, joints=JOINTS,
    values={"link_position": np.column_stack([shoulder(FINE), elbow(FINE)]),
            "reference_1": np.column_stack([command(FINE), elbow(FINE)])},
)  # fmt: skip


def lay_over(path: Path) -> tuple[Recording, Comparison]:
    recording = read_recording(path, joints=JOINTS)
    return recording, compare(SIMULATION, recording)


def check(path: Path) -> Recording:
    recording, compared = lay_over(path)
    for joint in JOINTS:
        series = compared.find(joint, "link_position")
        assert series is not None, f"no position of {joint}"
        # The lag is found to a few ms where a step is the only reference.
        assert series.metrics["rmse"] < 0.01
    return recording


@pytest.mark.parametrize("name", READ)
def test_text_files_are_read_as_they_are(tmp_path: Path, name: str) -> None:
    (tmp_path / "lab.csv").write_bytes(READ[name])
    check(tmp_path / "lab.csv")


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused_with_what_was_found(tmp_path: Path, name: str) -> None:
    content, words = REFUSED[name]
    (tmp_path / "lab.csv").write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        lay_over(tmp_path / "lab.csv")


@pytest.mark.parametrize("name", MATLAB)
def test_matlab_files(tmp_path: Path, name: str) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "lab.mat", MATLAB[name])
    check(tmp_path / "lab.mat")


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize("kind", ["joint state", "array", "own", "nested"])
def test_bags(tmp_path: Path, storage: str, kind: str) -> None:
    check(write_bag(tmp_path / "bag", storage, kind))


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        (
            "lab.csv",
            table(ABQ, before="# angles in degrees\nt,q1,q2\n"),
            "q1, q2: state no unit.*the file says: # angles in degrees",
        ),
        ("lab_deg.csv", table(ABQ, before="t,q1,q2\n"), "the file's name says deg"),
        ("lab.csv", table(ABQ, before="t,q1 [deg],q2\n"), r"q2: states no unit.*'q1 \[deg\]' is in deg"),
        ("lab.csv", table([TIME, 40 * A, B], before="t,q1,q2\n"), "q1, q2: state no unit.*'q1' would turn by 2"),
        ("lab.csv", table([TIME, 10 * A, B], before="t,q1,q2\n"), None),
        ("lab.csv", table([TIME, 40 * A, B], before="t,q1 [rad],q2 [rad]\n"), None),
        ("lab.csv", table(ABQ, before="# no degrees here\nt,q1 [rad],q2 [rad]\n"), None),
    ],
)
def test_a_unit_that_stands_elsewhere_is_asked_about(tmp_path: Path, name: str, content: bytes, told: str | None) -> None:
    (tmp_path / name).write_bytes(content)
    found = [str(one) for one in read_recording(tmp_path / name, joints=JOINTS).findings if one.code == "unstated-unit"]
    assert len(found) == (told is not None)
    assert told is None or re.search(told, found[0])


@pytest.mark.parametrize(
    ("factor", "header", "asked"), [(6.0, "q1", True), (1.2, "q1", False), (6.0, "q1 [rad]", False), (6.0, "dq1", False)]
)
def test_a_link_that_would_pass_its_stops_is_asked_about(tmp_path: Path, factor: float, header: str, asked: bool) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, factor * A], before=f"t,{header}\n"))
    (column,) = read_recording(tmp_path / "lab.csv", joints=("joint_1",)).channels.values()
    assert (beyond_stops(column, "joint_1", (-0.5, 0.5)) is not None) == asked
    assert beyond_stops(column, "joint_1", (-np.inf, np.inf)) is None


@pytest.mark.parametrize(("unit", "asked"), [("Grad", True), ("grad", True), ("grad/s", True), ("deg", False), ("gon", False)])
def test_grad_is_read_as_degrees_and_asked_about(tmp_path: Path, unit: str, asked: bool) -> None:
    (tmp_path / "lab.csv").write_bytes(table(ABQ, before=f"t,q1 [{unit}],q2 [{unit}]\n"))
    recording = read_recording(tmp_path / "lab.csv", joints=JOINTS)
    first = recording.channels[f"q1 [{unit}]"]
    assert first.values == pytest.approx(A * np.pi / (200 if unit == "gon" else 180))
    assert [one.key for one in recording.findings if one.code == "gradians"] == [f"q1 [{unit}], q2 [{unit}]"] * asked


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (table([TIME * 1e3, A, B], before="Time (s),q1,q2\n"), r"less than two samples(.|\n)*in ms they would be 0.01 s"),
        (table(ABQ, before="t,q1 [counts],q2 [counts]\n"), r"q1 \[counts\] looks like link_position, but its unit is counts"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_likely_reason(tmp_path: Path, content: bytes, told: str) -> None:
    (tmp_path / "lab.csv").write_bytes(content)
    with pytest.raises(RecordingError, match=told):
        lay_over(tmp_path / "lab.csv")


def test_what_is_odd_is_said(tmp_path: Path) -> None:
    for name, words in {
        "marked by -9999": "40 cells are -9999",
        "no number": "40 of 300 samples have no number",
        "date and time": "'Datum' and 'Uhrzeit' are read as one time",
        "duplicates": "3 duplicate time stamps, dropped: lines",
        "backward": "2 time stamps that go backward",
    }.items():
        (tmp_path / "lab.csv").write_bytes(READ[name])
        assert any(words in finding.message for finding in check(tmp_path / "lab.csv").findings), name


def test_constant_columns_and_columns_without_numbers_are_said(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, 0 * A + 0.3, np.nan * B], before="t,q1,q2\n"))
    recording, compared = lay_over(tmp_path / "lab.csv")
    said = [finding.message for finding in (*recording.findings, *compared.findings)]
    assert any("is constant at 0.3 rad" in text for text in said)
    assert any("has no number at all" in text for text in said)
    assert any("does not move in both" in text for text in said)


@pytest.mark.parametrize(
    ("factor", "header", "words"),
    [
        (180 / np.pi, "t,q1,q2", "57.3 times as large"),
        (1000.0, "t,q1,q2", "thousandths"),
        (-1.0, "t,q1,q2", "moves against the simulation"),
    ],
)
def test_units_and_signs_are_suspected(tmp_path: Path, factor: float, header: str, words: str) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, factor * A, factor * B], before=f"{header}\n"))
    recording, compared = lay_over(tmp_path / "lab.csv")
    said = " ".join(finding.message for finding in (*recording.findings, *compared.findings))
    assert re.search(words, said)


@pytest.mark.parametrize(
    ("column", "header", "words"),
    [
        (A, "q1 [furlong]", "its unit [furlong] is not known"),
        (np.round(2048 + 500 * A), "q1", "look like counts or degrees"),
        (np.round(2048 + 500 * A), "q1_ref", "look like counts or degrees"),
        (A, "q1_ref [counts]", "its unit is counts"),
        (A, "q1_ref [V]", "its unit is V"),
    ],
)
def test_what_is_hardly_in_si_is_asked_about_and_not_taken(tmp_path: Path, column: np.ndarray, header: str, words: str) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, column, B], before=f"t,{header},q2\n"))
    recording = read_recording(tmp_path / "lab.csv", joints=JOINTS)
    assert recording.channels[header].quantity is None
    assert words in recording.channels[header].origin
    named = [f"{header}=shoulder.link_position [deg]"]
    told = read_recording(tmp_path / "lab.csv", joints=JOINTS, mapping=named).column("shoulder", "link_position")
    np.testing.assert_allclose(told.values, column * np.pi / 180, rtol=1e-6, atol=1e-9)


def test_a_motor_before_its_gear_is_suspected(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, 273 * A], before="t,shoulder_motor\n"))
    motors = Samples(time=FINE, joints=JOINTS, values={"motor_1_position": SIMULATION.values["link_position"]})
    compared = compare(motors, read_recording(tmp_path / "lab.csv", joints=JOINTS))
    assert "273 times as large" in compared.findings[0].message
    assert "before the gear" in compared.findings[0].message


def test_a_minus_turns_an_axis(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, -A * 57.29577951, B], before="t,q1,q2\n"))
    recording = read_recording(tmp_path / "lab.csv", joints=JOINTS, mapping=["q1=-shoulder.link_position [deg]"])
    np.testing.assert_allclose(recording.column("shoulder", "link_position").values, A, atol=1e-7)


def test_plot_takes_them_from_the_command_line(tmp_path: Path) -> None:
    infos = tuple(JointInfo(name=n, actuator="sea", mode=6, motors=1, quantities=tuple(SIMULATION.values)) for n in JOINTS)
    with LogWriter(tmp_path / "log.mcap", RunInfo(robot="arm", joints=infos, step=0.001, urdf="<robot name='arm'/>")) as log:
        log.write(SIMULATION)
    (tmp_path / "lab.csv").write_bytes(READ["german joints"])
    arguments = ["plot", str(tmp_path / "log.mcap"), "--experiment", str(tmp_path / "lab.csv"), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["experiments"][0]["columns"]["Gelenk2_Ist [Grad]"] == "elbow.link_position"
    rmse = [row["value"] for row in told["metrics"] if (row["quantity"], row["measure"]) == ("link_position", "rmse")]
    assert max(rmse) < 0.01
    assert (tmp_path / "compared" / "comparison.png").stat().st_size > 10_000
