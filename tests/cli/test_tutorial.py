"""The tutorial's commands run as they stand there, each picture of the page is one that they make."""

from __future__ import annotations

import re
import runpy

from support.paths import ROOT

PAGE = ROOT / "docs" / "tutorial.md"


def test_the_tutorial_runs_and_makes_its_pictures(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    made = runpy.run_path(str(ROOT / "docs" / "generate.py"))["run_tutorial"](tmp_path)
    assert len(made) >= 5
    for shown, picture in made.items():
        assert picture.stat().st_size > 5000, picture
        assert shown.is_file()
        assert shown.stat().st_size < 150_000
    assert len(made) == len(re.findall(r"!\[", PAGE.read_text(encoding="utf-8")))
