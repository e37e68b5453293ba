"""The command line's table of commands; each command's body lives in its own module and imports what it needs when it runs."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from asrsim.cli import actuators, bench, check, ilc, init, rerun, run

# Without rich's markup, help comes in half the time.
app = typer.Typer(no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False, rich_markup_mode=None)


def _version(wanted: bool) -> None:
    if wanted:
        from asrsim import __version__

        typer.echo(f"asrsim {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
    debug: Annotated[
        bool, typer.Option("--debug", envvar="ASRSIM_DEBUG", help="Show where in the program an error came up.")
    ] = False,
) -> None:
    """Simulate articulated soft robots: joints driven through springs or variable-stiffness actuators.

    Example: asrsim run scenario.yaml
    """
    if debug:
        os.environ["ASRSIM_DEBUG"] = "1"


app.command()(run.run)
app.command()(rerun.rerun)
app.command()(ilc.ilc)
app.command()(check.check)
app.command()(actuators.actuators)
app.command()(bench.bench)
app.command()(init.init)


def main() -> None:
    """Entry point: known errors become a few lines and exit code 1."""
    code = _call()
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read our output has gone; Python must not complain of it once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _call() -> int:
    from asrsim.errors import AsrsimError

    try:
        app()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        sys.stderr.write("asrsim: aborted\n")
        return 130
    except AsrsimError as error:
        if _debugging():
            raise
        for line in (*str(error).splitlines(), *getattr(error, "__notes__", ())):
            sys.stderr.write(f"asrsim: {line}\n")
        return 1
    except Exception as error:
        if _debugging():
            raise
        sys.stderr.write(f"asrsim: unexpected error: {type(error).__name__}: {error}{_place(error)}\n")
        sys.stderr.write("asrsim: run with ASRSIM_DEBUG=1 to see where it came from\n")
        return 1
    return 0


def _debugging() -> bool:
    return os.environ.get("ASRSIM_DEBUG", "") not in ("", "0")


def _place(error: BaseException) -> str:
    trace, place = error.__traceback__, ""
    while trace is not None:
        place = f" ({trace.tb_frame.f_code.co_filename}:{trace.tb_lineno})"
        trace = trace.tb_next
    return place


if __name__ == "__main__":
    main()
