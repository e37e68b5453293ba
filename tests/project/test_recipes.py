"""Every recipe of the documentation, a fenced block of code, does what its page says, as it stands there."""

import re
import runpy
import tomllib

import numpy as np
import pytest
import yaml

from asrsim.registry.groups import GROUPS
from asrsim.robot import read_robot
from asrsim.robot.doubts import warnings_of
from asrsim.scenario import load_scenario
from support.examined import check_against_robot
from support.paths import ROOT
from support.tiny import PENDULUM

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BLOCKS = {
    page.name: FENCE.findall(page.read_text(encoding="utf-8"))
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
TESTED_ELSEWHERE = {"sh", "bash", ""}
"""Commands and what they print: tests/project/test_docs.py."""
ELSEWHERE = {"SLURMCluster": "needs a cluster with Slurm", "apiVersion": "is read by Kubernetes"}
"""Words of blocks that no single machine can run, with the reason."""
JOINTS = {"scenario.md": ("shoulder", "elbow"), "log.md": ("elbow_joint", "wrist"), "recordings.md": ("elbow", "wrist")}
"""Names of the two joints in the recipes of a page; `joint_1` and `joint_2` in others."""
GIVEN = {"twin.md": {"position": 0.1, "goal": 0.2}, "view.md": {"input": print}}
"""Values that the reader of a page has at hand; who looks at a view presses Enter at once."""


def blocks(language):
    """Pairs (page, code) for each block of the language."""
    found = [(page, code) for page, own in BLOCKS.items() for name, code in own if name == language]
    return [one for one in found if not any(word in one[1] for word in ELSEWHERE)]


def by_page(language):
    """Code of each page, with its blocks in their order."""
    return [(page, "\n".join(code for name, code in blocks(language) if name == page)) for page in dict(blocks(language))]


def test_every_kind_of_recipe_is_tested():
    tested = {"python", "yaml", "xml", "toml"}
    assert {language for own in BLOCKS.values() for language, _ in own} <= tested | TESTED_ELSEWHERE
    assert all(any(word in code for own in BLOCKS.values() for _, code in own) for word in ELSEWHERE)


@pytest.fixture
def place(tmp_path, asrsim_command):
    """Function that fills the working folder with the files that a reader of the page has."""

    def fill(page):
        assert asrsim_command("examples", "--overwrite").code == 0
        first, second = JOINTS.get(page, ("joint_1", "joint_2"))

        def renamed(text):
            return text.replace("joint_1", first).replace("joint_2", second)

        robot = (ROOT / "examples" / "urdf" / "dof2_horizontal.urdf").read_text()
        scenario = (
            (ROOT / "examples" / "scenarios" / "step_2dof.yaml").read_text().replace("../urdf/dof2_horizontal.urdf", "arm.urdf")
        )
        (tmp_path / "arm.urdf").write_text(renamed(robot))
        short = re.sub(r"(?m)^duration:.*$", "duration: 1.2", renamed(scenario.partition("expect:")[0]))
        (tmp_path / "scenario.yaml").write_text(short)
        head, _, variants = short.partition("variants:\n")
        (tmp_path / "lab.yaml").write_text(head)
        two = {name: yaml.safe_load(variants)[name] for name in ("soft", "stiff")}
        (tmp_path / "step.yaml").write_text(head + yaml.safe_dump({"variants": two}))
        needed = "\n".join(code for _, code in BLOCKS[page])
        if ".mcap" in needed or "out/" in needed:
            done = asrsim_command("run", "step.yaml", "--no-plot", "-q", "--out", ".")
            assert done.code == 0, done.err
            assert asrsim_command("run", "examples/scenarios/step_2dof.yaml", "--no-plot", "-q").code == 0
            for name in ("run", "long"):
                (tmp_path / f"{name}.mcap").write_bytes((tmp_path / "soft" / "log.mcap").read_bytes())
        time = np.arange(0.0, 1.0, 0.01)
        table = np.column_stack([time, 40.0 * time, 0.1 * time])
        np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header="time [s],alpha,tau", comments="")
        if "rows.parquet" in needed:
            pytest.importorskip("pyarrow")
            over = ("--over", "link_1.mass=[0.3, 0.4]", "--set", "duration=0.1")
            done = asrsim_command(
                "sweep", "scenario.yaml", "--variant", "soft", *over, "--workers", "1", "--no-plot", "--out", "parts/1"
            )
            assert done.code == 0, done.err

    return fill


@pytest.mark.slow
@pytest.mark.parametrize(("page", "code"), by_page("python"), ids=[page for page, _ in by_page("python")])
def test_python(page, code, place):
    if page == "live.md":
        pytest.importorskip("gymnasium")
    place(page)
    names = dict(GIVEN.get(page, {}))
    if page == "stages.md":
        # The page shows the class of this file.
        names |= runpy.run_path(str(ROOT / "examples" / "plugins" / "my_clutch.py"))
    if "asrsim." in code and "import asrsim" not in code:
        exec("import asrsim", names)
    exec(compile(code, page, "exec"), names)


