"""Writes the motion of a log as film strip, GIF or MP4."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.errors import InputError, OutputError
from asrsim.extras import library
from asrsim.outfile import is_ours, written
from asrsim.progress import Progress, Tell
from asrsim.render.motion import Film, FilmFrame, even_times, telling_times

if TYPE_CHECKING:
    from PIL.Image import Image as Picture
    from PIL.ImageFont import FreeTypeFont

GIF_FPS, GIF_FRAMES = 15.0, 240
"""GIF_FPS: frames per second of a GIF; GIF_FRAMES: largest number of frames of a GIF. A longer run gets fewer frames per
second."""
MP4_FPS = 30.0
"""Frames per second of an MP4."""
ROW = 6
"""Number of frames in a row of a film strip."""


def film_strip(frames: Sequence[FilmFrame], *, title: str = "", letters: float = 0.045) -> Picture:
    """Film strip with rows of at most `ROW` frames, each with its time and the objects in contact. letters: size of the text
    as a fraction of a frame.
    """
    from PIL import Image as Pictures
    from PIL import ImageDraw

    columns = min(len(frames), ROW)
    rows = -(-len(frames) // columns)
    height, width = frames[0].image.shape[:2]
    size = max(11, round(letters * (width * height) ** 0.5))
    line, gap = round(1.7 * size), max(2, size // 4)
    top = round(2.0 * size) if title else 0
    strip = Pictures.new("RGB", (columns * (width + gap) - gap, top + rows * (height + line)), "white")
    pen = ImageDraw.Draw(strip)
    if title:
        pen.text((gap, 0.4 * size), title, fill="#1a1a1a", font=_font(round(1.15 * size)))
    for number, frame in enumerate(frames):
        x, y = (number % columns) * (width + gap), top + (number // columns) * (height + line)
        touching = f"  touches {', '.join(frame.touching)}" if frame.touching else ""
        time = f"{frame.time:.3f}".rstrip("0")
        time += "0" * (2 - len(time.partition(".")[2])) + " s"
        pen.text((x + gap, y + 0.3 * size), time, fill="#4a4a4a", font=_font(size))
        after = x + gap + pen.textlength(time, font=_font(size))
        pen.text((after, y + 0.3 * size), touching, fill="#c33300", font=_font(size))
        strip.paste(Pictures.fromarray(frame.image), (x, y + line))
    return strip


def _font(size: int) -> FreeTypeFont:
    """Font of all texts in pictures, which comes with Matplotlib."""
    from importlib.util import find_spec

    from PIL import ImageFont

    place = find_spec("matplotlib")
    folders = place.submodule_search_locations if place is not None else None
    return ImageFont.truetype(str(Path((folders or ["."])[0]) / "mpl-data/fonts/ttf/DejaVuSans.ttf"), size)


def _stamped(film: Film, times: Sequence[float], progress: Tell | None, name: str) -> Iterator[Picture]:
    """Pictures of the film at these times in s, each with its time in a corner and a faint robot at the equilibrium."""
    from PIL import Image as Pictures
    from PIL import ImageDraw

    size = max(11, round(0.045 * (film.width * film.height) ** 0.5))
    for number, time in enumerate(times, 1):
        frame = film.frame(time, ghost=True)
        picture = Pictures.fromarray(frame.image)
        ImageDraw.Draw(picture).text((0.5 * size, 0.3 * size), f"{frame.time:.2f} s", fill="#4a4a4a", font=_font(size))
        yield picture
        if progress is not None:
            progress(Progress(task=name, fraction=number / len(times)))


def strip_of(film: Film, *, count: int = ROW) -> Picture:
    """Film strip with `count` frames, which are closer in time where the motion is faster."""
    frames = [film.frame(time) for time in telling_times([film], count)]
    variant = film.info.variant if film.info.variant not in ("", "default") else ""
    return film_strip(frames, title=" · ".join(filter(None, (film.info.robot, variant))))


def write_strip(film: Film, path: str | Path, *, count: int = ROW) -> Path:
    """Write the film strip as PNG and return the file. Raises OutputError."""
    from PIL.PngImagePlugin import PngInfo

    mark = PngInfo()
    mark.add_text("Software", "asrsim")
    strip = strip_of(film, count=count)
    path = Path(path)
    with written(path, "picture") as stream:
        strip.save(stream, format="PNG", compress_level=4, pnginfo=mark)
    return path


def write_gif(film: Film, path: str | Path, *, speed: float = 1.0, fps: float = GIF_FPS, progress: Tell | None = None) -> Path:
    """Write an endless GIF and return the file. speed: 2 plays the run twice as fast; fps: frames per second. Raises
    OutputError.
    """
    from PIL import Image as Pictures

    times = _times(film, speed, fps, most=GIF_FRAMES)
    pictures = list(_stamped(film, times, progress, Path(path).name))
    # Give all frames the palette of one of them. If each frame had its own palette, colours would flicker.
    palette = pictures[len(pictures) // 2].quantize(colors=128, method=Pictures.Quantize.MEDIANCUT)
    indexed = [picture.quantize(palette=palette, dither=Pictures.Dither.NONE) for picture in pictures]
    shown = (film.end - film.start) / speed / max(len(times) - 1, 1)
    path = Path(path)
    with written(path, "picture") as stream:
        indexed[0].save(
            stream,
            format="GIF",
            save_all=True,
            append_images=indexed[1:],
            duration=max(20, round(1000 * shown)),
            loop=0,
            optimize=False,
            comment=b"asrsim",
        )
    return path


def write_mp4(film: Film, path: str | Path, *, speed: float = 1.0, fps: float = MP4_FPS, progress: Tell | None = None) -> Path:
    """Write an MP4 (H.264) and return the file. speed, fps: as for `write_gif`. Raises OutputError, and InputError if
    imageio-ffmpeg is not installed.
    """
    imageio_ffmpeg = library("imageio_ffmpeg", "video")
    times = _times(film, speed, fps)
    path = Path(path)
    with written(path, "picture") as stream:
        writer = imageio_ffmpeg.write_frames(
            stream.name,
            (film.width, film.height),
            fps=fps,
            codec="libx264",
            quality=7,
            macro_block_size=2,
            ffmpeg_log_level="error",
            output_params=["-metadata", "comment=asrsim", "-f", "mp4"],
        )
        try:
            writer.send(None)
            for picture in _stamped(film, times, progress, Path(path).name):
                writer.send(np.ascontiguousarray(picture))
        finally:
            with suppress(OSError):
                writer.close()
        # Check that ffmpeg wrote the index at the end of the file, since it reports no error if the disk is full.
        if not is_ours(Path(stream.name), "picture") or not Path(stream.name).stat().st_size:
            raise OutputError(f"{path}: cannot be written: ffmpeg did not finish the video")
    return path


def _times(film: Film, speed: float, fps: float, *, most: int | None = None) -> list[float]:
    for key, value in (("speed", speed), ("fps", fps)):
        if not (np.isfinite(value) and value > 0):
            raise InputError("must be larger than 0", key=key, value=value, code="bad-speed")
    count = max(2, round((film.end - film.start) / speed * fps) + 1)
    return even_times(film, count if most is None else min(count, most))
