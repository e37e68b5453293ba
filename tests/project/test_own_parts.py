"""Parts of a user's own: the code of each page works as its page says, and errors of this code name its file and line."""

import json
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from asrsim import make_scenario, prepare, run
from asrsim.actuators.stages import STAGES
from asrsim.document.block import declare, declared_keys
from asrsim.document.kinds import Integer
from asrsim.engines import ENGINES
from asrsim.errors import ActuatorError, InputError, RecordingError, RobotError
from asrsim.log import read_log
from asrsim.metrics import MEASURES, Measure, measure
from asrsim.metrics.asked import asked_measures
from asrsim.metrics.expect import check_expectation
from asrsim.plots.curves import read_curves
from asrsim.plots.figures import run_pages
from asrsim.plugins import blame_plugins, load_plugin_file
from asrsim.recordings import READERS, Reader, read_recording
from asrsim.registry.steppings import STEPPINGS, Stepping
from asrsim.runs.rerun import rerun
from asrsim.scenario import load, names
from asrsim.scenario.data import KEYS, Expectation, Scenario, for_joint
from asrsim.signals import SIGNALS
from asrsim.sweeps.samplers import SAMPLERS
from support.paths import EXAMPLES, ROOT
from support.tiny import PENDULUM
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
        (
            "return [[self.inertia]]",
            "return [[-self.inertia]]",
            "not symmetric and positive definite, at the positions [0.0] (got",
        ),
        ("return [[self.inertia]]", "return [[self.inertia], []]", "must be arrays of numbers"),
        (
            "return [[self.inertia]]",
            "return [[self.inertia if positions[0] < 0.1 else -1.0]]",
            "positive definite, at the positions",
        ),
        ("(q,) = positions", "positions *= 2.0; (q,) = positions", "output array is read-only"),
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


def test_a_file_without_names_is_described_line_by_line(tmp_path, asrsim_command):
    """The reader is a user's: the advice names its file, and `init` does not advise itself."""
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom asrsim.recordings import READERS, Reader\n"
        "from asrsim.recordings.data import Content, RawColumn, RawTable\n\n\ndef read(path, reading):\n"
        "    values = np.frombuffer(path.read_bytes()[4:], '<i2').reshape(-1, 2)\n"
        "    columns = [RawColumn(name='time [s]', values=0.01 * np.arange(len(values)))]\n"
        "    columns += [RawColumn(name=f'ch{i}', values=values[:, i] * 1e-3) for i in range(2)]\n"
        "    return Content(format='counts', tables=(RawTable(columns=tuple(columns)),))\n\n\n"
        "READERS.add('counts', Reader(suffixes=('.counts',), magic=(b'CNTS',), read=read, confined=False))\n"
    )
    recording, plugin = tmp_path / "a.counts", tmp_path / "mine.py"
    recording.write_bytes(b"CNTS" + np.arange(200, dtype="<i2").tobytes())
    assert "A reader of your own needs --plugin FILE" in asrsim_command("init", "-e", recording).err
    done = asrsim_command("init", "-e", recording, "--plugin", plugin)
    assert done.code == 0, done.err
    assert "asrsim init" not in done.out + done.err
    assert "answer the questions, marked `# ?`" in done.out
    document = tmp_path / "a.counts.yaml"
    text, asked = document.read_text(), "# {}: JOINT.QUANTITY [unit]"
    for name in ("ch0", "ch1"):
        assert asked.format(name) in text
    document.write_text(text.replace(asked.format("ch1"), "ch1: elbow.link_position [mrad]"))
    values = read_recording(recording, joints=["elbow"]).column("elbow", "link_position").values
    np.testing.assert_allclose(values, 1e-6 * np.arange(1, 200, 2))
    document.unlink()
    (said,) = read_recording(recording).findings
    assert f"asrsim init --experiment a.counts --plugin {plugin}" in str(said)


def test_a_damaged_file_of_a_users_format_names_the_line_of_the_reader(own, tmp_path):
    plugin = own("recordings.md", "A format of your own")
    load_plugin_file(plugin)
    (tmp_path / "lab.pairs").write_text("t=0 q1=0\nt=0.01 q1\n")
    with pytest.raises(RecordingError, match=r"ValueError .*mine\.py:10"):
        read_recording(tmp_path / "lab.pairs")


def test_the_signal_jumps_at_the_times_that_it_names(own, tiny, asrsim_command):
    """Without these times the error falls with the first power of the step, and a warning names a time."""
    plugin, orders = own("signals.md", "Your own"), []
    saw = "references.elbow.equilibrium_position={sawtooth: {amplitude: 0.3, period: 0.2503}}"
    for number, hidden in enumerate((False, True)):
        if hidden:
            text = plugin.read_text().replace("def jumps", "def _jumps").replace("sawtooth", "hidden")
            plugin = plugin.with_name("hidden.py")
            plugin.write_text(text)
            saw = saw.replace("sawtooth", "hidden")
        options = ("--set", saw, "--set", "expect=[]", "--certify", "--no-plot", "--json", "--out", f"run{number}")
        done = asrsim_command("run", tiny.scenario, *options, "--plugin", plugin)
        assert done.code == 0, done.err
        (ran,) = json.loads(done.out)["runs"]
        orders.append(ran["certificate"]["joints"]["elbow"]["order"])
        said = [one for one in ran["warnings"] if one["code"] == "hidden-jump"]
        assert len(said) == hidden
        for one in said:
            teeth = float(one["value"].removesuffix(" s")) / 0.2503
            assert teeth == pytest.approx(round(teeth), abs=1e-7)
    assert orders[0] > 1.7
    assert orders[1] < 1.3


