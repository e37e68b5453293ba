"""Fixture that the tests of robots share."""

import pytest

from asrsim.robot import load_robot


@pytest.fixture
def read(tmp_path):
    """Function that writes the text of a robot to a file and reads the file."""

    def reader(text, name="robot.urdf", **options):
        path = tmp_path / name
        path.write_text(text)
        return load_robot(path, **options)

    return reader
