"""Pictures of the logged motion: the camera sees all of it, links without shapes are seen, files are what they say."""

import json
import math
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from asrsim.actuators import ACTUATORS
from asrsim.cli.app import app
from asrsim.errors import InputError, LogError
from asrsim.render import Film, even_times, telling_times, write_gif, write_mp4, write_strip
from asrsim.render.camera import fit_camera, viewpoint
from asrsim.render.draw import TILE_DARK, TILE_LIGHT
from asrsim.render.raster import rasterise
from asrsim.render.shapes import drawable
from asrsim.robot import load_robot
from support.plot_example import made_up_log, simulated_log


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return simulated_log("step_2dof", tmp_path_factory.mktemp("film") / "log.mcap", variant="soft", duration=0.4)


def background(image):
    """Where nothing is: the sky, which goes evenly from top to bottom."""
    share = np.linspace(0.0, 1.0, len(image))[:, None, None]
    sky = (1 - share) * image[0, 0].astype(float) + share * image[-1, 0].astype(float)
    return np.all(np.abs(image - sky) < 8, axis=2)


@pytest.mark.parametrize("seed", range(2))
def test_the_camera_sees_every_point_from_nearby(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * rng.uniform(0.1, 2.0, size=3) + rng.normal(size=3)
    towards, aspect = viewpoint(None), 1.4
    camera = fit_camera(points, towards, aspect=aspect)
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    np.testing.assert_allclose(forward, -towards / np.linalg.norm(towards), atol=1e-9)
    right, up, _ = camera.axes
    seen = points - camera.eye
    edge = math.tan(math.radians(camera.field / 2))
    x, y = np.abs(seen @ right) / (seen @ forward) / (edge * aspect), np.abs(seen @ up) / (seen @ forward) / edge
    assert (seen @ forward > 0).all()
    assert 0.85 < max(x.max(), y.max()) <= 1.0


def test_links_without_visuals_are_drawn_and_it_is_said(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(
        """<robot name="r">
        <link name="base"/>
        <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
        <link name="hand"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
        <collision><origin xyz="0 0 0.1"/><geometry><box size="1 2 3"/></geometry></collision></link>
        <link name="nice"><visual><geometry><sphere radius="1"/></geometry></visual></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/></joint>
        <joint name="k" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.3 0 0.4"/></joint>
        <joint name="l" type="fixed"><parent link="hand"/><child link="nice"/></joint>
        </robot>"""
    )
    robot, notes = drawable(load_robot(file))
    assert [note.rpartition(": ")[2] for note in notes] == ["hand", "base, arm"]
    base, arm, hand, nice = (link.visuals for link in robot.links)
    assert [(shape.kind, shape.size, shape.origin) for shape in hand] == [("box", (1.0, 2.0, 3.0), (0.0, 0.0, 0.1))]
    assert [shape.kind for shape in (*base, *arm)] == ["sphere", "cylinder"] * 2
    assert (base[1].size[1], arm[1].size[1]) == (0.5, 0.5)
    assert len(nice) == 1


def test_frames_show_the_motion_within_the_picture(log):
    film = Film(log, size=120)
    first, last = film.frame(film.start).image, film.frame(film.end).image
    for image in (first, last):
        seen = ~background(image)
        assert seen.sum() > 300
        # A margin all around: nothing of the motion is cut off.
        assert not np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]]).any()
    assert np.abs(first.astype(int) - last.astype(int)).max() > 50


def test_a_strip_has_frames_at_even_times(log, tmp_path):
    film = Film(log, size=80, sharpness=1)
    assert even_times(film, 3) == pytest.approx([0.0, 0.2, 0.4])
    assert even_times(film, 1) == [film.end]
    with pytest.raises(InputError):
        even_times(film, 0)
    one, four = (png_size(write_strip(film, tmp_path / "strip.png", count=count)) for count in (1, 4))
    assert four[0] > 3.9 * one[0]
    assert four[1] == one[1]


def png_size(path):
    from PIL import Image

    with Image.open(path) as picture:
        return picture.size