def test_the_command_prints_text_and_json(own, tiny, asrsim_command, monkeypatch):
    from asrsim.cli.app import COMMANDS

    monkeypatch.syspath_prepend(str(own("architecture.md", "A command of your own").parent))
    monkeypatch.setitem(COMMANDS, "energies", "mine")
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    assert (
        asrsim_command(
            "run", tiny.scenario, *("--set", "modes.elbow=6", "--set", "duration=0.3"), "--no-plot", "--out", "run"
        ).code
        == 0
    )
    log = read_log(tiny.folder / "run" / "log.mcap").samples
    assert "motor_work" in asrsim_command("energies", "run").out
    for start in (0.0, 0.13):
        found = json.loads(asrsim_command("energies", "run", "--start", start, "--json").out)["elbow"]
        assert sum(found["uses"].values()) == pytest.approx(found["motor_work"], rel=1e-9)
        # No stage takes part, so the rest is the kinetic energy of the rotors; a damping counted twice would be in it, too.
        first, last = np.searchsorted(log.time, start), -1
        moved = log.joint("elbow")["motor_1_velocity"] ** 2
        inertia = prepare(tiny.scenario).drives[0].values["motor_1_inertia"]
        assert found["uses"]["rotors and stages"] == pytest.approx(0.5 * inertia * (moved[last] - moved[first]), abs=1e-9)
        assert abs(found["uses"]["rotors and stages"]) > 1e-6
    assert log.joint("elbow")["damping_loss"][-1] > 1e-6
    assert "--start" in asrsim_command("energies", "--help").out
    assert "cannot read the log" in asrsim_command("energies", "nothing").err
    assert "the log contains no samples in that time" in asrsim_command("energies", "run", "--start", "99").err


def test_the_measures_are_claimed(own, tiny, asrsim_command):
    plugin = own("metrics.md", "A measure of your own")
    above = "{joint: elbow, quantity: link_position, measure: time_above, comparison: '>', value: 0.05, options: {level: 0.1}}"
    lead = "{joint: elbow, quantity: link_position, measure: largest_lead, comparison: '<', value: 1}"
    done = asrsim_command("run", tiny.scenario, "--set", f"expect=[{above}, {lead}]", "--plugin", plugin, "--no-plot")
    assert done.code == 0, done.err
    assert done.out.count("holds") == 2


def test_a_measure_that_divides_by_the_motion_of_the_reference_is_tried_without_a_warning(recwarn):
    def ratio(time, values, reference):
        return float(np.ptp(values) / np.ptp(reference))

    MEASURES.add("ratio", Measure(name="ratio", function=ratio, unit="1", needs="pair"))
    check_expectation(Expectation(joint="elbow", quantity="link_position", measure="ratio", value=1.0))
    assert not recwarn.list


def test_the_measure_of_the_page_counts_the_whole_time(own):
    load_plugin_file(own("metrics.md", "A measure of your own"))
    time = np.linspace(0.0, 2.0, 201)
    assert MEASURES.get("time_above").function(time, np.where(time > 0.5, 1.0, 0.0)) == pytest.approx(1.5, abs=0.01)


def test_a_measure_that_needs_either_gets_none_without_a_reference():
    def nearness(time, values, reference, *, target=0.0):
        return float(np.mean(values - (target if reference is None else reference)))

    MEASURES.add("nearness", Measure(name="nearness", function=nearness, unit="series", needs="either"))
    time = np.linspace(0.0, 1.0, 11)
    assert measure("nearness", time, np.ones(11), target=0.25) == 0.75
    assert measure("nearness", time, np.ones(11), np.full(11, 0.5)) == 0.5


@pytest.mark.parametrize(
    ("option", "claimed", "said"),
    [("", "tolerance: 9", ""), (", *, level=1.0", "options: {level: 2}", "with level: 2: .*")],
)
def test_the_error_of_a_measure_names_its_file_and_line(option, claimed, said, tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(
        f"from asrsim.metrics import MEASURES, Measure\n\ndef broken(time, values{option}):\n    return 1 / 0\n\n"
        'MEASURES.add("broken", Measure(name="broken", function=broken, unit="1", needs="series"))\n'
    )
    claim = f"expect=[{{joint: elbow, quantity: link_position, measure: broken, value: 0, {claimed}}}]"
    done = asrsim_command("run", tiny.scenario, "--set", claim, "--plugin", tiny.folder / "mine.py", "--no-plot")
    assert done.code == 1
    assert re.search(rf"{said}mine\.py:4: broken: the plugin raised ZeroDivisionError", done.err), done.err


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
        "from asrsim.errors import RobotError\nfrom asrsim.signals import SIGNALS, Signal\n"
        "class Mine(Signal): kind = 'mine'\nSIGNALS.add('mine', Mine)\n"
        "def explain(): raise RobotError('needs a robot with one joint')\n"
        "def fail(): raise KeyError('q')\n"
        "SIGNALS.explain, SIGNALS.fail = explain, fail\n"
    )
    load_plugin_file(tmp_path / "mine.py")
    with pytest.raises(RobotError, match="needs a robot with one joint"), blame_plugins():
        SIGNALS.explain()
    with pytest.raises(ActuatorError, match=r"mine\.py:6: fail: the plugin raised KeyError"), blame_plugins():
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


ENTRIES = {
    "a measure that is a function": (
        "from asrsim.metrics import MEASURES\nMEASURES.add('mine', lambda time, values: 0.0)",
        "the measure 'mine' is not an instance of asrsim.metrics.measures.Measure",
    ),
    "a program that is no class of programs": (
        "from asrsim.exports import PROGRAMS\nclass Mine: name = 'mine'\nPROGRAMS.add('mine', Mine)",
        "the program 'mine' is not a class derived from asrsim.exports.programs.base.Program",
    ),
    "a signal with another name": (
        "from asrsim.signals import SIGNALS, Signal\nclass Mine(Signal): kind = 'other'\nSIGNALS.add('mine', Mine)",
        "the signal 'mine' calls itself 'other' in `kind`",
    ),
    "a program without a title": (
        "from asrsim.exports import PROGRAMS, Program\nclass Mine(Program): name = 'mine'\nPROGRAMS.add('mine', Mine)",
        "the program 'mine' lacks the attribute `title`",
    ),
    "a sampler without a title": (
        "from asrsim.sweeps.samplers import SAMPLERS, Sampler\nclass A(Sampler): points = 0\nSAMPLERS.add('mine', A())",
        "the sampler 'mine' lacks the attribute `title`",
    ),
}