@pytest.mark.parametrize(("page", "code"), blocks("yaml"), ids=[f"{page}-{i}" for i, (page, _) in enumerate(blocks("yaml"))])
def test_yaml(page, code, tmp_path, tiny):
    """A scenario, a part of one, or a reading: every key is known and every value fits."""
    from asrsim.recordings.reading import load_reading

    given = yaml.safe_load(code)
    if page == "recordings.md":
        (tmp_path / "lab.csv.yaml").write_text(code)
        assert load_reading(tmp_path / "lab.csv.yaml").maps
        return
    if page == "signals.md":
        (tmp_path / "lab.csv").write_text("time,tau\n0,0\n1,0.1\n2,0.2\n")
        external, position = given.pop("external_torque"), given.pop("link_position")
        given = {"references": {"elbow": given}, "external_torques": {"elbow": external}, "desired": {"elbow": position}}
    names = sorted({*re.findall(r"(?<![\w.])(?:shoulder|elbow|joint_\d)(?![\w.])", code)} | {"elbow"})
    for name in re.findall(r"[\w./]+\.(?:urdf|xacro|csv)", code):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        example = ROOT / "examples" / name.removeprefix("examples/").removeprefix("../")
        if example.is_file():
            path.write_bytes(example.read_bytes())
        elif not path.exists() and not name.endswith(".csv"):
            path.write_text(arm(names))
        elif not path.exists():
            path.write_text("time [s],elbow.link_position [rad]\n0,0\n1,0.1\n")
    if not (isinstance(given.get("robot"), str) or "robot" in given):
        (tmp_path / "arm.urdf").write_text(arm(names))
        given["robot"] = "arm.urdf"
    given.setdefault("duration", 4.0)
    if any("body" in claim for claim in given.get("expect", ())):
        box = {"shape": "box", "size": [0.1, 0.1, 0.1], "mass": 1.0, "position": [2, 2, 1]}
        given |= {"world": {"objects": {"box": box}}, "variants": {"soft": {}, "stiff": {}}}
    (tmp_path / "recipe.yaml").write_text(yaml.safe_dump(given))
    for scenario in load_scenario(tmp_path / "recipe.yaml"):
        problems, _ = check_against_robot(scenario, read_robot(scenario.robot, xacro_arguments=scenario.xacro_arguments))
        assert not [problem for problem in problems if problem.code != "unknown-body"], problems


def arm(names):
    """URDF of joints of these names, one after the other, each with a qbMove."""
    joints, actuators = [], []
    parent = "world"
    for name in names:
        body = PENDULUM.partition('<link name="world"/>')[2].partition("<gazebo>")[0]
        body = (
            body.replace('link="world"', f'link="{parent}"').replace('"arm"', f'"{name}_arm"').replace('"elbow"', f'"{name}"')
        )
        joints.append(body)
        actuators.append(PLUGIN.format(name=name))
        parent = f"{name}_arm"
    return f'<robot name="arm"><link name="world"/>{"".join(joints)}{"".join(actuators)}</robot>'


PLUGIN = """<gazebo><plugin name="{name}_drive" filename="libqbmove_plugin.so"><joint>{name}</joint>
<operation_mode>6</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>true</sub_ext_tau></plugin></gazebo>"""


@pytest.mark.parametrize(("page", "code"), blocks("xml"), ids=[f"{page}-{i}" for i, (page, _) in enumerate(blocks("xml"))])
def test_xml(page, code, tmp_path):
    """A part of a robot's file is read without a problem and without a warning about its words."""
    if "<launch" in code or "<gazebo" not in code:
        pytest.skip("is no part of a robot's file")
    name = (re.findall(r"<joint>([^<]+)</joint>", code) or re.findall(r'reference="([^"]+)"', code))[0]
    text = PENDULUM.replace('"elbow"', f'"{name}"')
    whole = (
        text.partition("<gazebo>")[0] + code + "</robot>"
        if "<plugin" in code
        else text.replace("elbow</joint>", f"{name}</joint>").replace("</robot>", code + "</robot>")
    )
    (tmp_path / "robot.urdf").write_text(whole)
    robot = read_robot(tmp_path / "robot.urdf")
    assert not robot.faults
    assert not [warning for warning in warnings_of(robot) if "unknown" in warning.code]


@pytest.mark.parametrize(("page", "code"), blocks("toml"))
def test_toml(page, code):
    (groups,) = (tomllib.loads(code)["project"]["entry-points"].keys(),)
    assert set(groups) <= set(GROUPS)
