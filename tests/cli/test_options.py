"""Options of the command line reach the functions of the library."""

import ast
import json
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

from asrsim.cli.interrupt import Interruption
from asrsim.cli.options import lag_of
from asrsim.designs import design
from asrsim.errors import InputError
from asrsim.identification.task import task_of
from asrsim.live import Access
from asrsim.live.origin import origin_of
from asrsim.live.session import Settings
from asrsim.renamed import NAMES, OldKeyWarning
from asrsim.sweeps.study import read_study
from support.paths import ROOT

SHARED = {"variant": "soft", "overrides": ["step=0.001"]}
CALLS = {
    "asrsim.identification.task.task_of": (
        """identify a.yaml -e a.csv -e c.csv --validate b.csv --validate d.csv --free j.damping=1 --free k.damping
        --tie j.a=j.b --tie k.a=k.b --own j.c --own j.d --map q=j.x --map r=k.x --rate 50
        --hold-out 0.3 --variant soft --set step=0.001""",
        SHARED | {"given": ["a.yaml", ["a.csv", "c.csv"]], "validate": ["b.csv", "d.csv"], "free": ["j.damping=1", "k.damping"],
                  "ties": ["j.a=j.b", "k.a=k.b"], "own": ["j.c", "j.d"], "mapping": ["q=j.x", "r=k.x"], "rate": 50.0,
                  "hold_out": 0.3},
    ),
    "asrsim.designs.run.design": (
        """design a.yaml --limits l.yaml --free j.damping --free k.damping --tie j.a=j.b --tie k.a=k.b --duration 3
        --experiment a.csv --experiment b.csv --robust 2 --seed 7 --variant soft --set step=0.001""",
        SHARED | {"given": ["a.yaml", "l.yaml"], "free": ["j.damping", "k.damping"], "ties": ["j.a=j.b", "k.a=k.b"],
                  "duration": 3.0, "experiments": ["a.csv", "b.csv"], "robust": 2, "seed": 7},
    ),
    "asrsim.exports.export": (
        "export a.yaml --out b.xml --knots 9 --step 0.002 --fit fit.json --variant soft --set step=0.001 --no-plot",
        {"given": ["a.yaml", "b.xml"], "knots": 9, "step": 0.002, "fit": "fit.json", "variant": "soft",
         "overrides": ["step=0.001"], "plot": False},
    ),
    "asrsim.twin.follow.follow_recording": (
        """twin a.yaml -e a.csv --bandwidth 4 --map q=j.x --map r=k.x --rate 50 --clock-offset 0.2 --variant soft
        --set step=0.001""",
        {"given": ["a.yaml", "a.csv"], "bandwidth": 4.0, "mapping": ["q=j.x", "r=k.x"], "rate": 50.0, "clock_offset": 0.2,
         "variant": "soft", "overrides": ["step=0.001"]},
    ),
    "asrsim.sweeps.run.study_of": (
        "sweep a.yaml --over j.damping=1:2:3 --sampler sobol --samples 8 --seed 7 --fit f.json --variant soft --set step=0.001",
        {"given": ["a.yaml", ["j.damping=1:2:3"], {"variants": ["soft"], "overrides": ["step=0.001"], "sampler": "sobol",
                   "samples": 8, "seed": 7, "fit": "f.json"}]},
    ),
    "asrsim.plots.job.PlotJob": (
        """plot -e a.csv -e b.csv --map q=j.x --map r=k.x --rate 50 --joint j --joint k --quantity stiffness
        --quantity deflection --measure rms --measure mean --align 0.2 --format pdf --format svg --bode
        --band 1 5 --input j.reference_1 --output j.deflection --start 0.1 --end 2 --out pictures""",
        {"experiments": ["a.csv", "b.csv"], "mapping": ["q=j.x", "r=k.x"], "rate": 50.0, "joints": ["j", "k"],
         "quantities": ["stiffness", "deflection"], "measures": ["rms", "mean"], "lag": 0.2,
         "formats": ["pdf", "svg"], "bode": True, "band": [1.0, 5.0], "given": "j.reference_1", "output": "j.deflection",
         "start": 0.1, "end": 2.0, "folder": "pictures"},
    ),
}  # fmt: skip
"""Command line, and the arguments that the function receives: those without a name are called `given`."""


