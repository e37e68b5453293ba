"""`asrsim examples`: copies the bundled robots, scenarios, recordings and plugin, which every command can use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from asrsim.cli.command import Done, command
from asrsim.cli.console import say
from asrsim.cli.options import into_folder, option


@command("Print nothing.", plugins=False)
def examples(
    out: Annotated[Path, into_folder("Folder for the copies.")] = Path("examples"),
    overwrite: Annotated[bool, option("Replace existing files that have the names of the copies.", "--overwrite")] = False,
) -> Done:
    """Copy the bundled examples: robots, scenarios, recordings, and a custom actuator.

    Example: asrsim examples
    """
    from asrsim.plugins import command_line
    from asrsim.runs.examples import copy_examples

    written = copy_examples(out, overwrite=overwrite)
    run = command_line("run", out / "scenarios" / "step_2dof.yaml")
    return Done(
        data={"ok": True, "files": written},
        text=lambda: say(f"wrote {len(written)} files into {out}; run one: {run}"),
    )
