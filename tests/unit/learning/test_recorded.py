"""Recordings of the robot as a laboratory has them, taken as trials of learning."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.errors import InputError, OutputError
from asrsim.learning.hardware import next_input
from asrsim.learning.plant import make_plant
from asrsim.learning.recorded import MISSING, recorded
from asrsim.recordings import read_recording
from asrsim.scenario import make_scenario
from asrsim.simulation.examine import examine
from support.paths import ROOT

ARM = ROOT / "examples" / "urdf" / "dof2_vertical.urdf"
MOTION = {"joint_1": {"minimum_jerk": {"duration": 2.0, "to": 0.4}}, "joint_2": {"minimum_jerk": {"duration": 2.0, "to": -0.5}}}


@pytest.fixture(scope="module")
def plant():
    block = {"trajectory": MOTION, "tolerance": 1e-3}
    return make_plant(examine(make_scenario(ARM, duration=2.5, references={"*": {"stiffness_preset": 0.3}}, ilc=block)))


def write(path, plant, header, *, rate=200.0, late=0.0, scale=(1.0, 1.0), gap=(0.0, 0.0), mark=".", apart=","):
    """Write a recording of a robot that lags by 15 ms and has a constant error of 3 mrad."""
    time = np.arange(0.0, plant.time[-1] + late + 0.1, 1.0 / rate)
    time = time[(time <= gap[0]) | (time >= gap[1])]
    true = [0.003 + np.interp(time - late - 0.015, plant.time, one) for one in plant.reference.T]
    seen = [factor * values for factor, values in zip(scale, true, strict=True)]
    rows = [apart.join(f"{value:.9g}".replace(".", mark) for value in row) for row in np.column_stack([time, *seen])]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def take(path, plant, *maps, lag="off"):
    return recorded(read_recording(path, mapping=maps or None, joints=plant.joints), plant, lag)


DEGREES = (180.0 / np.pi, 180.0 / np.pi)


@pytest.mark.parametrize(
    ("header", "how"),
    [
        ("t_s,q1_deg,q2_deg", {"scale": DEGREES}),
        ("Zeit;Joint 1 [Grad];Joint 2 [Grad]", {"scale": DEGREES, "mark": ",", "apart": ";"}),
        ("time [s],joint_1.link_position [rad],joint_2.link_position [rad]", {"rate": 60.0}),
        ("time [s],joint_1 [rad],joint_2 [rad]", {"gap": (1.0, 1.08)}),
    ],
    ids=["degrees", "german", "slow", "gap"],
)
def test_what_the_laboratory_writes_is_the_trial(header, how, plant, tmp_path):
    found = take(write(tmp_path / "trial.csv", plant, header, **how), plant)
    late = np.column_stack([np.interp(plant.time - 0.015, plant.time, one) for one in plant.reference.T])
    assert np.abs(found.outputs - late - 0.003).max() < 1e-3
    assert any("interpolated" in one.message for one in found.findings) == ("gap" in how)


@pytest.mark.parametrize(
    ("header", "scale", "said"),
    [
        ("t,a1,a2", DEGREES, "degrees"),
        ("t,q1,q2", (-1.0, 1.0), "is its sign reversed"),
        ("t,q1 [m],q2 [m]", (1.0, 1.0), "is in m"),
    ],
    ids=["degrees", "sign", "unit"],
)
def test_implausible_columns_are_refused_unless_they_are_stated(header, scale, said, plant, tmp_path):
    path = write(tmp_path / "trial.csv", plant, header.replace("a", "angle"), scale=scale)
    with pytest.raises(InputError, match=said):
        take(path, plant)
    names = header.replace("a", "angle").split(",")[1:]
    unit = "deg" if scale is DEGREES else "rad"
    maps = [f"{name}=joint_{number}.link_position [{unit}]" for number, name in enumerate(names, 1)]
    assert take(path, plant, *maps).outputs.shape == plant.reference.shape


@pytest.mark.parametrize("kind", ["a mark for no value", "lost samples", "two joints"])
def test_numbers_that_would_mislead_the_robot_are_refused(plant, tmp_path, kind):
    path = write(tmp_path / "trial.csv", plant, "t,q1,q2")
    head, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    for i in (350, 351, 420) if kind != "two joints" else ():
        cells[i][1] = "-9999" if kind == "a mark for no value" else "0"
    if kind == "two joints":
        cells = [[t, str(-0.25 * float(b)), a] for t, a, b in cells]
        plant = replace(plant, reference=plant.reference * [1.0, -0.25])
    path.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")
    said = {"a mark for no value": "is -9999 in 3 samples", "lost samples": "falls to exactly 0 and back 2 times"}
    with pytest.raises(InputError, match=said.get(kind, "are the two columns interchanged")):
        take(path, plant)


def test_a_shifted_clock_is_reported_and_a_lagging_robot_not(plant, tmp_path):
    path = write(tmp_path / "late.csv", plant, "time [s],joint_1 [rad],joint_2 [rad]", late=0.3)
    (said,) = take(path, plant).findings
    assert "0.31" in said.message
    assert "--align 0.31" in str(said.hint)
    for lag in (0.3, "auto"):
        assert not take(path, plant, lag=lag).findings
    assert not take(write(path, plant, "time [s],joint_1 [rad],joint_2 [rad]"), plant).findings


def test_a_short_gap_is_bridged_and_noted(plant, tmp_path):
    path = write(tmp_path / "gap.csv", plant, "time [s],joint_1 [rad],joint_2 [rad]", gap=(1.0, 1.05))
    (said,) = (one for one in take(path, plant).findings if one.code == "gaps")
    assert said.file == path
    assert said.message == "has gaps of up to 0.049 s, which are interpolated linearly"


def test_a_recording_with_a_long_gap_is_refused(plant, tmp_path):
    """Linear interpolation would hide the motion in a gap of 0.2 s."""
    path = write(tmp_path / "gap.csv", plant, "time [s],joint_1 [rad],joint_2 [rad]", gap=(1.0, 1.2))
    with pytest.raises(InputError, match="of the whole motion"):
        take(path, plant)


@pytest.mark.parametrize("lacking", [0.7, 1.6])
@pytest.mark.parametrize("at", ["start", "end"])
def test_a_recording_may_lack_some_samples_at_its_ends(plant, tmp_path, at, lacking):
    missing = lacking * MISSING * plant.time[-1]
    gap = (-1.0, missing) if at == "start" else (plant.time[-1] - missing, 99.0)
    path = write(tmp_path / "short.csv", plant, "time [s],joint_1 [rad],joint_2 [rad]", gap=gap)
    if lacking > 1.0:
        with pytest.raises(InputError, match="of the whole motion"):
            take(path, plant, lag=0.0)
        return
    outputs = take(path, plant, lag=0.0).outputs
    late = np.column_stack([np.interp(plant.time - 0.015, plant.time, one) for one in plant.reference.T])
    assert np.abs(outputs - late - 0.003).max() < 2e-3


def test_the_last_recording_may_be_given_again(tmp_path):
    """With the right lag the last trial is replaced, and the next input equals that after the right reading alone."""
    block = {"trajectory": {"joint_1": {"minimum_jerk": {"duration": 0.3, "to": 0.3}}}, "tolerance": 1e-3, "law": "paper"}
    fast = {"engine": "mujoco", "step": 0.004, "substeps": 1, "parameters": {"joint_1": {"spring_k": 10.0}}}
    plant = make_plant(examine(make_scenario(ROOT / "examples/urdf/dof1_sea.urdf", duration=0.4, ilc=block, **fast)))
    header, late = "time [s],joint_1 [rad]", tmp_path / "late.csv"
    early = write(tmp_path / "early.csv", plant, header, scale=(1.0,))
    write(late, plant, header, late=0.1, scale=(1.0,))
    readings = (early, 0.0), (late, 0.0), (late, 0.1)
    _, wrong, again = (next_input(plant, tmp_path / "twice", path, lag=lag) for path, lag in readings)
    # The program ends before the next scenario is written, and the recording is given again.
    folder, unwritable = tmp_path / "once", tmp_path / "once" / "next.yaml"
    next_input(plant, folder, early)
    unwritable.unlink()
    unwritable.mkdir()
    with pytest.raises(OutputError):
        next_input(plant, folder, late, lag=0.1)
    unwritable.rmdir()
    once = next_input(plant, folder, late, lag=0.1)
    assert len(wrong.trials) == len(again.trials) == 2
    assert again.trials[1].largest == once.trials[1].largest < wrong.trials[1].largest
    assert (tmp_path / "twice" / "next.csv").read_text() == (folder / "next.csv").read_text()
