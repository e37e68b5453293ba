"""`asrsim render`: draws film strip, GIF and MP4 of a log's motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_problems, say_written
from asrsim.cli.options import End, Start, argument, check_window, into_folder, option

SIZE = 360
"""Size of a picture: square root of its area, pixels."""


@command("Print nothing.", plugins=False)
def render(
    log: Annotated[
        Path,
        argument("LOG", "Log (MCAP) of a run, its folder, or a folder of variants."),
    ],
    frames: Annotated[int | None, option("Frames of the film strip.", default="6, if neither --gif nor --mp4 is given")] = None,
    gif: Annotated[bool, option("Write an animated GIF.", "--gif")] = False,
    mp4: Annotated[bool, option("Write a video (needs the extra `video`).", "--mp4")] = False,
    size: Annotated[
        int,
        option("Square root of a picture's area, pixels; the motion determines its aspect ratio.", min=32, max=4000),
    ] = SIZE,
    speed: Annotated[float, option("Speed of the film; 2 is twice as fast as the run.")] = 1.0,
    fps: Annotated[float | None, option("Frames per second.", default="15 for a GIF, 30 for an MP4")] = None,
    start: Start = None,
    end: End = None,
    out: Annotated[Path | None, into_folder("Folder for the pictures.", "beside the log")] = None,
    *,
    quiet: bool,
) -> Done:
    """Draw the logged motion: a film strip, a GIF, a video. The command needs only the log, and no display.

    Example: asrsim render out/step_2dof/soft --frames 8 --gif
    """
    from asrsim.cli.progress import FractionBar
    from asrsim.outfile import make_folder
    from asrsim.render import Film, share_view, write_gif, write_mp4, write_strip
    from asrsim.runs.folder import find_logs

    check_window(start, end)
    logs, problems = find_logs(log)
    say_problems(problems, "warning")
    files: list[Path] = []
    rates = {} if fps is None else {"fps": fps}
    with FractionBar(show=not quiet) as progress:
        films = [Film(path, size=size, start=start, end=end) for path in logs]
        share_view(films)
        for path, film in zip(logs, films, strict=True):
            folder = make_folder(path.parent if out is None else out if len(logs) == 1 else out / path.parent.name)
            if frames is not None or not (gif or mp4):
                files.append(write_strip(film, folder / "filmstrip.png", count=6 if frames is None else frames))
            for wanted, name, write in ((mp4, "motion.mp4", write_mp4), (gif, "motion.gif", write_gif)):
                if wanted:
                    files.append(write(film, folder / name, speed=speed, progress=progress.update, **rates))
    notes = list(dict.fromkeys(note for film in films for note in film.notes))

    def text() -> None:
        for note in notes:
            say(f"note {note}", "yellow")
        say_written(files)

    return Done(data={"ok": True, "files": files, "notes": notes}, text=text)
