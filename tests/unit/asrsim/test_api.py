"""asrsim as a library: arrays by joint and quantity, files only when asked for, never a word on the terminal."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

import asrsim
from asrsim.identification import task_of
from asrsim.sweeps import make_study
from support.paths import ROOT

STANDARD = {"asrsim", *sys.stdlib_module_names}


def test_arrays_by_joint_and_quantity(tiny, capfd):
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


def test_names_that_do_not_exist(tiny):
    result = asrsim.run(tiny.scenario, overrides=["duration=0.01"])
    with pytest.raises(KeyError, match="Did you mean 'elbow'"):
        result["elbo"]
    with pytest.raises(KeyError, match="Did you mean 'link_position'"):
        result["elbow"]["link_positon"]
    with pytest.raises(AttributeError):
        _ = result["elbow"].link_positon
    assert "motor_2_position" not in result["elbow"]


def test_several_variants_must_be_chosen_from(tiny):
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants:\n  a: {duration: 0.1}\n  b: {duration: 0.2}\n")
    with pytest.raises(asrsim.InputError) as error:
        asrsim.run(tiny.scenario)
    assert error.value.problems[0].choices == ("a", "b")
    assert asrsim.run(tiny.scenario, variant="b").time[-1] == 0.2
    results = asrsim.run_variants(tiny.scenario, out=tiny.folder / "both")
    assert [(name, one.time[-1]) for name, one in results.items()] == [("a", 0.1), ("b", 0.2)]
    assert (tiny.folder / "both" / "b" / "log.mcap").is_file()


def test_without_keeping_the_samples_come_from_the_log(tiny):
    kept = asrsim.run(tiny.scenario)
    logged = asrsim.run(tiny.scenario, out=tiny.folder / "results", keep=False)
    assert logged.run.samples is None
    assert logged.log == tiny.folder / "results" / "log.mcap"
    for name in kept["elbow"]:
        assert np.array_equal(kept["elbow"][name], logged["elbow"][name]), name
    assert logged.summary.joints == kept.summary.joints


def test_a_loaded_robot_may_be_given(tiny):
    heavy = tiny.folder / "heavy.urdf"
    heavy.write_text(tiny.robot.read_text().replace('mass value="0.5"', 'mass value="1.0"'))
    sags = [
        asrsim.run(tiny.scenario, robot=robot).summary.joint("elbow").measures.steady_state_error
        for robot in (None, heavy, asrsim.load_robot(heavy))
    ]
    assert sags[1] > 1.5 * sags[0]
    assert sags[1] == sags[2]


def test_importing_asrsim_imports_nothing_else():
    code = "import sys; before = set(sys.modules); import asrsim; print(*sorted(set(sys.modules) - before))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert {name.partition(".")[0] for name in out.split()} <= STANDARD


def test_every_exported_name_is_there():
    for name in asrsim.__all__:
        assert getattr(asrsim, name) is not None
    assert set(asrsim.__all__) <= set(dir(asrsim))
    with pytest.raises(AttributeError):
        _ = asrsim.nothing_of_that_name


def test_the_documentation_runs(tmp_path, monkeypatch):
    shutil.copy(ROOT / "examples/urdf/dof1_qbmove.urdf", tmp_path / "arm.urdf")
    text = (ROOT / "examples/scenarios/step_1dof_qbmove.yaml").read_text()
    (tmp_path / "scenario.yaml").write_text(text.replace("../urdf/dof1_qbmove.urdf", "arm.urdf"))
    for folder in ("urdf", "scenarios", "plugins"):
        shutil.copytree(ROOT / "examples" / folder, tmp_path / "examples" / folder)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/library.md").read_text(), re.DOTALL)
    assert len(blocks) >= 8
    names = {}
    for block in blocks:
        exec(compile(block, "docs/library.md", "exec"), names)
    assert names["stopped"].status == "interrupted"


def test_arguments_of_several_values_take_one(tiny):
    """A text is no row of letters: in identification, sweeps and runs."""
    assert task_of(tiny.scenario, free="elbow.damping=2", experiments="a.csv") == task_of(
        tiny.scenario, free=["elbow.damping=2"], experiments=["a.csv"]
    )
    over = "elbow.damping=[0.1, 0.2]"
    assert make_study(tiny.scenario, over, variants="soft") == make_study(tiny.scenario, [over], variants=["soft"])
    with pytest.raises(asrsim.InputError, match=r"law\.py: no such plugin file"):
        asrsim.run(tiny.scenario, plugins="law.py")