@pytest.mark.parametrize(("code", "said"), ENTRIES.values(), ids=ENTRIES)
def test_a_part_of_the_wrong_kind_is_refused_when_it_is_added(code, said, tmp_path):
    (tmp_path / "mine.py").write_text(code)
    with pytest.raises(ActuatorError, match=f"mine\\.py:{code.count(chr(10)) + 1}: .*{re.escape(said)}"):
        load_plugin_file(tmp_path / "mine.py")


READING = """
import numpy as np
from asrsim.recordings import READERS, Reader
from asrsim.recordings.data import Content, RawColumn, RawTable

def table(**columns):
    made = tuple(RawColumn(name=name, values=values) for name, values in columns.items())
    return Content(tables=(RawTable(columns=made),))

time = np.arange(50) * 0.01
def read(path, reading):
    return RESULT

READERS.add("mine", Reader(suffixes=(".mine",), read=read, confined=CONFINED))
"""


@pytest.mark.parametrize("confined", [True, False])
@pytest.mark.parametrize(
    ("result", "said"),
    [
        ("None", "must return asrsim.recordings.data.Content; it returns a value of type NoneType"),
        ("Content(tables=({'time': time},))", "must return tables .* one is of type dict"),
        ("Content(tables=(RawTable(columns=(RawColumn(name=1, values=time),)),))", "with texts as names"),
        ("table(time=time, q1=time[1:])", "columns of equal length in a table: 'time' has 50, 'q1' has 49"),
        ("table(time=time, q1=['up'] * 50)", "a list of numbers for each column; 'q1' has the shape"),
        ("table(time=time, q1=np.ones((50, 2)))", r"'q1' has the shape \(50, 2\)"),
    ],
)
def test_what_a_reader_must_not_return_is_named_with_the_readers_line(result, said, confined, tmp_path):
    code = READING.replace("RESULT", result).replace("CONFINED", str(confined))
    (tmp_path / "mine.py").write_text(code)
    (tmp_path / "lab.mine").write_text("numbers")
    load_plugin_file(tmp_path / "mine.py")
    with pytest.raises(RecordingError, match=rf"the reader 'mine' .*{said}.*mine\.py:11\)"):
        read_recording(tmp_path / "lab.mine", joints=["elbow"])


def test_a_quantity_that_a_reader_states_exists(tmp_path):
    stated = "Content(tables=(RawTable(columns=(RawColumn(name='a', values=time, joint='elbow', quantity='link_postion'),)),))"
    (tmp_path / "mine.py").write_text(READING.replace("RESULT", stated).replace("CONFINED", "False"))
    (tmp_path / "lab.mine").write_text("numbers")
    load_plugin_file(tmp_path / "mine.py")
    with pytest.raises(RecordingError, match=r"quantity of the column 'a' that does not exist .*Did you mean 'link_position'"):
        read_recording(tmp_path / "lab.mine")


def test_a_reader_may_return_lists_of_numbers(tmp_path):
    columns = "table(time=time.tolist(), q1=[*range(50)])"
    (tmp_path / "mine.py").write_text(READING.replace("RESULT", columns).replace("CONFINED", "True"))
    (tmp_path / "lab.mine").write_text("numbers")
    (tmp_path / "lab.mine.yaml").write_text("map: {q1: 'elbow.link_position [deg]'}")
    load_plugin_file(tmp_path / "mine.py")
    recording = read_recording(tmp_path / "lab.mine", joints=["elbow"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, np.radians(np.arange(50)))


@pytest.mark.parametrize("result", ["None", "values", "'high'"])
def test_a_measure_that_returns_no_number_is_named(result, tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(
        "from asrsim.metrics import MEASURES, Measure\n\n"
        f"def broken(time, values):\n    return {result}\n\n"
        'MEASURES.add("broken", Measure(name="broken", function=broken, unit="1", needs="series"))\n'
    )
    claim = "expect=[{joint: elbow, quantity: link_position, measure: broken, value: 0, tolerance: 9}]"
    done = asrsim_command("run", tiny.scenario, "--set", claim, "--plugin", tiny.folder / "mine.py", "--no-plot")
    assert done.code == 1
    assert "a measure must return a number" in done.err
    assert "mine.py:3)" in done.err


def test_a_measure_cannot_change_what_other_measures_get(tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(
        "from asrsim.metrics import MEASURES, Measure\n\n"
        "def broken(time, values):\n    values[:] = 0.0\n    return 0.0\n\n"
        'MEASURES.add("broken", Measure(name="broken", function=broken, unit="1", needs="series"))\n'
    )
    claim = "expect=[{joint: elbow, quantity: link_position, measure: broken, value: 0, tolerance: 9}]"
    done = asrsim_command("run", tiny.scenario, "--set", claim, "--plugin", tiny.folder / "mine.py", "--no-plot")
    assert done.code == 1
    assert "mine.py:4: broken: the plugin raised ValueError: assignment destination is read-only" in done.err


@pytest.mark.parametrize(
    ("result", "said"),
    [
        ("None", "must return or yield pages"),
        ("[Figure()]", "must be a FigurePage with a figure of Matplotlib"),
        ("[FigurePage(name='a', figure=None)]", "must be a FigurePage with a figure of Matplotlib"),
        ("[FigurePage(name='../a', figure=Figure())]", "a file name of its own, without folder; it gives '../a'"),
        ("[FigurePage(name='a', figure=Figure()), FigurePage(name='a', figure=Figure())]", "it gives 'a'"),
    ],
)
def test_pages_that_a_figure_must_not_return_are_named(result, said, tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(
        "from matplotlib.figure import Figure\nfrom asrsim.plots import FIGURES, FigurePage, RunFigure\n\n"
        f"def pages(runs):\n    return {result}\n\n"
        "FIGURES.add('mine', RunFigure(title='mine', pages=pages))\n"
    )
    assert asrsim_command("run", tiny.scenario, "--no-plot", "--out", "run").code in (0, 1)
    done = asrsim_command("plot", "run", "--plugin", "mine.py", "--figure", "mine", "--out", "pictures")
    assert done.code == 1
    assert said in done.err
    assert "mine.py:4)" in done.err


ARM = EXAMPLES / "scenarios" / "step_1dof_sea.yaml"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"lambda scenario, robot: (PendulumEngine(scenario, robot), ())": "PendulumEngine"}, "mine.py:22)"),
        ({"(PendulumEngine(scenario, robot), ())": "PendulumEngine(scenario, robot)"}, "must return an engine and a tuple"),
        ({'version = "pendulum 1"': "pass"}, "must have the member `version`; PendulumEngine lacks it"),
        ({"def bias": "def torque"}, "abstract method"),
        (
            {"super().__init__(scenario, robot)\n        if len(self.joints) != 1:": "if False:"},
            "`__init__` of the engine must call super().__init__",
        ),
        ({"return [np.cos(q)": "return [np.nan * np.cos(q)"}, "the engine's bias is not finite, at the positions [0.0] (got"),
        ({"return [np.cos(q)": "return [(np.nan if q > 0.1 else 1.0)"}, "is not finite, at the positions"),
    ],
)
def test_a_part_that_an_engine_lacks_is_named(wrong, said, tmp_path, asrsim_command):
    code = (EXAMPLES / "plugins" / "pendulum_engine.py").read_text()
    for right, other in wrong.items():
        assert right in code
        code = code.replace(right, other)
    (tmp_path / "mine.py").write_text(code)
    done = asrsim_command("run", ARM, "--variant", "soft", "--engine", "pendulum", "--plugin", "mine.py", "--no-plot")
    assert done.code == 1
    assert said in done.err
    assert "unexpected error" not in done.err


