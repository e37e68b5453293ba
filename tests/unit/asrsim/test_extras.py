"""A plain install: what an extra brings is asked for by name, with the command that gets it."""

import sys
import tempfile
import tomllib
from pathlib import Path

import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.extras import install, library
from asrsim.live import Access, Interface
from asrsim.live.transport import opened
from asrsim.notebook import as_pandas
from asrsim.recordings.arrays import read_matlab
from asrsim.recordings.reading import Reading
from asrsim.render.files import write_mp4
from asrsim.viewer.server import PageServer
from asrsim.workers.cluster import Cluster
from support.paths import ROOT

SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


def read_hdf5():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lab.mat"
        path.write_bytes(b"\x89HDF")
        return read_matlab(path, Reading())


USES = {
    "video": ("imageio_ffmpeg", lambda: write_mp4(None, Path("film.mp4"))),
    "sweep": ("pyarrow", lambda: asrsim.sweep(SCENARIO, {"parameters.joint_1.spring_k_1": [0.02]}, variants=["soft"])),
    "cluster": ("distributed", lambda: Cluster("tcp://127.0.0.1:1")),
    "ros": ("rclpy", lambda: opened(["ros"], Interface("/asrsim", (), ()), Access(), print).__enter__()),
    "foxglove": ("foxglove", lambda: opened(["foxglove"], Interface("/asrsim", (), ()), Access(), print).__enter__()),
    "gym": ("gymnasium", lambda: asrsim.make_env(SCENARIO, variant="soft")),
    "hdf5": ("h5py", read_hdf5),
    "warp": ("warp", lambda: asrsim.Worlds(SCENARIO, 1, variant="soft", engine="mujoco_warp")),
    "view": ("viser", lambda: PageServer(0)),
    "notebook": ("pandas", lambda: as_pandas(None)),
}
"""Extra -> the module that it brings, and what needs that."""


@pytest.mark.parametrize("extra", USES)
def test_without_it_the_extra_is_named(extra, monkeypatch):
    module, use = USES[extra]
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"'?{module}'?(,| which| is)* not installed") as caught:
        use()
    assert install(extra) in str(caught.value)


def test_every_extra_of_users_is_tried():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(USES) == set(extras) - {"dev", "docs"}


def test_an_environment_without_pip_is_named(monkeypatch):
    monkeypatch.setattr("asrsim.extras.find_spec", lambda name: None)
    assert install("sweep") == f"pip --python {sys.prefix} install 'asrsim[sweep]'"


def test_a_library_that_is_broken_gives_its_own_reason(tmp_path, monkeypatch):
    (tmp_path / "broken_one.py").write_text("raise ImportError('built for another numpy')\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match="broken_one cannot be loaded: built for another numpy"):
        library("broken_one", "sweep")
