"""Renews what the documentation takes from the code: the schema, README's first run, the tutorial's pictures, and every
part marked as generated.

Usage: python docs/generate.py           all of it, in some minutes
       python docs/generate.py --text    the generated parts of the pages and the schema, in seconds

A part stands from `<!-- generated: NAME -->` to `<!-- end -->`
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from pkgutil import iter_modules
from tempfile import TemporaryDirectory
from textwrap import dedent
from typing import Any

import asrsim
from asrsim.errors import AsrsimError

sys.path.insert(0, str(Path(__file__).parent))  # absent where a test loads this file
from tables import (
    cause_table,
    figure_table,
    markdown_table,
    measure_table,
    problem_tables,
    sampler_table,
    scenario_tables,
    word_tables,
)

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(Path(__file__).parent.glob("*.md")))
PICTURE = ROOT / "docs" / "images" / "step_2dof_soft.png"
TUTORIAL = Path(__file__).parent / "tutorial.md"
WIDTH = 900
"""Pixels of the tutorial's pictures."""
DURATION = re.compile(r"in [\d.]+ s \([\d.]+ x real time\)")
"""Time of a run, which differs from run to run."""
PRINTED = re.compile(r"(<!-- printed -->\n```\n).*?```", re.DOTALL)
MARK = re.compile(r"(<!-- generated: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


@cache
def parts() -> dict[str, str]:
    """Name of a generated part -> its Markdown."""
    return {
        **scenario_tables(),
        **problem_tables(),
        **word_tables(),
        "measures": measure_table(),
        "samplers": sampler_table(),
        "causes": cause_table(),
        "figures": figure_table(),
        "commands": commands(),
        "options": options(),
        "extras": extras(),
        **api(),
        "notebook": notebook(),
        "packages": packages(),
        "actuators": actuators(),
        "models": models(),
        "stages": stages(),
        "stage-fields": stage_fields(),
        "steppings": steppings(),
        "engines": engines(),
        "transports": transports(),
        "live_topics": live_topics(),
    }


def commands() -> str:
    """Every command with the first sentence of its help and its first example."""
    rows = []
    for name, command in all_commands().items():
        what, *rest = (" ".join(part.split()) for part in str(command.help).split("\n\n"))
        example = next((part for part in rest if part.startswith("Example: ")), None)
        if example is None:
            raise SystemExit(f"the docstring of the command '{name}' has no line `Example: asrsim {name} ...`")
        rows.append((f"`{name}`", what, f"`{example.removeprefix('Example: ')}`"))
    return markdown_table(("command", "what it does", "example"), rows)


def options() -> str:
    """Every command with its usage and its options."""
    sections = []
    for name, command in all_commands().items():
        what, *rest = (" ".join(part.split()) for part in str(command.help).split("\n\n"))
        examples = [part.removeprefix("Example: ") for part in rest if part.startswith("Example: ")]
        prose = [what, *(part for part in rest if not part.startswith("Example: "))]
        rows = [(", ".join(f"`{spelling}`" for spelling in spellings(one)), one.help or "") for one in command.params]
        table = markdown_table(("option", "what it does"), [row for row in rows if row[0] != "`--help`, `-h`"])
        sections.append(f"## asrsim {name}\n\n" + "\n\n".join([*prose, "```sh\n" + "\n".join(examples) + "\n```", table]))
    return "\n\n".join(sections)


def spellings(parameter: Any) -> list[str]:
    """An argument's name, or all spellings of an option."""
    if parameter.param_type_name == "argument":
        return [parameter.make_metavar(None) if parameter.metavar else str(parameter.name).upper()]
    return sorted([*parameter.opts, *parameter.secondary_opts], key=len, reverse=True)


def extras() -> str:
    """Every extra of the package, with what the comment above it in pyproject.toml says."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8").split("[project.optional-dependencies]\n")[1]
    found = re.findall(r"((?:^# .*\n)+)^(\w+) = \[", text.split("\n[project.", maxsplit=1)[0], re.MULTILINE)
    rows = [(f"`{name}`", " ".join(line.removeprefix("# ") for line in said.splitlines())) for said, name in found]
    return markdown_table(("extra", "what it is for"), rows)


def notebook() -> str:
    """The notebook as a page: its texts, its code, and the picture that its code draws."""
    cells = json.loads((ROOT / "examples" / "first_steps.ipynb").read_text(encoding="utf-8"))["cells"]
    parts = []
    for cell in cells:
        text = "".join(cell["source"])
        parts.append(
            text.removeprefix("# From a robot file to a learned motion\n\n")
            if cell["cell_type"] == "markdown"
            else f"```python\n{text}\n```"
        )
    return "\n\n".join(parts)


API = {
    "runs": ("asrsim.api", "asrsim.summary", "asrsim.runs", "asrsim.viewer"),
    "stepping": ("asrsim.simulation", "asrsim.environment"),
    "inputs": ("asrsim.robot", "asrsim.scenario", "asrsim.recordings"),
    "logs": ("asrsim.log",),
    "studies": ("asrsim.designs", "asrsim.exports", "asrsim.identification", "asrsim.learning", "asrsim.sweeps", "asrsim.twin"),
    "errors": ("asrsim.errors",),
}
"""Pages about the public names, `docs/api-*.md`, and the modules whose names each page has."""


def api() -> dict[str, str]:
    """Part for each page of the public names: a line for mkdocstrings for each, by the place where it is defined."""
    found: dict[str, list[str]] = {page: [] for page in API}
    for name in asrsim.__all__:
        if name != "__version__":
            module = getattr(asrsim, name).__module__
            (page,) = (page for page, starts in API.items() if module.startswith(starts))
            found[page].append(f"::: {module}.{name}")
    return {f"api-{page}": "\n\n".join(lines) for page, lines in found.items()}


def all_commands() -> dict[str, Any]:
    """Every command of the command line, with its options and help."""
    from typer.main import get_command

    from asrsim.cli.app import app

    group: Any = get_command(app)
    return {name: group.get_command(None, name) for name in group.list_commands(None)}


def packages() -> str:
    """Every package and module of the top level with the first line of its docstring."""
    rows = []
    for found in sorted(iter_modules(asrsim.__path__), key=lambda module: (not module.ispkg, module.name)):
        name = f"{found.name}/" if found.ispkg else f"{found.name}.py"
        doc = (import_module(f"asrsim.{found.name}").__doc__ or "").splitlines()[0]
        rows.append((f"`{name}`", re.sub(r":\w+:`(\w+)`", r"`\1`", doc)))
    return markdown_table(("where", "what it contains"), rows)


def actuators() -> str:
    """Every built-in actuator with its law and the file name by which a URDF asks for it."""
    from asrsim.actuators import ACTUATORS

    known = [one for one in map(ACTUATORS.get, ACTUATORS) if one.__module__.startswith("asrsim.")]
    return markdown_table(
        ("actuator", "`filename` in the URDF", "law"),
        [(one.title, f"`lib{one.name}_plugin.so`", f"`{one.law}`") for one in known],
    )


def models() -> str:
    """Every optional parameter of an actuator with one motor, off at its default, but those of stages."""
    from asrsim.actuators import ACTUATORS
    from asrsim.actuators.stages import STAGES

    own = {one.name for stage in STAGES.loaded() for one in stage.parameters}
    chosen = [one for one in ACTUATORS.get("sea").all_parameters() if one.optional and one.name not in own]
    return _parameters(chosen, source=True)


def _parameters(parameters: Iterable[Any], *, source: bool) -> str:
    """Table of parameters of an actuator with one motor."""
    from asrsim.actuators import ACTUATORS
    from asrsim.robot.tags import parameter_tags

    tags = parameter_tags(ACTUATORS.get("sea"))
    rows = [
        (f"`{one.name}`", f"`<{tags[one.name]}>`", _value(one), one.doc, *([one.source] if source else []))
        for one in parameters
    ]
    return markdown_table(("parameter", "tag", "default", "what", *(["source"] if source else [])), rows)


def _value(parameter: Any) -> str:
    """Default of a parameter with its unit."""
    return f"{parameter.default:g}" if parameter.unit == "1" else f"{parameter.default:g} {parameter.unit}"


def stages() -> str:
    """Every stage with its parameters and the quantities that it logs."""
    from asrsim.actuators.stages import STAGES

    return "\n\n".join(
        f"**{stage.title}**"
        + (f", logs `{stage.quantities[0].name}`" if stage.quantities else "")
        + f"\n\n{_parameters(stage.parameters, source=False)}"
        for stage in STAGES.loaded()
    )


def stage_fields() -> str:
    """The fields of a stage's declarations, as their docstrings explain them."""
    from asrsim.actuators.parameters import Parameter
    from asrsim.actuators.stages import Stage
    from asrsim.quantities import Quantity

    rows = [
        (f"`{owner.__name__}`", f"`{name}`", said) for owner in (Stage, Parameter, Quantity) for name, said in field_docs(owner)
    ]
    return markdown_table(("of", "field", "is"), rows)


def field_docs(owner: type) -> list[tuple[str, str]]:
    """Fields of a class and the docstrings below them."""
    body = ast.parse(dedent(inspect.getsource(owner))).body[0].body  # type: ignore[attr-defined]
    found = []
    for field, said in pairwise(body):
        match field, said:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                found.append((name, " ".join(text.split()).rstrip(".")))
    return found


def engines() -> str:
    """Every engine and what must be installed for it."""
    from asrsim.engines import ENGINES

    known = [(name, ENGINES.get(name)) for name in ENGINES]
    rows = [(f"`{name}`", f"`{one.module}`" if one.module else "nothing", one.doc) for name, one in known]
    return markdown_table(("engine", "needs the module", "what"), rows)


def transports() -> str:
    """Every transport of live runs and what must be installed for it."""
    from asrsim.live import TRANSPORTS

    known = [(name, TRANSPORTS.get(name)) for name in TRANSPORTS]
    rows = [(f"`--on {name}`", one.doc, f"`pip install 'asrsim[{one.extra}]'`") for name, one in known]
    return markdown_table(("transport", "what", "install"), rows)


def live_topics() -> str:
    """The topics of a live run of the first joint of an example, and those of the robot."""
    from asrsim.live.commands import CommandInput
    from asrsim.live.publisher import Publisher
    from asrsim.scenario import load_scenario
    from asrsim.simulation.drives import ranges_of
    from asrsim.simulation.prepare import prepare
    from asrsim.simulation.simulation import Simulation

    (scenario,) = load_scenario(ROOT / "examples" / "scenarios" / "step_2dof.yaml", variant="soft")
    prepared = prepare(scenario, settable=True)
    with Simulation(prepared, compiled=False) as simulation:
        outlets = [(one, "out, latched" if one.latched else "out") for one in Publisher(simulation).outlets]
    inlets = [(one, "in") for one in CommandInput(prepared.info.joints, ranges_of(prepared.scenario, prepared.drives)).inlets]
    rows = [(f"`{one.name}`", one.message, way) for one, way in (*inlets, *outlets) if "joint_2" not in one.name]
    return markdown_table(("topic", "message", "way"), rows)


def steppings() -> str:
    """Every stepping with its order of convergence."""
    from asrsim.registry.steppings import STEPPINGS

    rows = [(f"`{one.name}`", str(one.order), one.doc) for one in STEPPINGS.values()]
    return markdown_table(("stepping", "order", "what"), rows)


def renewed(text: str) -> str:
    """A page with its generated parts made anew."""
    made = parts()
    return MARK.sub(lambda found: f"{found[1]}{made[found[2]]}\n{found[3]}", text)


def run_example() -> str:
    """What README's first command prints; its picture goes into README too."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "asrsim.cli.app", "run", "examples/scenarios/step_2dof.yaml", "--variant", "soft"]
        done = subprocess.run([*command, "--out", folder], cwd=ROOT, capture_output=True, text=True, check=True)
        shutil.copy(Path(folder) / "joints.png", PICTURE)
        return done.stdout.replace(folder, "out/step_2dof/soft").strip()


def tutorial_commands() -> list[str]:
    """The commands of the tutorial, in their order."""
    blocks = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
    return [line for block in blocks for line in block.strip().splitlines()]


def run_tutorial(folder: Path) -> dict[Path, Path]:
    """Runs the tutorial's commands in a folder; picture of the page -> the file that they made. Raises CalledProcessError."""
    for line in tutorial_commands():
        program, *words = shlex.split(line)
        if program != "asrsim":
            raise ValueError(f"the tutorial has a command of another program: {line}")
        subprocess.run([sys.executable, "-m", "asrsim", *words], cwd=folder, capture_output=True, text=True, check=True)
    return tutorial_pictures(folder)


def tutorial_pictures(folder: Path) -> dict[Path, Path]:
    """Picture of the tutorial -> the file that its commands made in a folder."""
    text = TUTORIAL.read_text(encoding="utf-8")
    pictures = re.findall(r"<!-- picture: (.+) -->\n!\[.+\]\((.+)\)", text)
    return {TUTORIAL.parent / shown: folder / made for made, shown in pictures}


def save_small(made: Path, shown: Path) -> None:
    """A picture for a page: narrower, with few colours."""
    from PIL import Image

    with Image.open(made) as picture:
        height = round(picture.height * WIDTH / picture.width)
        small = picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
    small.quantize(64).save(shown, optimize=True)


HOME = {
    "home_sweep.png": (
        "sweep examples/scenarios/step_2dof.yaml --variant soft --out {folder}/sweep"
        " --over references.joint_1.stiffness_preset=0.2:0.6:6 --over parameters.joint_1.motor_1_max_torque=[4,8,12]"
        + "".join(f" --result joint_1.{name}" for name in ("overshoot", "settling", "frequency", "peak_deflection")),
        "sweep/results.png",
    ),
    "home_bode.png": (
        "plot {folder}/chirp/soft {folder}/chirp/stiff --bode --out {folder}/bode",
        "bode/bode.png",
    ),
    "push.gif": ("render {folder}/push --gif --size 380 --fps 20 --speed 0.25", "push/motion.gif"),
}
"""Pictures of the first page: the command that draws each, and the file that it writes."""


def home_pictures(folder: Path) -> None:
    """Draw the pictures of the first page. Raises CalledProcessError."""

    def asrsim_command(line: str) -> None:
        words = [word.format(folder=folder) for word in shlex.split(line)]
        subprocess.run([sys.executable, "-m", "asrsim", *words], cwd=ROOT, capture_output=True, text=True, check=True)

    asrsim_command("run docs/images/push.yaml --no-plot --out {folder}/push")
    asrsim_command(
        "run examples/scenarios/chirp_1dof_qbmove.yaml --variant soft --variant stiff --no-plot --out {folder}/chirp"
    )
    for name, (line, made) in HOME.items():
        asrsim_command(line)
        if name.endswith(".png"):
            save_small(folder / made, PICTURE.parent / name)
        else:
            shutil.copy(folder / made, PICTURE.parent / name)


def runs_and_pictures() -> None:
    """Renew what README's run prints, and the pictures. Raises CalledProcessError."""
    text = PAGES[0].read_text(encoding="utf-8")
    printed = run_example()
    fresh = PRINTED.sub(lambda found: f"{found[1]}{printed}\n```", text)
    if DURATION.sub("", fresh) != DURATION.sub("", text):
        PAGES[0].write_text(fresh, encoding="utf-8")
    with TemporaryDirectory() as folder:
        for shown, made in run_tutorial(Path(folder)).items():
            save_small(made, shown)
        home_pictures(Path(folder))


def main() -> None:
    """Writes all pages and the schema."""
    from asrsim.scenario.schema import schema_text

    if "--text" not in sys.argv:
        runs_and_pictures()
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")
    (Path(__file__).parent / "scenario.schema.json").write_text(schema_text(), encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except AsrsimError as error:
        raise SystemExit(
            f"an example of the documentation fails with the present code, so the remaining pages were not renewed:\n{error}"
        ) from None
