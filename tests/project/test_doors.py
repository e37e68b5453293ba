"""An engine that users add is one file."""

import runpy

import numpy as np
import pytest

import asrsim
from asrsim.cli.findings import scenario_report
from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines.rigid import RigidEngine
from asrsim.errors import SimulationError
from support.paths import EXAMPLES
from validation.models import INSTALLED


@pytest.mark.parametrize("weightless", [[], ["link_1"]], ids=["heavy", "weightless"])
@pytest.mark.parametrize("compiled", [False, True])
def test_the_example_engine_moves_as_the_other_engines_do(compiled, weightless):
    """One joint under gravity in all directions, also about its axis."""
    runpy.run_path(str(EXAMPLES / "plugins" / "pendulum_engine.py"))
    ends = []
    for engine in ("pendulum", *INSTALLED):
        scenario = asrsim.make_scenario(
            EXAMPLES / "urdf" / "dof1_sea.urdf",
            engine=engine,
            duration=0.4,
            modes={"*": 6},
            gravity=[3.0, 5.0, -7.0],
            weightless=weightless,
            references={"*": {"equilibrium_position": 0.7}},
            compiled=compiled,
        )
        ends.append(asrsim.run(scenario).run.samples.values["link_position"])
    assert np.ptp(ends[0]) > 0.1
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-12)


def test_the_example_engine_maps_wrenches_as_the_other_engines_do():
    """A force on the link along all axes and a torque, in both frames, away from the origin of the link."""
    runpy.run_path(str(EXAMPLES / "plugins" / "pendulum_engine.py"))
    wrenches = [
        {
            "link": "link_1",
            "force": [0.7, -0.4, {"step": {"at": 0.05004, "to": 0.5}}],
            "point": [0.02, 0.03, -0.05],
            "frame": "link",
        },
        {"link": "link_1", "force": [0.3, 0.2, 0.1], "torque": [0.05, 0.02, -0.03], "point": [0.01, 0, 0.04]},
    ]
    ends = []
    for engine in ("pendulum", *INSTALLED):
        scenario = asrsim.make_scenario(
            EXAMPLES / "urdf" / "dof1_sea.urdf",
            engine=engine,
            duration=0.2,
            modes={"*": 6},
            wrenches=wrenches,
            references={"*": {"equilibrium_position": 0.7}},
        )
        ends.append(asrsim.run(scenario).run.samples.values["link_position"])
    assert np.ptp(ends[0]) > 0.1
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-12)


def test_an_engine_that_knows_no_scenario_refuses_wrenches(monkeypatch, tmp_path):
    """An engine derived from `RigidEngine` without the scenario cannot map wrenches: `check` and `run` say so."""
    plugin = runpy.run_path(str(EXAMPLES / "plugins" / "pendulum_engine.py"))

    class Blind(plugin["PendulumEngine"]):
        def __init__(self, scenario, robot):
            super().__init__(scenario, robot)
            RigidEngine.__init__(self, self._room, self._home)

    monkeypatch.setitem(ENGINES._entries, "mujoco", EngineEntry(make=lambda *given: (Blind(*given), ()), doc="blind"))
    path = tmp_path / "push.yaml"
    path.write_text(
        f"robot: {EXAMPLES / 'urdf' / 'dof1_sea.urdf'}\nduration: 0.1\nengine: mujoco\nmodes: 6\n"
        "wrenches: [{link: link_1, force: [1, 0, 0]}]\n"
    )
    (problem,) = scenario_report(path).errors
    assert "takes no wrenches" in problem.message
    with pytest.raises(SimulationError, match="takes no wrenches"):
        asrsim.run(path)