def test_the_ghost_stands_where_springs_are_without_load(log):
    """At the start the link is at its equilibrium, and the ghost is hidden; after the step both are apart."""
    film = Film(log, size=120, sharpness=1)
    start, later = ((film.frame(time, ghost=True).image.astype(int) - film.frame(time).image) for time in (0.0, 0.2))
    assert np.abs(start).max() <= 1
    assert (np.abs(later).max(axis=2) > 10).mean() > 0.01


def test_a_gif_plays_for_as_long_as_the_run(log, tmp_path):
    """All frames share the 128 colours of one palette, so that no colour flickers."""
    from PIL import Image

    film = Film(log, size=60, sharpness=1)
    path = write_gif(film, tmp_path / "motion.gif", fps=10, speed=0.5)
    with Image.open(path) as gif:
        assert gif.info["loop"] == 0
        # Frames that are alike are joined; the last one is shown too.
        total, colours = 0, set()
        for number in range(gif.n_frames):
            gif.seek(number)
            total += gif.info["duration"]
            colours |= {colour for _, colour in gif.convert("RGB").getcolors(10_000)}
    assert gif.n_frames > 3
    assert len(colours) <= 128
    assert total == pytest.approx(900, abs=20)


@pytest.mark.slow
def test_a_video_is_an_mp4(log, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    film = Film(log, size=60, sharpness=1)
    data = write_mp4(film, tmp_path / "motion.mp4").read_bytes()
    assert data[4:8] == b"ftyp"


def test_a_log_without_its_robot_cannot_be_drawn(tmp_path):
    with pytest.raises((LogError, InputError)):
        Film(made_up_log(tmp_path / "log.mcap", count=20))


def test_pictures_need_neither_engine_nor_plugin(log, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.setattr(ACTUATORS, "_entries", {})
    assert not background(Film(log, size=60).frame(0.0).image).all()


@pytest.mark.parametrize("seed", range(2))
def test_the_rasteriser_finds_what_is_in_front(seed):
    rng = np.random.default_rng(seed)
    width, height = 31, 23
    corners = rng.uniform([-8, -8, 0.2], [39, 31, 2.0], size=(40, 3, 3))
    found = rasterise(corners, width, height)
    front, depth = np.full(width * height, -1), np.zeros(width * height)
    for number, (a, b, c) in enumerate(corners):
        for pixel in range(width * height):
            x, y = pixel % width + 0.5, pixel // width + 0.5
            turn = np.linalg.solve(np.array([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [1, 1, 1]]), [x, y, 1])
            near = turn @ [a[2], b[2], c[2]]
            if (turn >= 0).all() and near > depth[pixel]:
                front[pixel], depth[pixel] = number, near
    mine = np.full(width * height, -1)
    mine[found.pixels] = found.triangles
    np.testing.assert_array_equal(mine, front)
    np.testing.assert_allclose(found.depth, depth, rtol=1e-6, atol=1e-9)
    corners[:, 2, 2] *= -1.0
    assert not len(rasterise(corners, width, height).pixels)  # a corner behind the camera


def test_frames_are_denser_where_more_moves(log):
    """The step comes at 0.1 s: before it nothing moves."""
    film = Film(log, size=60)
    times = telling_times([film], 12)
    assert (times[0], times[-1]) == (film.start, film.end)
    assert sum(time < 0.1 for time in times) < sum(time < 0.1 for time in even_times(film, 12))


def test_a_folder_and_a_part_of_runs_are_drawn(log, tmp_path):
    for variant in ("b", "a"):
        (tmp_path / variant).mkdir()
        (tmp_path / variant / "log.mcap").write_bytes(log.read_bytes())
    options = ["--size", "60", "--start", "0.2", "--end", "0.3", "--json"]
    result = CliRunner().invoke(app, ["render", str(tmp_path), *options])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["files"] == [str(tmp_path / name / "filmstrip.png") for name in ("a", "b")]
    film = Film(log, size=60, start=0.2, end=0.3)
    assert (film.start, film.end) == pytest.approx((0.2, 0.3))
    for wrong in (["--start", "0.3", "--end", "0.2"], ["--start", "5"]):
        assert CliRunner().invoke(app, ["render", str(log), *wrong]).exit_code != 0


def test_what_holds_for_several_runs_is_noted_once(tiny, asrsim_command):
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants: {a: {}, b: {}}\n")
    asrsim_command("run", tiny.scenario, "--no-plot", "--set", "duration=0.01", "--set", "compiled=false", "-o", "out")
    done = json.loads(asrsim_command("render", "out", "--size", "40", "--json").out)
    assert len(done["files"]) == 2
    assert done["notes"] == ["links without shapes, drawn as rods: arm"]


def test_a_body_behind_another_is_hidden_and_from_the_side_it_is_seen(log):
    film = Film(log, size=100)
    points = film._painter.points(film.frames(0))
    along = points[np.argmax(points[:, 0])] - points[np.argmin(points[:, 0])]
    behind, beside = (fit_camera(points, towards, aspect=1.0) for towards in (along, np.cross([0.0, 0.0, 1.0], along)))
    shares = [sorted(film._painter.hidden(film.frames(0), camera, 90, 90).values()) for camera in (behind, beside)]
    assert shares[0][0] < 0.1  # the last link is in front of all
    assert shares[0][-1] > 0.9
    assert shares[1][-1] < 0.5


def test_the_camera_goes_where_nothing_hides_a_moving_body(tmp_path):
    film = Film(simulated_log("box_push_5dof", tmp_path / "log.mcap", variant="stiff", duration=0.5), size=100)
    preferred = fit_camera(film._painter.points(film.frames(0)), viewpoint(None), aspect=1.0)
    assert max(film._painter.hidden(film.frames(0), preferred, 90, 90).values()) > 0.5
    shares = film._painter.hidden(film.frames(0), film.camera, 90, 90)
    moving = [name for name in shares if name not in ("world", "base_link")]
    assert max(shares[name] for name in moving if name != "box") < 0.6


def test_the_ground_stands_still_in_a_film(tmp_path):
    """The box moves away, so that the picture's content grows; the pixels beside it stay as they are."""
    film = Film(simulated_log("box_push_5dof", tmp_path / "log.mcap", variant="stiff", duration=0.5), size=100)
    film.samples.bodies["box"][-1, 1] += 3.0
    images = [film.frame(time).image for time in (film.start, film.end)]
    assert np.mean(np.any(images[0] != images[1], axis=2)) < 0.5


def test_tiles_of_the_ground_are_where_a_pinhole_camera_sees_them(tiny, asrsim_command):
    """The middle of each tile has its colour, unless a body or a shadow is there."""
    upright = ("initial={elbow: 3.0}", "world={ground: true}", "duration=0.01", "compiled=false")
    asrsim_command("run", tiny.scenario, "--no-plot", "-o", "out", *(word for one in upright for word in ("--set", one)))
    film = Film(tiny.folder / "out" / "log.mcap", size=300)
    image = film.frame(film.start).image.astype(float).mean(axis=2)
    points = film.place
    size = np.linalg.norm(np.ptp(points, axis=0))
    tile = 10.0 ** np.floor(np.log10(size / 2.0))
    numbers = np.stack(np.meshgrid(*[np.arange(-20, 20)] * 2), axis=-1).reshape(-1, 2)
    places = np.column_stack([tile * (numbers + 0.5), np.full(len(numbers), film.scene.ground)])
    camera = film.camera
    right, up, forward = camera.axes
    away = places - camera.eye
    scale = 0.5 * len(image) / np.tan(np.radians(0.5 * camera.field)) / (away @ forward)
    x, y = 0.5 * image.shape[1] + scale * (away @ right), 0.5 * len(image) - scale * (away @ up)
    near = np.linalg.norm(places[:, :2] - 0.5 * (points.min(axis=0) + points.max(axis=0))[:2], axis=1) < size
    seen = near & (away @ forward > 0.0) & (x > 1.0) & (x < image.shape[1] - 1.0) & (y > 1.0) & (y < len(image) - 1.0)
    shown = image[y[seen].astype(int), x[seen].astype(int)]
    dark = numbers[seen].sum(axis=1) % 2 == 1
    light_grey, dark_grey = (255.0 * np.mean(colour) for colour in (TILE_LIGHT, TILE_DARK))
    assert seen.sum() > 30
    alike = np.abs(shown - np.where(dark, dark_grey, light_grey)) < 0.3 * (light_grey - dark_grey)
    assert alike.mean() > 0.7