@pytest.mark.parametrize("function", CALLS)
def test_options_reach_the_library(function, monkeypatch, asrsim_command):
    line, expected = CALLS[function]
    passed = {}

    def receive(*given, **options):
        passed.update({"given": given, **options})
        raise InputError("received")

    monkeypatch.setattr(function, receive)
    done = asrsim_command(*line.split())
    plain = json.loads(json.dumps(passed, default=str))
    assert {name: plain.get(name) for name in expected} == expected, done.err


LASTING = {
    "asrsim.runs.execute.execute": "run step.yaml",
    "asrsim.runs.rerun.rerun": "rerun out",
    "asrsim.learning.session.learn": "ilc step.yaml",
    "asrsim.sweeps.sweep": "sweep step.yaml --over parameters.elbow.spring_k=8:12:3",
    "asrsim.identification.identify": "identify step.yaml -e lab.csv --free elbow.damping",
    "asrsim.designs.run.design": CALLS["asrsim.designs.run.design"][0],
    "asrsim.twin.follow.follow_recording": CALLS["asrsim.twin.follow.follow_recording"][0],
}
"""Function that may take long, and the command that calls it."""


@pytest.mark.parametrize("function", LASTING)
def test_a_command_that_lasts_shows_its_progress_and_ends_by_ctrl_c(function, tiny, monkeypatch, asrsim_command):
    learned = "ilc: {trajectory: {elbow: {minimum_jerk: {duration: 1, to: 0.3}}}, tolerance: 1}"
    tiny.scenario.write_text(f"{tiny.scenario.read_text().replace('1.5', '1.0')}compiled: false\n{learned}\n")
    (tiny.folder / "lab.csv").write_text("time,elbow_position\n0,0\n1,1\n")
    if "rerun" in function:
        asrsim_command("run", "step.yaml", "--set", "duration=0.01", "--no-plot", "--out", "out")
    passed = {}

    def receive(*given, **options):
        passed.update(options)
        raise InputError("received")

    monkeypatch.setattr(function, receive)
    done = asrsim_command(*LASTING[function].split())
    assert "received" in done.err
    assert passed["stop"].__func__ is Interruption.stop
    assert passed["stop"]() is False
    assert callable(passed.get("progress", passed.get("on_trial")))


@pytest.mark.parametrize("path", sorted((ROOT / "asrsim" / "cli").glob("*.py")), ids=lambda path: path.stem)
def test_a_command_uses_each_of_its_options(path):
    """`asrsim --version` is a callback of the library, without a use of its own."""
    for function in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(function, ast.FunctionDef) and function.name != "root":
            given = [one.arg for one in (*function.args.args, *function.args.kwonlyargs)]
            read = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
            assert [name for name in given if name not in read] == [], function.name


def test_texts_of_a_task_mean_what_they_say(tiny):
    for name in ("a.csv", "b.csv", "c.csv"):
        (tiny.folder / name).write_text("time,elbow_position\n0,0\n1,1\n")
    free = ["elbow.damping", "elbow.friction=0.5", "arm.mass=0.2:0.9", "arm.izz=0.1:0.2:0.3"]
    found = task_of(
        tiny.scenario, [tiny.folder / "a.csv", tiny.folder / "b.csv"], free=free, ties=["j.a=k.a", "j.b = 0.5 * k.b"],
        own=["elbow.damping"], validate=[tiny.folder / "c.csv"], mapping=["q=elbow.link_position"], rate=50.0, hold_out=0.3,
    )  # fmt: skip
    wishes = {key: (wish.start, wish.low, wish.high, wish.own) for key, wish in found.free.items()}
    assert wishes == {
        "elbow.damping": (None, None, None, True),
        "elbow.friction": (0.5, None, None, None),
        "arm.mass": (None, 0.2, 0.9, None),
        "arm.izz": (0.2, 0.1, 0.3, None),
    }
    assert [(tie.key, tie.to, tie.factor) for tie in found.ties] == [("j.a", "k.a", 1.0), ("j.b", "k.b", 0.5)]
    assert [one.file.name for one in (*found.experiments, *found.validate)] == ["a.csv", "b.csv", "c.csv"]
    assert {(one.mapping, one.rate) for one in (*found.experiments, *found.validate)} == {(("q=elbow.link_position",), 50.0)}
    assert found.hold_out == 0.3


