"""Pictures of the logged motion: the camera sees all of it, links without shapes are seen, files are what they say."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from plot_example import made_up_log, simulated_log
from typer.testing import CliRunner

from asrsim.cli.app import app
from asrsim.errors import InputError, LogError
from asrsim.render import Film, even_times, write_gif, write_mp4, write_strip
from asrsim.render.camera import fit_camera, main_axis, viewpoint
from asrsim.render.shapes import drawable


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_log("step_2dof", tmp_path_factory.mktemp("film") / "log.mcap", variant="soft", duration=0.4)


def background(image: np.ndarray) -> np.ndarray:
    """Where nothing is."""
    return np.all(np.abs(image.astype(int) - image[0, 0].astype(int)) < 8, axis=2)


@pytest.mark.parametrize("seed", range(5))
def test_the_camera_sees_every_point_and_stands_no_farther_than_needed(seed: int):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * rng.uniform(0.1, 2.0, size=3) + rng.normal(size=3)
    towards, aspect = viewpoint(None), 1.4
    camera = fit_camera(points, towards, aspect=aspect)
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    np.testing.assert_allclose(forward, -towards / np.linalg.norm(towards), atol=1e-9)
    right = np.cross(forward, camera.up)
    seen = points - camera.eye
    edge = math.tan(math.radians(camera.field / 2))
    x, y = np.abs(seen @ right) / (seen @ forward) / (edge * aspect), np.abs(seen @ camera.up) / (seen @ forward) / edge
    assert (seen @ forward > 0).all()
    assert 0.85 < max(x.max(), y.max()) <= 1.0


def test_a_planar_robot_is_seen_along_its_axis():
    axes = {"a": np.array([0.0, 1.0, 0.0]), "b": np.array([0.0, -1.0, 0.0])}
    axis = main_axis(axes, {"a": 1.0, "b": 0.5})
    assert axis is not None
    assert abs(viewpoint(axis)[1]) > 0.8
    assert viewpoint(np.array([0.0, 0.0, 1.0]))[2] > 0.8
    assert main_axis({**axes, "c": np.array([0.0, 0.0, 1.0])}, {"a": 1.0, "c": 1.0}) is None
    # A joint that does not move does not count.
    assert main_axis({**axes, "c": np.array([0.0, 0.0, 1.0])}, {"a": 1.0, "c": 0.0}) is not None


def test_links_without_visuals_are_drawn_and_it_is_said():
    made = drawable(
        """<robot name="r">
        <link name="base"/>
        <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/></inertial></link>
        <link name="hand"><collision><origin xyz="0 0 0.1"/><geometry><box size="1 2 3"/></geometry></collision></link>
        <link name="nice"><visual><geometry><sphere radius="1"/></geometry></visual></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/></joint>
        <joint name="k" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.3 0 0.4"/></joint>
        </robot>"""
    )
    assert made.collisions == ("hand",)
    assert made.rods == ("base", "arm")
    assert any("hand" in note for note in made.notes)
    assert 'box size="1 2 3"' in made.urdf.split('name="hand"')[1].split("<visual>")[1]
    assert 'length="0.5"' in made.urdf


def test_frames_show_the_motion_within_the_picture(log: Path):
    with Film(log, size=120) as film:
        first, last = film.frame(film.start).image, film.frame(film.end).image
        assert first.shape == (film.height, film.width, 3)
        for image in (first, last):
            seen = ~background(image)
            assert seen.sum() > 300
            # A margin all around: nothing of the motion is cut off.
            assert not np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]]).any()
        assert np.abs(first.astype(int) - last.astype(int)).max() > 50
        np.testing.assert_array_equal(film.frame(film.start).image, first)


def test_objects_stand_where_the_log_has_them(tmp_path: Path):
    path = simulated_log("box_push_5dof", tmp_path / "log.mcap", variant="stiff", duration=0.01)
    with Film(path, size=100, sharpness=1) as film:
        image = film.frame(0.0).image.astype(int)
    # The box is brown: much more red than blue.
    assert (image[:, :, 0] - image[:, :, 2] > 40).mean() > 0.05


def test_a_strip_has_so_many_frames_at_even_times(log: Path, tmp_path: Path):
    from matplotlib.image import imread

    with Film(log, size=80, sharpness=1) as film:
        assert even_times(film, 3) == pytest.approx([0.0, 0.2, 0.4])
        assert even_times(film, 1) == [film.end]
        with pytest.raises(InputError):
            even_times(film, 0)
        picture = imread(write_strip(film, tmp_path / "strip.png", count=4))
    dark = (picture[:, :, :3].max(axis=2) < 0.5).any(axis=0)
    assert dark.any()


def test_a_gif_plays_for_as_long_as_the_run(log: Path, tmp_path: Path):
    from PIL import Image

    with Film(log, size=60, sharpness=1) as film:
        path = write_gif(film, tmp_path / "motion.gif", fps=10, speed=0.5)
    with Image.open(path) as gif:
        assert gif.info["loop"] == 0
        # Frames that are alike are joined; the last one is shown too.
        total = 0
        for number in range(gif.n_frames):
            gif.seek(number)
            total += gif.info["duration"]
    assert gif.n_frames > 3
    assert total == pytest.approx(900, abs=20)


def test_a_video_without_its_library_says_how_to_get_it(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with Film(log, size=60) as film, pytest.raises(InputError, match=r"asrsim\[video\]"):
        write_mp4(film, tmp_path / "motion.mp4")


@pytest.mark.slow
def test_a_video_is_an_mp4(log: Path, tmp_path: Path):
    pytest.importorskip("imageio_ffmpeg")
    with Film(log, size=60, sharpness=1) as film:
        data = write_mp4(film, tmp_path / "motion.mp4").read_bytes()
    assert data[4:8] == b"ftyp"


def test_the_log_alone_is_enough(log: Path, tmp_path: Path):
    alone = tmp_path / "elsewhere.mcap"
    alone.write_bytes(log.read_bytes())
    result = CliRunner().invoke(app, ["render", str(alone), "--frames", "2", "--size", "60", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["files"] == [str(tmp_path / "filmstrip.png")]


def test_a_log_without_its_robot_cannot_be_drawn(tmp_path: Path):
    with pytest.raises((LogError, InputError)):
        Film(made_up_log(tmp_path / "log.mcap", count=20))
