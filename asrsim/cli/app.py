"""The command line's table of commands; each command's body lives in its own module and is imported when it runs."""

from __future__ import annotations

import sys

import typer

from asrsim.cli import actuators, bench, check, init

app = typer.Typer(no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False)


@app.callback()
def root() -> None:
    """Simulate articulated soft robots: joints driven through springs or variable-stiffness actuators."""


app.command()(check.check)
app.command()(actuators.actuators)
app.command()(bench.bench)
app.command()(init.init)


def main() -> None:
    """Entry point: known errors become a few lines and exit code 1."""
    from asrsim.errors import AsrsimError

    try:
        app()
    except AsrsimError as error:
        sys.stderr.write(f"asrsim: {error}\n")
        sys.exit(1)
