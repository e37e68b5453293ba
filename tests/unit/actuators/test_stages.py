"""Stages of users: a plugin file brings one with the rights of our own; the checker finds wrong bounds and gained energy."""

import os
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

import asrsim
from asrsim.actuators import MODES, Parameter
from asrsim.actuators.stage_checker import check_stage, stage_problems
from asrsim.actuators.stages import STAGES, Stage
from asrsim.actuators.stages.damper import Damper
from asrsim.actuators.stages.hysteresis import Hysteresis
from asrsim.errors import ActuatorError
from asrsim.identification.door import comparable
from asrsim.metrics.measures import MEASURES
from asrsim.plugins import load_plugin_file
from asrsim.quantities import MOST_MOTORS, QUANTITIES, Quantity, of_motors
from asrsim.recordings.names import column_quantities
from asrsim.records import constant, numbers, value
from asrsim.robot.values import block_for
from asrsim.simulation.quantities import simulated_quantities
from support.paths import EXAMPLES, ROOT

EXAMPLE = EXAMPLES / "plugins" / "my_clutch.py"


def scenario(parameters, **keys):
    motion = {"sinusoid": {"amplitude": 0.5, "frequency": 2.0}}
    return asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf",
        references={"joint_1": {"equilibrium_position": motion}},
        duration=0.2,
        modes={"*": 6},
        parameters={"joint_1": parameters},
        compiled=False,
        **keys,
    )


def test_a_plugin_brings_a_stage_that_runs_and_is_logged():
    assert load_plugin_file(EXAMPLE) == ()
    result = asrsim.run(scenario({"clutch_torque": 0.3}))["joint_1"]
    lost = result["clutch_loss"]
    assert lost[-1] > 1e-5
    assert np.diff(lost).min() >= 0.0
    assert np.abs(result["energy_residual"]).max() < 1e-3 * lost[-1]
    with pytest.raises(KeyError):
        asrsim.run(scenario({}))["joint_1"]["clutch_loss"]


