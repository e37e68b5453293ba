"""Plugin files: Python files that users name on the command line. They register actuators, signals, engines and so on."""

from __future__ import annotations

import inspect
import re
import shlex
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, TypeVar

from asrsim.actuators import ACTUATORS, Actuator
from asrsim.actuators.declaration import declaration_problem, declaration_problems, file_of
from asrsim.actuators.stage_checker import stage_problems
from asrsim.actuators.stages import STAGES, Stage
from asrsim.errors import ActuatorError, AsrsimError, Problem
from asrsim.plain import one_or_more
from asrsim.registry import Registry, all_or_none, plugin_file

C = TypeVar("C")

_MISFIT_CALL = re.compile(r"([\w.]+)\(\) (?:takes|missing|got) ")
"""Beginning of Python's message about a call with arguments that the function does not take."""
MODULES = "asrsim_plugin_"
"""Prefix of the names under which plugin files are imported as modules."""


def check_named(wanted: Iterable[Path], named: Iterable[Path | str], *, file: Path) -> None:
    """Raise ActuatorError if `file` lists plugins that the user has not named, since a data file must not run code without
    consent."""
    known = {Path(one).resolve() for one in named}
    problems = [
        Problem("is Python code, which runs only if you name it", file=file, key="plugins", value=one,
                hint=f"If you trust this code, add --plugin {shlex.quote(str(one))}", code="plugin-not-named")
        for one in wanted if one.resolve() not in known
    ]  # fmt: skip
    if problems:
        raise ActuatorError(problems)


def plugin_options(files: Iterable[Path | str]) -> list[str]:
    """Command-line options that name these plugin files."""
    return [word for file in files for word in ("--plugin", str(file))]


def command_line(name: str, file: Path | str, plugins: Iterable[Path | str] | None = ()) -> str:
    """The shell command `asrsim NAME FILE`, which the user can paste. plugins: plugin files that the file needs."""
    return shlex.join(["asrsim", name, str(file), *plugin_options(plugins or ())])


def load_plugin_files(files: str | Path | Sequence[str | Path]) -> tuple[Path, ...]:
    """Run plugin files and register what they define, as `load_plugin_file` does. Returns the paths of the files."""
    paths = tuple(Path(file) for file in one_or_more(files))
    for path in paths:
        load_plugin_file(path)
    return paths


@all_or_none()
def load_plugin_file(path: Path | str) -> tuple[type[Actuator], ...]:
    """Run a plugin file and register every class of an actuator or a stage that it defines; a file may be loaded again.

    The file may also add to any other registry of asrsim: signals, measures, recording readers, engines. The file
    runs as ordinary Python code: name only files that you trust. Classes whose names begin with an underscore are ignored.
    Returns the actuators. Raises ActuatorError with file and line if the file is missing, raises, adds nothing, or defines a
    malformed actuator or stage; then everything that the file added is removed.
    """
    path = Path(path)
    if not path.is_file():
        raise ActuatorError("no such plugin file", file=path, code="missing-file")
    before = Registry.added
    module = _run(path)
    found, stages = _classes(module, Actuator), _classes(module, Stage)
    if not (found or stages) and Registry.added == before:
        raise ActuatorError(
            "adds nothing to asrsim",
            file=path,
            code="empty-plugin",
            hint="Derive a class from asrsim.actuators.Actuator or asrsim.actuators.stages.Stage, or add to one of asrsim's "
            "tables, such as SIGNALS, MEASURES or READERS: docs/architecture.md, 'Where to add what', lists all of them",
        )
    problems = [problem for stage in stages for problem in stage_problems(stage)] or _taken_names(STAGES, stages, path)
    if not problems:
        # Register the stages first, since their parameters also belong to every actuator.
        with plugin_file(str(path.resolve())):
            for stage in stages:
                STAGES.add(stage.name, stage, replace=True)
    problems += [problem for actuator in found for problem in declaration_problems(actuator)]
    problems += [problem for one in [*stages, *found] for problem in _names_of_joints(one)]
    problems = problems or _taken_names(ACTUATORS, found, path)
    if problems:
        raise ActuatorError(problems)
    with plugin_file(str(path.resolve())):
        for actuator in found:
            ACTUATORS.add(actuator.name, actuator, replace=True)
    return tuple(found)


def _classes(module: ModuleType, base: type[C]) -> list[type[C]]:
    """Classes derived from `base` that a module itself defines, except those whose names begin with an underscore."""
    return [
        entry
        for name, entry in vars(module).items()
        if inspect.isclass(entry)
        and issubclass(entry, base)
        and entry.__module__ == module.__name__
        and not name.startswith("_")
    ]