def test_the_keys_of_the_page_are_keys_of_a_document():
    from dataclasses import dataclass

    from asrsim.document import block, kinds

    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("### A key of the scenario")[2]
    lines = text.split("```")[1].strip().splitlines()
    names = {**vars(kinds), "declare": block.declare, "Mapping": dict, "__name__": __name__}
    exec("class Keys:\n" + "".join(f"    {line}\n" for line in lines), names)
    made = block.block_of(dataclass(names["Keys"]), "mapping")
    assert [key.name for key in made.keys] == ["laboratory", "operator", "padding"]
    for row in re.findall(r"^\| (`.*?`) \|", text, re.MULTILINE)[:-1]:
        for kind in re.findall(r"`(.*?)`", row):
            assert isinstance(eval(re.sub(r"(\w+=)(?=[,)])", r"\g<1>None", kind), names), kinds.Kind)


@dataclass(frozen=True, kw_only=True)
class Numbered(Scenario):
    bench_number: int = declare(Integer(minimum=1), doc="number of the bench")
    base_number: int = declare(Integer(minimum=1), key="base.number", doc="number of the base")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("base: {number: 2}", "key.yaml:1: the key 'bench_number' is missing"),
        ("base: {number: 2}\nbench_number: none", "key.yaml:4: bench_number: must be a whole number >= 1"),
        ("bench_number: 3", "key.yaml:1: the key 'base' is missing"),
        ("bench_number: 3\nbase: {fixed: true}", "key.yaml:4: base: the key 'number' is missing"),
    ],
)
def test_a_required_key_of_ones_own_is_asked_for(keys, said, monkeypatch, tmp_path):
    groups = tuple(
        replace(key, kind=replace(key.kind, keys=())) for key in KEYS if key.name in ("robot", "base", "imperfections")
    )
    monkeypatch.setattr(load, "Scenario", Numbered)
    monkeypatch.setattr(load, "SCENARIO", replace(load.SCENARIO, keys=declared_keys(Numbered, groups)))
    (tmp_path / "key.yaml").write_text(f"robot: {EXAMPLES / 'urdf' / 'plain_arm.urdf'}\nduration: 0.1\n{keys}")
    with pytest.raises(InputError, match=re.escape(said)) as error:
        load.load_scenario(tmp_path / "key.yaml")
    assert len(error.value.problems) == 1


def test_the_value_of_a_joint_in_a_map_is_read_as_the_page_says():
    """The entry of a joint takes the place of the entry for all joints."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("### A key of the scenario")[2]
    code = re.search(r"`(for_joint\(.*?\))` \(`scenario/data.py`\)", text)[1]
    for padding, value in (({}, 0.0), ({"*": 2.0}, 2.0), ({"*": 2.0, "elbow": 3.0}, 3.0)):
        scenario = SimpleNamespace(padding=padding)
        assert eval(code, {"for_joint": for_joint, "scenario": scenario}) == value


def test_a_map_of_joints_takes_joints_with_actuators_unless_its_key_is_listed(monkeypatch):
    """The page says which joints a key of one's own may name, and where this is changed."""
    scenario = make_scenario(EXAMPLES / "urdf" / "plain_arm.urdf", duration=0.1, actuators={"shoulder": "sea"})
    robot = prepare(scenario).robot
    for joint, found in (("shoulder", []), ("elbow", ["the robot has no actuated joint 'elbow'"])):
        own = replace(scenario, named=((("padding", joint), joint, "joint"),))
        assert [problem.message for problem in names.unknown_names(own, robot)] == found
    monkeypatch.setattr(names, "MOVING", (*names.MOVING, "padding"))
    assert not [*names.unknown_names(own, robot)]


