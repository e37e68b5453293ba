"""Checks that a stage is declared as `Stage` requires, and that its laws agree with each other and with physics.

The laws are evaluated along random motions of a motor and its spring. In each kick they are evaluated in the order of a
simulation: torque, then memory, then energy and loss.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, fields, is_dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from asrsim.actuators.checker import Check, CheckReport, raised_text, report_of
from asrsim.actuators.declaration import declaration_problem
from asrsim.actuators.modes import MODES
from asrsim.actuators.parameters import Parameter
from asrsim.actuators.sea import Sea
from asrsim.actuators.stages import OF_JOINTS, STAGES, Kick, Stage
from asrsim.errors import Problem
from asrsim.quantities import Quantity, each_motor
from asrsim.records import declared

BOUNDS = ("stiffness_bound", "damping_bound", "ground_stiffness_bound", "ground_damping_bound")
LAWS = ("place", "torque", "ground", "limit", "remember", "energy", "loss", *BOUNDS)
SIZES = 1.0, 0.1, 0.3, 1.0, 3.0, 1.0
"""Relative size of each random motion. The sizes differ, since a law may differ between small and large deflections."""
STEPS, STEP = 4000, 1e-4
"""STEPS: number of kicks of a motion; STEP: largest time between two kicks in s."""
REACH, HERTZ = 0.3, 4.0
"""REACH: largest deflection of a motion of relative size 1, rad; HERTZ: largest frequency of the deflection, Hz. A motion is
larger or faster than these values if the parameters of the stage make it act only on larger or faster motions."""
BEYOND = 2.0
"""Factor by which the deflection and the speed of a motion exceed the stage's largest parameter in rad and in rad/s."""
LARGEST = 5.0
"""Largest torque of the motor and of the spring in a motion, N m. It is also the motor's torque limit before the stage reduces
it."""
SPRING = 10.0
"""Stiffness of the spring behind a stage in series, N m/rad. The default SEA has the same stiffness."""
MOTOR = 0.7
"""Ratio of the frequencies of the motor's motion to the frequencies of the deflection."""
SLACK = 1e-6
"""Largest relative excess of a slope over its bound that counts as a rounding error."""
SAMPLE = Kick(
    motor_position=0.5, motor_velocity=0.3, deflection=0.03, velocity=0.2, motor_torque=1.0, elastic_torque=0.7, step=1e-3,
    next_step=1e-3,
)  # fmt: skip
"""Kick with which each law is called once, to see what it returns."""
ELECTRIC = {"motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 30.0, "motor_1_resistance": 1.0}
"""Constants of the electric motor on which a stage is tried."""


def stage_problems(stage: type[Stage]) -> tuple[Problem, ...]:
    """Problems of a class that does not follow the interface of `Stage`."""
    return tuple(declaration_problem(stage, message, code, key=key) for key, message, code in _faults(stage))


def _faults(stage: type[Stage]) -> Iterator[tuple[str, str, str]]:
    name, parameters = getattr(stage, "name", None), stage.parameters
    if not (isinstance(name, str) and re.fullmatch(r"[a-z][a-z0-9_]*", name)):
        yield "name", "must be lower-case letters, digits and underscores", "bad-declaration"
    if not isinstance(getattr(stage, "title", None), str):
        yield "title", "must be a text", "bad-declaration"
    if not (isinstance(parameters, tuple) and parameters and all(isinstance(one, Parameter) for one in parameters)):
        yield "parameters", "must be a tuple of at least one Parameter(...)", "bad-declaration"
        return
    before = [own for one in STAGES.loaded() if one.name == name for own in one.parameters]
    taken = {one.name for one in Sea.all_parameters()} - {one.name for one in before}
    for one in parameters:
        if not one.optional:
            yield f"parameters.{one.name}", "must have optional=True: robots without its tag have no stage", "bad-parameter"
        if one.name in taken:
            yield f"parameters.{one.name}", "another parameter has this name", "bad-parameter"
    for key in ("Memory", "Constants"):
        kind = getattr(stage, key, None)
        if not (isinstance(kind, type) and is_dataclass(kind)):
            yield key, "must be a dataclass with slots of numbers (asrsim.records)", "bad-declaration"
            return
        maker = "value" if key == "Memory" else "constant"
        if bare := [one.name for one in fields(kind) if "doc" not in one.metadata]:
            yield f"{key}.{bare[0]}", f"must be declared by asrsim.records.{maker}(...)", "bad-declaration"
            return
    if not (isinstance(stage.quantities, tuple) and all(isinstance(one, Quantity) for one in stage.quantities)):
        yield "quantities", "must be a tuple of Quantity(...), of asrsim.quantities", "bad-declaration"
        return
    known = {one.name for one in stage.quantities}
    units = {one.name: one.unit for one in stage.quantities}
    for key, number in declared(stage.Memory).items():
        unit = "" if number["unit"] == "1" else number["unit"]
        shown = next((name for name in each_motor(number["log"]) if units.get(name, unit) != unit), "")
        if shown:
            said = f"has the unit '{number['unit']}', but is logged as the quantity '{shown}' in '{units[shown] or '1'}'"
            yield f"Memory.{key}", said, "bad-declaration"
    if units.get(stage.lost, "J") != "J":
        yield "quantities", f"must have '{stage.lost}' in J: it is an energy (got '{units[stage.lost]}')", "bad-declaration"
    logs = [one["log"] for one in declared(stage.Memory).values() if one["log"]]
    if shared := [log for log in logs if "{}" not in log]:
        said = f"must log '{shared[0]}' with {{}} for the number of the motor: each motor has a memory"
        yield "Memory", said, "bad-declaration"
        return
    logged = [each_motor(log) for log in logs]
    if unlogged := known - {stage.lost}.union(*logged):
        said = f"has '{min(unlogged)}', but no value of `Memory` is logged under this name (`log=`)"
        yield "quantities", said, "bad-declaration"
    others = OF_JOINTS.union(one.name for other in STAGES.loaded() if other.name != name for one in other.quantities)
    if shared := sorted(known & others):
        yield "quantities", f"must not have '{shared[0]}': another quantity has this name", "bad-declaration"
    for names in (*logged, *[(stage.lost,)] * bool(stage.lost)):
        missing = [name for name in names if name not in known]
        if missing:
            several = "; asrsim.quantities.of_motors makes this quantity for all motors" if len(names) > 1 else ""
            yield "quantities", f"must have the quantity '{missing[0]}', which the stage logs{several}", "bad-declaration"
    if stage.has("loss") != bool(stage.lost):
        yield "lost", "must name the lost energy in logs if, and only if, the stage has the law `loss`", "bad-declaration"
    for law in LAWS:
        if stage.has(law) and not isinstance(inspect.getattr_static(stage, law), staticmethod):
            yield law, "must be a @staticmethod: laws have no state except the memory", "bad-law"
            return
    for own in vars(stage):
        if own in LAWS or own == "constants" or own.startswith("_"):
            continue
        if isinstance(inspect.getattr_static(stage, own), staticmethod):
            yield own, f"is not a law; laws are {', '.join(LAWS)}; begin the names of your functions with _", "bad-law"
    yield from _law_faults(stage)


def _law_faults(stage: type[Stage]) -> Iterator[tuple[str, str, str]]:
    """Faults of the stage's constants, and of the results of its laws for a few arguments."""
    stated = inspect.getattr_static(stage, "constants")
    if not isinstance(stated, classmethod):
        yield "constants", "must be a @classmethod", "bad-law"
        return
    if stated is inspect.getattr_static(Stage, "constants"):
        yield "constants", "is missing: it gives the constants at a motor, or None where the stage does not act", "bad-law"
        return
    source = np.random.default_rng(48)
    values = {one.name: one.default for one in Sea.all_parameters()} | ELECTRIC
    values |= {one.name: _drawn(one, source) for one in stage.parameters}
    law = "constants"
    try:
        own = stage.constants(values, 1, MODES[5])
        if own is None:
            return
        if not isinstance(own, stage.Constants):
            yield law, f"must return {stage.Constants.__name__} or None", "bad-law"
            return
        memory = stage.Memory()
        for law in LAWS:
            before = replace(memory)
            takes = inspect.signature(getattr(Stage, law)).parameters
            given = {"memory": memory, "own": own, "torque": SAMPLE.motor_torque, "kick": replace(SAMPLE)}
            found = getattr(stage, law)(*(given[name] if name in given else getattr(SAMPLE, name) for name in takes))
            if law != "remember":
                if not _is_number(found):
                    yield law, f"must return a number (got {found!r})", "bad-law"
                # NaN in a memory means a value that is not yet known. Two such values count as equal.
                if not np.array_equal(astuple(memory), astuple(before), equal_nan=True):
                    yield law, "must not change the memory; only `remember` does", "bad-law"
            if wrong := [key for key in declared(stage.Memory) if not _is_number(getattr(memory, key))]:
                yield law, f"must keep a number in `{wrong[0]}` of the memory (got {getattr(memory, wrong[0])!r})", "bad-law"
                return
    except (Exception, SystemExit) as error:
        arguments = ", ".join(inspect.signature(getattr(Stage, law)).parameters)
        yield law, raised_text(error) + (f"; the law must take {arguments}" if isinstance(error, TypeError) else ""), "bad-law"


def _is_number(found: object) -> bool:
    return isinstance(found, (float, int, np.floating, np.integer))


def check_stage(stage: type[Stage]) -> CheckReport:
    """Results of all checks. An exception in a law fails the checks that need the law and is not raised."""
    doc = "name, parameters, records and laws are declared as `Stage` requires"
    trial_of = cache(partial(StageTrial, stage))
    return report_of(stage, stage_problems(stage), doc, (_run(trial_of, *check) for check in CHECKS))


def _run(
    trial_of: Callable[[int], StageTrial],
    name: str,
    doc: str,
    limit: float,
    measure: Callable[[StageTrial], Iterable[float]],
) -> Check:
    worst, where = 0.0, ""
    try:
        for seed in range(len(SIZES)):
            trial = trial_of(seed)
            found = float(np.max(np.fromiter(measure(trial), float), initial=0.0))
            if not found <= worst:
                worst, where = found, ", ".join(f"{key} = {value:.4g}" for key, value in trial.values.items())
    except (Exception, SystemExit) as error:
        return Check(name=name, passed=False, doc=doc, limit=limit, detail=raised_text(error))
    passed = worst <= limit
    detail = "" if passed else f"{worst:.3g} with {where}"
    return Check(name=name, passed=passed, doc=doc, figure=worst, limit=limit, detail=detail)


class StageTrial:
    """A stage with random parameters, a random motion of its motor, and a random deflection between this motor and the link."""

    def __init__(self, stage: type[Stage], seed: int) -> None:
        source = np.random.default_rng([seed, 48])
        self.stage, self.values = stage, {one.name: _drawn(one, source) for one in stage.parameters}
        defaults = {one.name: one.default for one in Sea.all_parameters()} | {one.name: one.default for one in stage.parameters}
        self.at_defaults = stage.constants(defaults | ELECTRIC, 1, MODES[5])
        self.own: Any = stage.constants(defaults | ELECTRIC | self.values, 1, MODES[5])
        time = np.arange(STEPS) * STEP
        waves = [(size, source.uniform(0.5, HERTZ), source.uniform(0.0, 6.0)) for size in source.uniform(0.0, REACH / 3, 3)]
        rates = 2.0 * np.pi * np.array([hertz for _, hertz, _ in waves])
        angles = rates[:, None] * time + np.array([[phase] for *_, phase in waves])
        sizes = np.array([[size] for size, *_ in waves])
        deflection = (sizes * np.sin(angles)).sum(axis=0)
        velocity = (sizes * rates[:, None] * np.cos(angles)).sum(axis=0)
        larger = SIZES[seed] * max(REACH, BEYOND * self._largest("rad")) / np.max(np.abs(deflection))
        faster = max(1.0, BEYOND * self._largest("rad/s") / float(np.max(np.abs(larger * velocity))))
        # The motor's motion differs from the motion of the deflection, since the link moves, too.
        slower = (
            (sizes * np.sin(MOTOR * angles)).sum(axis=0),
            (sizes * MOTOR * rates[:, None] * np.cos(MOTOR * angles)).sum(axis=0),
        )
        self.trajectory = np.column_stack(
            (
                larger * slower[0],
                larger * faster * slower[1],
                larger * deflection,
                larger * faster * velocity,
                LARGEST * np.sin(3.0 * angles[0]),
                LARGEST * np.sin(2.0 * angles[1]),
                np.full(STEPS, STEP / faster),
                np.full(STEPS, STEP / faster),
            )
        )
        """Rows of numbers, one for each kick, in the order of the fields of `Kick`."""
        # Before the first kick there is no other.
        self.trajectory[0, -2] = 0.0

    def _largest(self, unit: str) -> float:
        """Largest magnitude of the stage's parameters that have this unit; 0 if no parameter has it."""
        found = (abs(self.values[one.name]) for one in self.stage.parameters if one.unit == unit)
        return max((value for value in found if np.isfinite(value)), default=0.0)

    @cached_property
    def kicks(self) -> Sequence[tuple[Any, Any, Kick]]:
        """Memory before and after each kick, and the kick."""
        memory, kicks = self.stage.Memory(), []
        for row in self.trajectory.tolist():
            after, kick = replace(memory), Kick(*row)
            if self.stage.has("place"):
                kick.elastic_torque = SPRING * self.placed(memory, kick)
            self.stage.remember(after, self.own, replace(kick))
            kicks.append((memory, after, kick))
            memory = after
        return kicks

    def placed(self, memory: Any, kick: Kick) -> float:
        """Deflection of the spring behind a stage in series, rad."""
        return self.stage.place(memory, self.own, kick.deflection)

    def torque(self, memory: Any, kick: Kick, way: float = 0.0, speed: float = 0.0) -> float:
        """Torque between motor and link in N m, at the deflection and velocity of the kick plus `way` (rad) and `speed`
        (rad/s)."""
        return self.stage.torque(memory, self.own, kick.deflection + way, kick.velocity + speed)

    def ground(self, memory: Any, kick: Kick, way: float = 0.0, speed: float = 0.0) -> float:
        """Torque between motor and ground in N m, at the motor position and velocity of the kick plus `way` (rad) and `speed`
        (rad/s)."""
        place, velocity = kick.motor_position + way, kick.motor_velocity + speed
        return self.stage.ground(memory, self.own, place, velocity, kick.elastic_torque)


def _drawn(one: Parameter, source: np.random.Generator) -> float:
    """A random value with which the parameter has an effect."""
    usual = abs(one.default) if one.default and np.isfinite(one.default) else 0.2
    value = usual * float(source.uniform(0.5, 1.5))
    return min(max(value, one.minimum), one.maximum)


def _acts(trial: StageTrial) -> Iterator[float]:
    yield float(trial.at_defaults is not None) + float(trial.own is None)


def _finite(trial: StageTrial) -> Iterator[float]:
    stage, own = trial.stage, trial.own
    for memory, _, kick in trial.kicks:
        found = (
            stage.place(memory, own, kick.deflection),
            trial.torque(memory, kick),
            trial.ground(memory, kick),
            stage.limit(memory, own, abs(kick.motor_torque)),
            stage.energy(memory, own),
        )
        yield float(not np.isfinite(found).all())


def _stiffness(trial: StageTrial) -> Iterator[float]:
    return _excess(trial, trial.torque, trial.stage.stiffness_bound(trial.own), way=1e-6)


def _ground_stiffness(trial: StageTrial) -> Iterator[float]:
    return _excess(trial, trial.ground, trial.stage.ground_stiffness_bound(trial.own), way=1e-6)


def _damping(trial: StageTrial) -> Iterator[float]:
    return _excess(trial, trial.torque, trial.stage.damping_bound(trial.own), speed=1e-4)


def _ground_damping(trial: StageTrial) -> Iterator[float]:
    return _excess(trial, trial.ground, trial.stage.ground_damping_bound(trial.own), speed=1e-4)


def _excess(
    trial: StageTrial, law: Callable[..., float], bound: float, *, way: float = 0.0, speed: float = 0.0
) -> Iterator[float]:
    """Relative amount by which the slope of a torque of the trial exceeds `bound`, at each kick. The slope is computed from two
    points, at distances of plus and minus `way` (rad) or `speed` (rad/s) from the kick."""
    for memory, _, kick in trial.kicks:
        slope = abs(law(memory, kick, way, speed) - law(memory, kick, -way, -speed)) / (2.0 * (way + speed))
        yield max(slope - bound * (1.0 + SLACK) - 1e-6, 0.0) / max(bound, 1e-6)


def _balance(trial: StageTrial) -> Iterator[float]:
    stage, own = trial.stage, trial.own
    work = lost = turned = stored = first = pull_before = hold_before = slipped_before = 0.0
    last = trial.kicks[0][2]
    for number, (memory, after, kick) in enumerate(trial.kicks):
        pull, hold = trial.torque(memory, kick), trial.ground(memory, kick)
        slipped = kick.deflection - trial.placed(memory, kick)
        stored = stage.energy(after, own)
        if number == 0:
            first = stored
        else:
            pulled = 0.5 * (pull + pull_before) * (kick.deflection - last.deflection)
            held = 0.5 * (hold + hold_before) * (kick.motor_position - last.motor_position)
            work, turned = work + pulled + held, turned + abs(pulled) + abs(held)
            if stage.has("place"):
                # Add the work of the spring's torque on the part in series.
                spring = 0.5 * (kick.elastic_torque + last.elastic_torque)
                work += spring * (slipped - slipped_before)
                turned += abs(spring * (kick.deflection - last.deflection))
            lost += stage.loss(after, own)
        pull_before, hold_before, slipped_before, last = pull, hold, slipped, kick
    yield abs(work - (stored - first) - lost) / max(turned, 1e-9)


def _gains(trial: StageTrial) -> Iterator[float]:
    for number, (_, after, *_) in enumerate(trial.kicks):
        yield max(-trial.stage.loss(after, trial.own), 0.0) if number else 0.0


def _series(trial: StageTrial) -> Iterator[float]:
    stage, own, near = trial.stage, trial.own, 1e-6
    for memory, _, kick in trial.kicks:
        x = kick.deflection
        slope = (stage.place(memory, own, x + near) - stage.place(memory, own, x - near)) / (2.0 * near)
        yield max(slope - 1.0 - SLACK, -slope - SLACK, 0.0)


def _limits(trial: StageTrial) -> Iterator[float]:
    for memory, *_ in trial.kicks:
        found = trial.stage.limit(memory, trial.own, LARGEST)
        yield max(found - LARGEST, -found, 0.0)


CHECKS: tuple[tuple[str, str, float, Callable[[StageTrial], Iterable[float]]], ...] = (
    ("off by default", "the stage does not act at its defaults, and acts with other values", 0.0, _acts),
    ("finite", "no overflow or division by zero along random motions; `kick.step` of the first kick is 0", 0.0, _finite),
    ("stiffness", "the slope of `torque` over the deflection is at most `stiffness_bound`", 0.0, _stiffness),
    (
        "ground stiffness",
        "the slope of `ground` over the position of the motor is at most `ground_stiffness_bound`",
        0.0,
        _ground_stiffness,
    ),
    ("damping", "the slope of `torque` over the velocity is at most `damping_bound`", 0.0, _damping),
    (
        "ground damping",
        "the slope of `ground` over the velocity of the motor is at most `ground_damping_bound`",
        0.0,
        _ground_damping,
    ),
    ("energy", "work of the torques = change of `energy` + `loss` (relative to the turnover)", 0.01, _balance),
    ("loss", "the stage gains no energy: `loss` is never negative, J", 1e-12, _gains),
    ("series", "`place` does not decrease, and has no slope above 1", 0.0, _series),
    ("limit", "`limit` lies between 0 and the motor's torque limit, N m", 0.0, _limits),
)
"""Checks: name, requirement, largest allowed figure, function that yields the figures of a trial."""
