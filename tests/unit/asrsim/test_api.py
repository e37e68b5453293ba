"""asrsim as a library: arrays by joint and quantity, files only when asked for, never a word on the terminal."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import asrsim
from asrsim.identification import task_of
from asrsim.recordings import read_recording
from asrsim.sweeps import make_study
from support.paths import ROOT

STANDARD = {"asrsim", *sys.stdlib_module_names}


def test_arrays_by_joint_and_quantity(tiny, capfd: pytest.CaptureFixture[str]) -> None:
    result = asrsim.run(tiny.scenario, overrides=["step=5e-4", "duration=0.5"])
    assert result.status == "complete"
    assert result.joints == ("elbow",)
    assert len(result.time) == 1001
    elbow = result["elbow"]
    assert elbow.link_position is not None
    assert np.array_equal(elbow["link_position"], result.joint("elbow").link_position)
    assert np.array_equal(elbow.deflection, elbow.motor_1_position - elbow.link_position)
    assert np.array_equal(elbow.position_error, elbow.reference_1 - elbow.link_position)
    assert set(elbow) >= {"link_position", "deflection", "stiffness"}
    assert len(elbow) == len(list(elbow))
    assert "link_velocity" in dir(elbow)
    captured = capfd.readouterr()
    # PyBullet's own banner is not ours to take away.
    assert "elbow" not in captured.out + captured.err
    assert not (tiny.folder / "out").exists()


def test_names_that_do_not_exist(tiny) -> None:
    result = asrsim.run(tiny.scenario, overrides=["duration=0.01"])
    with pytest.raises(KeyError, match="Did you mean 'elbow'"):
        result["elbo"]
    with pytest.raises(KeyError, match="Did you mean 'link_position'"):
        result["elbow"]["link_positon"]
    with pytest.raises(AttributeError):
        _ = result["elbow"].link_positon
    assert "motor_2_position" not in result["elbow"]


def test_several_variants_must_be_chosen_from(tiny) -> None:
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants:\n  a: {duration: 0.1}\n  b: {duration: 0.2}\n")
    with pytest.raises(asrsim.InputError) as error:
        asrsim.run(tiny.scenario)
    assert error.value.problems[0].choices == ("a", "b")
    assert asrsim.run(tiny.scenario, variant="b").time[-1] == 0.2
    results = asrsim.run_variants(tiny.scenario, out=tiny.folder / "both")
    assert [(name, one.time[-1]) for name, one in results.items()] == [("a", 0.1), ("b", 0.2)]
    assert (tiny.folder / "both" / "b" / "log.mcap").is_file()


def test_without_keeping_the_samples_come_from_the_log(tiny) -> None:
    kept = asrsim.run(tiny.scenario)
    logged = asrsim.run(tiny.scenario, out=tiny.folder / "results", keep=False)
    assert logged.run.samples is None
    assert logged.log == tiny.folder / "results" / "log.mcap"
    for name in kept["elbow"]:
        assert np.array_equal(kept["elbow"][name], logged["elbow"][name]), name
    assert logged.summary.joints == kept.summary.joints


def test_a_loaded_robot_may_be_given(tiny) -> None:
    heavy = tiny.folder / "heavy.urdf"
    heavy.write_text(tiny.robot.read_text().replace('mass value="0.5"', 'mass value="1.0"'))
    sags = [
        asrsim.run(tiny.scenario, robot=robot).summary.joint("elbow").measures.steady_state_error
        for robot in (None, heavy, asrsim.load_robot(heavy))
    ]
    assert sags[1] > 1.5 * sags[0]
    assert sags[1] == sags[2]


def test_divergence_raises_and_keeps_what_was(tiny) -> None:
    # Without stops, which would hold the link.
    tiny.robot.write_text(tiny.robot.read_text().replace('type="revolute"', 'type="continuous"'))
    with pytest.raises(asrsim.DivergenceError) as error:
        asrsim.run(tiny.scenario, overrides=["external_torques={elbow: {step: {at: 0.5, to: 1e9}}}"])
    assert error.value.joint == "elbow"
    assert error.value.time == pytest.approx(0.5, abs=0.01)
    assert error.value.run.samples.time[-1] == pytest.approx(0.5, abs=0.01)


def test_claims_do_not_raise(tiny) -> None:
    claims = "expect=[{joint: '*', quantity: link_position, measure: maximum, comparison: <, value: 0.1}]"
    result = asrsim.run(tiny.scenario, overrides=[claims])
    assert not result.ok
    assert [claim.expectation.joint for claim in result.summary.failed_claims] == ["elbow"]
    assert result.summary.claims[0].measured == result["elbow"].link_position.max()


def test_a_claim_against_a_recording(tiny) -> None:
    first = asrsim.run(tiny.scenario)
    rows = np.column_stack([first.time, first["elbow"].link_position + 0.01])[::7]
    rows = np.column_stack([rows, first["elbow"].deflection[::7] - 0.2])
    header = "time [s],elbow.link_position [rad],elbow.deflection [rad]"
    np.savetxt(tiny.folder / "lab.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
    against = "measure: bias, tolerance: 1e-5, against: lab.csv, options: {lag: 0}"
    claims = (
        f"{{joint: elbow, quantity: {name}, value: {value}, {against}}}"
        for name, value in (("link_position", -0.01), ("deflection", 0.2))
    )
    result = asrsim.run(tiny.scenario, overrides=[f"expect=[{', '.join(claims)}]"])
    assert result.ok, [claim.text for claim in result.summary.claims]


def test_importing_asrsim_imports_nothing_else() -> None:
    code = "import sys; before = set(sys.modules); import asrsim; print(*sorted(set(sys.modules) - before))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert {name.partition(".")[0] for name in out.split()} <= STANDARD


def test_every_exported_name_is_there() -> None:
    for name in asrsim.__all__:
        assert getattr(asrsim, name) is not None
    assert set(asrsim.__all__) <= set(dir(asrsim))
    with pytest.raises(AttributeError):
        _ = asrsim.nothing_of_that_name


def test_the_documentation_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(ROOT / "examples/urdf/dof1_qbmove.urdf", tmp_path / "arm.urdf")
    text = (ROOT / "examples/scenarios/step_1dof_qbmove.yaml").read_text()
    (tmp_path / "scenario.yaml").write_text(text.replace("../urdf/dof1_qbmove.urdf", "arm.urdf"))
    for folder in ("urdf", "scenarios"):
        shutil.copytree(ROOT / "examples" / folder, tmp_path / "examples" / folder)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/library.md").read_text(), re.DOTALL)
    assert len(blocks) >= 8
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/library.md", "exec"), names)
    assert names["stopped"].status == "interrupted"


def test_arguments_of_several_values_take_one(tiny, tmp_path: Path) -> None:
    """A text is no row of letters: in identification, sweeps, runs and recordings."""
    recording = tmp_path / "lab.csv"
    np.savetxt(recording, np.ones((9, 2)) * np.arange(9)[:, None], delimiter=",", header="time [s],elbow", comments="")
    several = {"experiments": [recording], "validate": ["b.csv"], "free": ["elbow.damping=2"], "own": ["elbow.friction"],
               "mapping": ["a=b"], "plugins": [str(ROOT / "examples/plugins/my_vsa.py")], "overrides": ["duration=1"],
               "ties": ["a.b=c.d"]}  # fmt: skip
    for one in (str, Path):
        alone = {name: one(value[0]) if isinstance(value[0], Path) else value[0] for name, value in several.items()}
        assert task_of(tiny.scenario, **alone) == task_of(tiny.scenario, **several)
    over = {
        "scenario": tiny.scenario, "over": ["elbow.damping=[0.1, 0.2]"],
        "variants": ["soft"], "plugins": ["law.py"],
    }  # fmt: skip
    assert make_study(**{key: value if key == "scenario" else value[0] for key, value in over.items()}) == make_study(**over)
    assert [column.joint for column in read_recording(recording, joints="elbow").channels.values()] == ["elbow"]
    for call in (asrsim.run, asrsim.run_variants):
        with pytest.raises(asrsim.InputError, match=r"law\.py: no such plugin file"):
            call(tiny.scenario, plugins="law.py")