def _taken_names(registry: Registry[type[C]], found: Sequence[type[Any]], path: Path) -> list[Problem]:
    """Problems of classes of a plugin file whose names are taken by another file, or by an earlier class of the same file."""
    names = [one.name for one in found]
    taken = {name for name in names if name in registry and file_of(registry.get(name)) != path.resolve()}
    return [
        declaration_problem(one, f"another {registry.noun} is called '{name}'", "name-taken", key="name")
        for number, (name, one) in enumerate(zip(names, found, strict=True))
        if name in taken.union(names[:number])
    ]


def _names_of_joints(one: Any) -> list[Problem]:
    """Problems of parameters whose names are taken by a number that every joint has, such as `elbow.damping`."""
    from asrsim.robot.vary import JOINT_NAMES

    return [
        declaration_problem(
            one, "every joint already has a number with this name", "bad-parameter", key=f"parameters.{parameter.name}"
        )
        for parameter in one.parameters
        if parameter.name in JOINT_NAMES
    ]


@contextmanager
def blame_plugins() -> Iterator[None]:
    """Convert exceptions that a plugin file raises to an ActuatorError with file and line; errors of asrsim stay as they
    are."""
    try:
        yield
    except (Exception, SystemExit) as error:
        fault = plugin_fault(error)
        if fault is None:
            raise
        raise fault from error


def plugin_fault(error: BaseException) -> ActuatorError | None:
    """An ActuatorError with file and line if `error` was raised in a plugin file. None for other errors, and for errors of
    asrsim, which state their own cause.
    """
    if isinstance(error, AsrsimError):
        return None
    for frame, line in _plugin_frames(error):
        file, key = Path(frame.f_code.co_filename), frame.f_code.co_name
        message = f"the plugin raised {type(error).__name__}: {error}"
        return ActuatorError(message, file=file, line=line, key=key, hint=_law_hint(frame), code="plugin-raised")
    return _call_fault(error)


def _call_fault(error: BaseException) -> ActuatorError | None:
    """An ActuatorError if asrsim called a function of a plugin file with arguments that the function does not take. Python
    raises such an error at the call, so that no frame of the plugin file contains it."""
    match = _MISFIT_CALL.match(str(error)) if isinstance(error, TypeError) else None
    if match is None:
        return None
    for module in [module for name, module in list(sys.modules.items()) if name.startswith(MODULES)]:
        found: Any = module
        for part in match[1].split("."):
            found = getattr(found, part, None)
        code = getattr(inspect.unwrap(found), "__code__", None) if callable(found) else None
        if code is not None and code.co_filename == module.__file__:
            message = f"asrsim calls it with other arguments: {error}"
            return ActuatorError(
                message, file=Path(code.co_filename), line=code.co_firstlineno, key=code.co_name, code="plugin-arguments"
            )
    return None


def _law_hint(frame: FrameType) -> str:
    """Hint with the command that checks the law whose code a frame runs; empty if the code is not the code of a law."""
    for option, registry in (("--actuator", ACTUATORS), ("--stage", STAGES)):
        for one in registry.loaded():
            law = inspect.getattr_static(one, frame.f_code.co_name, None)
            if isinstance(law, staticmethod) and law.__wrapped__.__code__ is frame.f_code:
                command = shlex.join(["asrsim", "check", option, one.name, *plugin_options([frame.f_code.co_filename])])
                return f"{command} evaluates the laws over their whole range"
    return ""


def _plugin_frames(error: BaseException) -> list[tuple[FrameType, int]]:
    """Frames of plugin files in which `error` was raised, with their line numbers; the innermost frame is the first."""
    frames = list(traceback.walk_tb(error.__traceback__))
    return [place for place in frames[::-1] if str(place[0].f_globals.get("__name__", "")).startswith(MODULES)]


def _run(path: Path) -> ModuleType:
    from importlib.util import module_from_spec, spec_from_file_location

    name = f"{MODULES}{re.sub(r'[^0-9A-Za-z_]', '_', path.stem)}_{abs(hash(str(path.resolve()))):x}"
    spec = spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise ActuatorError("is not a Python file", file=path, code="not-python")
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        # Redirect the output of the plugin to stderr, since stdout may contain JSON.
        with redirect_stdout(sys.stderr), plugin_file(str(path.resolve())):
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        lines = [error.lineno] if isinstance(error, SyntaxError) else [line for _, line in _plugin_frames(error)]
        message = f"the plugin file raised {type(error).__name__}: {error}"
        raise ActuatorError(message, file=path, line=next(iter(lines), None), code="plugin-raised") from error
    return module
