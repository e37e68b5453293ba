"""What a fit says: its tables, remarks, verdict and advice, from results that are written down here."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asrsim import identification
from asrsim.identification import show
from asrsim.identification.verdicts import Estimate
from support.identify_files import CHIRP, SEA, record, write

pytestmark = pytest.mark.once

NAN = float("nan")
SLOW = "turn slowly, and reverse often: friction shows at low speed"
FAST = "move fast and let swing out: damping shows at high speed"
FAR = "deflect j to and fro, far and little, slowly: hysteresis shows where the motion turns"
LOADED = "deflect j more, by loads or fast reversals, and at several presets"
HARD = "accelerate more: steps and chirps at higher frequencies"
MOVEMENTS = {
    "friction": SLOW, "motor_1_friction_torque": SLOW, "motor_2_stribeck_friction": SLOW, "damping": FAST,
    "motor_1_damping": FAST, "hysteresis_torque": FAR, "hysteresis_deflection": FAR, "spring_k": LOADED, "spring_a_1": LOADED,
    "max_deflection": LOADED, "lever_length": LOADED, "pulley_radius": LOADED, "motor_1_inertia": HARD, "mass": HARD,
    "ixx": HARD, "iyz": HARD, "izz": HARD, "offset": "", "delay": "", "impulse": "", "masses": "", "x": "",
}  # fmt: skip


def estimate(
    key: str,
    verdict: str = "weak",
    *,
    low: float = 1.0,
    high: float = 3.0,
    value: float = 2.0,
    start: float = 0.123456,
    reason: str = "",
) -> Estimate:
    return Estimate(key=key, name=key, unit="N m", start=start, value=value, low=low, high=high, verdict=verdict, reason=reason)


def channel(key: str, **changes: Any) -> SimpleNamespace:
    numbers = {"before": 0.12345, "after": 0.0012345, "held_before": 0.2, "held_after": NAN, "noise": 0.001}
    rest = {"recording": "one", "unit": "rad", "explained": NAN, "correlation": 0.987}
    return SimpleNamespace(**{"key": key, **rest, **numbers, **changes})


def result(**changes: Any) -> Any:
    count = len(changes.get("estimates", ()))
    usual = {
        "estimates": (), "channels": (), "remarks": (), "status": "complete", "whole": False, "fits": True, "accepted": False,
        "misfit": (), "causes": (), "correlation": np.eye(count),
    }  # fmt: skip
    return SimpleNamespace(**{**usual, **changes})


@pytest.mark.parametrize("name", MOVEMENTS)
def test_what_is_not_well_known_is_to_be_moved_in_its_own_way(name: str) -> None:
    told = list(show.advice(result(estimates=(estimate(f"j.{name}"),))))
    assert told == ([f"j.{name}: {MOVEMENTS[name]}"] if MOVEMENTS[name] else [])
    for verdict in ("identified", "at bound"):
        assert not list(show.advice(result(estimates=(estimate(f"j.{name}", verdict),))))


def test_what_asks_for_the_same_is_said_once() -> None:
    told = list(show.advice(result(estimates=(estimate("a.damping"), estimate("a.friction"), estimate("b.damping")))))
    assert told == [f"a.damping, b.damping: {FAST}", f"a.friction: {SLOW}"]


def test_the_table_of_parameters() -> None:
    rows = (
        estimate("j.a", "identified", low=1.99999, high=2.00001),
        estimate("j.b", "no effect", low=NAN, high=NAN, value=1234567.8),
        estimate("j.c", low=-1000.0, high=1000.0),
        estimate("j.d", low=-1e-3, high=1e-3, start=1.29284e-10, value=2e-4),
    )
    table = {name: (cells, right) for name, cells, right in show.columns(result(estimates=rows))}
    assert list(table) == ["parameter", "unit", "start", "estimate", "95 % interval", "+-", "verdict"]
    assert [right for _, right in table.values()] == [False, False, True, True, True, True, False]
    assert table["start"][0] == [*["0.12346"] * 3, "0"]
    assert table["estimate"][0] == ["2", "1.23457e+06", "2", "0.0002"]
    assert table["95 % interval"][0] == ["2 .. 2", "-", "-1000 .. 1000", "-0.001 .. 0.001"]
    assert table["+-"][0] == ["0.0005 %", "-", "-", "500 %"]


def test_a_place_has_its_interval_in_its_unit_not_as_a_share_of_a_zero() -> None:
    rows = (replace(estimate("j.offset", low=-1e-3, high=3e-3, value=v), is_place=True) for v in (0.0, 1e-9, 2.0))
    table = {name: cells for name, cells, _ in show.columns(result(estimates=tuple(rows)))}
    assert table["+-"] == ["0.002 N m"] * 3


def test_the_table_of_errors() -> None:
    one = {
        name: cells for name, cells, _ in show.errors(result(channels=(channel("j.q"), channel("j.p", correlation=NAN))))[:2]
    }
    assert one == {"RMS error": ["j.q", "j.p"], "unit": ["rad", "rad"]}
    both = show.errors(result(channels=(channel("j.q"), channel("j.q", recording="two", correlation=NAN))))
    assert [cells for _, cells, _ in both] == [
        ["j.q (one)", "j.q (two)"], ["rad"] * 2, ["0.123"] * 2, ["0.00123"] * 2, ["0.2"] * 2, ["-"] * 2, ["0.001"] * 2,
        ["0.99", "-"],
    ]  # fmt: skip
    assert [right for _, _, right in both] == [False, False, True, True, True, True, True, True]


def test_only_what_is_known_and_closely_so_is_called_correlated() -> None:
    correlation = np.array([[1, 0.951, 0.949, 0.99], [0.951, 1, -0.96, 0.99], [0.949, -0.96, 1, 0.99], [0.99, 0.99, 0.99, 1]])
    rows = (*(estimate(name) for name in "abc"), estimate("d", low=NAN, high=NAN, reason="moves nothing"))
    found = result(estimates=rows, correlation=correlation, remarks=("said last",))
    assert list(show.correlated(found)) == [("a", "b", 0.951), ("b", "c", -0.96)]
    assert list(show.remarks(found)) == [
        ("d: weak: moves nothing", "yellow"), ("a and b are correlated (0.951)", "dim"),
        ("b and c are correlated (-0.960)", "dim"), ("said last", "dim"),
    ]  # fmt: skip


def test_the_judgement() -> None:
    assert list(show.judgement(result(status="checked"))) == []
    assert [style for _, style in show.judgement(result(status="interrupted"))] == ["yellow"]
    assert [style for _, style in show.judgement(result(whole=True))] == ["dim", "green"]
    poor = result(
        fits=False, misfit=("too large",), causes=("a delay",),
        channels=(channel("a", explained=0.91234), channel("b", explained=0.5), channel("c")),
    )  # fmt: skip
    assert list(show.judgement(poor)) == [
        ("model does not fit: intervals hold for this model only", "bold red"), ("  too large", "red"), ("  a delay", "red"),
        ("  it explains 50 % of the variance of b, and no less of the others", "red"),
    ]  # fmt: skip
    assert "does not show" in list(show.judgement(result(fits=False)))[-1][0]


ENDINGS = {
    "fits": ({}, (), 0, {"fit.json", "robot", "picture", "page"}, ""),
    "does not fit": (
        {"misfit": ("too large",)},
        (),
        2,
        {"fit.json", "picture", "page"},
        "no robot is written, since the model",
    ),
    "all the same": ({"misfit": ("too large",)}, ("--all",), 2, {"fit.json", "robot", "picture", "page"}, ""),
    "accepted": ({"misfit": ("too large",), "accepted": True}, ("--accept",), 2, {"fit.json", "robot", "picture", "page"}, ""),
    "interrupted": ({"status": "interrupted"}, (), 130, {"fit.json"}, ""),
    "out of time": ({"status": "unfinished"}, (), 2, {"fit.json"}, ""),
    "interrupted, all": ({"status": "interrupted"}, ("--all",), 130, {"fit.json"}, ""),
    "without pictures": ({}, ("--no-plot",), 0, {"fit.json", "robot", "page"}, ""),
    "without a page": ({}, ("--no-report",), 0, {"fit.json", "robot", "picture"}, ""),
    "checked": ({"status": "checked"}, ("--check",), 0, set(), ""),
}
"""How a fit ended: what of the result, options, exit code, files, words."""


def given_back(result: Any, *_: object, **__: object) -> Any:
    return result


def test_which_files_an_end_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asrsim_command: Any) -> None:
    recording = record(write(tmp_path, "true", SEA, f"{{equilibrium_position: {CHIRP}}}"), tmp_path / "a.csv")
    guess = write(tmp_path, "guess", {**SEA, "damping": 0.03})
    found = identification.identify(identification.task_of(guess, [recording], free=["joint_1.damping"]))
    for name, (changes, options, code, files, words) in ENDINGS.items():
        ended = replace(found, **changes)
        monkeypatch.setattr(identification, "identify", partial(given_back, ended))
        about = ("-e", recording, "--free", "joint_1.damping", "-o", tmp_path / name)
        outcome = asrsim_command("identify", guess, *about, *options)
        kinds = {".urdf": "robot", ".yaml": "robot", ".png": "picture", ".html": "page"}
        written = {kinds.get(path.suffix, path.name) for path in (tmp_path / name).rglob("*") if path.is_file()}
        assert (name, outcome.code, written - {".lock"}) == (name, code, files)
        assert words in outcome.out + outcome.err