def test_the_quantity_of_the_page_is_logged_plotted_and_claimed(own, tiny, asrsim_command):
    plugin = own("stages.md", "Log a quantity of your own")
    assert asrsim_command("check", "--stage", "meter", "--plugin", plugin).code == 0
    claim = "expect=[{joint: elbow, quantity: meter_1_reach, measure: final, comparison: '>', value: 0.001}]"
    meter = ("--set", "parameters.*.meter=1", "--set", claim, "--plugin", plugin)
    done = asrsim_command("run", tiny.scenario, *meter, "--no-plot", "--out", "run")
    assert done.code == 0, done.err
    plain = asrsim_command("run", tiny.scenario, "--set", "expect=[]", "--no-plot", "--out", "plain")
    assert plain.code == 0, plain.err
    measured, without = (read_log(tiny.folder / name / "log.mcap").samples.joint("elbow") for name in ("run", "plain"))
    np.testing.assert_array_equal(measured["link_position"], without["link_position"])
    assert np.diff(measured["meter_1_reach"]).min() >= 0.0
    drawn = asrsim_command("plot", "run", "--quantity", "meter_1_power", "--plugin", plugin, "--out", "pictures")
    assert drawn.code == 0, drawn.err


EXPORTING = """
import numpy as np
from asrsim.exports import PROGRAMS, Program

class Mine(Program):
    name, title = "mine", "Mine"

    def write(self, path, prepared, timestep, ranges, remarks):
        return WRITTEN

    def positions(self, path, model, start, controls, torques):
        return np.zeros((len(controls), model.nq))[:ROWS]

PROGRAMS.add("mine", Mine)
"""


@pytest.mark.parametrize(
    ("written", "rows", "said"),
    [
        ("None", "None", r"`write` must return the list .*mine\.py:8\)"),
        ("[path.with_suffix('.gone')]", "None", r"`write` must return .*there is no file .*mine\.gone \(.*mine\.py:8\)"),
        ("remarks.append(3) or []", "None", r"`write` must add texts to `remarks`; it adds 3 .*mine\.py:8\)"),
        ("[]", "5", r"`positions` must return .*mine\.py:11\)"),
    ],
)
def test_results_that_a_program_must_not_return_are_named(written, rows, said, tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(EXPORTING.replace("WRITTEN", written).replace("ROWS", rows))
    done = asrsim_command(
        "export", tiny.scenario, "--set", "modes=6", "--for", "mine", "--plugin", "mine.py", "--out", "mine.xml"
    )
    assert done.code == 1
    assert re.search(said, done.err), done.err
    assert (tiny.folder / "mine.xml").exists() is ("positions" in said), "an unfinished export leaves no model"


TABLE = """
from asrsim.exports import PROGRAMS, Program

class Table(Program):
    name, title = "table", "a table of joints"

    def write(self, path, prepared, timestep, ranges, remarks):
        lines = [f"{prepared.scenario.duration} {timestep} {ranges}"]
        for drive in prepared.drives:
            units = {one.name: one.unit for one in drive.actuator.all_parameters()}
            lines.append(f"{drive.name} {drive.joint.kind} {drive.joint.child} {drive.actuator.name} {drive.mode.number}")
            lines += [f"{name} {value} {units[name]}" for name, value in drive.values.items()]
            lines.append(str(drive.actuator.elastic_torques(0.0, 0.1, 0.0, drive.elastic)[0]))
        remarks.append("the table has no gravity")
        (beside := path.with_suffix(".txt")).write_text("\\n".join(lines))
        return [beside]

PROGRAMS.add("table", Table)
"""


def test_a_program_writes_parameters_with_units_beside_the_model_which_is_replayed(tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(TABLE)
    words = ("--set", "modes=6", "--set", "duration=0.2", "--for", "table", "--plugin", "mine.py", "--no-plot")
    done = asrsim_command("export", tiny.scenario, *words, "--out", "mine.xml")
    assert done.code == 0, done.err
    assert "Replayed in MuJoCo" in done.out
    assert "not in table: asrsim has no replay in a table of joints." in done.out
    assert "the table has no gravity" in done.out.partition("Not in the file:")[2]
    assert (tiny.folder / "mine.xml").read_text().startswith("<mujoco")
    first, joint, *lines = (tiny.folder / "mine.txt").read_text().splitlines()
    assert first == "0.2 0.0005 None"
    assert joint == "elbow revolute arm sea 6"
    values = prepare(tiny.scenario).drives[0].values
    assert f"motor_1_inertia {values['motor_1_inertia']} kg m^2" in lines
    assert len(lines) == len(values) + 1
    assert abs(float(lines[-1])) == pytest.approx(0.1 * values["spring_stiffness"])


def test_a_function_that_takes_other_arguments_is_named_with_its_line(tiny, asrsim_command):
    code = (
        EXPORTING.replace("WRITTEN", "[]").replace("ROWS", "None").replace("path, prepared, timestep, ranges, remarks", "path")
    )
    (tiny.folder / "mine.py").write_text(code)
    done = asrsim_command(
        "export", tiny.scenario, "--set", "modes=6", "--for", "mine", "--plugin", "mine.py", "--out", "mine.xml"
    )
    assert done.code == 1
    assert re.search(r"mine\.py:8: write: asrsim calls it with other arguments: Mine\.write\(\) takes 2", done.err), done.err


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"suffixes": ("lab",)}, r"suffixes: must be a tuple of endings"),
        ({"suffixes": (".LAB",)}, r"suffixes: must be a tuple of endings"),
        ({"suffixes": ".lab"}, r"suffixes: must be a tuple of endings"),
        ({"suffixes": (".lab",), "magic": b"LAB"}, r"magic: must be a tuple of bytes"),
    ],
)
def test_marks_by_which_no_file_would_be_found_are_refused(wrong, said):
    with pytest.raises(InputError, match=said):
        Reader(**wrong, read=lambda path, reading: None)


def test_a_parameter_cannot_have_the_name_of_a_number_of_the_joint(tmp_path):
    code = (EXAMPLES / "plugins" / "my_vsa.py").read_text()
    (tmp_path / "mine.py").write_text(code.replace('"linear"', '"damping"').replace('"my_vsa"', '"own_vsa"'))
    with pytest.raises(ActuatorError, match=r"parameters\.damping: every joint already has a number with this name"):
        load_plugin_file(tmp_path / "mine.py")


