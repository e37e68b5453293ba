"""Documentation and code agree: generated parts, snippets, links, commands, pictures."""

import ast
import importlib.util
import re
import shlex
from importlib import import_module
from types import ModuleType

import pytest

import asrsim
from asrsim import errors
from asrsim.actuators import ACTUATORS
from asrsim.engines import ENGINES
from asrsim.exports import PROGRAMS
from asrsim.identification import CAUSES
from asrsim.live.transport import TRANSPORTS
from asrsim.metrics import MEASURES
from asrsim.plots import FIGURES
from asrsim.robot import load_robot
from asrsim.scenario import load_scenario
from asrsim.scenario.data import KEYS
from asrsim.scenario.schema import schema_text
from asrsim.signals import SIGNALS
from asrsim.sweeps.samplers import SAMPLERS
from support.imports import SOURCES
from support.paths import ROOT
from validation.sections import SECTIONS

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LINK = re.compile(r"(?<!`)!?\[[^]]*\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def generator():
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


GENERATE = generator()
COMMANDS = GENERATE.all_commands()


def plain(text):
    """A page without its code blocks."""
    return FENCE.sub("", text)


def anchor(heading):
    """The anchor that a Markdown heading gets."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def snippets(language):
    """Code of one language in README: fenced, or in a table's cell as <pre lang>."""
    cells = re.findall(rf'<pre lang="{language}">\n(.*?)</pre>', README, re.DOTALL)
    fenced = [code for name, code in FENCE.findall(README) if name == language]
    return [code.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&") for code in cells] + fenced


def test_the_page_of_validations_has_the_text_of_each_section():
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    assert [section.title for section in SECTIONS if section.text not in page] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_generated_parts_are_current(page):
    """Renew them by: python docs/generate.py."""
    text = page.read_text(encoding="utf-8")
    assert GENERATE.renewed(text) == text
    assert text.count("<!-- generated: ") == len(GENERATE.MARK.findall(text)) == text.count("<!-- end -->")


def test_every_key_signal_and_measure_is_documented():
    parts = GENERATE.parts()
    assert all(f"`{key.name}`" in parts["scenario-keys"] for key in KEYS)
    assert all(f"### {name}" in parts["signal-keys"] for name in SIGNALS)
    assert all(f"| `{name}` | " in parts["measures"] and len(MEASURES.get(name).doc) > 10 for name in MEASURES)


def test_every_message_about_an_input_has_a_code():
    """The page of messages lists them by code, and programs read it."""
    kinds = {name for name, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, errors.InputError)}
    without = []
    for path in SOURCES:
        calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
        for call in calls:
            name = getattr(call.func, "id", "")
            # Other errors take problems, which have codes.
            says = name == "Problem" or (name in kinds and call.args and is_text(call.args[0]))
            if says and not {"code", None} & {keyword.arg for keyword in call.keywords}:
                without.append(f"{path.relative_to(ROOT)}:{call.lineno}")
    assert not without


def is_text(node):
    """Whether an argument is a message rather than problems: a text, or a variable that is called so."""
    return (
        isinstance(node, ast.JoinedStr) or isinstance(getattr(node, "value", None), str) or getattr(node, "id", "") == "message"
    )


def test_the_schema_is_current():
    """Renew it by: python docs/generate.py."""
    assert (ROOT / "docs" / "scenario.schema.json").read_text(encoding="utf-8") == schema_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_targets_of_links_exist(page):
    for found in LINK.finditer(plain(page.read_text(encoding="utf-8"))):
        target = found[1] or found[2]
        if "://" in target:
            continue
        name, _, mark = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        assert path.exists(), f"{page.name}: {target}"
        assert path.is_relative_to(ROOT), f"{page.name}: {target}"
        if mark:
            headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            assert mark in [anchor(heading) for heading in headings], f"{page.name}: {target}"


def test_the_index_lists_every_page_and_pages_show_every_picture():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "index.md" or f"({page.name})" in index, page.name
    for picture in (ROOT / "docs").rglob("*.png"):
        name = picture.relative_to(ROOT / "docs").as_posix()
        assert any(name in page.read_text(encoding="utf-8") for page in PAGES), f"{name} is shown nowhere"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_the_documentation_exist(page):
    """Every `asrsim COMMAND --option` of the pages is one."""
    text = page.read_text(encoding="utf-8")
    blocks = "\n".join(code for _, code in FENCE.findall(text))
    found = re.findall(r"(?:^ +|`|/bin/|&& )asrsim ([^`\n|]*)", plain(text), re.MULTILINE)
    for line in [*found, *re.findall(r"(?:^\s*|&& )asrsim ([^\n|]*)", blocks, re.MULTILINE)]:
        words = line.split("#")[0].split()
        if not words or words[0].startswith("-") or words[0] == "COMMAND":
            continue
        assert words[0] in COMMANDS, f"{page.name}: asrsim {line}"
        options = {word.partition("=")[0].rstrip(".,;:)") for word in words[1:] if re.match(r"--[a-z]", word)}
        known = {name for parameter in COMMANDS[words[0]].params for name in (*parameter.opts, *parameter.secondary_opts)}
        assert options <= known | {"--help"}, f"{page.name}: asrsim {line}"


def test_names_of_the_library_in_the_pages_exist(tiny):
    """Every name such as `result.summary.claims`, `simulation.joints` and `asrsim.open_log(...)` in the pages exists."""
    # Groups of entry points have similar names.
    registries = (ACTUATORS, CAUSES, ENGINES, FIGURES, MEASURES, PROGRAMS, SAMPLERS, SIGNALS, TRANSPORTS)
    groups = {(registry.entry_point_group or "").removeprefix("asrsim.") for registry in registries}
    result = asrsim.run(tiny.scenario)
    with asrsim.Simulation(tiny.scenario, record=True) as simulation:
        roots = {"simulation": simulation, "result": result, "asrsim": asrsim, "Scenario": simulation.scenario}
        named = re.compile(rf"`({'|'.join(roots)})((?:\.[a-zA-Z_]+)+)(?=[`(])")
        found = {match.groups() for page in PAGES for match in named.finditer(page.read_text(encoding="utf-8"))}
        assert {root for root, _ in found} == set(roots)
        for root, path in sorted(found):
            thing = roots[root]
            for name in path[1:].split("."):
                if path[1:] in groups:
                    break
                if isinstance(thing, ModuleType) and not hasattr(thing, name):
                    import_module(f"{thing.__name__}.{name}")
                assert hasattr(thing, name), f"{root}{path}"
                thing = getattr(thing, name)


def printed_commands(page):
    """The lines of a page's sh blocks that call asrsim, in their order."""
    blocks = [code for name, code in FENCE.findall(page.read_text(encoding="utf-8")) if name == "sh"]
    return [line for block in blocks for line in block.splitlines() if line.startswith("asrsim ")]


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if printed_commands(page)], ids=lambda page: page.name)
def test_commands_run_as_they_are_printed(page, asrsim_command):
    """In a folder with the examples. Commands that need a user's robot or a cluster are in blocks of another language."""
    assert asrsim_command("examples", "--overwrite").code == 0
    for line in printed_commands(page):
        done = asrsim_command(*shlex.split(line, comments=True)[1:])
        assert done.code == 0, f"{page.name}: {line}\n{done.out}\n{done.err}"


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_have_a_summary_an_example_and_help_for_options(name):
    command = COMMANDS[name]
    assert f"Example: asrsim {name}" in command.help
    assert command.help.split("\n\n")[0].endswith(".")
    for parameter in command.params:
        assert parameter.help, f"{name}: {parameter.name} has no help"


