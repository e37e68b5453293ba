"""MATLAB files: vectors, structs, Simulink's structures, matrices; and what cannot be read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording

pytestmark = pytest.mark.once

TIME = 0.002 * np.arange(100)
Q = np.sin(5 * TIME)

CONTENTS: dict[str, dict[str, Any]] = {
    "vectors": {"t": TIME, "q1": Q},
    "columns": {"t": TIME[:, None], "q1": Q[:, None]},
    "milliseconds and degrees": {"time_ms": TIME * 1e3, "q1_deg": np.degrees(Q)},
    "struct": {"run": {"time": TIME, "q1": Q}},
    "nested struct": {"data": {"run": {"time": TIME, "joint": 3.0, "q1": Q}}},
    "structure with time": {"out": {"time": TIME, "signals": {"values": Q[:, None], "label": "q1"}}},
    "structure with time and several signals": {
        "out": {"time": TIME, "signals": [{"values": Q, "label": "q1"}, {"values": 2 * Q, "label": "other"}]}
    },
}


@pytest.mark.parametrize("content", CONTENTS)
def test_contents(tmp_path: Path, content: str) -> None:
    path = tmp_path / "lab.mat"
    savemat(path, CONTENTS[content])
    recording = read_recording(path)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q, atol=1e-12)


def test_a_matrix_with_time_in_its_first_column(tmp_path: Path) -> None:
    savemat(tmp_path / "lab.mat", {"M": np.column_stack([TIME, Q, 2 * Q])})
    recording = read_recording(tmp_path / "lab.mat", mapping=["M_2=elbow.link_position"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, Q)


def test_structs_with_times_of_their_own(tmp_path: Path) -> None:
    savemat(tmp_path / "lab.mat", {"a": {"t": TIME, "q1": Q}, "b": {"t": TIME[::2], "q2": Q[::2]}})
    recording = read_recording(tmp_path / "lab.mat")
    assert len(recording.column("joint_1", "link_position").time) == 100
    assert len(recording.column("joint_2", "link_position").time) == 50
    assert any(f.code == "several-times" for f in recording.findings)


def test_fields_of_structs_are_named_by_their_path(tmp_path: Path) -> None:
    savemat(tmp_path / "lab.mat", {"data": {"run": {"time": TIME, "q1": Q}}})
    assert read_recording(tmp_path / "lab.mat").column("joint_1", "link_position").source == "data.run.q1"


def test_a_variable_of_two_values_beside_the_vectors_is_reported(tmp_path: Path) -> None:
    savemat(tmp_path / "lab.mat", {"t": TIME, "q1": Q, "gains": np.arange(2.0)})
    recording = read_recording(tmp_path / "lab.mat")
    assert [f.key for f in recording.findings if f.code == "length"] == ["gains"]


def test_vectors_of_another_length_are_reported(tmp_path: Path) -> None:
    savemat(tmp_path / "lab.mat", {"t": TIME, "q1": Q, "gains": np.arange(5.0)})
    recording = read_recording(tmp_path / "lab.mat")
    assert [f.key for f in recording.findings if f.code == "length"] == ["gains"]


def test_without_a_time(tmp_path: Path) -> None:
    savemat(tmp_path / "lab.mat", {"q1": Q, "q2": Q})
    with pytest.raises(RecordingError, match="no time"):
        read_recording(tmp_path / "lab.mat")
    np.testing.assert_allclose(read_recording(tmp_path / "lab.mat", rate=500.0).time, TIME)


def test_damaged(tmp_path: Path) -> None:
    (tmp_path / "lab.mat").write_bytes(b"MATLAB 5.0 nothing of the kind" * 30)
    with pytest.raises(RecordingError, match="matlab"):
        read_recording(tmp_path / "lab.mat")