def test_options_reach_a_live_run(monkeypatch, asrsim_command):
    plan = SimpleNamespace(scenario=SimpleNamespace(name="arm", variant="soft"))
    line = """live a.yaml --on none --speed 2 --duration 3 --publish-rate 50 --namespace lab --domain 7 --port 0 --network
        --allow-origin https://Lab.example/ --allow-origin http://here:80 --variant soft --set step=0.001 --set duration=1
        --overwrite"""
    passed = {}

    def examine(scenario, **options):
        passed.update(scenario=str(scenario), **{key: options[key] for key in ("variant", "overrides")})
        return plan

    def session(*given, **options):
        passed.update(given=given, **options)
        raise InputError("received")

    monkeypatch.setattr("asrsim.simulation.examine.examine", examine)
    monkeypatch.setattr("asrsim.live.session.Session", session)
    asrsim_command(*line.split())
    origins = tuple(map(origin_of, ("https://lab.example", "http://here:80")))
    access = Access(network=True, port=0, domain=7, origins=origins)
    settings = Settings(speed=2.0, duration=3.0, rate=50.0, namespace="lab", transports=[], access=access)
    assert passed["given"] == (plan, Path("out/arm/soft_live"), settings)
    assert (passed["scenario"], passed["variant"], passed["overrides"]) == ("a.yaml", "soft", ["step=0.001", "duration=1"])
    assert passed["overwrite"] is True


@pytest.mark.parametrize(
    ("text", "lag"), [("auto", "auto"), ("off", "off"), ("start", "start"), ("-0.25", -0.25), ("1e-3", 1e-3)]
)
def test_an_alignment_is_a_word_or_a_number_of_seconds(text, lag):
    assert lag_of(text) == lag


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("design a.yaml --limits l.yaml --seconds 3", "--seconds is called --duration now"),
        ("export a.yaml --timestep 0.001", "--timestep is called --step now"),
        ("twin a.yaml -e a.csv --lag=0.2", "--lag is called --clock-offset now"),
        ("sweep a.yaml --over a.b=1 --design lhs", "--design is called --sampler now"),
        ("export a.yaml --to mjcf", "--to is called --format now"),
    ],
)
def test_an_old_name_of_an_option_works_and_says_the_new_one(asrsim_command, line, said):
    err = asrsim_command(*line.split()).err
    assert said in err
    assert "cannot be read" in err


def test_an_old_name_of_a_keyword_works_and_warns(tmp_path):
    with pytest.warns(DeprecationWarning, match="seconds is called duration now"), pytest.raises(InputError, match=r"l\.yaml"):
        design("a.yaml", tmp_path / "l.yaml", seconds=3.0)


def test_an_old_key_of_a_file_is_told_of_in_one_line(tiny, asrsim_command):
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}\nsubstep_cap: 50\n")
    done = asrsim_command("run", tiny.scenario, "--set", "effects.sensors.*.delay=0.01", "--set", "duration=0.01", "--no-plot")
    told = [line for line in done.err.splitlines() if "is called" in line]
    assert sorted(line.partition("the key ")[2] for line in told) == [
        "`effects` is called `imperfections` now; the next version drops the old name",
        "`substep_cap` is called `max_substeps` now; the next version drops the old name",
    ]
    assert any(f"{tiny.scenario.name}:{len(tiny.scenario.read_text().splitlines())}: the key" in line for line in told)


def test_an_old_key_of_a_study_has_the_same_meaning(tiny):
    (tiny.folder / "study.yaml").write_text("scenario: step.yaml\nover: {duration: 'uniform(0.1, 0.2)'}\ndesign: lhs\n")
    with pytest.warns(OldKeyWarning, match="`design` is called `sampler` now"):
        assert read_study(tiny.folder / "study.yaml").sampler == "lhs"


@pytest.mark.parametrize(("package", "names"), NAMES.items())
def test_an_old_name_of_a_package_works_and_warns(package, names):
    module = import_module(package)
    for old, new in names.items():
        with pytest.warns(DeprecationWarning, match=rf"{package}\.{old} is called {package}\.{new} now"):
            assert getattr(module, old) is getattr(module, new)
    with pytest.raises(AttributeError, match="no attribute 'older'"):
        _ = module.older
