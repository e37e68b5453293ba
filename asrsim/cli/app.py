"""Table of all commands. The module of a command is imported when the command runs."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Callable
from importlib import import_module
from inspect import cleandoc
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from asrsim.renamed import OPTIONS, OldKeyWarning, tell

GROUPS = {
    "Simulate": {"run": "run", "live": "live", "rerun": "rerun"},
    "Look": {"view": "view", "plot": "plot", "render": "render", "report": "report_page"},
    "Laboratory": {"init": "init", "identify": "identify", "design": "design"},
    "Use elsewhere": {"export": "export", "twin": "twin"},
    "Learn and vary": {"ilc": "ilc", "sweep": "sweep"},
    "Reference": {
        "check": "check",
        "actuators": "actuators",
        "datasheet": "datasheet",
        "examples": "examples",
        "reproduce": "reproduce",
    },
}
"""Commands under each heading of the help; the value of a command is the module of `asrsim.cli` that defines the command."""
COMMANDS = {name: f"asrsim.cli.{module}" for group in GROUPS.values() for name, module in group.items()}
"""Module of each command; a module is imported when its command is used or listed."""


HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}


class PlainCommand(TyperCommand):
    """Command whose help text has no braces around required arguments and no parentheses around default values."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        renamed = OPTIONS.get(ctx.info_name or "", {})
        for index, text in enumerate(args):
            name, separator, value = text.partition("=")
            if name in renamed:
                args[index] = f"{renamed[name]}{separator}{value}"
                typer.echo(f"asrsim: {tell(name, renamed[name])}", err=True)
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]

    def get_help(self, ctx: Any) -> str:
        return re.sub(r"(\[default:\s+)\(([^]]*)\)\]", r"\1\2]", super().get_help(ctx))


class LazyGroup(TyperGroup):
    """Imports the module of a command only when the command is needed, so that the options of other commands are not loaded."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        from asrsim.errors import did_you_mean

        # The base class suggests only commands whose modules are imported already, so compare with all names.
        hint = did_you_mean(args[0], list(COMMANDS)) if args[0] not in COMMANDS else None
        if hint and not ctx.resilient_parsing:
            ctx.fail(f"No such command '{args[0]}'. {hint}")
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        single = typer.Typer(rich_markup_mode=None, add_completion=False, pretty_exceptions_enable=False, context_settings=HELP)
        single.command(name=cmd_name, cls=PlainCommand)(_function_of(cmd_name))
        return typer.main.get_command(single)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        # Show only the first sentence about each command, since collecting the options of all commands would take most of the
        # time. The library would truncate long lines.
        widest = max(map(len, COMMANDS))
        for title, group in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(widest), first_sentence(_function_of(name))) for name in group])


def _function_of(command: str) -> Any:
    return getattr(import_module(COMMANDS[command]), command)


def first_sentence(function: Any) -> str:
    """First sentence of a function's docstring."""
    return cleandoc(function.__doc__).split("\n\n")[0].split(". ")[0].replace("\n", " ").rstrip(".") + "."


# Disable typer's rich markup, so that the help appears in half the time.
app = typer.Typer(
    cls=LazyGroup,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=HELP,
)


def _version(wanted: bool) -> None:
    if wanted:
        from asrsim import __version__
        from asrsim.cli.console import say

        say(f"asrsim {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
) -> None:
    """Simulate articulated soft robots: joints driven through springs or variable-stiffness actuators.

    Example: asrsim examples && asrsim run examples/scenarios/step_2dof.yaml
    """


def main() -> None:
    """Run the command line: expected errors are printed in a few lines, with exit code 1."""
    # If the shell closed a stream (>&-), replace it. Otherwise the next opened file would get its file descriptor.
    sys.stdout = sys.stdout or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    sys.stderr = sys.stderr or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    from asrsim.cli.console import clean_streams
    from asrsim.workers import use_one_thread

    use_one_thread(os.environ)
    clean_streams()
    code = _call()
    try:
        sys.stdout.flush()
    except OSError as error:
        # The program that reads the output has ended, or the disk is full. Discard the rest of the output, since Python would
        # otherwise print an error at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            sys.stderr.write(f"asrsim: cannot write the output: {error.strerror}\n")
            code = code or 1
    sys.exit(code)


def _call() -> int:
    from asrsim.cli.console import complain
    from asrsim.cli.interrupt import INTERRUPTED, interruptible

    with interruptible() as interrupted, warnings.catch_warnings():
        warnings.showwarning = _tell_old_keys(warnings.showwarning)
        try:
            app()
        except SystemExit as end:
            # Print the message here, since typer prints nothing for an interrupted command.
            if isinstance(getattr(end.__context__, "__cause__", None), KeyboardInterrupt):
                complain("asrsim: aborted")
            return end.code if isinstance(end.code, int) else int(end.code is not None)
        except (KeyboardInterrupt, Exception) as error:
            if isinstance(error, Exception) and not interrupted():
                return _report_error(error)
            complain("asrsim: aborted")
            return INTERRUPTED
    return 0


def _tell_old_keys(show: Callable[..., None]) -> Callable[..., None]:
    """Function that prints a warning about a key's old name as one line, once, and passes other warnings to `show`."""
    from asrsim.cli.console import complain

    told = set[str]()

    def tell_old_key(message: Warning | str, *given: Any, **named: Any) -> None:
        if isinstance(message, OldKeyWarning):
            if str(message) not in told:
                told.add(str(message))
                complain(f"asrsim: {message}")
        else:
            show(message, *given, **named)

    return tell_old_key


def _report_error(error: BaseException) -> int:
    """Print the message of an error, and return the exit code."""
    from asrsim.cli.console import complain, error_lines
    from asrsim.errors import AsrsimError

    if isinstance(error, BrokenPipeError):
        # Print no message, since the program that reads the output has ended on purpose.
        return 0
    if _debugging():
        raise error
    if isinstance(error, AsrsimError):
        for line in (*error_lines(error), *getattr(error, "__notes__", ())):
            complain(f"asrsim: {line}")
    elif isinstance(error, OSError):
        what = f"{error.filename}: " if error.filename else ""
        complain(f"asrsim: {what}{error.strerror or error}{'' if what else ' (while reading or writing)'}")
    elif isinstance(error, MemoryError):
        complain("asrsim: the command needs more memory than this machine has")
    else:
        import traceback

        place = traceback.extract_tb(error.__traceback__)[-1]
        complain(f"asrsim: unexpected error: {type(error).__name__}: {error} ({place.filename}:{place.lineno})")
        complain("asrsim: the environment variable ASRSIM_DEBUG=1 shows the whole traceback")
    return 1


def _debugging() -> bool:
    return os.environ.get("ASRSIM_DEBUG", "") not in ("", "0")


if __name__ == "__main__":
    main()
