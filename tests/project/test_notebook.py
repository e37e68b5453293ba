"""The notebook of the examples: its cells run in order, and give what its texts say."""

import json

import pytest

from support.paths import ROOT

NOTEBOOK = ROOT / "examples" / "first_steps.ipynb"


def test_the_notebook_runs_and_finds_the_true_numbers(tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names = {}
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    for cell in cells:
        assert not cell.get("outputs"), "the notebook is kept without outputs"
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    damping = names["fit"].find("joint_1.damping")
    assert damping.low < 0.11 < damping.high
    assert damping.verdict == "identified"
    assert names["learned"].converged
    worst = [trial.worst for trial in names["learned"].trials]
    assert len(worst) > 2
    assert worst[-1] == pytest.approx(min(worst))
    assert len(names["figure"].axes) == 3