def test_the_example_passes_the_checker_and_is_documented():
    load_plugin_file(EXAMPLE)
    assert check_stage(STAGES.get("clutch")).passed
    shown = (ROOT / "docs" / "stages.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    assert shown.strip() in EXAMPLE.read_text(encoding="utf-8")


@pytest.mark.parametrize("stage", STAGES.loaded(), ids=lambda stage: stage.name)
def test_the_built_in_stages_pass_the_checker(stage):
    report = check_stage(stage)
    assert report.passed, [check for check in report.checks if not check.passed]


def test_a_law_that_raises_names_the_command_that_checks_it(tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8")
    at_rest = "if velocity == 0.0:\n            raise RuntimeError('torn')\n        return 0.0"
    (tmp_path / "torn.py").write_text(text.replace("return own.level * tanh(velocity / own.speed)", at_rest))
    load_plugin_file(tmp_path / "torn.py")
    with pytest.raises(ActuatorError) as caught:
        asrsim.run(scenario({"clutch_torque": 0.3}))
    (problem,) = caught.value.problems
    assert problem.hint == (
        f"asrsim check --stage clutch --plugin {tmp_path / 'torn.py'} evaluates the laws over their whole range"
    )


@pytest.mark.parametrize("stage", STAGES.loaded(), ids=lambda stage: stage.name)
def test_a_stage_acts_alike_at_every_motor(stage):
    """Both motors of a qbMove are equal."""
    values = {name: value or 0.3 for name, value in block_for("joint_1", "qbmove", 6).values().items()}
    first, second = (stage.constants(values, motor, MODES[6]) for motor in (1, 2))
    assert first is not None
    assert numbers(first) == numbers(second)
    assert stage.constants(dict.fromkeys(values, 0.0), 1, MODES[6]) is None


def failed(name, base, **laws):
    """Names of the checks that a stage derived from another one fails."""
    made = type(name, (base,), {key: staticmethod(law) for key, law in laws.items()})
    return {check.name for check in check_stage(made).checks if not check.passed}


def test_the_times_since_the_last_kicks_add_up_to_the_time_of_the_run(tmp_path):
    kept = "memory.power, memory.slip = power, kick.velocity"
    text = EXAMPLE.read_text(encoding="utf-8")
    assert kept in text
    (tmp_path / "clock.py").write_text(text.replace(kept, "memory.slip += kick.step"))
    load_plugin_file(tmp_path / "clock.py")
    result = asrsim.run(scenario({"clutch_torque": 0.3}))
    np.testing.assert_allclose(result["joint_1"]["clutch_1_slip"], result.time, rtol=0.0, atol=1e-12)


def test_wrong_bounds_and_gained_energy_are_found():
    assert failed("Soft", Hysteresis, stiffness_bound=lambda own: own.level / own.length) == {"stiffness"}
    assert failed("Weak", Damper, damping_bound=lambda own: 0.5 * own.damping) == {"damping"}
    held = {"ground": lambda memory, own, position, velocity, torque: 2.0 * position + 3.0 * velocity}
    assert failed("Held", Damper, **held) == {"ground stiffness", "ground damping", "energy"}
    assert failed("Gain", Damper, loss=lambda memory, own: -memory.lost) == {"energy", "loss"}
    assert failed("Free", Damper, loss=lambda memory, own: 0.0) == {"energy"}
    pushing = {"torque": lambda memory, own, deflection, velocity: -own.damping * velocity}
    assert failed("Pushing", Damper, **pushing) == {"energy"}
    faint = {"torque": lambda memory, own, deflection, velocity: 1e-6 * own.damping * velocity}
    assert failed("Faint", Damper, **faint, loss=lambda memory, own: 0.0) == {"energy"}
    assert failed("Strong", Damper, limit=lambda memory, own, torque: 2.0 * torque) == {"limit"}
    assert failed("Steep", Damper, place=lambda memory, own, deflection: 2.0 * deflection) == {"energy", "series"}


def test_a_stage_that_always_acts_or_never_acts_is_found():
    for own in (Damper.Constants(damping=0.1), None):
        made = type("Constant", (Damper,), {"constants": classmethod(lambda cls, values, motor, mode, own=own: own)})
        assert "off by default" in {check.name for check in check_stage(made).checks if not check.passed}, own


def test_constants_that_are_no_class_method_are_found():
    made = type("Static", (Damper,), {"constants": staticmethod(lambda values, motor, mode: None)})
    assert [(problem.key, problem.message) for problem in stage_problems(made)] == [
        ("Static.constants", "must be a @classmethod")
    ]


def test_torques_that_overflow_are_found():
    endless = {"ground": lambda memory, own, position, velocity, torque: float("inf")}
    assert "finite" in failed("Endless", Damper, **endless)


def test_a_division_by_the_time_since_the_last_kick_is_found():
    assert "finite" in failed("Rate", Damper, remember=lambda memory, own, kick: setattr(memory, "power", 1.0 / kick.step))


class Slip(Stage):
    """A clutch in series with the spring, which slips in proportion to the torque of the spring."""

    name, title, lost = "slip", "Slip", "slip_loss"
    parameters = (
        Parameter(name="slip_rate", default=0.0, unit="rad/(N m s)", minimum=0.0, optional=True, doc="rate over torque"),
    )
    quantities = (Quantity("slip_loss", "J", "", "energy lost in the clutch"),)

    @dataclass(slots=True)
    class Memory:
        """Slip, and what it costs."""

        slip: float = value("slip so far", "rad")
        lost: float = value("energy lost in the last kick", "J")

    @dataclass(slots=True)
    class Constants:
        """Constants of the clutch."""

        rate: float = constant("rate of the slip over the torque", "rad/(N m s)")

    @classmethod
    def constants(cls, values, motor, mode):
        return cls.Constants(values["slip_rate"]) if values["slip_rate"] else None

    @staticmethod
    def place(memory, own, deflection):
        return deflection - memory.slip

    @staticmethod
    def remember(memory, own, kick):
        slip = own.rate * kick.elastic_torque * kick.step
        memory.slip += slip
        memory.lost = kick.elastic_torque * slip

    @staticmethod
    def loss(memory, own):
        return memory.lost


def test_a_clutch_in_series_takes_its_loss_from_the_spring():
    assert check_stage(Slip).passed
    assert failed("Free", Slip, loss=lambda memory, own: 0.0) == {"energy"}
    assert failed("Twice", Slip, loss=lambda memory, own: 2.0 * memory.lost) == {"energy"}


class Bumps(Stage):
    """Rubber that the spring meets at a deflection, and oil whose slope grows up to a speed."""

    name, title = "bumps", "Bumps"
    parameters = (
        Parameter(name="bump_stiffness", default=0.0, unit="N m/rad", minimum=0.0, optional=True, doc="stiffness"),
        Parameter(name="bump_gap", default=1.4, unit="rad", minimum=0.0, optional=True, doc="free deflection"),
        Parameter(name="oil", default=0.0, unit="N m s^2/rad^2", minimum=0.0, optional=True, doc="torque over squared speed"),
        Parameter(name="oil_speed", default=40.0, unit="rad/s", minimum=0.0, optional=True, doc="speed of the steepest slope"),
    )

    @dataclass(slots=True)
    class Constants:
        """Constants of the rubber and the oil."""

        stiff: float = constant("stiffness", "N m/rad")
        gap: float = constant("free deflection", "rad")
        oil: float = constant("torque over squared speed", "N m s^2/rad^2")
        fastest: float = constant("speed of the steepest slope", "rad/s")

    @classmethod
    def constants(cls, values, motor, mode):
        own = cls.Constants(*(values[one.name] for one in cls.parameters))
        return own if own.stiff or own.oil else None

    @staticmethod
    def torque(memory, own, deflection, velocity):
        depth = max(abs(deflection) - own.gap, 0.0)
        speed = min(abs(velocity), own.fastest)
        flow = own.oil * (speed * speed + 2.0 * own.fastest * (abs(velocity) - speed))
        return own.stiff * depth * np.sign(deflection) + flow * np.sign(velocity)

    @staticmethod
    def stiffness_bound(own):
        return own.stiff

    @staticmethod
    def damping_bound(own):
        return 2.0 * own.oil * own.fastest


def test_a_stage_is_tried_beyond_the_deflections_and_speeds_that_it_states():
    def wrong(**laws):
        return failed("Wrong", Bumps, **laws) & {"stiffness", "damping"}

    assert wrong() == set()
    assert wrong(stiffness_bound=lambda own: 0.99 * own.stiff) == {"stiffness"}
    assert wrong(damping_bound=lambda own: 1.98 * own.oil * own.fastest) == {"damping"}


def test_a_law_that_raises_is_named_with_its_line():
    def torque(memory, own, deflection, velocity):
        return own.nothing

    report = check_stage(type("Broken", (Damper,), {"torque": staticmethod(torque)}))
    (detail,) = {check.detail for check in report.checks if not check.passed}
    assert f"({__file__}:{torque.__code__.co_firstlineno + 1})" in detail


def test_wrong_declarations_are_found_with_their_file_and_line(tmp_path):
    path = tmp_path / "bad.py"
    path.write_text("from asrsim.actuators.stages import Stage\n\n\nclass Bad(Stage):\n    name = 'Bad One'\n    title = 'x'\n")
    with pytest.raises(ActuatorError) as caught:
        load_plugin_file(path)
    assert {problem.key for problem in caught.value.problems} == {"Bad.name", "Bad.parameters"}
    assert all(problem.line == 4 and problem.file == path for problem in caught.value.problems)

    @dataclass(slots=True)
    class One:
        """One number."""

        number: float = constant("a number", "1")

    keeps = type("Keeps", (Damper,), {"parameters": tuple(Hysteresis.parameters), "Constants": One, "lost": ""})
    assert {problem.key for problem in stage_problems(keeps)} == {
        "Keeps.parameters.hysteresis_torque",
        "Keeps.parameters.hysteresis_deflection",
        "Keeps.quantities",
        "Keeps.lost",
    }
    assert not stage_problems(Damper)
    assert issubclass(keeps, Stage)


@pytest.mark.parametrize(
    ("unit", "joules", "key", "said"),
    [
        ("kW", "J", "Memory.power", "has the unit 'W', but is logged as the quantity 'spent_1_power' in 'kW'"),
        ("W", "kJ", "quantities", "must have 'slip_loss' in J: it is an energy (got 'kJ')"),
    ],
)
def test_a_logged_number_has_the_unit_of_its_quantity(unit, joules, key, said):
    @dataclass(slots=True)
    class Memory:
        """Power, and a number without a unit."""

        slip: float = value("slip so far", "rad")
        power: float = value("power", "W", log="spent_{}_power")
        share: float = value("share", "1", log="spent_{}_share")
        lost: float = value("energy lost in the last kick", "J")

    quantities = (
        Quantity("slip_loss", joules, "", "energy lost"),
        *of_motors("spent_{}_power", unit, "", "power"),
        *of_motors("spent_{}_share", "1", "", "share"),
    )
    (problem,) = stage_problems(type("Spent", (Slip,), {"Memory": Memory, "quantities": quantities}))
    assert problem.key == f"Spent.{key}"
    assert problem.message == said


def test_stages_of_one_file_have_different_names(tmp_path):
    path = tmp_path / "twice.py"
    own = "(Parameter(name='{}', default=0.0, unit='N m s/rad', minimum=0.0, optional=True, doc='damping'),)"
    classes = (
        f"class {one}(Damper):\n    name = 'twice'\n    parameters = {own.format(one.lower())}\n"
        f"    lost = '{one}_loss'\n    quantities = (Quantity(lost, 'J', 'E', 'loss'),)\n"
        for one in ("One", "Two")
    )
    imports = "from asrsim.actuators import Parameter\nfrom asrsim.actuators.stages.damper import Damper\n"
    imports += "from asrsim.quantities import Quantity\n"
    path.write_text("\n\n".join((imports, *classes)))
    with pytest.raises(ActuatorError, match="another stage is called 'twice'") as caught:
        load_plugin_file(path)
    assert [problem.key for problem in caught.value.problems] == ["Two.name"]
    assert "twice" not in STAGES


def test_of_a_file_with_a_fault_nothing_stays(tmp_path):
    path = tmp_path / "half.py"
    path.write_text(
        "from asrsim.actuators import Actuator, Parameter\n"
        "from asrsim.actuators.stages.damper import Damper\n"
        "from asrsim.metrics.measures import MEASURES, Measure\n"
        "from asrsim.quantities import Quantity\n"
        "mean = lambda time, values: 0.0\n"
        "MEASURES.add('half', Measure(name='half', function=mean, unit='1', needs='series'))\n\n\n"
        "class Half(Damper):\n"
        "    name = 'half'\n"
        "    lost = 'half_loss'\n"
        "    quantities = (Quantity('half_loss', 'J', 'E', 'loss'),)\n"
        "    parameters = (Parameter(name='half', default=0.0, unit='N m s/rad', minimum=0.0, optional=True, doc='d'),)\n"
        "\n\nclass Wrong(Actuator):\n    name = 'wrong one'\n"
    )
    with pytest.raises(ActuatorError) as caught:
        load_plugin_file(path)
    assert all((problem.key or "").startswith("Wrong") for problem in caught.value.problems)
    assert "half" not in STAGES
    assert "half" not in MEASURES
    assert "half_loss" not in QUANTITIES


def test_quantities_of_a_stage_of_a_file_are_columns_of_recordings_and_of_fits():
    load_plugin_file(EXAMPLE)
    logged = {one.name for one in STAGES.get("clutch").quantities}
    assert logged <= column_quantities().keys()
    assert logged & set(comparable()) == {name for name in logged if QUANTITIES[name].unit != "J"}


def test_a_stage_of_an_installed_package_acts_without_being_asked_for(tmp_path):
    package = tmp_path / "clutches-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: clutches\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text("[asrsim.stages]\nclutch = clutches:Clutch\n")
    (tmp_path / "clutches.py").write_text(EXAMPLE.read_text(encoding="utf-8"))
    code = (
        "from asrsim.actuators import ACTUATORS; from asrsim.quantities import QUANTITIES\n"
        "names = {one.name for one in ACTUATORS.get('sea').all_parameters()}\n"
        "assert 'clutch_torque' in names and 'clutch_loss' in QUANTITIES"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), *filter(None, sys.path)))}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


def test_what_a_stage_logs_is_declared_for_every_motor():
    load_plugin_file(EXAMPLE)
    assert QUANTITIES.keys() >= set(simulated_quantities(MOST_MOTORS))
    clutch = STAGES.get("clutch")
    few = type("Few", (clutch,), {"quantities": clutch.quantities[:3]})
    assert [problem.key for problem in stage_problems(few)] == ["Few.quantities"]


def test_quantities_of_a_stage_are_a_tuple():
    load_plugin_file(EXAMPLE)
    once = type("Once", (STAGES.get("clutch"),), {"quantities": (one for one in STAGES.get("clutch").quantities)})
    assert [problem.key for problem in stage_problems(once)] == ["Once.quantities"]


def test_a_quantity_of_each_motor_is_a_tuple_and_a_pure_number_has_no_unit():
    turns = of_motors("clutch_{}_turns", "1", "$n_{}$", "turns of clutch {}")
    assert isinstance(turns, tuple)
    assert [one.name for one in turns] == [f"clutch_{i}_turns" for i in range(1, MOST_MOTORS + 1)]
    assert {one.unit for one in turns} == {""}
