"""What a repetition is held against, and whose files a run may take away, with the differences put in by hand."""

from __future__ import annotations

import itertools
import json
import re
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import pytest

from asrsim.errors import InputError, LogError, OutputError
from asrsim.log import LogWriter
from asrsim.plots import draw_run
from asrsim.runs.compare import Comparer, Difference
from asrsim.runs.execute import execute
from asrsim.runs.folder import find_logs, new_log, open_folder
from asrsim.runs.rerun import rerun
from asrsim.samples import Samples
from asrsim.scenario import load_scenario
from asrsim.simulation.examine import examine
from support.log_example import INFO, example_samples, part

COUNT = 60


@dataclass
class Log:
    """What a comparer asks of a reader."""

    chunks: list[Samples]

    def iter_samples(self):
        yield from self.chunks


def pieces(samples, rng):
    ends = [0, *sorted(rng.choice(np.arange(1, len(samples.time)), 4, replace=False).tolist()), len(samples.time)]
    return [part(samples, slice(a, b)) for a, b in itertools.pairwise(ends)]


def compared(logged, made, seed=0):
    rng = np.random.default_rng(seed)
    comparer = Comparer(Log(pieces(logged, rng)))  # type: ignore[arg-type]
    for chunk in pieces(made, rng):
        comparer.write(chunk)
    return comparer


@pytest.mark.parametrize("seed", range(2))
def test_every_bit_that_differs_is_found_wherever_chunks_end(seed):
    """Zero of either sign differs; one NaN is as good as another; joints and quantities are matched by name."""
    logged = example_samples(COUNT, bodies=("box",), contacts=("box/ground",))
    same = compared(logged, deepcopy(logged), seed)
    assert (same.differences, same.samples, same.rest()) == ((), COUNT, 0)
    made = deepcopy(logged)
    position, velocity = made.values["link_position"], made.values["link_velocity"]
    position[[40, 50, 59], 1] = 7.0
    logged.values["link_velocity"][5, 0], velocity[5, 0] = 0.0, -0.0
    velocity[6, 0] = np.nan
    logged.values["link_velocity"][6, 0] = -np.float64(np.nan)
    made.bodies["box"][[11, 12], 3] = 9.0
    made.contacts["box/ground"][20, 2] = 8.0
    made.time[58] += 1e-9
    order = [2, 0, 3, 1]
    made = replace(
        made,
        joints=tuple(made.joints[i] for i in order),
        values={name: table[:, order] for name, table in reversed(made.values.items())},
    )
    found = compared(logged, made, seed).differences
    time, joints = logged.time, logged.joints

    def expected(kind, name, joint, row, before, after, count):
        return Difference(kind=kind, name=name, joint=None if joint is None else joints[joint], time=float(time[row]),
                          sample=row, logged=float(before), repeated=after, count=count)  # fmt: skip

    assert found == (
        expected("value", "link_velocity", 0, 5, 0.0, -0.0, 1),
        expected("body", "box", None, 11, logged.bodies["box"][11, 3], 9.0, 2),
        expected("contact", "box/ground", None, 20, logged.contacts["box/ground"][20, 2], 8.0, 1),
        expected("value", "link_position", 1, 40, logged.values["link_position"][40, 1], 7.0, 3),
        expected("time", "time", None, 58, time[58], float(time[58] + 1e-9), 1),
    )
    assert str(found[0]) == (
        f"link_velocity of shoulder: 1 samples differ, the first at t = {time[5]:.6g} s (sample 5): 0.0 in the log, -0.0 now"
    )


def test_missing_series_differ_and_missing_samples_are_counted():
    logged = example_samples(COUNT, bodies=("box",))
    made = deepcopy(logged)
    fewer = replace(made, values={name: table for name, table in made.values.items() if name != "stiffness"}, bodies={})
    for before, after in ((logged, fewer), (fewer, logged)):
        names = {(one.name, one.joint) for one in compared(before, after).differences}
        recorded = {("stiffness", joint.name) for joint in INFO.joints if "stiffness" in joint.quantities}
        assert names == recorded | {("box", None)}
    short = compared(logged, part(made, slice(0, 37)))
    assert (short.differences, short.samples, short.exhausted, short.rest()) == ((), 37, False, COUNT - 37)
    long = compared(part(logged, slice(0, 37)), made)
    assert (long.differences, long.samples, long.exhausted, long.rest()) == ((), 37, True, 0)


