"""Decorator for the functions of commands: the options `--plugin`, `--quiet` and `--json`, the JSON document, and the exit
code.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from asrsim.cli.console import json_errors, say_json

Plugins = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE",
        help="Python file with your own actuators, signals, figures and so on; may be repeated.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print only a JSON document on stdout.")]


@dataclass(frozen=True, kw_only=True)
class Done:
    """Result that the function of a command returns."""

    data: Mapping[str, Any] | Sequence[Any]
    """JSON document that `--json` prints."""
    text: Callable[[], object] | None = None
    """Function that prints the result as text, unless `--quiet` or `--json` is given."""
    always: Callable[[], object] | None = None
    """Function that prints text even with `--quiet`."""
    code: int = 0
    """Exit code of the command."""


def command(quiet: str | None = "Print errors only.", *, plugins: bool = True) -> Callable[[Callable[..., Done]], Any]:
    """Decorator that turns a function into a command.

    The decorator adds the options `--json`, `--plugin` (loads the named files) and `--quiet` (quiet: its help text; None: the
    command has no such option). The function receives `quiet` (also set by `--json`), `json` and `plugin` if it has parameters
    with these names.
    """

    def decorate(function: Callable[..., Done]) -> Callable[..., None]:
        own = inspect.signature(function, eval_str=True).parameters
        added: dict[str, Any] = {"plugin": Plugins} if plugins else {}
        if quiet is not None:
            added["quiet"] = Annotated[bool, typer.Option("--quiet", "-q", help=quiet)]
        added["json"] = Json
        defaults = {"plugin": None, "quiet": False, "json": False}
        parameters = [
            *(parameter for name, parameter in own.items() if name not in defaults),
            *(
                inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY, default=defaults[n], annotation=a)
                for n, a in added.items()
            ),
        ]

        @functools.wraps(function)
        def run(**arguments: Any) -> None:
            json, silent, files = (arguments.pop(name, default) for name, default in reversed(defaults.items()))
            for name, value in arguments.items():
                numbers = value if isinstance(value, tuple) else (value,)
                if any(isinstance(number, float) and not math.isfinite(number) for number in numbers):
                    raise typer.BadParameter("must be finite", param_hint=f"--{name.replace('_', '-')}")
            given = {"plugin": files or [], "quiet": silent or json, "json": json}
            with json_errors(json), blaming(files):
                done = function(**arguments, **{name: value for name, value in given.items() if name in own})
            if not isinstance(done, Done):
                raise TypeError(f"the command '{function.__name__}' must return Done(data=...), not {done!r}")
            if json:
                say_json(done.data)
            else:
                for print_result in filter(None, (done.always, None if silent else done.text)):
                    print_result()
            if done.code:
                raise typer.Exit(done.code)

        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate


def blaming(plugins: Sequence[Path] | None) -> AbstractContextManager[None]:
    """Context manager that registers what the users' plugin files define. Exceptions that these files raise become errors with
    file and line. Raises ActuatorError.
    """
    if not plugins:
        return nullcontext()
    from asrsim.plugins import blame_plugins, load_plugin_files

    load_plugin_files(plugins)
    return blame_plugins()