METER = (ROOT / "docs" / "stages.md").read_text(encoding="utf-8").partition("## Log a quantity of your own")[2]
METER = METER.partition("```python\n")[2].partition("```")[0].replace("meter_", "gauge_").replace('"meter"', '"gauge"')
LAW = "    @staticmethod\n    def "


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("def constants(cls, values", "def others(cls, values", "constants: is missing"),
        ("own, kick)", "own, kick, step)", r"remember: raised TypeError: .*; the law must take memory, own, kick"),
        ("abs(kick.deflection))", "abs(kick.deflection)),", r"remember: must keep a number in `reach` of the memory \(got \(0"),
        ("def remember(", "def remembers(", "remembers: is not a law; laws are place, torque"),
        ("return MeterConstants(1.0)", "return 1.0", "constants: must return MeterConstants or None"),
        (
            'value("largest deflection so far", "rad", log="gauge_{}_reach")',
            "0.0",
            r"Memory\.reach: must be declared by asrsim",
        ),
        ('log="gauge_{}_reach"', 'log="gauge_reach"', "must log 'gauge_reach' with {} for the number of the motor"),
        (', log="gauge_{}_reach"', "", "quantities: has 'gauge_1_reach', but no value of `Memory` is logged"),
        ("gauge_{}_reach", "motor_{}_position", "must not have 'motor_1_position': another quantity has this name"),
        (
            f"{LAW}remember",
            f"{LAW}energy(memory, own):\n        pass\n\n{LAW}remember",
            r"energy: must return a number \(got None",
        ),
        (
            f"{LAW}remember",
            f"{LAW}limit(memory, own, torque):\n        memory.reach = 1.0\n        return torque\n\n{LAW}remember",
            "limit: must not change the memory; only `remember` does",
        ),
    ],
)
def test_what_is_wrong_with_a_stage_is_said_when_its_file_is_read(right, wrong, said, tmp_path):
    assert right in METER
    (tmp_path / "mine.py").write_text(METER.replace(right, wrong))
    with pytest.raises(ActuatorError, match=said):
        load_plugin_file(tmp_path / "mine.py")


def test_a_key_declared_with_the_class_of_a_kind_is_refused():
    from asrsim.document import block, kinds

    with pytest.raises(TypeError, match=r"takes a kind of asrsim\.document\.kinds, such as Number\(\), not <class"):
        block.declare(kinds.Number, doc="a number")


def test_a_command_that_returns_nothing_is_named():
    from asrsim.cli.command import command

    @command(plugins=False)
    def forgetful():
        """Return nothing."""

    with pytest.raises(TypeError, match=r"the command 'forgetful' must return Done\(data=\.\.\.\), not None"):
        forgetful()


def test_the_data_of_a_command_may_be_undefined_numbers_and_arrays(capsys):
    from asrsim.cli.command import Done, command

    @command(plugins=False)
    def measured():
        """Return numbers as NumPy makes them."""
        return Done(
            data={"gain": np.float64("nan"), "rows": np.array([[1.0, np.inf]]), "count": np.int64(3), "file": Path("a")}
        )

    measured(json=True)
    assert json.loads(capsys.readouterr().out) == {"gain": None, "rows": [[1.0, None]], "count": 3, "file": "a"}


@pytest.mark.parametrize("wrong", [{"implicitness": 1.7}, {"implicitness": -1.0}, {"first_drift": float("nan")}])
def test_a_stepping_with_an_impossible_fraction_is_refused(wrong):
    with pytest.raises(InputError, match=f"stepping mine.{next(iter(wrong))}: must be from 0 to 1"):
        Stepping(name="mine", order=1, doc="mine", **wrong)


