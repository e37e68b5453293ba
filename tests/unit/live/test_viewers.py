"""Layouts for viewers name what a log holds; the launch file starts the run and its helpers."""

from __future__ import annotations

import json
import runpy
import sys
from unittest.mock import MagicMock
from xml.etree import ElementTree

import layouts
import pytest
from mcap.reader import make_reader

from support.paths import ROOT


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    import asrsim

    scenario = ROOT / "examples" / "scenarios" / "step_2dof.yaml"
    folder = tmp_path_factory.mktemp("run")
    asrsim.run(scenario, variant="soft", overrides={"duration": 0.02, "compiled": False, "expect": []}, out=folder)
    return next(folder.rglob("log.mcap"))


def test_layouts_are_about_topics_of_the_log(log):
    with log.open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    plots = layouts.curves(log)
    assert {topic for curves in plots.values() for topic, _, _ in curves} <= topics
    root = ElementTree.parse(layouts.write_plotjuggler(log)).getroot()
    assert len(list(root.iter("curve"))) == sum(map(len, plots.values())) == 8


def test_a_foxglove_layout_has_the_robot_and_all_plots(log):
    pytest.importorskip("foxglove")
    text = layouts.write_foxglove(log).read_text()
    assert '"topic":"/robot_description"' in text
    assert json.dumps(json.loads(text)).count('"panelType": "Plot"') == len(layouts.curves(log))


def test_the_launch_file_starts_asrsim_without_the_sourced_ros(monkeypatch):
    names = ("", ".actions", ".conditions", ".substitutions", "_ros", "_ros.actions", "_ros.parameter_descriptions")
    modules = {f"launch{name}": MagicMock() for name in names}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    runpy.run_path(str(ROOT / "ros" / "live.launch.py"))["generate_launch_description"]()
    command = modules["launch.actions"].ExecuteProcess.call_args.kwargs["cmd"]
    assert command[:3] == ["env", "-u", "PYTHONPATH"]
    assert "live" in command
