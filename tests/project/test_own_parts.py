"""Parts of a user's own: the code of each page works as its page says, and errors of this code name its file and line."""

import numpy as np
import pytest

from asrsim.actuators.stages import STAGES
from asrsim.engines import ENGINES
from asrsim.errors import ActuatorError, RecordingError, RobotError
from asrsim.log import read_log
from asrsim.metrics import MEASURES, Measure
from asrsim.plugins import blame_plugins, load_plugin_file
from asrsim.recordings import READERS, read_recording
from asrsim.runs.rerun import rerun
from asrsim.signals import SIGNALS
from asrsim.sweeps.samplers import SAMPLERS
from support.paths import EXAMPLES, ROOT
from validation.models import INSTALLED


@pytest.fixture
def own(tmp_path):
    """Function that writes the code under a heading of a page into a file, and returns the file."""

    def write(page, heading):
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        code = text.partition(f"# {heading}\n")[2].partition("```python\n")[2].partition("```")[0]
        assert code
        (tmp_path / "mine.py").write_text(code)
        return tmp_path / "mine.py"

    return write


def test_the_engine_moves_as_the_other_engines_do(own, asrsim_command, tmp_path):
    plugin = own("architecture.md", "An engine of your own")
    ends = []
    for engine in ("two_links", *INSTALLED):
        shorter = ("--variant", "soft", "--set", "duration=0.2", "--set", "expect=[]", "--no-plot", "-q", "--out", engine)
        done = asrsim_command(
            "run", EXAMPLES / "scenarios" / "step_2dof.yaml", *shorter, "--engine", engine, "--plugin", plugin
        )
        assert done.code == 0, done.err
        ends.append(read_log(tmp_path / engine / "log.mcap").samples.values["link_position"])
    assert np.ptp(ends[0]) > 0.05
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("line", "wrong", "said"),
    [
        ("return [[self.inertia]]", "return [self.inertia]", "must have the shape (1, 1)"),
        ("return [[self.inertia]]", "return [[-self.inertia]]", "not symmetric and positive definite"),
    ],
)
def test_an_engine_with_an_impossible_mass_matrix_is_refused(line, wrong, said, tmp_path, asrsim_command):
    code = (EXAMPLES / "plugins" / "pendulum_engine.py").read_text()
    (tmp_path / "mine.py").write_text(code.replace(line, wrong))
    arm = EXAMPLES / "scenarios" / "step_1dof_sea.yaml"
    done = asrsim_command("run", arm, "--variant", "soft", "--engine", "pendulum", "--plugin", "mine.py", "--no-plot")
    assert done.code == 1
    assert said in done.err


def test_an_engine_without_contacts_refuses_a_ground(tmp_path):
    load_plugin_file(EXAMPLES / "plugins" / "pendulum_engine.py")
    import asrsim

    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf", engine="pendulum", duration=0.1, world={"ground": True}
    )
    with pytest.raises(RobotError, match="a world without ground and objects"):
        asrsim.run(scenario)


