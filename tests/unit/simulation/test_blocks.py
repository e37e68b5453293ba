"""Worlds advance through blocks of inputs."""

from asrsim import make_scenario
from asrsim.simulation.worlds import Worlds
from support.paths import EXAMPLES


def test_a_diverged_world_does_not_shorten_the_blocks_of_others(monkeypatch):
    scenario = make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", engine="mujoco", compiled=False, duration=1.0)
    with Worlds(scenario, 2, chunk=50) as worlds:
        worlds.advance(-(-49 // worlds.substeps))
        worlds.set_reference("joint_1", "external_torque", 1e305, worlds=[0])
        worlds.advance()
        lengths = []
        take = worlds.blocks.go_on
        monkeypatch.setattr(worlds.blocks, "go_on", lambda numbers, length: lengths.append(length) or take(numbers, length))
        worlds.advance(400)
        assert max(lengths) == 50
        assert len(lengths) < 400 * worlds.substeps / 50 + 2
