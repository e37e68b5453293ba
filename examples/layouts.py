"""Write viewer layouts that show the joints of a log into the folder of the log.

    python examples/layouts.py out/step_2dof/soft/log.mcap

foxglove.json: Foxglove, Layouts > Import (needs `asrsim[foxglove]`). plotjuggler.xml: PlotJuggler, Layout > Load.
log.rrd: the log with a blueprint for `rerun log.rrd` (needs rerun-sdk).
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import asrsim
from asrsim.log.topics import REFERENCE_TOPICS, topic_paths

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf")


def curves(log: Path) -> dict[str, list[tuple[str, str, str]]]:
    """Curves of each plot, by plot title. A curve: topic, joint of a JointState (or an empty string), field."""
    joints = asrsim.open_log(log).info.joints
    paths = dict(zip((joint.name for joint in joints), topic_paths(joints), strict=True))
    first = [(joint, REFERENCE_TOPICS.get(joint.mode, ())[:1]) for joint in joints]
    return {
        "position, rad, and reference": [
            *(("/joint_states", joint.name, "position") for joint in joints),
            *((f"{paths[joint.name]}/{name}", "", "data") for joint, names in first for name in names),
        ],
        "motor 1, rad": [(f"{paths[joint.name]}/motor_1_state", joint.name, "position") for joint in joints if joint.motors],
        "torque, N m": [("/joint_states", joint.name, "effort") for joint in joints],
    }


def write_foxglove(log: Path) -> Path:
    """Write a Foxglove layout: a 3D view of the robot next to the plots."""
    from foxglove import layouts as fl

    joints = [joint.name for joint in asrsim.open_log(log).info.joints]

    def value(topic: str, joint: str, field: str) -> str:
        place = joints.index(joint) if topic == "/joint_states" else 0
        return f"{topic}.{field}[{place}]" if joint else f"{topic}.{field}"

    plots = [
        fl.SplitItem(content=fl.PlotPanel(title=title, config=fl.PlotConfig(
            paths=[fl.PlotSeries(value=value(*curve), label=curve[1] or curve[0]) for curve in one])))
        for title, one in curves(log).items()
    ]  # fmt: skip
    robot = fl.BaseRendererUrdfLayerSettings(source_type="topic", topic="/robot_description")
    view = fl.ThreeDeePanel(config=fl.ThreeDeeConfig(layers={"robot": robot, "grid": fl.BaseRendererGridLayerSettings()}))
    side = fl.SplitContainer(direction="column", items=plots)
    path = log.with_name("foxglove.json")
    path.write_text(
        fl.Layout(content=fl.SplitContainer(items=[fl.SplitItem(content=view), fl.SplitItem(content=side)])).to_json()
    )
    return path


def write_plotjuggler(log: Path) -> Path:
    """Write a PlotJuggler layout: the plots in one column."""
    root = ElementTree.Element("root")
    tabs = ElementTree.SubElement(root, "tabbed_widget", name="Main Window", parent="main_window")
    container = ElementTree.SubElement(ElementTree.SubElement(tabs, "Tab", tab_name="asrsim", containers="1"), "Container")
    plots = curves(log)
    sizes = ";".join([f"{1 / len(plots):.6f}"] * len(plots))
    splitter = ElementTree.SubElement(container, "DockSplitter", orientation="-", count=str(len(plots)), sizes=sizes)
    for title, one in plots.items():
        plot = ElementTree.SubElement(
            ElementTree.SubElement(splitter, "DockArea", name=title), "plot", mode="TimeSeries", style="Lines"
        )
        for number, curve in enumerate(one):
            ElementTree.SubElement(plot, "curve", name="/".join(filter(None, curve)), color=COLOURS[number % len(COLOURS)])
    ElementTree.SubElement(tabs, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="1")
    path = log.with_name("plotjuggler.xml")
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def write_rerun(log: Path) -> Path:
    """Write the log as a Rerun recording with a blueprint: the robot next to plots of positions and torques."""
    import rerun as rr
    import rerun.blueprint as rrb

    path = log.with_suffix(".rrd")
    plots = [rrb.TimeSeriesView(origin=f"/joint_states/{name}", name=name) for name in ("position", "velocity", "effort")]
    blueprint = rrb.Blueprint(rrb.Horizontal(rrb.Spatial3DView(origin="/"), rrb.Vertical(*plots)))
    recording = rr.RecordingStream("asrsim")
    recording.save(path, default_blueprint=blueprint)
    recording.log_file_from_path(log)
    recording.flush()
    return path


if __name__ == "__main__":
    writers = {"foxglove": write_foxglove, "": write_plotjuggler, "rerun": write_rerun}
    for module, write in writers.items():
        if not module or find_spec(module):
            print(write(Path(sys.argv[1])))
