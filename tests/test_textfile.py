"""Text files are there as a whole, or as they were."""

from __future__ import annotations

from pathlib import Path

import pytest

from asrsim.errors import OutputError
from asrsim.textfile import write_text


def test_a_file_is_replaced_and_nothing_is_left_beside_it(tmp_path: Path):
    path = tmp_path / "page.html"
    path.write_text("before")
    write_text(path, "naïve ω")
    assert path.read_text(encoding="utf-8") == "naïve ω"
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_put_in_place_leaves_nothing_behind(tmp_path: Path):
    folder = tmp_path / "page.html"
    folder.mkdir()
    (folder / "kept").write_text("kept")
    with pytest.raises(OutputError, match=r"page\.html: cannot be written: "):
        write_text(folder, "text")
    assert list(tmp_path.iterdir()) == [folder]


def test_a_folder_that_is_not_there_is_an_output_error(tmp_path: Path):
    with pytest.raises(OutputError, match="No such file or directory"):
        write_text(tmp_path / "nowhere" / "page.html", "text")