def log_in(folder, *, origin="", variant="soft", text="robot: r.urdf\n", **changes):
    folder.mkdir(parents=True, exist_ok=True)
    info = replace(INFO, scenario=text, scenario_path=origin, variant=variant, **changes)
    with LogWriter(folder / "log.mcap", info) as log:
        log.write(example_samples(5, info=info))
    return folder / "log.mcap"


def test_a_plugin_with_a_path_out_of_its_folder_is_not_loaded(tmp_path):
    joints = tuple(replace(joint, actuator="mine") for joint in INFO.joints)
    log = log_in(tmp_path, joints=joints, attachments={"plugins/../mine.py": b"1 / 0"}, resolved={})
    with pytest.raises(LogError, match="contains no scenario"):
        rerun(log, trust_plugins=True)


def test_logs_of_variants_have_the_order_of_their_scenario(tmp_path):
    text = "robot: r.urdf\nvariants: {soft: {}, rigid: {}, hard: {}}\n"
    for name in ("hard", "alone", "soft", "rigid"):
        log_in(tmp_path / name, variant=name, text=text)
    assert [log.parent.name for log in find_logs(tmp_path)[0]] == ["soft", "rigid", "hard", "alone"]
    own = log_in(tmp_path)
    assert find_logs(tmp_path) == ([own], []) == find_logs(own)


def test_a_missing_folder_beside_a_log_names_the_folder_of_the_log(tmp_path):
    log_in(tmp_path)
    with pytest.raises(InputError, match=f"The folder above contains a log: {re.escape(str(tmp_path))}"):
        find_logs(tmp_path / "soft")


def test_a_next_run_replaces_every_picture_of_a_run(tiny):
    (scenario,) = load_scenario(tiny.scenario)
    info = replace(INFO, scenario_path=str(tiny.scenario.resolve()), variant=scenario.variant)
    with LogWriter(tiny.folder / "log.mcap", info) as log:
        log.write(example_samples(50, info=info, bodies=("a", "b", "c", "d")))
    pictures = draw_run(tiny.folder / "log.mcap", tiny.folder, brief=True)
    assert {"objects_1.png", "objects_2.png"} <= {path.name for path in pictures}
    assert {*open_folder(tiny.folder, scenario, overwrite=False)} == {tiny.folder / "log.mcap", *pictures}


def test_only_results_of_the_same_file_and_variant_are_replaced(tiny):
    """Whatever else is of the folder: pictures go with their run, and other people's files stay."""
    (scenario,) = load_scenario(tiny.scenario)
    folder, path = tiny.folder / "results", str(tiny.scenario.resolve())
    for origin, variant, fine in (
        (path, scenario.variant, True),
        (path, "other", False),
        ("/else.yaml", scenario.variant, False),
    ):
        log_in(folder, origin=origin, variant=variant)
        (folder / "summary.json").write_text(json.dumps({"generator": "asrsim 1", "scenario_path": "x", "variant": "y"}))
        if fine:
            assert {one.name for one in open_folder(folder, scenario, overwrite=False)} == {"log.mcap", "summary.json"}
        else:
            with pytest.raises(OutputError, match="another run"):
                open_folder(folder, scenario, overwrite=False)
            assert {one.name for one in open_folder(folder, scenario, overwrite=True)} == {"log.mcap", "summary.json"}
    new = log_in(tiny.folder / "elsewhere", variant="new").read_bytes()
    for stop in (True, False):
        earlier = open_folder(folder, scenario, overwrite=True)
        before = (folder / "log.mcap").read_bytes()
        (folder / "notes.txt").write_text("mine")
        try:
            with new_log(folder, earlier) as place:
                assert place == folder / "log.mcap.part"
                place.write_bytes(new)
                if stop:
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            assert (folder / "log.mcap").read_bytes() == before
        left = {one.name for one in folder.iterdir()}
        assert left == {"log.mcap", "notes.txt"} | ({"summary.json"} if stop else set())
    assert (folder / "log.mcap").read_bytes() == new


def test_a_repeated_run_names_the_meshes_that_changed(tiny):
    mesh = '<collision><geometry><mesh filename="part.obj"/></geometry></collision></link>'
    tiny.robot.write_text(tiny.robot.read_text().replace("</link>", mesh))
    part = tiny.folder / "part.obj"
    part.write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    (tiny.folder / "out").mkdir()
    execute(examine(tiny.scenario), tiny.folder / "out")
    assert rerun(tiny.folder / "out" / "log.mcap").changed == ()
    part.write_text(part.read_text().replace("0.1", "0.11"))
    assert rerun(tiny.folder / "out" / "log.mcap").changed == ("part.obj",)