def test_the_stepping_of_the_page_runs_and_is_of_its_order(monkeypatch, tmp_path):
    """A link with damping c and inertia I coasts: each substep h divides its velocity by 1 + c h / I."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("### A stepping of your own\n")[2]
    made = eval(text.partition("```python\n")[2].partition("```")[0], {"Stepping": Stepping})[0]
    monkeypatch.setitem(STEPPINGS._table, made.name, made)
    (tmp_path / "coasting.urdf").write_text(re.sub("<gazebo>.*</gazebo>", "", PENDULUM, flags=re.DOTALL))
    keys = {"duration": 0.05, "gravity": [0, 0, 0], "initial": {"elbow": {"velocity": 1.0}}, "engine": "mujoco"}
    scenario = make_scenario(tmp_path / "coasting.urdf", **keys)
    result = run(replace(scenario, stepping=made.name), certify=True, out=tmp_path / "out")
    ways = np.diff(result["elbow"].link_position)
    np.testing.assert_allclose(ways[1:] / ways[:-1], 1.0 / (1.0 + 0.2 * scenario.step / 6e-3), rtol=1e-6)
    assert result.summary.certificate["joints"]["elbow"]["order"] == pytest.approx(made.order, abs=0.1)
    assert not result.summary.certificate["warnings"]
    monkeypatch.undo()
    with pytest.raises(InputError, match=r"stepping: is not one of the choices \(got 'damped'\)"):
        rerun(tmp_path / "out" / "log.mcap")


def test_two_steppings_with_one_name_are_refused():
    with pytest.raises(
        InputError, match=r"two steppings have this name; each stepping needs a separate name \(got 'leapfrog'\)"
    ):
        type(STEPPINGS)(*STEPPINGS.values(), Stepping(name="leapfrog", order=2, doc="mine"))


@pytest.mark.parametrize(("name", "declared", "measured"), [("euler", 2, 1), ("leapfrog", 1, 2), ("euler", 1, None)])
def test_a_wrongly_declared_order_of_a_stepping_is_remarked(name, declared, measured, monkeypatch, tmp_path):
    monkeypatch.setitem(STEPPINGS._table, name, replace(STEPPINGS[name], order=declared))
    (tmp_path / "swinging.urdf").write_text(re.sub("<gazebo>.*</gazebo>", "", PENDULUM, flags=re.DOTALL))
    keys = {"duration": 0.2, "initial": {"elbow": 0.5}, "stepping": name, "engine": "mujoco"}
    remarks = run(make_scenario(tmp_path / "swinging.urdf", **keys), certify=True).summary.certificate["warnings"]
    if measured is None:
        assert not remarks
    else:
        assert re.search(rf"declared order {declared}, measured ([\d.]+)", remarks[0])
        assert float(re.search(r"measured ([\d.]+\d)", remarks[0])[1]) == pytest.approx(measured, abs=0.1)


@pytest.mark.parametrize("attempt", ["STEPPINGS[MINE.name] = MINE", "STEPPINGS.add(MINE.name, MINE)"])
def test_a_plugin_that_adds_a_stepping_is_referred_to_the_page(attempt, tmp_path):
    text = 'from asrsim.registry.steppings import *\nMINE = Stepping(name="mine", order=1, doc="mine")\n'
    (tmp_path / "mine.py").write_text(text + attempt)
    with pytest.raises(InputError, match=r"plugins cannot add a stepping .*docs/architecture\.md, 'A stepping of your own'"):
        load_plugin_file(tmp_path / "mine.py")
    assert "mine" not in STEPPINGS
    assert "### A stepping of your own\n" in (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


CLAIM = "expect: [{{joint: elbow, quantity: {}, measure: {}, value: 1}}]"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("engine: mine", "choose from auto, bullet, mujoco, bench.* Your own engines need --plugin FILE"),
        ("references: {elbow: {equilibrium_position: {tremor: 1}}}", "choose from .* Your own signals need --plugin FILE"),
        ("parameters: {elbow: {spring_kk: 1}}", r"Did you mean '.*'\? Your own actuators and stages need --plugin FILE"),
        (CLAIM.format("tremor", "final"), "Your own stages and their quantities need --plugin FILE"),
        (CLAIM.format("link_position", "finall"), r"Did you mean 'final'\? Your own measures need --plugin FILE"),
        ("stepping: rk4", r"docs/architecture\.md, 'A stepping of your own'"),
        ("substeps: 1.5", r"must be a whole number >= 1 \(got 1\.5\)\. Or write `auto`"),
    ],
)
def test_a_name_of_a_users_own_part_is_refused_with_the_way_to_give_it(line, said, tiny, asrsim_command):
    tiny.scenario.write_text(f"robot: {tiny.robot}\nduration: 0.1\n{line}\n")
    assert re.search(said, asrsim_command("check", tiny.scenario).out)


def test_an_unknown_actuator_is_the_only_finding(tiny, asrsim_command):
    """The robot's file has no actuator, which is no fault: the scenario names one."""
    tiny.robot.write_text(re.sub("<gazebo>.*</gazebo>", "", tiny.robot.read_text(), flags=re.DOTALL))
    tiny.scenario.write_text(f"robot: {tiny.robot}\nduration: 0.1\nactuators: mine\n")
    assert "1 file: 1 error, 0 warnings" in asrsim_command("check", tiny.scenario).out


def test_a_module_beside_a_plugin_is_refused_with_the_reason(tmp_path):
    (tmp_path / "beside.py").write_text("GAIN = 1.0\n")
    (tmp_path / "mine.py").write_text("\nfrom beside import GAIN\n")
    with pytest.raises(ActuatorError, match=r"mine\.py:2: .*'beside'\. A plugin is one file: it can import installed packages"):
        load_plugin_file(tmp_path / "mine.py")


PULSE = """
from dataclasses import dataclass
import numpy as np
from asrsim.document.block import declare
from asrsim.document.kinds import Number
from asrsim.errors import ScenarioError
from asrsim.signals import SIGNALS, Signal


@dataclass(frozen=True, kw_only=True)
class Pulse(Signal):
    kind = "own_pulse"
    begin: float = declare(Number(), unit="s", doc="begin")
    end: float = declare(Number(), unit="s", doc="end")

    def __post_init__(self):
        if self.end <= self.begin:
            raise ScenarioError("the pulse ends before it begins")

    def values(self, time):
        return np.where((time >= self.begin) & (time < self.end), 0.1, 0.0)


SIGNALS.add("own_pulse", Pulse)
"""


def test_a_value_of_set_that_contradicts_the_file_is_named_without_a_line(tiny, asrsim_command):
    (tiny.folder / "mine.py").write_text(PULSE)
    signal = "references: {elbow: {equilibrium_position: {own_pulse: {begin: 0.02, end: 0.05}}}}"
    tiny.scenario.write_text(f"robot: {tiny.robot}\nduration: 0.1\n{signal}\n")
    key = "references.elbow.equilibrium_position.own_pulse"
    run = ("run", tiny.scenario, "--plugin", "mine.py", "--no-plot", "--out", "out", "--set")
    assert asrsim_command(*run, f"{key}.end=0.01").err == f"asrsim: {key}.end: the pulse ends before it begins\n"
    two = asrsim_command(*run, f"{key}.end=0.3", "--set", f"{key}.begin=0.4").err
    assert two == f"asrsim: {key}: the pulse ends before it begins. Overrides set begin, end\n"


def test_a_stage_keeps_its_name_in_a_warning(tiny, asrsim_command):
    stated = "parameters: {elbow: {thermal_resistance: 2}}"  # in mode 3, whose motors have no winding
    tiny.scenario.write_text(f"robot: {tiny.robot}\nduration: 0.1\n{stated}\n")
    (stage,) = (one for one in STAGES.loaded() if one.parameters[0].name == "thermal_resistance")
    assert f"the stage '{stage.title}' does not act" in asrsim_command("check", tiny.scenario).out


