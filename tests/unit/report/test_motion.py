"""Moving view of a page: its shapes, frames and camera are those of the film."""

import base64

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asrsim.render import Film
from asrsim.report.motion import motion_data
from asrsim.report.series import unpack
from support.plot_example import simulated_log


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    return Film(simulated_log("box_push_5dof", tmp_path_factory.mktemp("film") / "log.mcap", variant="soft"), size=60)


@pytest.fixture(scope="module")
def data(film):
    return motion_data([film], ["soft"])


def numbers(text, kind):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, 3)


def test_shapes_have_their_triangles_and_colours(film, data):
    for part, packed in zip(film.scene.parts, data["parts"], strict=True):
        assert packed["body"] == part.body
        points = np.array(packed["centre"]) + packed["size"] / 32767 * numbers(packed["points"], "<i2")
        shown = points[numbers(packed["triangles"], "<u2")].reshape(-1, 9)
        colours = np.repeat([colour[:3] for colour in packed["colours"]], [colour[3] for colour in packed["colours"]], axis=0)
        wanted = part.mesh.points[part.mesh.triangles].reshape(-1, 9)
        size = np.ptp(wanted)
        near = np.abs(shown[:, None] - wanted).max(axis=2) < 1e-4 * size
        near &= np.abs(colours[:, None] - 255 * part.colours).max(axis=2) < 0.51
        assert len(shown) == len(wanted)
        assert near.any(axis=0).all()
        assert near.any(axis=1).all()


def test_frames_of_links_and_objects_are_those_of_the_film(film, data):
    (run,) = data["runs"]
    rows = np.searchsorted(film.samples.time, np.linspace(run["start"], run["end"], run["count"]) - 1e-9)
    assert (run["start"], run["end"], run["label"]) == (film.start, film.end, "soft")
    for k in (0, -1):
        place = {data["root"]: np.reshape(data["base"], (4, 4))}
        for joint in data["joints"]:
            q = unpack(run["joints"][joint["name"]], run["count"])[k] if joint["name"] in run["joints"] else 0.0
            moved = np.eye(4)
            if joint["kind"] == "prismatic":
                moved[:3, 3] = q * np.array(joint["axis"])
            elif joint["kind"] != "fixed":
                moved[:3, :3] = Rotation.from_rotvec(q * np.array(joint["axis"])).as_matrix()
            place[joint["child"]] = place[joint["parent"]] @ np.reshape(joint["origin"], (4, 4)) @ moved
        for name, pose in run["poses"].items():
            x, y, z, *turn = (unpack(column, run["count"])[k] for column in pose)
            place[name] = np.eye(4)
            place[name][:3, :3], place[name][:3, 3] = Rotation.from_quat(turn).as_matrix(), (x, y, z)
        positions = dict(zip(film.samples.joints, film.samples.values["link_position"][rows[k]], strict=True))
        wanted = film.scene.frames(positions, {name: poses[rows[k]] for name, poses in film.samples.bodies.items()})
        assert place.keys() == wanted.keys()
        for name, frame in wanted.items():
            np.testing.assert_allclose(place[name], frame, atol=1e-4, err_msg=name)
