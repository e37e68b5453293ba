"""What a command tells people is what it tells programs by `--json`."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

RUN = ("run", "step.yaml", "-o", "out", "--no-plot")
COMMANDS = {
    # arguments, and the parts of the data that the text contains
    "run": (RUN, ("runs.0.joints", "runs.0.expect.0.text", "runs.0.files", "runs.0.engine", "runs.0.stepping")),
    "certify": ((*RUN, "--certify", "--cross-check"), ("runs.0.certificate.joints", "runs.0.cross_check.joints")),
    "check": (("check", "step.yaml"), ("files.0.file", "files.0.robot", "files.0.actuators.0.joint")),
    "plot": (
        ("plot", "out", "-e", "lab.csv", "--measure", "rms"),
        ("metrics", "alignment", "expect", "experiments.0.columns", "experiments.0.file", "files"),
    ),
    "rerun": (("rerun", "out"), ("log", "samples")),
    "twin": (("twin", "step.yaml", "-e", "lab.csv", "--no-plot"), ("joints", "notes", "files")),
    "identify": (
        ("identify", "step.yaml", "-e", "lab.csv", "--free", "elbow.damping", "--check"),
        ("estimates", "channels.0.before", "channels.0.noise", "channels.0.correlation", "misfit", "remarks"),
    ),
    "actuators": (("actuators", "qbmove"), ("0.name", "0.title", "0.source", "0.parameters")),
    "init": (("init", "pendulum.urdf", "-o", "first.yaml", "--overwrite"), ("files",)),
}


@pytest.fixture
def lab(tiny):
    """The tiny robot with a claim, and a recording of its step."""
    claim = "{joint: elbow, quantity: link_position, measure: maximum, comparison: '<', value: 3}"
    text = tiny.scenario.read_text().replace("1.5", "0.5")
    tiny.scenario.write_text(f"{text}compiled: false\nexpect:\n- {claim}\n")
    time = np.arange(0.0, 0.5, 0.005)
    place = 0.3 * (1.0 - np.cos(20.0 * np.maximum(time - 0.1, 0.0)))
    columns = np.column_stack([time, 0.4 * (time > 0.1), place])
    header = "time [s],elbow.reference_1 [rad],elbow.link_position [rad]"
    np.savetxt(tiny.folder / "lab.csv", columns, delimiter=",", header=header, comments="")
    return tiny


def leaves(data):
    """Numbers and texts of data, except for undefined values, zeros (a table shows them as it likes) and empty texts."""
    if isinstance(data, dict):
        data = [] if data.get("value", 0.0) is None else [*data.values()]
    if isinstance(data, list):
        for one in data:
            yield from leaves(one)
    elif data and not (data is True or (isinstance(data, float) and abs(data) < 1e-12)):
        yield data


def part(data, path):
    for name in path.split("."):
        data = data[int(name)] if isinstance(data, list) else data[name]
    return data


def is_said(value, text):
    """Whether a text contains a value: a number with some digits, also in thousandths or percent, or the name of a file."""
    if isinstance(value, str):
        return value in text or Path(value).name in text
    numbers = set(re.findall(r"\d+\.?\d*(?:e[-+]?\d+)?", text))
    return any(f"{abs(scale * value):.{digits}g}" in numbers for scale in (1.0, 1e3, 1e2) for digits in range(1, 7))


@pytest.mark.parametrize("command", COMMANDS)
def test_the_text_of_a_command_contains_the_numbers_and_words_of_its_data(command, lab, asrsim_command):
    arguments, parts = COMMANDS[command]
    if "out" in arguments and arguments[0] != "run":
        asrsim_command(*RUN)
    done = asrsim_command(*arguments, "--json")
    data = json.loads(done.out)
    told = asrsim_command(*arguments)
    assert done.code == told.code == 0, told.err
    # Long words are broken between lines.
    text = re.sub(r"\s+", " ", told.out + told.err)
    for path in parts:
        values = [*leaves(part(data, path))]
        assert [value for value in values if not is_said(value, text)] == [], f"{path}: {told.out}"