def test_urdf_in_the_readme_is_in_the_example_robot():
    """The robot is that of the first command."""
    (block,) = snippets("xml")
    robot = ROOT / "examples/urdf/dof2_horizontal.urdf"
    flat = " ".join(robot.read_text(encoding="utf-8").split())
    assert " ".join(block.split()) in flat
    assert load_robot(robot).actuators[0].joint == "joint_1"


def test_scenario_in_the_readme_agrees_with_the_example(tmp_path):
    """The scenario of the README is a shortened example with equal variants."""
    code = snippets("yaml")[0]
    path = ROOT / "examples/scenarios" / "step_2dof.yaml"
    short = tmp_path / "step_2dof.yaml"
    short.write_text(code.replace("../urdf", (ROOT / "examples/urdf").as_posix()), encoding="utf-8")
    made = {scenario.variant: scenario for scenario in load_scenario(short)}
    full = {scenario.variant: scenario for scenario in load_scenario(path)}
    for name, scenario in made.items():
        assert scenario.references == full[name].references
        assert scenario.duration == full[name].duration
        assert scenario.robot.resolve() == full[name].robot.resolve()


def test_the_readme_shows_the_output_of_its_first_command(asrsim_command):
    """Times, speeds and the default engine depend on the machine."""

    def fixed(text):
        varying = r"in [\d.]+ s \([\d.]+ x real time\)|(bullet|mujoco), (plain|compiled) loop"
        lines = [re.sub(varying, "-", line).rstrip() for line in text.splitlines()]
        return [line for line in lines if line and not line.startswith("wrote")]

    (shown,) = re.findall(r"<!-- printed -->\n```\n(.*?)```", README, re.DOTALL)
    run = asrsim_command("run", ROOT / "examples/scenarios/step_2dof.yaml", "--variant", "soft", "--no-plot")
    assert run.code == 0
    assert fixed(run.out) == fixed(shown)
