"""Film strip, GIF and MP4 of a log's motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.errors import InputError, OutputError, Problem
from asrsim.outfile import is_ours, written
from asrsim.render.motion import Film, Frame, even_times

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[float], None]
GIF_FPS, GIF_FRAMES = 15.0, 240
"""Pictures a second of a GIF, and the most that one gets: a longer run is shown with fewer a second."""
MP4_FPS = 30.0


def film_strip(frames: Sequence[Frame], *, title: str = "") -> Figure:
    """Frames in a row (rows of six at most) with their times, as a figure."""
    from asrsim.plots import style
    from asrsim.plots.figures import new_figure

    columns = min(len(frames), 6)
    rows = -(-len(frames) // columns)
    height, width = frames[0].image.shape[:2]
    wide = (2.1 if columns > 3 else 3.2) * min(1.0, (width / height) ** 0.5)
    figure = new_figure(wide * columns, (wide * height / width + 0.22) * rows + (0.3 if title else 0.0))
    axes = figure.subplots(rows, columns, squeeze=False)
    for ax, frame in zip(axes.flat, [*frames, *[None] * (rows * columns - len(frames))], strict=True):
        ax.set_axis_off()
        if frame is not None:
            ax.imshow(frame.image, interpolation="lanczos")
            ax.set_title(f"{frame.time:.2f} s", fontsize=8.5, color=style.GREY, pad=2)
    if title:
        figure.suptitle(title, fontsize=10.5, x=0.01, ha="left", color=style.BLACK)
    return figure


def write_strip(film: Film, path: Path, *, count: int = 6, progress: Progress | None = None) -> Path:
    """A film strip as PNG. Raises OutputError."""
    from asrsim.plots import style
    from asrsim.plots.output import METADATA, styled

    frames = []
    for number, time in enumerate(even_times(film, count), 1):
        frames.append(film.frame(time))
        if progress is not None:
            progress(number / count)
    variant = film.info.variant if film.info.variant not in ("", "default") else ""
    with styled():
        figure = film_strip(frames, title=style.plain(" · ".join(filter(None, (film.info.robot, variant)))))
        kind = path.suffix[1:] or "png"
        with written(path, "picture") as stream:
            figure.savefig(stream, format=kind, metadata=METADATA.get(kind))
    return path


def write_gif(film: Film, path: Path, *, speed: float = 1.0, fps: float = GIF_FPS, progress: Progress | None = None) -> Path:
    """An endless GIF. speed: 2 shows the run twice as fast; fps: pictures a second. Raises OutputError."""
    from PIL import Image as Pictures

    times = _times(film, speed, fps, most=GIF_FRAMES)
    pictures = []
    for number, time in enumerate(times, 1):
        pictures.append(Pictures.fromarray(film.frame(time).image))
        if progress is not None:
            progress(number / len(times))
    # One palette for all frames: colours do not flicker.
    palette = pictures[len(pictures) // 2].quantize(colors=128, method=Pictures.Quantize.MEDIANCUT)
    indexed = [picture.quantize(palette=palette, dither=Pictures.Dither.NONE) for picture in pictures]
    shown = (film.end - film.start) / speed / max(len(times) - 1, 1)
    with written(path, "picture") as stream:
        indexed[0].save(
            stream, format="GIF", save_all=True, append_images=indexed[1:], duration=max(20, round(1000 * shown)), loop=0,
            optimize=False, comment=b"asrsim",
        )  # fmt: skip
    return path


def write_mp4(film: Film, path: Path, *, speed: float = 1.0, fps: float = MP4_FPS, progress: Progress | None = None) -> Path:
    """An MP4 (H.264) by imageio-ffmpeg. Raises InputError if that is not installed, and OutputError."""
    try:
        import imageio_ffmpeg
    except ModuleNotFoundError:
        raise InputError(
            Problem(message="MP4 needs imageio-ffmpeg", key="--mp4", hint="pip install 'asrsim[video]', or use --gif",
                    code="no-video")
        ) from None  # fmt: skip
    times = _times(film, speed, fps)
    with written(path, "picture") as stream:
        writer = imageio_ffmpeg.write_frames(
            stream.name, (film.width, film.height), fps=fps, codec="libx264", quality=7, macro_block_size=2,
            ffmpeg_log_level="error", output_params=["-metadata", "comment=asrsim", "-f", "mp4"],
        )  # fmt: skip
        try:
            writer.send(None)
            for number, frame in enumerate(film.frames(times), 1):
                writer.send(np.ascontiguousarray(frame.image))
                if progress is not None:
                    progress(number / len(times))
        finally:
            with suppress(OSError):
                writer.close()
        # Without its index, which comes last, a video is none: ffmpeg tells nobody that the disk was full.
        if not is_ours(Path(stream.name), "picture") or not Path(stream.name).stat().st_size:
            raise OutputError(f"{path}: cannot be written: ffmpeg could not finish it")
    return path


def _times(film: Film, speed: float, fps: float, *, most: int | None = None) -> list[float]:
    for key, value in (("speed", speed), ("fps", fps)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(Problem(message="must be larger than 0", key=key, value=value, code="bad-speed"))
    count = max(2, round((film.end - film.start) / speed * fps) + 1)
    return even_times(film, count if most is None else min(count, most))