def test_quantities_of_a_stage_share_axes_only_with_those_of_their_unit(tiny, asrsim_command, tmp_path):
    place = 'log="gauge_{}_reach")\n'
    span = '    span: float = value("reach in other words", "rad", log="gauge_{}_span")\n'
    logged = '    quantities = (\n        *of_motors("gauge_{}_span", "rad", "$s_{}$", "reach", apart=True),\n'
    code = METER.replace(place, place + span).replace("    quantities = (\n", logged)
    (tmp_path / "mine.py").write_text(code)
    before = STAGES.state()
    named = ("--set", "name=mine", "--set", "parameters.elbow.gauge=1", "--set", "expect=[]", "--plugin", "mine.py")
    done = asrsim_command("run", tiny.scenario, *named, "--no-plot", "--out", "run")
    assert done.code == 0, done.err
    (page,) = run_pages([read_curves(tmp_path / "run" / "log.mcap")], figures=("joints",))
    assert page.figure.texts[0].get_text().split(" · ")[1] == "mine"
    panels = {axes.get_ylabel(): axes for axes in page.figure.axes if "gauge" in axes.get_ylabel()}
    assert list(panels) == ["gauge (rad)", "gauge (W)"]
    drawn = panels["gauge (rad)"]
    assert len({(line.get_color(), line.get_linestyle()) for line in drawn.lines}) == len(drawn.lines) == 2
    assert {text.get_text() for text in drawn.get_legend().get_texts()} == {"gauge 1 span $s_1$", "gauge 1 reach $r_1$"}
    STAGES.put(before)
    done = asrsim_command("plot", "run", "--quantity", "gauge_1_span", "--out", "plots")
    assert "the units of quantities are not known here: gauge_1_span. The run used mine.py" in done.out


def test_the_page_of_three_motors_passes_the_checks_and_runs(own, tiny, asrsim_command, tmp_path):
    plugin = own("actuators.md", "Three motors")
    done = asrsim_command("check", "--actuator", "three_springs", "--plugin", plugin)
    assert done.code == 0, done.out
    text = tiny.robot.read_text().replace("libsea", "libthree_springs")
    tiny.robot.write_text(text.replace("<operation_mode>3", "<operation_mode>6"))
    options = ("--set", "references.elbow.stiffness_preset=0.2", "--set", "expect=[]", "--no-plot", "--out", "run")
    done = asrsim_command("run", tiny.scenario, *options, "--plugin", plugin)
    assert done.code == 0, done.err
    motors = read_log(tmp_path / "run" / "log.mcap").samples.joint("elbow")
    apart = motors["motor_1_position"][-1] - motors["motor_3_position"][-1]
    assert apart == pytest.approx(0.4, abs=0.02)


def test_an_energy_that_does_not_grow_linearly_beyond_the_limit_fails_its_check(own, asrsim_command):
    plugin = own("actuators.md", "Three motors")
    plugin.write_text(plugin.read_text().replace(" * (x - d)\n", " * 0.0\n"))
    done = asrsim_command("check", "--actuator", "three_springs", "--plugin", plugin)
    assert done.code == 1
    assert re.findall(r"^ *(\w+) +FAIL", done.out, re.MULTILINE) == ["energy"]


def test_a_signal_refuses_a_combination_of_options_at_its_line(own, tiny, asrsim_command):
    plugin = own("signals.md", "Your own")
    refusal = "    def __post_init__(self):\n        if self.period > 9.0:\n            raise ScenarioError('is too slow')\n\n"
    code = plugin.read_text().replace("    def values(", refusal + "    def values(")
    plugin.write_text("from asrsim.errors import ScenarioError\n" + code)
    tiny.scenario.write_text(
        f"robot: {tiny.robot}\nduration: 0.1\n"
        "references:\n  elbow: {equilibrium_position: {sawtooth: {amplitude: 1, period: 10}}}\n"
    )
    said = asrsim_command("check", tiny.scenario, "--plugin", plugin).out
    assert "step.yaml:4: references.elbow.equilibrium_position.sawtooth: is too slow" in said


def test_an_option_of_a_measure_may_be_a_list():
    def band(time, values, *, weights=(1.0,), level=0.0):
        """Weighted mean."""
        return float(sum(weights) * np.mean(values) + level)

    MEASURES.add("banded", Measure(name="banded", function=band, unit="series", needs="series"))
    (asked,) = asked_measures(["banded:weights=[1, 2.5],level=4"])
    assert asked.options == {"weights": [1, 2.5], "level": 4}
    assert asked.of(np.arange(3.0), np.ones(3), None) == 7.5


TWO_CLOCKS = """
import numpy as np
from asrsim.recordings import READERS, Reader
from asrsim.recordings.data import Content, RawColumn, RawTable

def read(path, reading):
    ticks = (np.arange(50) * 1000 + 2**32 - 9500) % 2**32
    names = "elbow.link_position [rad]", "hip.reference_1 [rad]"
    columns = [[("tick [us]", ticks), (name, np.arange(50) / 50)] for name in names]
    tables = [RawTable(columns=tuple(RawColumn(name=n, values=v) for n, v in one)) for one in columns]
    return Content(format="ticks", tables=tuple(tables))

READERS.add("ticks", Reader(suffixes=(".ticks",), read=read))
"""


def test_a_counter_that_restarts_in_two_tables_gives_one_note(tmp_path):
    (tmp_path / "mine.py").write_text(TWO_CLOCKS)
    load_plugin_file(tmp_path / "mine.py")
    (tmp_path / "a.ticks").write_text("x")
    (note,) = [one for one in read_recording(tmp_path / "a.ticks").findings if one.code == "restarted-clock"]
    assert "restarts 1 time after 4.29497e+09 us" in note.message


def test_a_reader_that_takes_other_arguments_is_named_with_its_line(tmp_path):
    (tmp_path / "mine.py").write_text(TWO_CLOCKS.replace("def read(path, reading)", "def read(path)"))
    load_plugin_file(tmp_path / "mine.py")
    (tmp_path / "a.ticks").write_text("x")
    with pytest.raises(RecordingError, match=r"takes 1 positional argument.*mine\.py:6\)"):
        read_recording(tmp_path / "a.ticks")


def test_the_hint_on_readers_of_users_is_given_once(tmp_path):
    (tmp_path / "a.slg").write_bytes(b"SLG2\0\0\1")
    with pytest.raises(RecordingError) as caught:
        read_recording(tmp_path / "a.slg")
    assert str(caught.value).count("A reader of your own needs --plugin FILE") == 1
