"""`asrsim render`: film strip, GIF and MP4 of a log's motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli.options import Plugins, load_plugins

SMALL = 360
"""Pixels (root of the area) of a GIF's pictures."""


def render(
    log: Annotated[Path, typer.Argument(help="Log (MCAP) of a run.", show_default=False)],
    frames: Annotated[
        int | None, typer.Option(help="Pictures of the film strip.", show_default="6, if no film is asked for")
    ] = None,
    gif: Annotated[bool, typer.Option("--gif", help="Write an animated GIF.")] = False,
    mp4: Annotated[bool, typer.Option("--mp4", help="Write a video (needs the extra `video`).")] = False,
    size: Annotated[
        int | None,
        typer.Option(help="Pixels, root of a picture's area; its shape follows from the motion.", show_default="550, GIF 360"),
    ] = None,
    speed: Annotated[float, typer.Option(help="2 shows the run twice as fast.")] = 1.0,
    fps: Annotated[float | None, typer.Option(help="Pictures a second.", show_default="GIF 15, MP4 30")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the pictures.", show_default="beside the log")
    ] = None,
    plugin: Plugins = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document, and nothing else, on stdout.")] = False,
) -> None:
    """Draw the logged motion: a film strip, a GIF, a video. Needs no display, and nothing but the log.

    Example: asrsim render out/scenario/soft/log.mcap --frames 8 --gif
    """  # fmt: skip
    from asrsim.cli.console import json_errors, say, say_json

    with json_errors(json):
        from asrsim.cli.fraction import FractionProgress
        from asrsim.outfile import make_folder
        from asrsim.render import Film, write_gif, write_mp4, write_strip

        load_plugins(plugin)
        if size is not None and not 32 <= size <= 4000:
            raise typer.BadParameter("must be 32 to 4000 pixels", param_hint="--size")
        folder = make_folder(out or log.parent)
        files: list[Path] = []
        rates = {} if fps is None else {"fps": fps}
        notes: tuple[str, ...] = ()
        with FractionProgress(show=not quiet and not json) as progress:
            if frames is not None or not (gif or mp4):
                with Film(log, size=size or 550) as film:
                    notes = film.notes
                    strip = folder / "filmstrip.png"
                    files.append(
                        write_strip(
                            film,
                            strip,
                            count=6 if frames is None else frames,
                            progress=lambda f: progress.update("film strip", f),
                        )
                    )
            if mp4:
                with Film(log, size=size or 550) as film:
                    notes = film.notes
                    video = folder / "motion.mp4"
                    files.append(write_mp4(film, video, speed=speed, progress=lambda f: progress.update("MP4", f), **rates))
            if gif:
                with Film(log, size=size or SMALL) as film:
                    notes = film.notes
                    path = folder / "motion.gif"
                    files.append(write_gif(film, path, speed=speed, progress=lambda f: progress.update("GIF", f), **rates))
    if json:
        say_json({"ok": True, "files": [str(path) for path in files], "notes": list(notes)})
    elif not quiet:
        for note in notes:
            say(f"note {note}", "yellow")
        say(f"wrote {', '.join(str(path) for path in files)}")
