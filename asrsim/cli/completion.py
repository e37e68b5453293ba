"""Shell completion for the names of a scenario's variants."""

from __future__ import annotations

import typer


def variants(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of the scenario's variants that begin with the incomplete word; empty if the scenario cannot be read."""
    from asrsim.errors import AsrsimError
    from asrsim.scenario import load_scenario

    try:
        found = [one.variant for one in load_scenario(_named(ctx))]
    except (AsrsimError, OSError):
        return []
    return [name for name in found if name.startswith(incomplete)]


def _named(ctx: typer.Context) -> str:
    """Path of the scenario on the command line. If the value of an option is still missing, the path is among the unparsed
    words.
    """
    given = ctx.params.get("scenario") or ctx.args
    return str(given[0] if isinstance(given, list | tuple) and given else given or "")
