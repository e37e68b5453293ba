"""Files are there as a whole, or as they were; what others wrote stays."""

import os
from pathlib import Path

import numpy as np
import pytest

from asrsim.errors import OutputError
from asrsim.log import LogWriter
from asrsim.outfile import MARKS, check_output, csv_text, is_ours, make_folder, write_text, written
from support.log_example import INFO, example_samples

PAGE = '<meta name="generator" content="asrsim 1">'


def test_an_own_file_is_replaced_without_remains(tmp_path):
    path = tmp_path / "page.html"
    write_text(path, PAGE, "page")
    write_text(path, "naïve ω", "page")
    assert path.read_text(encoding="utf-8") == "naïve ω"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", MARKS)
def test_a_file_of_somebody_else_stays(tmp_path, kind):
    path = tmp_path / "file"
    path.write_text("# a file about asrsim, by hand: asrsim run scenario.yaml\n")
    with pytest.raises(OutputError, match="was not written by asrsim"):
        write_text(path, "new", kind)
    assert path.read_text().startswith("# a file about asrsim")
    write_text(path, "new", kind, replace=True)
    assert path.read_text() == "new"


def test_an_empty_file_holds_nothing_to_lose(tmp_path):
    path = tmp_path / "page.html"
    path.touch()
    write_text(path, "new", "page")
    assert path.read_text() == "new"


@pytest.mark.parametrize("there", [True, False])
def test_links_are_not_followed(tmp_path, there):
    target, link = tmp_path / "precious", tmp_path / "page.html"
    if there:
        target.write_text(PAGE)
    link.symlink_to(target)
    with pytest.raises(OutputError, match="is a link"):
        write_text(link, "new", "page")
    assert link.is_symlink()
    assert target.exists() == there
    assert not there or target.read_text() == PAGE


def test_an_input_is_never_an_output_even_when_allowed(tmp_path):
    path, other = tmp_path / "page.html", tmp_path / "hard.html"
    path.write_text(PAGE)
    os.link(path, other)
    for one in (path, other, tmp_path / "." / "page.html"):
        with pytest.raises(OutputError, match="is an input of this command"):
            check_output(one, "page", inputs=[path], replace=True)


@pytest.mark.parametrize("linked", [False, True])
def test_a_device_is_written_to_as_it_is(tmp_path, linked):
    """Also through a link: /dev/stdout is one."""
    path = Path(os.devnull)
    if linked:
        path = tmp_path / "run.mcap"
        path.symlink_to(os.devnull)
    with written(path, "page") as stream:
        stream.write(b"gone")
    with LogWriter(path, INFO) as log:
        log.write(example_samples(20))
    assert not Path(os.devnull).is_file()
    assert path.is_symlink() == linked


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failed_write_leaves_the_earlier_file(tmp_path, error):
    path = tmp_path / "page.html"
    path.write_text(PAGE)

    def fail():
        with written(path, "page") as stream:
            stream.write(b"half")
            raise error

    with pytest.raises((OutputError, KeyboardInterrupt)):
        fail()
    assert path.read_text() == PAGE
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_in_the_way_stays(tmp_path):
    folder = tmp_path / "page.html"
    folder.mkdir()
    with pytest.raises(OutputError, match=r"page\.html: cannot be written: "):
        write_text(folder, "text", "page")
    assert list(tmp_path.iterdir()) == [folder]


def test_a_file_where_a_folder_should_be_is_named(tmp_path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "deeper" / "still"):
        with pytest.raises(OutputError, match=r"cannot make the folder: .*/file is a file$"):
            make_folder(folder)


def test_a_folder_that_is_not_there_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match="No such file or directory"):
        write_text(tmp_path / "nowhere" / "page.html", "text", "page")


def test_an_unreadable_file_is_not_overwritten(tmp_path):
    assert not is_ours(tmp_path, "page")
    assert not is_ours(tmp_path / "nowhere", "page")


def test_numbers_in_csv_are_the_shortest_texts_that_read_back_exactly():
    assert csv_text(["time [s]", "a"], np.array([[0.1 + 0.2, 1e-9], [np.nan, 2.0]])) == (
        "time [s],a\n0.30000000000000004,1e-09\nnan,2.0\n"
    )