def test_the_recording_format_is_read_although_it_is_text(own, tmp_path):
    load_plugin_file(own("recordings.md", "A format of your own"))
    (tmp_path / "lab.pairs").write_text("".join(f"t={0.01 * i} q1_deg={i} tau1=0.5\n" for i in range(50)))
    recording = read_recording(tmp_path / "lab.pairs", joints=["elbow"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, np.radians(np.arange(50)))


def test_a_damaged_file_of_a_users_format_names_the_line_of_the_reader(own, tmp_path):
    plugin = own("recordings.md", "A format of your own")
    load_plugin_file(plugin)
    (tmp_path / "lab.pairs").write_text("t=0 q1=0\nt=0.01 q1\n")
    with pytest.raises(RecordingError, match=r"ValueError .*mine\.py:10"):
        read_recording(tmp_path / "lab.pairs")


def test_the_measures_are_claimed(own, tiny, asrsim_command):
    plugin = own("metrics.md", "A measure of your own")
    above = "{joint: elbow, quantity: link_position, measure: time_above, comparison: '>', value: 0.05, options: {level: 0.1}}"
    lead = "{joint: elbow, quantity: link_position, measure: largest_lead, comparison: '<', value: 1}"
    done = asrsim_command("run", tiny.scenario, "--set", f"expect=[{above}, {lead}]", "--plugin", plugin, "--no-plot")
    assert done.code == 0, done.err
    assert done.out.count("holds") == 2


def test_the_error_of_a_measure_names_its_file_and_line(tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(
        "from asrsim.metrics import MEASURES, Measure\n\ndef broken(time, values):\n    return 1 / 0\n\n"
        'MEASURES.add("broken", Measure(name="broken", function=broken, unit="1", needs="series"))\n'
    )
    claim = "expect=[{joint: elbow, quantity: link_position, measure: broken, value: 0, tolerance: 9}]"
    done = asrsim_command("run", tiny.scenario, "--set", claim, "--plugin", tiny.folder / "mine.py", "--no-plot")
    assert done.code == 1
    assert "mine.py:4: broken: the plugin raised ZeroDivisionError" in done.err


@pytest.mark.parametrize(
    ("needs", "function", "said"),
    [
        ("two series", lambda time, values: 0.0, "choose from series, pair"),
        ("pair", lambda time, values: 0.0, "must take \\(time, values, reference\\)"),
        ("series", lambda time, values, level: 0.0, "options after a `\\*`"),
    ],
)
def test_a_measure_that_cannot_be_called_is_refused_at_once(needs, function, said):
    from asrsim.errors import InputError

    with pytest.raises(InputError, match=said):
        MEASURES.add("mine", Measure(name="mine", function=function, unit="1", needs=needs))


def test_the_sampler_places_points(own):
    load_plugin_file(own("sweep.md", "A sampler of your own"))
    points = SAMPLERS.get("halton").points(64, 2, 1)
    assert points.shape == (64, 2)
    assert 0.0 <= points.min() < 0.05
    assert 0.95 < points.max() <= 1.0


def test_an_error_of_a_users_part_names_its_file_and_line(own, tiny, asrsim_command):
    plugin = own("sweep.md", "A sampler of your own")
    plugin.write_text(plugin.read_text().replace("return qmc", "return seed / 0 + qmc"))
    varied = ("--over", "arm.mass=uniform(0.3, 0.5)", "--samples", "2", "--sampler", "halton", "--out", "study")
    done = asrsim_command("sweep", tiny.scenario, *varied, "--plugin", plugin)
    assert done.code == 1
    assert f"{plugin}:10: points: the plugin raised ZeroDivisionError" in done.err
    assert "unexpected error" not in done.err


def test_errors_of_asrsim_stay_as_they_are_within_a_plugin(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from asrsim.errors import RobotError\nfrom asrsim.signals import SIGNALS\nSIGNALS.add('mine', 1)\n"
        "def explain(): raise RobotError('needs a robot with one joint')\n"
        "def fail(): raise KeyError('q')\n"
        "SIGNALS.explain, SIGNALS.fail = explain, fail\n"
    )
    load_plugin_file(tmp_path / "mine.py")
    with pytest.raises(RobotError, match="needs a robot with one joint"), blame_plugins():
        SIGNALS.explain()
    with pytest.raises(ActuatorError, match=r"mine\.py:5: fail: the plugin raised KeyError"), blame_plugins():
        SIGNALS.fail()


@pytest.mark.parametrize(
    ("plugin", "key"),
    [
        ("my_lab.py", "references.joint_1.equilibrium_position={triangle: {amplitude: 0.3}}"),
        ("pendulum_engine.py", "engine=pendulum"),
        ("my_clutch.py", "parameters.joint_1.clutch_torque=0.1"),
    ],
)
def test_a_log_asks_for_the_plugin_files_that_its_run_needs(plugin, key, tmp_path, asrsim_command):
    arm, path = EXAMPLES / "scenarios" / "step_1dof_sea.yaml", EXAMPLES / "plugins" / plugin
    options = [word for change in ("duration=0.05", "expect=[]", key) for word in ("--set", change)]
    done = asrsim_command("run", arm, "--variant", "soft", *options, "--no-plot", "--plugin", path, "--out", "run")
    assert done.code == 0, done.err
    for registry in (SIGNALS, ENGINES, READERS, MEASURES, SAMPLERS, STAGES):
        for name in [name for name in registry.names() if registry.file_of(name) == str(path)]:
            registry._entries.pop(name)
    with pytest.raises(ActuatorError, match="--trust-plugins"):
        rerun(tmp_path / "run" / "log.mcap")
    assert rerun(tmp_path / "run" / "log.mcap", trust_plugins=True).identical


def test_plots_say_that_an_actuator_is_not_here(tiny, asrsim_command):
    (tiny.folder / "drive.py").write_text(
        "from asrsim.actuators.sea import Sea\n\nclass Drive(Sea):\n    name = 'drive'\n    title = 'Drive'\n"
    )
    tiny.robot.write_text(tiny.robot.read_text().replace("libsea", "libdrive"))
    claim = "expect=[{joint: elbow, quantity: link_position, measure: final, value: 0, tolerance: 9}]"
    options = ("--set", claim, "--set", "duration=0.1", "--plugin", "drive.py", "--no-plot", "--out", "run")
    assert asrsim_command("run", tiny.scenario, *options).code == 0
    from asrsim.actuators import ACTUATORS

    ACTUATORS._entries.pop("drive")
    done = asrsim_command("plot", "run", "--quantity", "deflection")
    assert "the actuator 'drive' of elbow is not known here" in done.out
    assert "drive.py: name your copy with --plugin" in done.out
