"""Control characters in files never reach the terminal; they are printed as escape sequences."""

import json
from pathlib import Path

import pytest

from asrsim.cli.console import MOVING_CODES, OWN_CODES, CleanStream
from asrsim.errors import CONTROL, Problem


def test_a_problem_is_one_line_without_control_characters():
    problem = Problem(
        message="a\x1b[2Jb", file=Path("x\x9b.urdf"), key="k\rk", value="v\x1b", choices=("c\x07",), hint="h\nh\u202e"
    )
    assert not CONTROL.search(str(problem))
    assert "\n" not in str(problem)
    assert "a\\u001b[2Jb" in str(problem)


@pytest.mark.parametrize("text", ["\x1b[31mred\x1b[0m", "tab\tand\nline", "é 中 ─"])
def test_known_control_codes_are_kept(text, tmp_path):
    path = tmp_path / "out"
    with path.open("w", encoding="utf-8") as stream:
        CleanStream(stream, OWN_CODES).write(text)
    assert path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("text", ["\x1b]0;title\x07", "\x1b[2J", "\x1b[1A", "\r", "\x9b2J", "\x00", "\u202e"])
def test_codes_that_move_the_cursor_are_removed(text, tmp_path):
    path = tmp_path / "out"
    with path.open("w", encoding="utf-8", newline="") as stream:
        CleanStream(stream, OWN_CODES).write(text)
    assert not CONTROL.search(path.read_text(encoding="utf-8"))
    assert MOVING_CODES.split("\x1b[1A\x1b[2K")[1::2] == ["\x1b[1A", "\x1b[2K"]


@pytest.mark.parametrize(
    ("place", "character"),
    [("robot", "\x9b"), ("joint", "\u202e"), ("key", "\x1b"), ("file", "\x9b")],
)
def test_no_command_prints_control_characters_of_files(place, character, tiny, asrsim_command):
    robot, scenario = tiny.robot.read_text(), tiny.scenario.read_text()
    text = f"[2J{character}[2J"
    escaped = f"\\u{ord(character):04x}"
    xml = f"&#{ord(character)};" if character not in "\x1b\x07" else "&#155;"  # XML has no such characters
    path = tiny.scenario
    if place == "robot":
        robot = robot.replace('<robot name="pendulum"', f'<robot name="{xml}"')
    elif place == "joint":
        robot = robot.replace("elbow", f"el{xml}bow")
        scenario = "robot: pendulum.urdf\nduration: 0.1\n"
    elif place == "key":
        scenario += f'"{text.replace(character, escaped)}": 1\n'
    else:
        path = tiny.folder / f"{character}.yaml"
    tiny.robot.write_text(robot)
    path.write_text(scenario)
    for arguments in (("check", path), ("check", tiny.robot), ("run", path, "--no-plot", "--json")):
        outcome = asrsim_command(*arguments)
        told = outcome.out + outcome.err
        assert not CONTROL.search(told)
        if "--json" in arguments:
            json.loads(outcome.out)
