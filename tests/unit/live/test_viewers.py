"""Layouts for viewers name what a log holds; the launch file starts the run and its helpers."""

import json
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
