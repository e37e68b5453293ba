"""Draws a logged motion as film strip, GIF or MP4, without a display."""

from __future__ import annotations

from asrsim.render.files import film_strip, strip_of, write_gif, write_mp4, write_strip
from asrsim.render.motion import Film, FilmFrame, even_times, share_view, telling_times

__all__ = [
    "Film",
    "FilmFrame",
    "even_times",
    "film_strip",
    "share_view",
    "strip_of",
    "telling_times",
    "write_gif",
    "write_mp4",
    "write_strip",
]
